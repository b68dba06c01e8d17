"""Accompanying documents of a publication: licence, citation and Zenodo record."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from typing import Any

import yaml


def licence_url(licence: str) -> str | None:
    """Return where the text of a licence stands, None for one that SPDX does not list.

    Args:
        licence: SPDX identifier; `LicenseRef-` begins those of licences off its list.
    """
    if licence.startswith("LicenseRef-"):
        return None
    return f"https://spdx.org/licenses/{licence}.html"


def web_page(url: str | None) -> str | None:
    """Return the address that a browser opens, None where there is none.

    Args:
        url: Where a dataset is hosted: `https://…`, or what fsspec opens, such as
            `hf://datasets/ada/ropes`, whose page is on huggingface.co.
    """
    page = re.sub("^hf://", "https://huggingface.co/", url or "")
    return page if page.startswith(("https://", "http://")) else None


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
    document = {
        "cff-version": "1.2.0",
        "message": "If you use this dataset, please cite it as below.",
        "type": "dataset",
        "title": info["title"],
        "version": info["version"],
        "abstract": info["description"],
        "authors": [{"name": author} for author in authors],
        "license": info["licence"] if licence_url(info["licence"]) else None,
        "url": web_page(url),
        "date-released": date,
    }
    given = {name: value for name, value in document.items() if value is not None}
    return yaml.safe_dump(given, sort_keys=False, allow_unicode=True, width=100)


def keywords(info: Mapping[str, Any]) -> list[str]:
    """Return the keywords of a dataset, with the kinds of its objects.

    Args:
        info: The dataset's `dataset.json`.
    """
    kinds = sorted({tier["kind"] for tier in info["tiers"]})
    return ["dense correspondence", "deformable objects", *kinds]


def zenodo(
    info: Mapping[str, Any], authors: Sequence[str], url: str | None, date: str | None
) -> dict[str, Any]:
    """Return `.zenodo.json`: the metadata that Zenodo takes for a deposit.

    Args:
        info: The dataset's `dataset.json`.
        authors: Who publishes it.
        url: Where it is hosted, or None.
        date: Day of its release, YYYY-MM-DD, or None.
    """
    document: dict[str, Any] = {
        "upload_type": "dataset",
        "title": info["title"],
        "version": info["version"],
        "description": info["description"] or info["title"],
        "creators": [{"name": author} for author in authors],
        "access_right": "open",
        "keywords": keywords(info),
    }
    if licence_url(info["licence"]) is not None:
        document["license"] = str(info["licence"]).lower()
    if date is not None:
        document["publication_date"] = date
    if (page := web_page(url)) is not None:
        document["related_identifiers"] = [
            {"identifier": page, "relation": "isIdenticalTo", "resource_type": "dataset"}
        ]
    return document
