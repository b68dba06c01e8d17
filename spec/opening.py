"""Checks when a dataset is opened: folder, version, names, tiers, and truth."""

from __future__ import annotations

import os
import re
from collections.abc import Mapping
from pathlib import Path
from typing import Any, Final

import pyarrow as pa
import pyarrow.compute as pc

from pliant.spec.conventions import NAME, SPEC_VERSION
from pliant.spec.errors import CallError, SpecError
from pliant.spec.io.parquet import read_footer
from pliant.spec.io.reading import AnyFile, FileRefusedError
from pliant.spec.model import Tier

SAMPLE_NAME: Final = "sample"
SAMPLE: Final = Path(__file__).parent / "sample"
"""The small dataset of the package: 12 ropes in two frames each, packed."""


def sample_or(root: Path | str) -> Path | str:
    """Return the small dataset of the package for `sample`, if no such folder exists."""
    return SAMPLE if str(root) == SAMPLE_NAME and not Path(root).exists() else root


def require_dataset_folder(root: Path | str) -> None:
    """Refuse what is not a folder of this machine.

    Raises:
        CallError: It is not.
    """
    if not os.path.isdir(root):  # unlike Path.is_dir, False of a name that is too long
        raise CallError("folder not found", path=root, fix="Name a dataset's folder.")


def is_name(text: str) -> bool:
    """Return whether a text may name a tier or a sequence (and so a folder)."""
    return re.fullmatch(NAME, text) is not None


def check_names(listing: pa.Table, tiers: Mapping[str, Tier], path: AnyFile) -> None:
    """Refuse names that cannot be those of folders, and tiers that are not described."""
    names = {column: listing[column].unique().to_pylist() for column in ("id", "tier")}
    if not all(map(is_name, (*names["id"], *names["tier"]))):
        named = zip(listing["id"].to_pylist(), listing["tier"].to_pylist(), strict=True)
        name, tier = next(each for each in named if not all(map(is_name, each)))
        raise SpecError(
            "invalid name of a sequence or tier",
            path=path,
            where="id, tier",
            found=f"{name!r:.80}, {tier!r:.80}",
        )
    for tier in names["tier"]:
        if tier not in tiers:
            first = pc.index(listing["tier"], tier).as_py()
            raise SpecError(
                "a sequence names a tier that dataset.json does not describe",
                path=path,
                where=f"sequence {listing['id'][first].as_py()}, tier",
                found=f"{tier!r:.80}",
                required="one of " + ", ".join(tiers),
            )


def check_version(version: object, path: AnyFile) -> None:
    """Refuse a file of another major version.

    Args:
        version: The file's `spec_version`.
        path: The file, for the message.

    Raises:
        FileRefusedError: The version is not one this code can read.
    """
    match = re.fullmatch(r"(\d{1,6})\.(\d{1,6})\.(\d{1,6})", str(version))
    if match is None or match[1] != SPEC_VERSION.split(".")[0]:
        raise FileRefusedError(
            "SPEC_VERSION_UNSUPPORTED",
            "this specification version cannot be read here",
            path=path,
            where="spec_version",
            found=str(version)[:40],
            required=f"{SPEC_VERSION.split('.')[0]}.x",
            fix="Install a version of Pliant that reads it.",
        )


def check_truth(truth: Path, dataset_id: str, dataset_version: str, split: str, sha: str) -> None:
    """Check by its footer that a truth file belongs to a dataset's split.

    Args:
        truth: The file.
        dataset_id: The dataset's id.
        dataset_version: Its version.
        split: The split.
        sha: sha256 of the split's queries file.

    Raises:
        SpecError: It belongs to something else, or is not a truth.
    """
    if not truth.is_file():
        raise SpecError(
            f"the truth of split {split} was not found",
            path=truth,
            fix="Give its file, its folder or the private half of the dataset with --truth. Where "
            "its publisher withholds it, `pliant check` finds the problems of a submission.",
        )
    found = read_footer(truth)
    required = {
        "table": "truth",
        "dataset": {"id": dataset_id, "version": dataset_version},
        "split": split,
        "queries_sha256": sha,
    }
    for field, value in required.items():
        if found.get(field) != value:
            raise foreign_truth(truth, f"{field} {found.get(field)!r:.120}", f"{field} {value!r}")


def foreign_truth(truth: Path, found: str, required: str) -> SpecError:
    """Return the error of a truth that belongs to other queries."""
    return SpecError(
        "the truth does not belong to these queries",
        path=truth,
        found=found,
        required=required,
        fix="Give the truth file of this dataset's split.",
    )


def tiers_of(info: Mapping[str, Any], path: AnyFile) -> dict[str, Tier]:
    """Return the tiers that `dataset.json` describes, by name.

    Raises:
        SpecError: The queried object is not one of a tier's objects.
    """
    tiers = {}
    for index, document in enumerate(info["tiers"]):
        tier = Tier.from_document(document)
        if tier.queried_object not in {each.id for each in tier.objects}:
            raise SpecError(
                "the queried object is not one of the tier's objects",
                path=path,
                where=f"tiers[{index}], queried_object",
                found=tier.queried_object,
                required=f"one of {[each.id for each in tier.objects]}",
            )
        tiers[tier.name] = tier
    return tiers
