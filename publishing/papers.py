"""The papers of a publication: licence, citation, and what the private half says of itself."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import yaml

_WHERE = "https://spdx.org/licenses/{}.html"


def licence_url(licence: str) -> str:
    """Return where the text of a licence stands, by its SPDX identifier."""
    return _WHERE.format(licence)


def licence_text(info: Mapping[str, Any], authors: Sequence[str]) -> str:
    """Return the `LICENSE` of a dataset that brings none of its own.

    Args:
        info: Its `dataset.json`.
        authors: Who publishes it.
    """
    return (
        f"{info['title']} ({info['id']} {info['version']})\n"
        f"Copyright of the data: {', '.join(authors)}\n\n"
        f"SPDX-License-Identifier: {info['licence']}\n\n"
        f"The data of this dataset is licensed under {info['licence']}. The text of the licence:\n"
        f"{licence_url(info['licence'])}\n"
    )


def citation(
    info: Mapping[str, Any], authors: Sequence[str], url: str | None, date: str | None
) -> str:
    """Return `CITATION.cff` (Citation File Format 1.2.0).

    Args:
        info: The dataset's `dataset.json`.
        authors: Who publishes it.
        url: Where it is hosted, or None.
        date: Day of its release, YYYY-MM-DD, or None.
    """
    document: dict[str, Any] = {
        "cff-version": "1.2.0",
        "message": "If you use this dataset, please cite it as below.",
        "type": "dataset",
        "title": info["title"],
        "version": info["version"],
        "abstract": info["description"],
        "authors": [{"name": author} for author in authors],
        "license": info["licence"],
    }
    if url is not None:
        document["url"] = url
    if date is not None:
        document["date-released"] = date
    return yaml.safe_dump(document, sort_keys=False, allow_unicode=True, width=100)


def private_readme(
    info: Mapping[str, Any], hold_out: Sequence[str], warnings: Sequence[str]
) -> str:
    """Return the private half's `README.md`.

    Args:
        info: The dataset's own `dataset.json`.
        hold_out: The splits held out.
        warnings: What the publisher should know.
    """
    name = f"{info['id']} {info['version']}"
    notes = "".join(f"- {text}\n" for text in warnings)
    return (
        f"# Private half of {name}\n\n"
        f"The answers of the split {', '.join(hold_out)}: truth, depth and surface images, points, "
        "correspondences and cameras. **Keep this folder to yourself**: whoever has it has the "
        "answers.\n\n"
        "To score a submission exactly as on the whole dataset:\n\n"
        "    pliant evaluate SUB.parquet --data PUBLIC --truth THIS_FOLDER --out REPORT\n\n"
        "`sha256sum -c SHA256SUMS` says whether it is whole; `manifest.json` names the public half "
        "it belongs to.\n" + (f"\n## Beware\n\n{notes}" if notes else "")
    )
