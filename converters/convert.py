"""Writes a dataset in the format of another tool, and lists what it cannot store."""

from __future__ import annotations

import importlib
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from pliant.converters.targets.recording import Options
from pliant.spec.dataset import Dataset
from pliant.spec.errors import CallError
from pliant.spec.extras import require_packages
from pliant.spec.io.staging import staged
from pliant.spec.progress import Progress
from pliant.spec.sequence import SequenceRecord

_SURFACE: Final = "the material coordinate of every pixel"
_QUERIES: Final = "queries and their answers"
_CAMERA: Final = "cameras and depth"
_CONFIGURATIONS: Final = "independent configurations (their frames become consecutive)"


@dataclass(frozen=True)
class Target:
    """A form that datasets are converted to.

    Attributes:
        name: As `--to` takes it.
        title: What it is.
        opened_by: What opens the result; {out} is its folder, {shell} the same in a shell.
        lost: What it cannot hold, beyond provenance and symmetries, which none can.
        packages: Import names of packages that writing it needs.
    """

    name: str
    title: str
    opened_by: str
    lost: tuple[str, ...]
    packages: tuple[str, ...] = ()


TARGETS: Final = {
    each.name: each
    for each in (
        Target(
            "rerun",
            "Rerun recordings",
            "rerun {shell}/*.rrd",
            (_SURFACE, _QUERIES, "depth beyond what is seen: infinite depth becomes 0"),
            ("rerun",),
        ),
        Target(
            "lerobot",
            "LeRobot dataset v3.0",
            'LeRobotDataset(repo_id, root="{out}")',
            (
                _SURFACE,
                _QUERIES,
                _CONFIGURATIONS,
                "cameras",
                "splits (all episodes are in one)",
            ),
        ),
        Target(
            "coco",
            "COCO keypoints",
            "pycocotools, annotation tools, `pliant import {shell}/annotations.json`",
            (_SURFACE, _QUERIES, _CAMERA, "positions in metres", "splits"),
        ),
        Target(
            "tapvid",
            "TAP-Vid npz files",
            "numpy, TAP-Vid's evaluation, `pliant import {shell}`",
            (_SURFACE, _QUERIES, _CONFIGURATIONS, _CAMERA, "positions in metres", "splits"),
        ),
        Target(
            "webdataset",
            "WebDataset tars",
            'webdataset.WebDataset("{out}/SPLIT-000000.tar")',
            (_QUERIES,),
        ),
        Target(
            "glb",
            "animated glTF meshes",
            "Blender, three.js, trimesh",
            (_SURFACE, _QUERIES, _CONFIGURATIONS, "pictures", _CAMERA, "visibility", "splits"),
        ),
    )
}
"""Name -> target."""


def chosen_sequences(
    dataset: Dataset,
    *,
    split: str | None = None,
    tier: str | None = None,
    sequences: Sequence[str] = (),
) -> list[SequenceRecord]:
    """Return the sequences to convert.

    Args:
        dataset: The dataset.
        split: Only of this split.
        tier: Only of this tier.
        sequences: Only these, by their ids.

    Raises:
        CallError: There are none, the dataset has no such sequence, or a named split is held out:
            its truth is not in the dataset.
    """
    named = [dataset.chosen(each) for each in sequences] or dataset.sequences
    wanted = [each for each in named if split in (None, each.split) and tier in (None, each.tier)]
    usable = [each for each in wanted if each.split not in dataset.held_out]
    if not usable:
        asked = (f"{name} {value}" for name, value in (("split", split), ("tier", tier)) if value)
        hidden = {*dataset.held_out} if wanted else set()  # no such split: name every one
        splits = sorted({each.split for each in dataset} - hidden)
        known = f"splits {', '.join(splits)}; tiers {', '.join(dataset.tiers)}"
        raise CallError(
            "the dataset does not contain the truth of these sequences"
            if wanted
            else "there are no such sequences",
            path=dataset.address,
            found=", ".join(asked) or "all sequences",
            required=known if splits else "a dataset with truth inside, as of pliant generate",
        )
    return usable


def convert(
    sequences: Sequence[SequenceRecord],
    target: Target,
    out: Path,
    options: Options,
    progress: Progress | None = None,
) -> int:
    """Write sequences in the format of another tool.

    Args:
        sequences: What to convert, as `chosen_sequences` returns it.
        target: The form.
        out: A folder that does not exist or is empty.
        options: Number of points, and the clock.
        progress: Called with (sequences done, of how many).

    Returns:
        The size of all files, bytes.

    Raises:
        CallError: The folder has files in it, the frame rate is invalid, or the form cannot
            hold these sequences.
        MissingExtraError: A package is not installed.
        SpecError: A file of the dataset is damaged.
    """
    if not 1e-3 <= options.frame_rate_hz <= 1e6:  # nan neither
        raise CallError(
            "invalid frame rate",
            where="--frame-rate",
            found=options.frame_rate_hz,
            required="0.001 to 1,000,000 Hz",
        )
    require_packages(target.packages, f"conversion to {target.title}", "convert")
    module = importlib.import_module(f"pliant.converters.targets.{target.name}")
    with staged(out, new=True) as folder:
        for done, _ in enumerate(module.write(sequences, folder, options), start=1):
            if progress is not None:
                progress(done, len(sequences))
        return sum(path.stat().st_size for path in folder.rglob("*") if path.is_file())
