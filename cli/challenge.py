"""`pliant challenge`: administration of an evaluation service."""

from __future__ import annotations

import functools
import os
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from pliant.cli.options import FILE, PATH, json_option, out_option, path_option
from pliant.cli.terminal import echo, echo_result, to_call
from pliant.spec.conventions import SPLITS
from pliant.spec.errors import CallError
from pliant.spec.extras import require_packages
from pliant.spec.text import plural

if TYPE_CHECKING:
    from pliant.service.challenge import Challenge

database_option = click.option(
    "--database",
    envvar="PLIANT_DATABASE",
    metavar="URL",
    help="PostgreSQL database, such as postgresql://user@host/name (or PLIANT_DATABASE); "
    "default: a SQLite file in the challenge's folder.",
)
challenge_argument = click.argument("challenge", metavar="CHALLENGE", type=PATH)


def require_service() -> None:
    """Refuse to go on without the extra `service`."""
    require_packages(("alembic", "cryptography", "fastapi"), "The evaluation service", "service")


def open_challenge(challenge: Path, database: str | None) -> Challenge:
    """Open a challenge; refuse to without the extra `service`."""
    require_service()
    from pliant.service.challenge import Challenge

    return Challenge.open(challenge, database)


def _of_challenge(function: Callable[..., None]) -> Callable[..., None]:
    """Add CHALLENGE and --database to a command that receives the open challenge."""

    @challenge_argument
    @database_option
    @functools.wraps(function)
    def opened(challenge: Path, database: str | None, **given: Any) -> None:
        function(open_challenge(challenge, database), **given)

    return opened


@click.group("challenge")
def command() -> None:
    """Run an evaluation service: create a challenge, invite teams, rescore, back up.

    CHALLENGE is one folder. `pliant serve CHALLENGE` serves it.
    """


@command.command("create")
@challenge_argument
@path_option("--data", "PUBLIC", "Public half of a published dataset.", required=True)
@path_option("--private", "PRIVATE", "Private half, with the answers.", required=True)
@click.option(
    "--split",
    "splits",
    multiple=True,
    type=click.Choice(SPLITS),
    help="Split to score (default: test); may be repeated.",
)
@path_option("--config", "FILE", "Rules: challenge.yaml with titles, phases, limits.", kind=FILE)
@database_option
@json_option
def create(
    challenge: Path,
    data: Path,
    private: Path,
    splits: tuple[str, ...],
    config: Path | None,
    database: str | None,
    as_json: bool,
) -> None:
    """Make CHALLENGE from a published dataset; print the host's token.

    Without --config every --split is a phase that is open now: protocol
    standard, 5 attempts a day, 100 in all.
    """
    require_service()
    from pliant.service.creation import create_challenge

    token = create_challenge(challenge, data, private, splits, config, database)
    text = f"{challenge}: created.\nHost's token, shown this once: {token}\n"
    named = _database_named(database)
    invite = to_call("pliant", "challenge", "invite", challenge, *named, "TEAM")
    text += f"Next: {invite}; {to_call('pliant', 'serve', challenge, *named)}"
    echo_result({"challenge": str(challenge), "host_token": token}, text, as_json=as_json)


@command.command("invite")
@_of_challenge
@click.argument("team", metavar="TEAM")
@click.option(
    "--again",
    is_flag=True,
    help="Print one more token for an existing team; earlier ones stay valid.",
)
@json_option
def invite(challenge: Challenge, team: str, again: bool, as_json: bool) -> None:
    """Add TEAM and print its token, of which only a hash is stored."""
    from pliant.service import teams

    with challenge.database.write() as session:
        if again:
            found = teams.team_of(session, team)
            token = teams.new_token(session, found.id, actor="host")
        else:
            found, token = teams.invite(session, team, actor="host")
        name = found.name
    text = f"Token of {name}, shown this once: {token}"
    echo_result({"team": name, "token": token}, text, as_json=as_json)


@command.command("credit")
@_of_challenge
@click.argument("team", metavar="TEAM")
@click.argument("attempts", metavar="N", type=int)
@click.option("--phase", metavar="NAME", help="Phase; default: the first one.")
def credit(challenge: Challenge, team: str, attempts: int, phase: str | None) -> None:
    """Give TEAM N more attempts, today and in all."""
    from pliant.service import ledger
    from pliant.service.audit import log_time
    from pliant.service.teams import team_of

    rules = challenge.settings.phase(phase) if phase else challenge.settings.phases[0]
    with challenge.database.write() as session:
        found = team_of(session, team)
        ledger.credit(session, found.id, rules, attempts, log_time(session), actor="host")
        left = ledger.attempts(session, found.id, rules, log_time(session))
    echo(f"{found.name}, phase {rules.name}: {left.today} today, {left.total} in all.")


@command.command("rescore")
@_of_challenge
@click.option(
    "--protocol", metavar="NAME|FILE", help="Protocol, or a protocol's JSON or YAML file."
)
@path_option("--private", "PRIVATE", "Private half with corrected answers.")
@click.option("--phase", metavar="NAME", help="Phase; default: the first one.")
@click.option("--reason", required=True, metavar="TEXT", help="Reason, shown on the pages.")
def rescore(challenge: Challenge, **given: Any) -> None:
    """Score the stored submissions by another protocol or truth.

    Their earlier scores are kept.
    """
    from pliant.service.rescoring import rescore_challenge

    versions, count = rescore_challenge(challenge, **given)
    names = ", ".join(f"{each.id} ({each.protocol}, truth {each.truth})" for each in versions)
    echo(f"Version {names}: {plural(count, 'submission')} to score.")


@command.command("audit")
@_of_challenge
@json_option
def audit(challenge: Challenge, as_json: bool) -> None:
    """Verify the audit log, and every score against it.

    Exit code 1 if something was changed; the first such entry is named.
    """
    from pliant.service.audit import verify_log

    with challenge.database.read() as session:
        chain = verify_log(session)
    text = f"{plural(chain.entries, 'entry')}, whole; {chain.hash}"
    echo_result({"entries": chain.entries, "hash": chain.hash}, text, as_json=as_json)


@command.command("backup")
@_of_challenge
@out_option("DIR", "Backup folder: new, or an earlier backup, which is brought up to date.")
def backup(challenge: Challenge, out: Path) -> None:
    """Copy everything into DIR while the service runs. DIR contains the answers and the keys."""
    from pliant.service.archive import write_backup

    write_backup(challenge, out)
    echo(f"{out}: backup of {challenge.root}. It contains the answers and the keys.")


@command.command("archive")
@_of_challenge
@out_option("FILE", "Archive, such as challenge.tar; must not exist.", FILE)
@path_option(
    "--passphrase-file",
    "FILE",
    "Include the signing key, encrypted with the passphrase in FILE.",
    kind=FILE,
)
def archive(challenge: Challenge, out: Path, passphrase_file: Path | None) -> None:
    """Write everything into one FILE: data, answers, submissions.

    FILE also contains the scores and a static site. Without --passphrase-file the signing key is
    left out; receipts can still be verified.
    """
    from pliant.service.archive import write_archive

    write_archive(challenge, out, _passphrase(passphrase_file))
    echo(f"{out}: archive of {challenge.root}. It contains the answers.")


@command.command("restore")
@click.argument("source", metavar="FILE|DIR", type=PATH)
@out_option("CHALLENGE", "New challenge folder.")
@path_option(
    "--passphrase-file", "FILE", "File with the passphrase of the archive's signing key.", kind=FILE
)
@database_option
def restore(source: Path, out: Path, passphrase_file: Path | None, database: str | None) -> None:
    """Restore CHALLENGE from an archive or a backup."""
    require_service()
    from pliant.service.archive import restore_challenge

    new_key = restore_challenge(source, out, _passphrase(passphrase_file), database)
    text = f"{out}: restored.\n"
    if new_key:
        text += (
            "Receipts are signed with a new key; an archive's own needs --passphrase-file. "
            f"Earlier receipts are verified with {out}/keys/earlier-*.pem.\n"
        )
    echo(f"{text}Next: {to_call('pliant', 'serve', out, *_database_named(database))}")


@command.command("upgrade")
@challenge_argument
@database_option
def upgrade(challenge: Path, database: str | None) -> None:
    """Upgrade the database for this version of Pliant.

    Make a backup first.
    """
    require_service()
    from pliant.service.challenge import Challenge

    Challenge.open(challenge, database, upgrade=True)
    echo(f"{challenge}: up to date.")


@command.command("work")
@challenge_argument
@database_option
def work(challenge: Path, database: str | None) -> None:
    """Run one worker in the foreground.

    For `pliant serve --workers 0`, or to use more machines.
    """
    require_service()
    from pliant.service.server import work

    work(challenge, database)


def _database_named(database: str | None) -> tuple[str, ...]:
    """Return the option that names a database to the next command; the environment still does."""
    asked = database is not None and database != os.environ.get("PLIANT_DATABASE")
    return ("--database", str(database)) if asked else ()


def _passphrase(path: Path | None) -> bytes | None:
    if path is None:
        return None
    text = path.read_bytes().strip()
    if not text:
        raise CallError("the passphrase is empty", path=path)
    return text
