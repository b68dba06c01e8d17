"""What a reader under test is, and right files to start from."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Final

from pliant.spec.dataset import Dataset
from pliant.spec.io.reading import AnyFile, read_bytes
from pliant.spec.opening import SAMPLE

ROOT: Final = Path(__file__).parents[2]
TINY: Final = ROOT / "tests" / "data" / "tiny-submission"
MAX_BYTES: Final = 1 << 16
"""Longest input that is tried; larger seeds are cut, as a broken download is."""


@dataclass(frozen=True)
class Reader:
    """A reader under test.

    Attributes:
        read: Reads a file at a path.
        seeds: Right files to change.
        suffix: Ending of the file's name.
    """

    read: Callable[[Path], object]
    seeds: Callable[[], Iterable[bytes]]
    suffix: str = ""


@cache
def sample() -> Dataset:
    return Dataset.open(SAMPLE)


@cache
def tiny() -> Dataset:
    return Dataset.open(TINY / "dataset")


def of_sample(*names: str) -> Callable[[], list[bytes]]:
    """Return files of the sample's first sequence."""

    def seeds() -> list[bytes]:
        sequence = sample().sequences[0]
        files: list[AnyFile] = [sequence.file(name) for name in names]
        return [read_bytes(file, 1 << 24) for file in files]

    return seeds


def files(folder: Path, *patterns: str) -> Callable[[], list[bytes]]:
    """Return files of a folder."""
    return lambda: [path.read_bytes() for each in patterns for path in sorted(folder.glob(each))]


def texts(*texts: str) -> Callable[[], list[bytes]]:
    """Return texts."""
    return lambda: [text.encode() for text in texts]


def in_folder(path: Path, name: str, source: Path | None = None) -> Path:
    """Return a folder that contains the input under a name, and links to the rest of a folder."""
    folder = path.with_suffix(".folder")
    (folder / name).parent.mkdir(parents=True, exist_ok=True)
    for entry in source.iterdir() if source is not None else ():
        link = folder / entry.name
        if entry.name != name and not link.exists():
            link.symlink_to(entry)
    (folder / name).unlink(missing_ok=True)
    (folder / name).hardlink_to(path)
    return folder
