"""What is kept: the log, receipts, versions of scoring, backups, archives, tables."""

from __future__ import annotations

import errno
import json
import os
import re
import shutil
import stat
import tarfile
from importlib import resources
from pathlib import Path
from typing import Any

import pyarrow.parquet as pq
import pytest
from alembic.autogenerate import compare_metadata
from alembic.runtime.migration import MigrationContext
from fastapi.testclient import TestClient
from sqlalchemy import select, text
from sqlalchemy.exc import DBAPIError

from pliant.cli.main import run
from pliant.evaluator import read_protocol
from pliant.evaluator.protocols.protocol import protocol_text
from pliant.service.archive import restore_challenge, write_archive, write_backup
from pliant.service.audit import verify_log
from pliant.service.challenge import Challenge
from pliant.service.creation import create_challenge
from pliant.service.database import Database, sqlite_url
from pliant.service.models import APPEND_ONLY, Base, Score, State, Submission, Version
from pliant.service.queue import lease_next
from pliant.service.receipts import Signer, read_public_key, verify_receipt, write_keys
from pliant.service.rescoring import rescore_challenge
from pliant.service.scoring import Result, Task, score
from pliant.service.settings import Scoring, read_challenge_settings
from pliant.service.site import write_challenge_site
from pliant.service.teams import invite, team_of
from pliant.service.versions import add_missing_versions
from pliant.service.web.app import make_app
from pliant.spec.errors import CallError, PliantError, SpecError
from pliant.spec.io.yamlfiles import yaml_text
from tests.conftest import Refused
from tests.service.conftest import Halves, MakeTrial, Trial, quick


def scored(trial: Trial) -> Trial:
    trial.send(b"good")
    trial.send(b"fine", team=1)
    trial.send(b"bad")
    trial.work()
    return trial


def rows(challenge: Challenge) -> dict[str, list[tuple[object, ...]]]:
    with challenge.database.read() as session:
        return {
            table.name: [
                tuple(map(str, row))
                for row in session.execute(select(table).order_by(*table.primary_key.columns))
            ]
            for table in Base.metadata.sorted_tables
        }


def test_tables_are_those_of_the_models(trial: Trial) -> None:
    with trial.challenge.database.engine.connect() as connection:
        context = MigrationContext.configure(connection)
        assert compare_metadata(context, Base.metadata) == []


def test_a_team_is_found_by_its_name_in_any_case_and_composition(trial: Trial) -> None:
    with trial.challenge.database.write() as session:
        team, _ = invite(session, " \u00c9quipe  \u03a9\n", actor="host")
        assert team.name == "\u00c9quipe \u03a9"
        for same in ("\u00c9quipe \u03a9", "\u00e9QUIPE \u03c9", "E\u0301quipe \u2126"):
            assert team_of(session, same).id == team.id
            with pytest.raises(CallError, match="a team of this name exists"):
                invite(session, same, actor="host")
        for wrong in ("", "\u3000", "x\u200b", "x\u202ey", "x" * 81):
            with pytest.raises(CallError, match="name cannot be used"):
                invite(session, wrong, actor="host")


def test_the_database_refuses_to_change_what_is_written(trial: Trial) -> None:
    scored(trial)
    for table in APPEND_ONLY:
        key = "seq" if table == "audit" else "id"
        for statement in (f"DELETE FROM {table}", f"UPDATE {table} SET {key} = {key} + 100"):
            with (
                pytest.raises(DBAPIError, match="append-only"),
                trial.challenge.database.write() as session,
            ):
                session.execute(text(statement))


@pytest.mark.parametrize(
    ("statement", "message"),
    [
        ("UPDATE audit SET actor = 'somebody' WHERE seq = 3", "entry 3.*changed"),
        ("DELETE FROM audit WHERE seq = 4", "entry 4.*changed"),
        ("UPDATE score SET figures = '{}' WHERE id = 1", "submission 1"),
        ("DELETE FROM score WHERE id = 2", "a logged score is missing"),
    ],
)
def test_changes_outside_the_service_are_found(
    make_trial: MakeTrial, statement: str, message: str
) -> None:
    trial = scored(make_trial())
    root = str(trial.challenge.root)
    assert run(["challenge", "audit", root]) == 0
    with trial.challenge.database.write() as session:
        for table in APPEND_ONLY:
            for event in ("update", "delete"):
                session.execute(text(f"DROP TRIGGER {table}_no_{event}"))
        session.execute(text(statement))
    with trial.challenge.database.read() as session, pytest.raises(SpecError, match=message):
        verify_log(session)
    assert run(["challenge", "audit", root]) == 1


def test_receipts(make_trial: MakeTrial, tmp_path: Path) -> None:
    trial = scored(make_trial())
    receipt = trial.values(select(Score.receipt))[0]
    assert receipt["figures"] == trial.values(select(Score.figures))[0]
    key = read_public_key(trial.challenge.public_key)
    verify_receipt(json.loads(json.dumps(receipt)), key)
    for name in receipt:
        changed = {**receipt, name: "1.0" if name == "receipt_version" else "x"}
        if changed != receipt:
            with pytest.raises(SpecError):
                verify_receipt(changed, key)
    with pytest.raises(SpecError, match="signature"):
        verify_receipt({**receipt, "more": 1}, key)
    write_keys(tmp_path / "other")
    other = read_public_key(tmp_path / "other" / "receipts.public.pem")
    with pytest.raises(SpecError, match="another key"):
        verify_receipt(receipt, other)
    assert Signer.read(trial.challenge.private_key).key_id == receipt["key_id"]
    with pytest.raises(CallError, match="not a public key"):
        read_public_key(trial.challenge.private_key)
    wrongs: list[object] = [None, [], "x", {}, {"signature": 1}]
    for wrong in wrongs:
        with pytest.raises(SpecError, match="not a receipt"):
            verify_receipt(wrong, key)
    file, pem = tmp_path / "receipt.json", str(trial.challenge.public_key)
    file.write_text(json.dumps(receipt))
    assert run(["verify", str(file), "--key", pem]) == 0
    (tmp_path / "good").write_bytes(b"good")
    assert run(["verify", str(file), "--key", pem, "--file", str(tmp_path / "good")]) == 0
    assert run(["verify", str(file), "--key", pem, "--file", pem]) == 1
    assert run(["verify", str(file), "--key", str(file)]) == 2
    assert run(["verify", str(tmp_path / "nothing.json"), "--key", pem]) == 2
    assert run(["verify", str(file), "--key", pem, "--file", str(tmp_path / "nothing")]) == 2


def test_secrets_are_readable_by_their_owner_alone(make_trial: MakeTrial) -> None:
    challenge = make_trial().challenge
    for path in [challenge.private_key, *challenge.private(1).rglob("*")]:
        mode = stat.S_IMODE(path.stat().st_mode)
        assert mode in (0o600, 0o700), path


def corrected(private: Path, tmp_path: Path) -> Path:
    """Return a private half with another truth of the split test."""
    half = Path(shutil.copytree(private, tmp_path / "corrected"))
    path, manifest = half / "truth" / "test.parquet", half / "manifest.json"
    pq.write_table(pq.read_table(path), path, compression="none")
    document = json.loads(manifest.read_text())
    manifest.write_text(json.dumps({**document, "checksums_sha256": "0" * 64}))
    return half


def test_rescoring_adds_scores_and_changes_none(
    make_trial: MakeTrial, service_halves: Halves, tmp_path: Path
) -> None:
    trial = scored(make_trial())
    before = rows(trial.challenge)["score"]
    versions, count = rescore_challenge(trial.challenge, None, "paper", None, "more figures")
    assert (len(versions), count) == (1, 2)
    _, twice = rescore_challenge(trial.challenge, None, "paper", None, "they wait already")
    assert twice == 0
    trial.work()
    after = rows(trial.challenge)["score"]
    assert after[: len(before)] == before
    assert len(after) == 4
    _, again = rescore_challenge(trial.challenge, None, "paper", None, "the same")
    assert again == 0
    _, same_truth = rescore_challenge(trial.challenge, None, None, service_halves.private, "same")
    assert same_truth == 0
    with pytest.raises(CallError, match="nothing would change"):
        rescore_challenge(trial.challenge, None, None, None, "nothing")
    with pytest.raises(CallError, match="the reason is empty"):
        rescore_challenge(trial.challenge, None, None, service_halves.private, " ")
    with pytest.raises(SpecError, match="public half"):
        rescore_challenge(trial.challenge, None, None, service_halves.public, "wrong folder")
    assert os.listdir(trial.challenge.root / "private") == ["1"]
    half = corrected(service_halves.private, tmp_path)
    new, count = rescore_challenge(trial.challenge, None, None, half, "corrected")
    assert ({each.truth for each in new}, len(new), count) == ({2}, 2, 2)
    trial.send(b"later")
    trial.work()
    of_later = select(Version.protocol).join(Score).where(Score.submission_id == 4)
    assert sorted(trial.values(of_later)) == ["paper", "standard"]
    with trial.challenge.database.read() as session:
        verify_log(session)


def test_what_waits_during_a_rescore_gets_the_new_scores_too(make_trial: MakeTrial) -> None:
    trial = make_trial()
    trial.send(b"runs")
    trial.send(b"waits", team=1)

    def rescores(task: Task, limits: Scoring) -> Result:
        if task.file.read_bytes() == b"runs":
            rescore_challenge(trial.challenge, None, "paper", None, "more figures")
        return quick(task, limits)

    trial.work(rescores)
    with trial.challenge.database.read() as session:
        found = session.execute(select(Score.submission_id, Score.version_id)).all()
    assert sorted(map(tuple, found)) == [(1, 1), (1, 2), (2, 1), (2, 2)]


def test_backup_and_archive_give_the_same_service(
    trial: Trial, tmp_path: Path, request: pytest.FixtureRequest
) -> None:
    scored(trial)
    url = None
    write_backup(trial.challenge, tmp_path / "backup")
    trial.send(b"new")
    trial.work()
    write_backup(trial.challenge, tmp_path / "backup")
    write_archive(trial.challenge, tmp_path / "all.tar", b"secret")
    write_archive(trial.challenge, tmp_path / "keyless.tar", None)
    key = trial.challenge.private_key.read_bytes()
    passphrases = {"all.tar": b"secret"}
    # PostgreSQL is restored once: its tables are written and read in the same form.
    for source in ("backup", "all.tar", "keyless.tar") if trial.url is None else ("all.tar",):
        passphrase = passphrases.get(source)
        if trial.url is not None:
            url = request.getfixturevalue("postgres")()
        out = tmp_path / f"restored-{source}"
        restore_challenge(tmp_path / source, out, passphrase, url)
        restored = Challenge.open(out, url)
        expected, found = rows(trial.challenge), rows(restored)
        assert found["audit"][:-1] == expected["audit"]
        for table in ("team", "token", "ledger", "submission", "score", "version", "job"):
            assert found[table] == expected[table], table
        assert (restored.private_key.read_bytes() == key) == (source != "keyless.tar")
        again = Trial(restored, url, trial.host, trial.tokens)
        assert again.send(b"after") == len(expected["submission"]) + 1
        again.work()
        with restored.database.read() as session:
            verify_log(session)
            receipts = session.scalars(select(Score.receipt).order_by(Score.id)).all()
        verify_receipt(receipts[-1], read_public_key(restored.public_key))
        if source == "keyless.tar":
            earlier = next((out / "keys").glob("earlier-*.public.pem"))
            verify_receipt(receipts[0], read_public_key(earlier))
            write_challenge_site(restored, tmp_path / "site")
            assert f'href="{earlier.name}"' in (tmp_path / "site" / "index.html").read_text()
            receipt = str(tmp_path / "site" / "submissions" / "1-1.json")
            for key_name, status in ((earlier.name, 0), ("key.pem", 1)):
                assert (
                    run(["verify", receipt, "--key", str(tmp_path / "site" / key_name)]) == status
                )
            with TestClient(make_app(restored)) as client:
                page = client.get("/rules").text
            assert earlier.read_text().split("\n")[1] in page
        restored.database.engine.dispose()


def test_a_job_in_its_last_try_is_done_after_a_restore(
    make_trial: MakeTrial, tmp_path: Path
) -> None:
    trial = make_trial("scoring: {tries: 1}\n")
    trial.send(b"good")
    limits = trial.challenge.settings.scoring
    assert lease_next(trial.challenge.database, "busy", limits) is not None
    write_backup(trial.challenge, tmp_path / "backup")
    restore_challenge(tmp_path / "backup", tmp_path / "restored", None, None)
    restored = Trial(Challenge.open(tmp_path / "restored"), None, trial.host, trial.tokens)
    restored.work()
    assert restored.values(select(Submission.state)) == [State.SCORED]
    restored.challenge.database.engine.dispose()


def test_protocols_of_a_phase_score_one_kind(
    trial: Trial, tmp_path: Path, service_halves: Halves
) -> None:
    """A phase with both kinds refuses every submission, and no version is ever taken back."""
    with pytest.raises(CallError, match=r"found matches for matches; required: .* for answers"):
        rescore_challenge(trial.challenge, None, "matches", None, "more figures")
    scored(trial)
    config = tmp_path / "both.yaml"
    config.write_text("phases: [{name: a, split: test, protocols: [matches, paper]}]")
    halves = service_halves.public, service_halves.private
    with pytest.raises(CallError, match="found paper for answers"):
        create_challenge(tmp_path / "both", *halves, (), config)
    assert not (tmp_path / "both").exists()


def test_commands_of_the_host(
    make_trial: MakeTrial, tmp_path: Path, refused: Refused, capsys: pytest.CaptureFixture[str]
) -> None:
    root = scored(make_trial()).challenge.root
    paths = [str(tmp_path / name) for name in ("backup", "all.tar", "again", "phrase", "empty")]
    backup, archived, again, phrase, empty = paths
    Path(phrase).write_text("secret\n")
    Path(empty).write_text("\n")
    assert run(["challenge", "credit", str(root), "Ada", "2"]) == 0
    assert "phase test" in capsys.readouterr().out
    assert run(["challenge", "backup", str(root), "--out", backup]) == 0
    assert run(["challenge", "archive", str(root), "--out", archived]) == 0
    secret = ["--passphrase-file", phrase, "--out"]
    assert run(["challenge", "archive", str(root), *secret, f"{archived}2"]) == 0
    assert run(["challenge", "restore", f"{archived}2", *secret, again]) == 0
    key = Path("keys", "receipts.private.pem")
    assert (Path(again) / key).read_bytes() == (root / key).read_bytes()
    assert "new key" not in capsys.readouterr().out
    assert run(["challenge", "restore", f"{archived}2", "--out", f"{again}3"]) == 0
    assert "new key; an archive's own needs --passphrase-file" in capsys.readouterr().out
    assert run(["challenge", "upgrade", again]) == 0
    void = ["--passphrase-file", empty, "--out", f"{again}2"]
    assert "the passphrase is empty" in refused(2, "challenge", "restore", archived, *void)


def test_a_backup_replaces_nothing_but_a_backup_of_the_same_challenge(
    make_trial: MakeTrial, tmp_path: Path, service_halves: Halves
) -> None:
    """A published half has checksums too: a backup in it would publish the answers."""
    first, second = make_trial().challenge, make_trial("title: Other").challenge
    public = shutil.copytree(service_halves.public, tmp_path / "public")
    names = sorted(public.rglob("*"))
    with pytest.raises(CallError, match="the folder is not a backup"):
        write_backup(first, public)
    assert sorted(public.rglob("*")) == names
    write_backup(first, tmp_path / "backup")
    with pytest.raises(CallError, match="the backup of another challenge"):
        write_backup(second, tmp_path / "backup")


def test_a_folder_that_cannot_be_removed_does_not_get_into_a_backup(
    make_trial: MakeTrial, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    challenge, out = make_trial().challenge, tmp_path / "backup"
    write_backup(challenge, out)
    names = sorted(out.rglob("*"))
    monkeypatch.setattr("shutil.rmtree", lambda *_, **__: None)
    write_backup(challenge, out)
    assert sorted(out.rglob("*")) == names


def test_archives_contain_no_open_key_and_are_checked(
    make_trial: MakeTrial, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    trial = scored(make_trial())
    file = tmp_path / "all.tar"
    write_archive(trial.challenge, file, b"secret")
    secret = trial.challenge.private_key.read_bytes().splitlines()[1]
    assert secret not in file.read_bytes()
    assert stat.S_IMODE(file.stat().st_mode) == 0o600
    with tarfile.open(file) as tar:
        names = tar.getnames()
    for name in (".zenodo.json", "site/index.html", "database/audit.parquet", "challenge.yaml"):
        assert name in names
    with pytest.raises(CallError, match="passphrase"):
        restore_challenge(file, tmp_path / "wrong", b"wrong", None)
    assert not (tmp_path / "wrong").exists()
    data = file.read_bytes()
    at = data.index(b"good")  # the content of a submission
    (tmp_path / "changed.tar").write_bytes(data[:at] + b"evil" + data[at + 4 :])
    with pytest.raises(SpecError, match="changed"):
        restore_challenge(tmp_path / "changed.tar", tmp_path / "changed", None, None)
    unlink = os.unlink

    def failing(path: Any, *more: Any, **named: Any) -> None:
        if str(path).endswith("index.html") and not failed:
            failed.append(path)
            raise OSError(errno.EIO, "I/O error")
        unlink(path, *more, **named)

    failed: list[Any] = []
    monkeypatch.setattr(os, "unlink", failing)
    with pytest.raises(CallError, match="I/O error"):  # the pages of the archive would stay
        restore_challenge(file, tmp_path / "half", b"secret", None)
    assert not (tmp_path / "half").exists()


def test_restore_names_what_is_no_archive(
    tmp_path: Path, service_halves: Halves, refused: Refused
) -> None:
    other, text, absent = (tmp_path / name for name in ("other.tar", "a.txt", "absent"))
    text.write_text("{}")
    with tarfile.open(other, "w") as tar:
        tar.add(text, "a.txt")
    out = tmp_path / "challenge"
    neither = "not a backup or an archive of a challenge; found no challenge"
    for code, source, message in (
        (2, service_halves.public, neither),
        (2, other, neither),
        (2, absent, "found nothing there"),
        (1, text, "cannot be read; found file could not be opened successfully\n"),
    ):
        said = refused(code, "challenge", "restore", source, "--out", out)
        assert f"{source}: " in said
        assert message in said
        assert not out.exists()


def test_a_site_without_scores_refers_to_no_column(make_trial: MakeTrial, tmp_path: Path) -> None:
    write_challenge_site(make_trial().challenge, tmp_path / "site")
    page = (tmp_path / "site" / "index.html").read_text()
    assert "No submission is scored yet" in page
    assert "the last column" not in page


def test_the_site_needs_no_service(make_trial: MakeTrial, tmp_path: Path) -> None:
    trial = scored(make_trial())
    pages = write_challenge_site(trial.challenge, tmp_path / "site")
    assert pages == ["index.html"]
    page = (tmp_path / "site" / "index.html").read_text()
    assert "Ada" in page
    assert 'href="/' not in page
    linked = re.findall(r'href="(submissions/.*?|key\.pem)"', page)
    assert sorted(linked) == ["key.pem", "submissions/1-1.json", "submissions/2-1.json"]
    receipt, _, key = (str(tmp_path / "site" / each) for each in linked)
    assert run(["verify", receipt, "--key", key]) == 0
    assert len(os.listdir(tmp_path / "site" / "submissions")) == 2  # the third was refused
    rescore_challenge(trial.challenge, None, "paper", None, "more figures")
    for _ in range(2):  # an earlier site is replaced, and nothing else
        assert len(write_challenge_site(trial.challenge, tmp_path / "site")) == 2
    for page, protocol in (("index", "standard"), ("version-2", "paper")):  # tabs of a browser
        text = (tmp_path / "site" / f"{page}.html").read_text()
        assert f"<title>Leaderboard: test, {protocol} " in text
    (tmp_path / "site" / "mine.txt").touch()
    for place in (tmp_path / "site", trial.challenge.root):
        before = sorted(os.listdir(place))
        with pytest.raises(CallError, match="something other than a site; found "):
            write_challenge_site(trial.challenge, place)
        assert sorted(os.listdir(place)) == before


@pytest.mark.parametrize(
    ("yaml", "message"),
    [
        ("phases: []", "phases"),
        ("colour: red", "colour"),
        ("phases: [{name: a, split: nowhere}]", "phases.0.split.*nowhere.*one of train"),
        ("phases: [{name: a, split: test}, {name: a, split: val}]", "different names"),
        ("phases: [{name: a, split: test, opens: '2027-01-01T00:00:00'}]", "a time with its zone"),
        ("phases: [{name: a, split: test, opens: 2027-01-01}]", "required: a time, such as"),
        ("phases: [{name: a, split: test, opens: 0001-01-01T00:00:00+02:00}]", "the years 1 to"),
        ("max_file_mb: -1", "above 0 to 16384 MB"),
        ("phases: [{name: A b, split: test}]", "name.*small letters"),
        ("phases: [{name: a, split: test, shwo: last}]", "Did you mean .show"),
        ("phases: [{name: a, split: test, protocols: [auc, auc]}]", "different protocols"),
    ],
)
def test_settings_name_what_is_wrong(tmp_path: Path, yaml: str, message: str) -> None:
    path = tmp_path / "challenge.yaml"
    path.write_text(yaml)
    with pytest.raises(CallError, match=message):
        read_challenge_settings(path, ())


def test_what_create_and_open_refuse(
    tmp_path: Path, service_halves: Halves, tiny_dataset: Path
) -> None:
    halves = service_halves
    with pytest.raises(CallError, match="not a challenge"):
        Challenge.open(tmp_path)
    truth, absent = halves.private / "truth" / "test.parquet", tmp_path / "no"
    for data, private, message in (
        (halves.public, halves.public, f"{halves.public}.*is the public half"),
        (halves.public, truth, "a challenge needs the private half"),
        (tiny_dataset, halves.private, "contains the answers of split test"),
        (absent, halves.private, str(absent)),
        (halves.public, absent, str(absent)),
    ):
        with pytest.raises(PliantError, match=message):
            create_challenge(tmp_path / "a", data, private, ["test"])
    config = tmp_path / "c.yaml"
    for protocol, message in (
        ("tapvid-first", r"tapvid-first scores points .*; found no image pair"),
        ("none", "c.yaml, phase a, protocols: no such protocol; found 'none'"),
    ):
        config.write_text(f"phases: [{{name: a, split: test, protocols: [standard, {protocol}]}}]")
        with pytest.raises(CallError, match=message):
            create_challenge(tmp_path / "a", halves.public, halves.private, [], config)
    with pytest.raises(CallError, match="phases name their splits already"):
        create_challenge(tmp_path / "a", halves.public, halves.private, ["val"], config)
    without = f"^{halves.private}/truth/train.parquet: the true answers of split train are missing"
    with pytest.raises(SpecError, match=without):
        create_challenge(tmp_path / "a", halves.public, halves.private, ["train"])
    assert not (tmp_path / "a").exists()
    create_challenge(tmp_path / "a", halves.public, halves.private, ["test"])
    with pytest.raises(CallError, match="exists already"):
        create_challenge(tmp_path / "a", halves.public, halves.private, ["test"])
    assert not [name for name in os.listdir(tmp_path) if name.startswith(".")]
    (tmp_path / "a" / "challenge.sqlite").unlink()
    for upgrade in (False, True):
        with pytest.raises(CallError, match="database is missing"):
            Challenge.open(tmp_path / "a", upgrade=upgrade)
    (tmp_path / "a" / "challenge.sqlite").touch()
    for upgrade in (False, True):
        with pytest.raises(CallError, match="not the database of a challenge"):
            Challenge.open(tmp_path / "a", upgrade=upgrade)


def test_a_protocol_file_is_beside_the_rules_and_goes_into_the_challenge(
    service_halves: Halves, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    rules, elsewhere = tmp_path / "rules", tmp_path / "elsewhere"
    rules.mkdir()
    elsewhere.mkdir()
    built_in = resources.files("pliant.evaluator") / "protocols" / "paper.json"
    (rules / "mine.json").write_bytes(built_in.read_bytes() + b"\n")
    config = rules / "c.yaml"
    config.write_text("phases: [{name: a, split: test, protocols: [mine.json]}]")
    monkeypatch.chdir(elsewhere)
    root = tmp_path / "challenge"
    create_challenge(root, service_halves.public, service_halves.private, [], config)
    shutil.rmtree(rules)
    challenge = Challenge.open(root)
    with challenge.database.write() as session:
        add_missing_versions(session, challenge)  # as at the start of the service
        version = session.scalars(select(Version)).one()
    assert challenge.settings.phases[0].protocols == (f"protocols/{version.protocol_sha256}.json",)


def test_figures_of_a_protocol_file_are_those_of_the_command_line(
    service_halves: Halves, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    document = read_protocol("standard").document
    document |= {"name": "mine", "headline": ["pck_2.5px", "rmse_px", "median_px"]}
    document["metrics"]["pck"]["thresholds_px"] = [2.5]
    given = tmp_path / "mine.yaml"
    given.write_text(yaml_text(document))
    config = tmp_path / "c.yaml"
    config.write_text("phases: [{name: a, split: test, protocols: [mine.yaml, paper]}]")
    halves = service_halves
    create_challenge(tmp_path / "challenge", halves.public, halves.private, [], config)
    challenge = Challenge.open(tmp_path / "challenge")
    with challenge.database.write() as session:
        token = invite(session, "Ada", actor="host")[1]
    trial = Trial(challenge, None, "", (token,))
    file = halves.submissions[0]
    number = trial.send(file.read_bytes())
    trial.work(lambda task, limits: score(task))
    with TestClient(make_app(challenge)) as client:
        view = client.get(f"/api/v1/submissions/{number}").json()
        assert client.get("/api/v1/leaderboard").json()["protocol"] == "mine 1.3"  # the first one
    stored = challenge.root / challenge.settings.phases[0].protocols[0]
    capsys.readouterr()
    for protocol in (given, stored):
        data = ["--data", str(halves.public), "--truth", str(halves.private), "--hide-truth"]
        assert run(["evaluate", str(file), *data, "--protocol", str(protocol), "--json"]) == 0
        found = json.loads(capsys.readouterr().out)
        assert found["protocol_sha256"] == view["scores"][0]["protocol_sha256"]
        assert found["tiers"] | {"overall": found["overall"]} == view["scores"][0]["figures"]
    assert list(view["scores"][0]["figures"]["overall"]) == document["headline"]
    challenge.database.engine.dispose()


def test_a_challenge_with_a_database_of_its_own_takes_no_other(
    make_trial: MakeTrial, monkeypatch: pytest.MonkeyPatch, refused: Refused
) -> None:
    """Else PLIANT_DATABASE of one challenge would be read, and saved, as that of another."""
    root = make_trial().challenge.root
    monkeypatch.setenv("PLIANT_DATABASE", "postgresql://nobody@/none")
    for call in (("audit", root), ("invite", root, "Team"), ("backup", root, "--out", root / "b")):
        said = refused(2, "challenge", *call)
        assert "the challenge has its own" in said
        assert "unset PLIANT_DATABASE" in said
    monkeypatch.setenv("PLIANT_DATABASE", sqlite_url(root / "challenge.sqlite"))
    assert run(["challenge", "audit", str(root)]) == 0


@pytest.mark.parametrize(
    "url", ["mysql://x/y", "postgresql+asyncpg://x@/y", "postgresql://x@localhost:port/y", "y"]
)
def test_addresses_that_are_no_database_are_refused(
    url: str, make_trial: MakeTrial, refused: Refused
) -> None:
    root = make_trial().challenge.root
    (root / "challenge.sqlite").unlink()
    said = refused(2, "challenge", "audit", root, "--database", url)
    assert "the database's URL cannot be used" in said


def test_a_sqlite_file_that_cannot_be_opened_is_no_server_to_start(tmp_path: Path) -> None:
    with pytest.raises(CallError, match=r"unable to open .*space, and check who may write"):
        Database(sqlite_url(tmp_path / "none" / "challenge.sqlite")).check()


def test_the_database_of_a_newer_version_is_not_upgraded(
    make_trial: MakeTrial, refused: Refused
) -> None:
    trial = make_trial()
    with trial.challenge.database.engine.begin() as connection:
        connection.exec_driver_sql("UPDATE alembic_version SET version_num = '9999'")
    for command in ("audit", "upgrade"):
        said = refused(2, "challenge", command, trial.challenge.root)
        assert "of a newer version of Pliant; found revision 9999" in said


def test_a_protocol_that_is_added_scores_what_was_scored_before(make_trial: MakeTrial) -> None:
    trial = scored(make_trial()).with_rules("- standard", "- paper\n  - standard")
    assert [each[1] for each in rows(trial.challenge)["version"]] == ["test", "test"]
    trial.work()
    with TestClient(make_app(trial.challenge)) as client:
        page = client.get("/").text
        assert "protocol <strong>paper</strong>" in page
        assert "2 teams" in page
        assert "<td>standard, paper</td>" in client.get("/rules").text
        # The form keeps the protocol, and leaves it with the phase.
        assert 'name="version" value="2"' in page
        assert "protocol <strong>standard</strong>" in client.get("/?version=1&phase=test").text


def test_a_protocol_file_that_is_changed_scores_again_and_stays_the_first(
    make_trial: MakeTrial, tmp_path: Path
) -> None:
    """Its name in the rules is a path: the leaderboard still opens with it."""
    document = json.loads(protocol_text("standard")) | {"name": "mine"}
    (tmp_path / "mine.json").write_text(json.dumps(document))
    rules = "phases: [{name: test, split: test, protocols: [mine.json, standard]}]"
    trial = scored(make_trial(rules))

    def shown(challenge: Challenge) -> str:
        with TestClient(make_app(challenge)) as client:
            return str(client.get("/api/v1/leaderboard").json()["protocol"])

    assert shown(trial.challenge) == f"mine {document['version']}"
    (trial.challenge.root / "mine.json").write_text(json.dumps(document | {"version": "9.9"}))
    trial = trial.with_rules(trial.challenge.settings.phases[0].protocols[0], "mine.json")
    trial.work()
    assert shown(trial.challenge) == "mine 9.9"
    assert len(rows(trial.challenge)["version"]) == 3
    assert len(rows(trial.challenge)["score"]) == 6


def test_a_phase_that_is_added_is_scored_by_the_corrected_answers(
    make_trial: MakeTrial, service_halves: Halves, tmp_path: Path
) -> None:
    trial = make_trial("phases:\n- {name: test, split: test}\n- {name: open, split: val}\n")
    corrected_half = corrected(service_halves.private, tmp_path)
    rescore_challenge(trial.challenge, "test", None, corrected_half, "corrected")
    trial = trial.with_rules("max_file", "- {name: final, split: test}\nmax_file")
    found = [(each[1], each[5]) for each in rows(trial.challenge)["version"]]
    assert found == [("test", "1"), ("open", "1"), ("test", "2"), ("final", "2")]


def test_phases_with_submissions_keep_their_names(make_trial: MakeTrial) -> None:
    trial = make_trial()
    path = trial.challenge.root / "challenge.yaml"
    rules = path.read_text()
    renamed = rules.replace("name: test", "name: final")
    path.write_text(renamed)
    Challenge.open(trial.challenge.root).database.engine.dispose()
    path.write_text(rules)
    trial.send(b"file")
    path.write_text(renamed)
    with pytest.raises(CallError, match=r"submissions is missing: test.*closes"):
        Challenge.open(trial.challenge.root)


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("- standard", "- standart", "no such protocol; found 'standart'"),
        ("split: test", "split: val", "phase test: the truth of a phase is not the one"),
    ],
)
def test_a_phase_that_cannot_be_scored_is_refused_before_serving(
    old: str, new: str, message: str, make_trial: MakeTrial, capsys: pytest.CaptureFixture[str]
) -> None:
    root = make_trial().challenge.root
    path = root / "challenge.yaml"
    path.write_text(path.read_text().replace(old, new))
    assert run(["serve", str(root)]) == 2
    assert message in capsys.readouterr().err


def test_an_address_with_a_path_is_refused(make_trial: MakeTrial) -> None:
    """No link of the pages would lead to it."""
    challenge = make_trial().challenge
    assert make_app(challenge, "https://example.org/")
    with pytest.raises(CallError, match="host name of its own"):
        make_app(challenge, "https://example.org/ropes")


@pytest.mark.parametrize("kind", ["sqlite", "postgresql"])
def test_a_challenge_that_another_process_made_first(
    kind: str, service_halves: Halves, tmp_path: Path, request: Any, monkeypatch: Any
) -> None:
    """The second `create` is refused, and its database stays empty."""
    url = request.getfixturevalue("postgres")() if kind == "postgresql" else None

    def create(name: str) -> None:
        halves = service_halves
        create_challenge(tmp_path / name, halves.public, halves.private, ["test"], None, url)

    def too_late(folder: Path) -> None:
        write_keys(folder)
        (tmp_path / "lost").mkdir()
        (tmp_path / "lost" / "challenge.yaml").touch()

    with monkeypatch.context() as patched:
        patched.setattr("pliant.service.creation.write_keys", too_late)
        with pytest.raises(CallError, match="exists already"):
            create("lost")
    assert os.listdir(tmp_path) == ["lost"]
    create("other")
    if url is not None:
        with pytest.raises(CallError, match="the database is not empty"):
            create("third")
    challenge = Challenge.open(tmp_path / "other", url)
    with challenge.database.read() as session:
        assert verify_log(session).entries > 0
    challenge.database.engine.dispose()
