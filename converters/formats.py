"""The foreign formats that can be imported, distinguished by what the source is."""

from __future__ import annotations

import math
import shlex
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final, Literal

from pliant.converters.annotation_tools import (
    is_coco,
    is_labelme,
    read_coco,
    read_document,
    read_labelme,
)
from pliant.converters.annotations import Annotations
from pliant.converters.canvas import PictureOptions, clip_of
from pliant.converters.clip import Clip
from pliant.converters.knots import KNOTS_JSON, read_knots
from pliant.converters.marks_csv import collect_marks
from pliant.converters.queries import Scheme
from pliant.converters.tapvid import read_tapvid
from pliant.spec.errors import CallError, SpecError
from pliant.spec.marks import ANNOTATIONS_CSV
from pliant.spec.progress import Progress
from pliant.spec.text import plural

_LEAST_SHARE: Final = 0.25  # of the canvas; of a picture that covers less, too little is seen


@dataclass(frozen=True)
class Source:
    """Data of a foreign format.

    Attributes:
        clips: What was read.
        kind: What its points usually are on.
        queries: Which pairs of frames its own benchmark asks about.
        facts: Where it comes from and how it was read, for the dataset's provenance.
        notes: What was left out, in sentences.
    """

    clips: Sequence[Clip]
    kind: Literal["rope", "cloth"]
    queries: Scheme
    facts: Mapping[str, Any]
    notes: Sequence[str] = ()


def read_source(
    path: Path, options: PictureOptions | None = None, progress: Progress | None = None
) -> Source:
    """Read annotated pictures or point tracks.

    Args:
        path: `annotations.csv`, a COCO or LabelMe file, the folder of one of them or of
            `knots_info.json`, or an npz file of TAP-Vid tracks, or a folder of such files.
        options: How annotated pictures are read.
        progress: Called after every file of tracks.

    Raises:
        CallError: There is nothing at this path, or an option is for pictures alone.
        SpecError: The data is damaged.
    """
    options = options or PictureOptions()
    if not path.exists():
        raise CallError(
            "file or folder not found", path=path, fix="Name annotations, tracks, or their folder."
        )
    if tracks := _track_files(path):
        given = next((each for each in (options.pairs, options.masks, options.depth) if each), None)
        if given is not None:
            raise CallError(
                "--pair-list, --masks and --depth apply to annotated pictures, not to tracks",
                path=given,
            )
        if options.pixels == "index":
            raise CallError(
                "tracks have positions, not indices of pixels",
                where="--pixels",
                found="index",
                fix="If points are columns and rows, add 0.5 to them in the file.",
            )
        facts = {"source": path.name, "format": "tap-vid"}
        return Source(read_tapvid(tracks, progress), "cloth", "first", facts)
    name, annotations = _annotations(path)
    clip = clip_of(annotations, options)
    facts = {"source": path.name, "format": name, "pixels": options.pixels, **clip.facts}
    notes = []
    if annotations.suggested:
        folder = shlex.quote(str(annotations.path.parent))
        notes.append(
            f"Left out: {plural(annotations.suggested, 'mark')} that a method suggested and nobody "
            f"confirmed. To confirm: pliant annotate {folder}"
        )
    least = min(clip.facts["pictures"], key=lambda picture: math.prod(picture["placed"]))
    width, height = clip.size
    covered = math.prod(least["placed"])
    if covered < _LEAST_SHARE * width * height:
        notes.append(
            f"The pictures differ in size: {least['name']} covers "
            f"{covered / (width * height):.1%} of the canvas of {width}x{height} px, and the rest "
            "is black." + ("" if options.size else " --size WxH fits them into one size.")
        )
    return Source([clip], "rope", "pairs", facts, notes)


def _track_files(path: Path) -> list[Path]:
    """Return the files of point tracks at a path: a file other than annotations, or all npz."""
    if path.is_file():
        return [] if path.suffix.lower() in (".csv", ".json") else [path]
    annotated = ANNOTATIONS_CSV, KNOTS_JSON, f"images/{KNOTS_JSON}"
    return [] if any((path / name).is_file() for name in annotated) else sorted(path.glob("*.npz"))


def _annotations(path: Path) -> tuple[str, Annotations]:
    """Return the name of the format and what was read."""
    if path.suffix.lower() == ".csv":
        return "annotations.csv", collect_marks(path).annotations()
    if path.is_file():
        if path.name == KNOTS_JSON:
            return KNOTS_JSON, read_knots(path.parent)
        return _tool(path, [path])
    if (path / ANNOTATIONS_CSV).is_file():
        return "annotations.csv", collect_marks(path / ANNOTATIONS_CSV).annotations()
    if (path / KNOTS_JSON).is_file() or (path / "images" / KNOTS_JSON).is_file():
        return KNOTS_JSON, read_knots(path)
    return _tool(path, sorted([*path.glob("*.json"), *path.glob("annotations/*.json")]))


def _tool(path: Path, files: Sequence[Path]) -> tuple[str, Annotations]:
    """Return what JSON files of an annotation tool say."""
    coco: list[tuple[Path, Any]] = []
    labelme = []
    for file in files:
        document = read_document(file)
        coco += [(file, document)] if is_coco(document) else []
        labelme += [file] if is_labelme(document) else []  # one at a time: they hold pictures
    if len(coco) > 1:
        raise SpecError(
            "there are several COCO files",
            path=path,
            found=", ".join(file.name for file, _ in coco[:4]),
            fix="Import one of them by its path.",
        )
    if coco:
        return "coco", read_coco(*coco[0])
    if labelme:
        return "labelme", read_labelme(labelme, path)
    raise SpecError(
        "there are no annotations to import",
        path=path,
        required=f"{ANNOTATIONS_CSV} (picture,point,x,y,visible), COCO keypoints, LabelMe files, "
        f"{KNOTS_JSON} or point tracks (.npz)",
        fix="Click points with `pliant annotate DIR`, which writes annotations.csv.",
    )
