"""`pliant verify`: check a receipt of an evaluation service, offline."""

from __future__ import annotations

from pathlib import Path

import click

from pliant.cli.challenge import require_service
from pliant.cli.options import json_option, path_option
from pliant.cli.terminal import echo_result

_THERE = click.Path(exists=True, path_type=Path, dir_okay=False)  # exit code 1 is for a forgery


@click.command("verify")
@click.argument("receipt", metavar="RECEIPT.json", type=_THERE)
@path_option("--key", "KEY", "Public key of the challenge (PEM).", kind=_THERE, required=True)
@path_option("--file", "SUB.parquet", "Submission that the receipt must be of.", kind=_THERE)
@json_option
def command(receipt: Path, key: Path, file: Path | None, as_json: bool) -> None:
    """Verify that RECEIPT.json was signed by the challenge and not changed since.

    Exit code 0: genuine; 1: changed, or signed with another key.
    """
    require_service()
    from pliant.service.receipts import check_file, read_public_key, verify_receipt
    from pliant.spec.io.jsonfiles import read_json

    document = read_json(receipt)
    verify_receipt(document, read_public_key(key), receipt)
    if file is not None:
        check_file(document, file)
    text = (
        f"{receipt}: genuine. Submission {document['submission']} of {document['team']}, "
        f"protocol {document['protocol']['name']} {document['protocol']['version']}."
    )
    echo_result({"valid": True, "receipt": document}, text, as_json=as_json)
