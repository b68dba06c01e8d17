"""The foreign formats that can be imported, told apart by what the source is."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from pliant.converters.clip import Clip
from pliant.converters.knots import Pixels, read_knots
from pliant.converters.queries import Scheme
from pliant.converters.tapvid import Coordinates, read_tapvid
from pliant.spec.errors import CallError


@dataclass(frozen=True)
class Source:
    """Data of a foreign format.

    Attributes:
        clips: What was read.
        kind: What its points usually lie on.
        queries: Which pairs of frames its own benchmark asks about.
        facts: Where it comes from and how it was read, for the dataset's provenance.
    """

    clips: Sequence[Clip]
    kind: Literal["rope", "cloth"]
    queries: Scheme
    facts: Mapping[str, str]


def read_source(
    path: Path,
    *,
    pixels: Pixels = "rounded",
    temporal: bool = False,
    coordinates: Coordinates = "auto",
) -> Source:
    """Read a folder with `knots_info.json` or a file of TAP-Vid tracks.

    Args:
        path: The folder or the file.
        pixels: Of `knots_info.json`, what its numbers are.
        temporal: Of `knots_info.json`, whether the frames follow each other in time.
        coordinates: Of tracks, what positions are.

    Raises:
        CallError: There is nothing at this path.
        SpecError: The data is damaged.
    """
    if path.is_dir():
        clips = [read_knots(path, pixels=pixels, temporal=temporal)]
        facts = {"source": path.name, "format": "knots_info.json", "pixels": pixels}
        return Source(clips, "rope", "pairs", facts)
    if path.is_file():
        tracks = read_tapvid(path, coordinates=coordinates)
        facts = {"source": path.name, "format": "tap-vid", "coordinates": coordinates}
        return Source(tracks, "cloth", "first", facts)
    raise CallError("there is nothing to import", path=path)
