"""Reading a dataset: its description, its sequences, its queries and their truth."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path
from typing import Any, Final

import numpy as np
import numpy.typing as npt
import pyarrow as pa

from pliant.spec import layout
from pliant.spec.checksums import sha256_file
from pliant.spec.conventions import SPEC_VERSION, SPLITS
from pliant.spec.errors import CallError, SpecError
from pliant.spec.exr import Surface, read_surface
from pliant.spec.files import Files, LayeredFiles, LocalFiles, PackedFiles, storage_of
from pliant.spec.jsonfiles import read_json
from pliant.spec.manifest import check_halves
from pliant.spec.parquet import open_table, read_table
from pliant.spec.parquet_columns import load_columns
from pliant.spec.png import read_rgb
from pliant.spec.reading import AnyFile, FileRefusedError
from pliant.spec.tables import CORRESPONDENCES

NAME: Final = re.compile(r"[A-Za-z0-9](?:[A-Za-z0-9._-]{0,126}[A-Za-z0-9])?")
"""What names of tiers and sequences look like; they are folder names too."""


def is_name(text: str) -> bool:
    """Return whether a text may name a tier or a sequence (and so a folder)."""
    return NAME.fullmatch(text) is not None and ".." not in text


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
            fix="Use a Pliant that knows it, or run: pliant migrate DIR",
        )


def tier_object(tier: Mapping[str, Any], object_id: int) -> dict[str, Any]:
    """Return an object of a tier, as `dataset.json` describes it.

    Args:
        tier: A tier of `dataset.json`.
        object_id: Id of one of its objects.
    """
    found: dict[str, Any] = next(each for each in tier["objects"] if each["id"] == object_id)
    return found


@dataclass(frozen=True)
class Sequence:
    """One sequence of a dataset; its files are read when they are asked for.

    Attributes:
        id: Its name, unique in the dataset.
        tier: Name of its tier.
        split: The split it belongs to.
        shape: Named shape of the object, or None.
        frames: Number of frames.
        temporal: True for an episode.
        dir: Its folder, or where it would be if the dataset were not packed.
        size: (width, height) of its images.
        files: Where its files come from.
    """

    id: str
    tier: str
    split: str
    shape: str | None
    frames: int
    temporal: bool
    dir: Path
    size: tuple[int, int]
    files: Files = field(repr=False, compare=False)

    def has(self, name: str) -> bool:
        """Return whether the sequence has a file, such as `depth/000000.exr`."""
        return self.files.has(f"{layout.sequence_name(self.tier, self.id)}/{name}")

    def file(self, name: str) -> AnyFile:
        """Return a file of the sequence's folder, to be given to a reader."""
        return self.files.get(f"{layout.sequence_name(self.tier, self.id)}/{name}")

    @cached_property
    def info(self) -> dict[str, Any]:
        """The sequence's `sequence.json`."""
        document: dict[str, Any] = read_json(self.file(layout.SEQUENCE_JSON), "sequence")
        return document

    @cached_property
    def _cameras(self) -> tuple[npt.NDArray[np.float64], npt.NDArray[np.float64]]:
        path = self.file(layout.CAMERAS_JSON)
        document = read_json(path, "cameras")
        frames = document["frames"]
        if [camera["frame"] for camera in frames] != list(range(self.frames)):
            raise SpecError(
                "the cameras are not one per frame, in order", path=path, where="frames"
            )
        K = np.array([camera["K"] for camera in frames], np.float64)
        poses = np.array([camera["world_to_camera"] for camera in frames], np.float64)
        return K, poses

    def camera(self, frame: int) -> tuple[npt.NDArray[np.float64], npt.NDArray[np.float64]]:
        """Return a frame's camera.

        Args:
            frame: 0 to frames - 1.

        Returns:
            K float64 (3, 3), pixels; world_to_camera float64 (4, 4), metres.
        """
        self._check(frame)
        K, poses = self._cameras
        return K[frame].copy(), poses[frame].copy()

    def rgb(self, frame: int) -> npt.NDArray[np.uint8]:
        """Return a frame's colour image, uint8 (H, W, 3), sRGB."""
        self._check(frame)
        return read_rgb(self.file(layout.rgb_name(frame)), size=self.size)

    def surface(self, frame: int) -> Surface:
        """Return a frame's depth and surface image."""
        self._check(frame)
        return read_surface(self.file(layout.depth_name(frame)), size=self.size)

    def points(self) -> pa.Table:
        """Return the table of material points."""
        return read_table(self.file(layout.POINTS_TABLE), "points")

    def correspondences(self, frame: int | None = None) -> pa.Table:
        """Return where the points are, of one frame or of all.

        Args:
            frame: 0 to frames - 1; None for the whole table.

        Returns:
            The correspondences table; of one frame, row i is point i.
        """
        path = self.file(layout.CORRESPONDENCES_TABLE)
        file = open_table(path)
        if frame is None:
            return load_columns(file, path, CORRESPONDENCES)
        self._check(frame)
        rows = file.metadata.num_rows
        if rows % self.frames:
            raise SpecError(
                "the table does not hold every point of every frame", path=path, found=rows
            )
        count = rows // self.frames
        wanted = range(frame * count, (frame + 1) * count)
        groups: list[int] = []
        start = first = 0
        for index in range(file.metadata.num_row_groups):
            stop = start + file.metadata.row_group(index).num_rows
            if start < wanted.stop and stop > wanted.start:
                if not groups:
                    first = start
                groups.append(index)
            start = stop
        table = load_columns(file, path, CORRESPONDENCES, groups)
        return table.slice(wanted.start - first, count)

    def _check(self, frame: int) -> None:
        if not 0 <= frame < self.frames:
            raise CallError(
                "the sequence has no such frame",
                where=self.id,
                found=frame,
                required=f"0 to {self.frames - 1}",
            )


@dataclass(frozen=True)
class Dataset:
    """A dataset: a folder, loose or packed, or one that is read from afar.

    Attributes:
        root: Its folder; of a remote one, its URL for messages.
        info: Its `dataset.json`.
        sequences: Its sequences, in the order of `sequences.parquet`.
        files: Where its files come from.
    """

    root: Path
    info: dict[str, Any]
    sequences: list[Sequence]
    files: Files = field(repr=False, compare=False)

    @classmethod
    def open(cls, root: Path | str) -> Dataset:
        """Open a dataset by its folder or its URL.

        It reads `dataset.json` and `sequences.parquet` and lists no folder, so that opening
        takes the same time however many frames there are.

        Args:
            root: The folder that holds `dataset.json`; with `://` in it, a URL for fsspec.

        Raises:
            SpecError: It is no dataset, of another major version, or its two top files are
                damaged. (`pliant validate` lists everything that is wrong.)
            MissingExtraError: A URL, and fsspec is not installed.
        """
        files: Files
        files = storage = storage_of(root)
        if not storage.has(layout.DATASET_JSON):
            raise SpecError(
                "this is no Pliant dataset",
                path=storage.address,
                required=f"a folder with a {layout.DATASET_JSON}",
            )
        path = storage.get(layout.DATASET_JSON)
        info = read_json(path)
        check_version(info.get("spec_version") if isinstance(info, dict) else None, path)
        info = read_json(path, "dataset")
        size = (info["image_size"]["width"], info["image_size"]["height"])
        listing = storage.get(layout.SEQUENCES_TABLE)
        table = read_table(listing, "sequences")
        if storage.has(layout.INDEX_TABLE):
            files = PackedFiles(storage, table["id"].to_pylist())
        place = Path(root)
        sequences = []
        for row in table.to_pylist():
            if not (is_name(row["id"]) and is_name(row["tier"])):
                raise SpecError(
                    "a sequence or tier has a name that is no name",
                    path=listing,
                    where="id, tier",
                    found=f"{row['id']!r:.80}, {row['tier']!r:.80}",
                )
            sequences.append(
                Sequence(
                    id=row["id"],
                    tier=row["tier"],
                    split=row["split"],
                    shape=row["shape"],
                    frames=row["frames"],
                    temporal=row["temporal"],
                    dir=layout.sequence_dir(place, row["tier"], row["id"]),
                    size=size,
                    files=files,
                )
            )
        return cls(place, info, sequences, files)

    def with_private(self, folder: Path | str) -> Dataset:
        """Return this dataset with the private half that `pliant publish` made of it.

        Args:
            folder: The private half.

        Raises:
            SpecError: The two halves do not belong together.
        """
        private = LocalFiles(Path(folder))
        check_halves(self.files, private)
        files = LayeredFiles(private, self.files)
        sequences = [replace(sequence, files=files) for sequence in self.sequences]
        return replace(self, sequences=sequences, files=files)

    @property
    def address(self) -> str:
        """What opens the same dataset again: its path or its URL."""
        return self.files.address

    def has(self, name: str) -> bool:
        """Return whether the dataset has a file, such as `truth/test.parquet`."""
        return self.files.has(name)

    def local(self, name: str) -> Path:
        """Return a file outside `sequences` as one on this machine, fetched if need be."""
        return self.files.local(name)

    @property
    def id(self) -> str:
        """The dataset's id."""
        return str(self.info["id"])

    @property
    def version(self) -> str:
        """The dataset's own version."""
        return str(self.info["version"])

    @property
    def size(self) -> tuple[int, int]:
        """(width, height) of every image."""
        return self.info["image_size"]["width"], self.info["image_size"]["height"]

    @property
    def held_out(self) -> list[str]:
        """The splits whose sequences come as colour images alone, without any truth."""
        return list(self.info.get("held_out", ()))

    @cached_property
    def tiers(self) -> dict[str, dict[str, Any]]:
        """The tiers of `dataset.json` by name."""
        return {tier["name"]: tier for tier in self.info["tiers"]}

    @cached_property
    def _by_id(self) -> dict[str, Sequence]:
        return {sequence.id: sequence for sequence in self.sequences}

    def sequence(self, sequence_id: str) -> Sequence:
        """Return a sequence by its id.

        Raises:
            SpecError: The dataset has no such sequence.
        """
        if sequence_id not in self._by_id:
            raise SpecError(
                "the dataset has no such sequence", path=self.root, found=repr(sequence_id)[:100]
            )
        return self._by_id[sequence_id]

    def splits_with_queries(self) -> list[str]:
        """Return the splits that have a queries file, in the order train, val, test."""
        return [name for name in SPLITS if self.has(layout.queries_name(name))]

    def queries(self, split: str) -> pa.Table:
        """Return a split's queries."""
        return read_table(self._existing(layout.queries_name(split)), "queries")

    def truth(self, split: str) -> pa.Table:
        """Return a split's truth; row i answers query row i."""
        return read_table(self._existing(layout.truth_name(split)), "truth")

    def queries_sha256(self, split: str) -> str:
        """Return the sha256 of a split's queries file, as submissions must name it."""
        return sha256_file(self._existing(layout.queries_name(split)))

    def _existing(self, name: str) -> Path:
        if not self.has(name):
            folder, split = Path(name).parent.name, Path(name).stem
            raise SpecError(
                f"the dataset has no {folder} for split {split!r}",
                path=f"{self.address}/{name}",
                required=f"one of {self.splits_with_queries()}",
            )
        return self.local(name)
