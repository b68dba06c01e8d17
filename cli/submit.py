"""`pliant submit`: send a file to an evaluation service and wait for its score."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import click

from pliant.cli.options import FILE, json_option
from pliant.cli.terminal import echo, echo_json, progress_bar


@click.command("submit")
@click.argument("submission", metavar="SUB.parquet", type=FILE)
@click.option("--to", "address", required=True, metavar="URL", help="Address of the service.")
@click.option(
    "--token", envvar="PLIANT_TOKEN", required=True, help="Token of the team (or PLIANT_TOKEN)."
)
@click.option("--phase", metavar="NAME", help="Phase; default: the first one that is open.")
@click.option("--check-only", is_flag=True, help="Only check the file: no score, no attempt.")
@click.option("--no-wait", is_flag=True, help="Do not wait for the score.")
@json_option
def command(
    submission: Path, address: str, token: str, no_wait: bool, as_json: bool, **given: Any
) -> int:
    """Send SUB.parquet, show its place in the queue, then its score.

    Needs no extra. Sending the same file again is safe: it is never charged twice. Exit code 0:
    scored; 1: the file has problems, which are listed; 2: not accepted.
    """
    from pliant.service.client import Client

    client = Client(address, token)
    with progress_bar("Sending", "bytes", hidden=as_json) as bar:
        view = client.send(submission, progress=bar, **given)
    if not no_wait:
        view = client.wait(view, lambda text: None if as_json else echo(text, err=True))
    if as_json:
        echo_json(view)
    else:
        print_submission(view, client.page(view))
    return 1 if view["state"] in ("refused", "failed") else 0


def print_submission(view: dict[str, Any], page: str) -> None:
    """Print what became of a submission, and the address of its page."""
    for issue in view["issues"]:
        where = f" [{issue['where']}]" if issue["where"] else ""
        echo(f"{issue['severity'].upper()} {issue['code']}{where}: {issue['message']}", err=True)
    if view["failure"]:
        echo(view["failure"], err=True)
    if view.get("hidden_until") and view["state"] == "scored":  # an earlier service has none
        echo(f"The scores are hidden until {view['hidden_until']}.")
    for score in view["scores"]:
        echo(f"Protocol {score['protocol']}:")
        groups = score["figures"]
        # Of one tier, the whole and the tier are the same figures.
        for group in groups if len(groups) > 2 else ["overall"]:
            figures = ", ".join(
                f"{name} {value:.4g}" for name, value in groups[group].items() if value is not None
            )
            echo(f"  {group}: {figures}")
    echo(f"Submission {view['id']}: {view['state']}. {page}")
