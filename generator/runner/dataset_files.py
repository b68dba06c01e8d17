"""The files of a whole dataset: written when its sequences are there, `dataset.json` last."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from contextlib import suppress
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa

from pliant.generator.config import GenerateConfig
from pliant.generator.objects.tiers import describe_tier
from pliant.generator.seeding import SequenceTask
from pliant.generator.truth.queries import build_queries
from pliant.spec.conventions import CONVENTIONS, SPEC_VERSION, SPLITS
from pliant.spec.io.jsonfiles import read_json, write_json
from pliant.spec.io.parquet import write_table
from pliant.spec.io.staging import staged
from pliant.spec.model import Tier
from pliant.spec.storage.layout import (
    DATASET_JSON,
    QUERIES_DIR,
    SEQUENCE_JSON,
    SEQUENCES_TABLE,
    TRUTH_DIR,
)
from pliant.spec.tables import SEQUENCES
from pliant.spec.text import plural


def write_dataset_files(
    config: GenerateConfig,
    tasks: Sequence[SequenceTask],
    root: Path,
    *,
    stated: Mapping[str, Any] | None = None,
) -> None:
    """Write `sequences.parquet`, the queries, their truth and `dataset.json`.

    `dataset.json` is removed before the first file is replaced and written after the last one: a
    folder that has it is whole.

    Args:
        config: The dataset's config.
        tasks: The finished sequences, in the order of the table.
        root: The dataset's folder.
        stated: Settings to keep as provenance; None keeps the config.

    Raises:
        CallError: The disk is full or cannot be written.
    """
    infos = [read_json(task.folder(root) / SEQUENCE_JSON) for task in tasks]
    tiers = [describe_tier(config, tier) for tier in config.tiers]
    dataset = {"id": config.id, "version": config.version}
    with staged(root / QUERIES_DIR) as queries_dir, staged(root / TRUTH_DIR) as truth_dir:
        build_queries(config, tasks, root, queries_dir, truth_dir)
        (root / DATASET_JSON).unlink(missing_ok=True)
    for name in (QUERIES_DIR, TRUTH_DIR):
        with suppress(OSError):  # it is not empty
            (root / name).rmdir()
    write_table(root / SEQUENCES_TABLE, sequence_rows(infos), "sequences", {"dataset": dataset})
    write_json(root / DATASET_JSON, describe_dataset(config, tiers, infos, stated), "dataset")


def describe_dataset(
    config: GenerateConfig,
    tiers: Sequence[Tier],
    infos: Sequence[Mapping[str, Any]],
    stated: Mapping[str, Any] | None = None,
) -> dict[str, Any]:
    """Return the content of `dataset.json`.

    Args:
        config: The dataset's config.
        tiers: The tiers.
        infos: The `sequence.json` of every sequence.
        stated: Settings to keep as provenance; None keeps the config.
    """
    names = ", ".join(config.tiers)
    kind = "episodes" if config.episodes else "configurations"
    return {
        "spec_version": SPEC_VERSION,
        "id": config.id,
        "version": config.version,
        "title": config.title or f"Pliant: {names}",
        "description": config.description
        or f"{plural(len(infos), 'sequence')} of {plural(config.frames, 'frame')} ({kind}) of "
        f"{names}, rendered in style {config.style} with exact correspondences.",
        "licence": config.licence,
        "conventions": CONVENTIONS,
        "image_size": {"width": config.width, "height": config.height},
        "tiers": [tier.as_document() for tier in tiers],
        "splits": [split for split in SPLITS if any(info["split"] == split for info in infos)],
        "provenance": {
            "generator": f"pliant {version('pliant')}",
            "seed": config.public_seed,
            "config": config.resolved() if stated is None else stated,
            "tools": {key: tool for info in infos for key, tool in info["tools"].items()},
        },
    }


def sequence_rows(infos: Sequence[Mapping[str, Any]]) -> pa.Table:
    """Return the rows of `sequences.parquet` from every sequence's `sequence.json`."""
    rows = [
        {
            **{name: info[name] for name in ("id", "tier", "split", "shape", "frames")},
            **{name: info[name] for name in ("temporal", "seed", "style")},
            "coverage": _mean(info, "coverage"),
            "self_occluded": _mean(info, "self_occluded"),
        }
        for info in infos
    ]
    return pa.Table.from_pylist(rows, schema=SEQUENCES)


def _mean(info: Mapping[str, Any], name: str) -> float | None:
    """Return the mean of a fact over the frames that state it, None where none does."""
    values = [frame[name] for frame in info["frame_info"] if frame.get(name) is not None]
    return float(np.mean(values)) if values else None
