"""Writes imported data as a dataset: images and queries, and the answers next to it.

The specification lets a split stand without depth, cameras, points and correspondences: that is
what a held-out split looks like. Data whose geometry nobody knows is written in that form, so
every reader and the validator take it, and nothing is invented. The truth is a file of its own.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from importlib.metadata import version
from pathlib import Path
from typing import Any, Final

import numpy as np
import pyarrow as pa

from pliant.converters.alike import Alike, alike
from pliant.converters.clip import Clip, resized
from pliant.converters.import_settings import ImportSettings, check_call, check_names, common_size
from pliant.converters.queries import make_queries
from pliant.spec.arrays import Mask
from pliant.spec.ball import separate_ball
from pliant.spec.conventions import CONVENTIONS, SPEC_VERSION
from pliant.spec.errors import SpecError
from pliant.spec.io.exr import write_camera_depth
from pliant.spec.io.jsonfiles import write_json
from pliant.spec.io.parquet import write_table
from pliant.spec.io.png import write_mask, write_rgb
from pliant.spec.io.reading import file_entry, sha256_file
from pliant.spec.io.staging import next_to, staged_both
from pliant.spec.model import MaterialCoordinate, MaterialObject, Tier
from pliant.spec.progress import Progress
from pliant.spec.storage import layout
from pliant.spec.tables import SEQUENCES

OBJECT: Final = 1
"""Value in a mask of the object that the points are on."""

ATTACHED: Final = 2
"""Value in a mask of what is attached to it and is not asked about, such as a rope's ball."""

UNKNOWN: Final = ("cameras", "surface", "material coordinates", "scale", "symmetries")
"""What imported data does not say; it is in the dataset's provenance."""


@dataclass(frozen=True)
class Imported:
    """What was written.

    Attributes:
        dataset: The dataset's folder.
        truth: The file of the answers.
        sequences, frames, pairs, queries: How many.
        balls: Frames from whose mask a ball was separated.
        off_mask: Visible points that are off their frame's mask.
        on_mask: Visible points that are on it.
    """

    dataset: Path
    truth: Path
    sequences: int
    frames: int
    pairs: int
    queries: int
    balls: int
    off_mask: int
    on_mask: int


def write_imported(
    clips: Sequence[Clip],
    out: Path,
    settings: ImportSettings,
    source: Mapping[str, Any],
    *,
    progress: Progress | None = None,
) -> Imported:
    """Write clips as a dataset in `out`, and their truth as `out-truth/SPLIT.parquet`.

    Args:
        clips: What was read.
        out: The dataset's folder; must not be there yet.
        settings: How.
        source: JSON-able facts of where the data comes from, for the provenance.
        progress: Called after every frame.

    Raises:
        CallError: A folder is there already, or the settings do not fit the data.
        SpecError: A frame cannot be read, or nothing can be asked.
    """
    beside = next_to(out, "-truth")
    check_call(out, beside, settings)
    check_names(clips, source)
    same = alike(settings.alike)
    size = common_size(clips, settings)
    clips = [resized(clip, size) for clip in clips]
    ids = [f"{settings.id}-{settings.split}-{index:06d}" for index in range(len(clips))]
    queries, truth = make_queries(
        clips, ids, settings.id, settings.queries, settings.pairs, alike=same
    )
    if not len(queries):
        raise SpecError(
            "no query can be made: no point is visible in one frame and known in another",
            path=source.get("source"),
            required="a point that is visible in one frame and has a position in another",
            fix="Mark the same points, under the same names, in several pictures.",
        )
    with staged_both(out, beside) as (root, answers):
        done, total, balls = 0, sum(clip.frames for clip in clips), 0
        on_mask: list[bool] = []
        documents = []
        for index, (clip, name) in enumerate(zip(clips, ids, strict=True)):
            folder = root / layout.sequence_name(settings.id, name)
            files = []
            for frame in range(clip.frames):
                names, mask, ball = _write_frame(clip, frame, folder, settings.kind)
                files += names
                done, balls = done + 1, balls + ball
                if mask is not None:
                    uv_px = clip.uv_px[clip.visible[:, frame], frame].astype(np.int64)
                    on_mask += [bool(_around(mask, u, v).any()) for u, v in uv_px]
                if progress is not None:
                    progress(done, total)
            documents.append(_sequence(clip, name, index, settings, folder, files))
            write_json(folder / layout.SEQUENCE_JSON, documents[-1], "sequence")
        _write_tables(root, answers, settings, documents, queries, truth)
        sources = dict(zip(ids, (clip.name for clip in clips), strict=True))
        config = {
            **source,
            "queries": settings.queries,
            "sources": sources,
            "unknown": _unknown(clips, same),
        }
        document = _dataset(settings, size, config, balls > 0, same)
        write_json(root / layout.DATASET_JSON, document, "dataset")
    pairs = int(queries["pair_id"][-1].as_py()) + 1
    answers = beside / f"{settings.split}.parquet"
    on, off = on_mask.count(True), on_mask.count(False)
    return Imported(out, answers, len(clips), total, pairs, len(queries), balls, off, on)


def _unknown(clips: Sequence[Clip], same: Sequence[Alike]) -> list[str]:
    """Return what the clips do not say, in words."""
    unknown = [each for each in UNKNOWN if each != "symmetries" or not same]
    measured = all(clip.read_depth is not None for clip in clips)
    return unknown if measured else [*unknown, "depth"]


def _write_tables(
    root: Path,
    truth_root: Path,
    settings: ImportSettings,
    documents: Sequence[Mapping[str, Any]],
    queries: pa.Table,
    truth: pa.Table,
) -> None:
    """Write the three tables; that of the truth in the folder `truth_root`."""
    identity = {"dataset": {"id": settings.id, "version": settings.version}}
    rows = [{**document, "coverage": None, "self_occluded": 0.0} for document in documents]
    table = pa.Table.from_pylist(rows, schema=SEQUENCES)
    write_table(root / layout.SEQUENCES_TABLE, table, "sequences", identity)
    path = root / layout.queries_name(settings.split)
    path.parent.mkdir()
    footer: dict[str, Any] = {**identity, "split": settings.split}
    write_table(path, queries, "queries", footer)
    footer["queries_sha256"] = sha256_file(path)
    write_table(truth_root / f"{settings.split}.parquet", truth, "truth", footer)


def _around(mask: Mask, column: int, row: int) -> Mask:
    """Return a pixel of a mask and its neighbours: a corner may be marked just outside of it."""
    return mask[max(0, row - 1) : row + 2, max(0, column - 1) : column + 2]


def _write_frame(
    clip: Clip, frame: int, folder: Path, kind: str
) -> tuple[list[str], Mask | None, bool]:
    """Write the files of a frame.

    Returns:
        Their paths relative to the folder, the frame's mask, and whether a rope's ball was
        separated from it.
    """
    names = [layout.rgb_name(frame)]
    names += [layout.mask_name(frame)] if clip.read_mask else []
    names += [layout.camera_depth_name(frame)] if clip.read_depth else []
    for name in names:
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
    write_rgb(folder / names[0], clip.read(frame))
    mask = ball = None
    if clip.read_mask:
        mask = clip.read_mask(frame)
        ids = np.where(mask, OBJECT, 0).astype(np.uint8)
        if kind == "rope":
            _, ball = separate_ball(mask)
        if ball is not None:
            ids[ball] = ATTACHED
        write_mask(folder / layout.mask_name(frame), ids)
    if clip.read_depth:
        write_camera_depth(folder / layout.camera_depth_name(frame), clip.read_depth(frame))
    return names, mask, ball is not None


def _sequence(
    clip: Clip,
    name: str,
    index: int,
    settings: ImportSettings,
    folder: Path,
    files: Sequence[str],
) -> dict[str, Any]:
    """Return a `sequence.json` that says nothing but the files."""
    return {
        "spec_version": SPEC_VERSION,
        "id": name,
        "tier": settings.id,
        "split": settings.split,
        "shape": None,
        "index": index,
        "seed": 0,
        "temporal": clip.temporal,
        "frames": clip.frames,
        "style": "external",
        "noise": None,
        "parameters": {},
        "frame_info": [{} for _ in range(clip.frames)],
        "tools": {"pliant": version("pliant")},
        "files": [file_entry(folder, file) for file in files],
    }


def _dataset(
    settings: ImportSettings,
    size: tuple[int, int],
    config: Mapping[str, Any],
    attached: bool,
    same: Sequence[Alike],
) -> dict[str, Any]:
    """Return `dataset.json`; the tier's material is one that is called unknown."""
    unsaid = config["unknown"]
    names = {OBJECT: "unknown", **({ATTACHED: "attached"} if attached else {})}
    material = (MaterialCoordinate("unknown", 0, 1, 1), MaterialCoordinate("unknown", 0, 1, 1))
    objects = tuple(MaterialObject(number, name, material) for number, name in names.items())
    tier = Tier(
        settings.id,
        settings.kind,
        "unknown",
        OBJECT,
        objects,
        tuple(each.symmetry for each in same),
    )
    return {
        "spec_version": SPEC_VERSION,
        "id": settings.id,
        "version": settings.version,
        "title": settings.title or settings.id,
        "description": "Imported images and point annotations. Not known: "
        + ", ".join(unsaid)
        + ".",
        "licence": settings.licence,
        "conventions": CONVENTIONS,
        "image_size": {"width": size[0], "height": size[1]},
        "tiers": [tier.as_document()],
        "splits": [settings.split],
        "held_out": [settings.split],
        "provenance": {
            "generator": f"pliant import {version('pliant')}",
            "seed": None,
            "config": dict(config),
            "tools": {"pliant": version("pliant")},
        },
    }
