"""The provenance of scores, written for people."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any


def facts(document: Mapping[str, Any]) -> list[tuple[str, str]]:
    """Return the provenance of scores as (name, text) for people."""
    dataset, submission = document["dataset"], document["submission"]
    counts = document["counts"]
    rows = [
        ("Protocol", f"{document['protocol']} {document['protocol_version']}"),
        ("Protocol sha256", document["protocol_sha256"]),
        ("Dataset", f"{dataset['id']} {dataset['version']}, split {document['split']}"),
        ("Queries sha256", dataset["queries_sha256"]),
        ("Truth sha256", dataset["truth_sha256"] or "not used"),
        ("Submission", f"{submission['file']} ({submission['rows']:,} rows)"),
        ("Submission sha256", submission["sha256"]),
        ("Counted", f"{counts['counted']:,} in {counts['pairs']:,} pairs"),
    ]
    rows += [
        (f"Method: {key}", str(value))
        for key, value in submission["method"].items()
        if key != "name"
    ]
    tools = ", ".join(f"{name} {version}" for name, version in document["tools"].items())
    return [*rows, ("Computed with", tools)]
