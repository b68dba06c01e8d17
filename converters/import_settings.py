"""How imported data becomes a dataset, and what is refused before anything is written."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

from pliant.converters.clip import Clip
from pliant.converters.queries import Scheme
from pliant.spec.conventions import VERSION
from pliant.spec.errors import CallError, SpecError
from pliant.spec.io import limits
from pliant.spec.io.staging import is_left_alone, refuse_existing
from pliant.spec.opening import is_name
from pliant.spec.text import escape, unsafe_character


@dataclass(frozen=True)
class ImportSettings:
    """How imported data becomes a dataset.

    Attributes:
        id: The dataset's id, and the name of its tier.
        kind: What the points are on: `rope`, `cloth` or another name.
        split: The split that all of it becomes.
        title: One line for people.
        licence: SPDX identifier of the data's licence, or `LicenseRef-unknown`.
        version: The dataset's version, three numbers.
        queries: Which pairs of frames are asked about.
        pairs: Of scheme `pairs`, the most pairs of a clip.
        size: (width, height) to bring every frame to, px; None keeps their common size.
        alike: Groups of points that look alike, see `converters.alike`.
    """

    id: str
    kind: str = "rope"
    split: Literal["train", "val", "test"] = "test"
    title: str = ""
    licence: str = "LicenseRef-unknown"
    version: str = "1.0.0"
    queries: Scheme = "pairs"
    pairs: int = 100
    size: tuple[int, int] | None = None
    alike: Sequence[str] = ()


def check_call(out: Path, beside: Path, settings: ImportSettings) -> None:
    """Refuse folders that are there, and settings that are none."""
    for folder in (out, beside):
        if not is_left_alone(folder, out):
            refuse_existing(folder)
    for what, name, fix in (
        ("the dataset's id", settings.id, "Name the dataset with --id."),
        ("--kind", settings.kind, None),
    ):
        if not is_name(name):
            raise CallError(
                "invalid name",
                where=what,
                found=repr(name)[:80],
                required="1 to 128 letters, digits, '.', '_', '-'",
                fix=fix,
            )
    for what, text in (("--title", settings.title), ("--licence", settings.licence)):
        if (found := unsafe_character(text)) is not None:
            raise CallError(
                "the text has a control or bidirectional character",
                where=what,
                found=escape(found),
                fix="Remove it.",
            )
    if not re.fullmatch(VERSION, settings.version):
        raise CallError(
            "invalid version",
            where="--version",
            found=repr(settings.version)[:80],
            required="three numbers, such as 1.0.0",
        )
    if settings.pairs < 1:
        raise CallError("the number of pairs is wrong", found=settings.pairs, required=">= 1")


def check_names(clips: Sequence[Clip], source: Mapping[str, Any]) -> None:
    """Refuse names of files that the provenance cannot say."""
    pictures = [picture["name"] for clip in clips for picture in clip.facts.get("pictures", ())]
    for name in (str(source.get("source", "")), *(clip.name for clip in clips), *pictures):
        if not name.isprintable():
            raise SpecError(
                "the name of a file has characters that cannot be printed",
                found=repr(name)[:80],
                fix="Rename the file.",
            )


def common_size(clips: Sequence[Clip], settings: ImportSettings) -> tuple[int, int]:
    """Return the (width, height) of all frames, px."""
    sizes = sorted({clip.size for clip in clips})
    if settings.size is None and len(sizes) > 1:
        raise CallError(
            "the clips differ in size, and a dataset has one",
            found=", ".join(f"{width}x{height}" for width, height in sizes[:6]),
            fix="Give --size WxH to bring all of them to one size (TAP-Vid scores at 256x256)",
        )
    size = settings.size or sizes[0]
    if min(size) < 1:
        raise CallError("invalid size", where="--size", found=f"{size[0]}x{size[1]}")
    if max(size) > limits.MAX_IMAGE_SIDE_PX or size[0] * size[1] > limits.MAX_IMAGE_PIXELS:
        raise CallError(
            "the frames are larger than a dataset's may be",
            found=f"{size[0]}x{size[1]}",
            required=f"sides of at most {limits.MAX_IMAGE_SIDE_PX:,} px, "
            f"{limits.MAX_IMAGE_PIXELS:,} pixels in all",
            fix="Give a smaller --size WxH",
        )
    return size
