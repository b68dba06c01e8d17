"""Reading a dataset: its description, its sequences, its queries and their truth."""

from __future__ import annotations

import json
import operator
import os
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from functools import cached_property, reduce
from pathlib import Path
from typing import Any, ClassVar, Final

import pyarrow as pa

from pliant.spec.calls import check_whole
from pliant.spec.conventions import SPLITS
from pliant.spec.decoded import decoded_images
from pliant.spec.errors import CallError, SpecError
from pliant.spec.io.jsonfiles import read_json
from pliant.spec.io.parquet import read_footer, read_table
from pliant.spec.io.reading import sha256_file
from pliant.spec.model import Tier
from pliant.spec.opening import (
    check_names,
    check_truth,
    check_version,
    foreign_truth,
    require_dataset_folder,
    sample_or,
    tiers_of,
)
from pliant.spec.queries import QueryPair, group_queries
from pliant.spec.sequence import RecordedFrame, SequenceRecord
from pliant.spec.storage import layout
from pliant.spec.storage.files import Files, LayeredFiles, LocalFiles, SingleFile, storage_of
from pliant.spec.storage.manifest import check_halves
from pliant.spec.storage.packed import PackedFiles

_LISTED: Final = ["id", "tier", "split", "shape", "frames", "temporal"]
"""Columns of `sequences.parquet` that a `SequenceRecord` has."""


@dataclass(frozen=True, repr=False)
class Dataset:
    """A dataset: a folder, loose or packed, or one that is read over the network.

    Attributes:
        root: Its folder; of a remote one, its URL for messages.
        info: Its `dataset.json`.
        tiers: Its tiers by name.
        listing: The columns of `sequences.parquet` that its sequences are made of.
        files: Where its files come from.

    Examples:
        >>> dataset = pliant.load("sample")
        >>> [sequence.id for sequence in dataset][:2]
        ['rope-train-000000', 'rope-train-000001']
        >>> pair = dataset.pairs("val")[0]
        >>> pair.source.rgb.shape, pair.queries.shape
        ((192, 256, 3), (64, 2))
    """

    root: Path
    info: dict[str, Any] = field(repr=False)
    tiers: dict[str, Tier] = field(repr=False)
    listing: pa.Table = field(repr=False)
    files: Files = field(repr=False, compare=False)

    sequence_class: ClassVar[type[SequenceRecord]] = SequenceRecord

    @classmethod
    def open(cls, root: Path | str) -> Dataset:
        """Open a dataset by its folder or its URL.

        It reads `dataset.json` and `sequences.parquet` and lists no folder, so that opening
        takes the same time however many frames there are.

        Args:
            root: The folder that contains `dataset.json`; with `://` in it, a URL for fsspec;
                `sample`, where no such folder exists, is the small dataset of the package.

        Raises:
            CallError: The folder does not exist.
            SpecError: It is not a dataset, a private half, of another major version, or its two top
                files are damaged. (`pliant validate` lists everything that is wrong.)
            MissingExtraError: A URL, and fsspec is not installed.
        """
        root = sample_or(root)
        files: Files
        files = storage = storage_of(root)
        if isinstance(storage, LocalFiles):
            require_dataset_folder(root)
        if not storage.has(layout.DATASET_JSON):
            raise SpecError(
                "this is not a Pliant dataset",
                path=storage.address,
                required=f"a folder with a {layout.DATASET_JSON}",
            )
        path = storage.get(layout.DATASET_JSON)
        info = read_json(path)
        check_version(info.get("spec_version") if isinstance(info, dict) else None, path)
        info = read_json(path, "dataset")
        tiers = tiers_of(info, path)
        table_path = storage.get(layout.SEQUENCES_TABLE)
        listing = read_table(table_path, "sequences").select(_LISTED)
        check_names(listing, tiers, table_path)
        if storage.has(layout.INDEX_TABLE):
            files = PackedFiles(storage, listing["id"].to_pylist())
        elif storage.has(layout.MANIFEST_JSON):
            raise SpecError(
                "this is the private half of a published dataset, with the answers alone",
                path=storage.address,
                required="the public half",
                fix="Name that one; `--truth` adds the answers to it.",
            )
        return cls(Path(root), info, tiers, listing, files)

    def __reduce__(self) -> tuple[Any, ...]:
        # A copy in another process lists its sequences itself.
        return type(self), (self.root, self.info, self.tiers, self.listing, self.files)

    @cached_property
    def sequences(self) -> list[SequenceRecord]:
        """Its sequences, in the order of `sequences.parquet`."""
        decoded = decoded_images()
        return [
            self.sequence_class(
                **row,
                described=self.tiers[row["tier"]],
                root=self.root,
                size=self.size,
                files=self.files,
                decoded=decoded,
            )
            for row in self.listing.to_pylist()
        ]

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
        listed = read_table(files.get(layout.SEQUENCES_TABLE), "sequences")
        shapes = dict(zip(listed["id"].to_pylist(), listed["shape"].to_pylist(), strict=True))
        rows = zip(self.listing["id"].to_pylist(), self.listing["shape"].to_pylist(), strict=True)
        known = pa.array(
            [shapes.get(name, shape) for name, shape in rows], self.listing["shape"].type
        )
        place = self.listing.column_names.index("shape")
        listing = self.listing.set_column(place, "shape", known)
        return replace(self, listing=listing, files=files)

    def with_truth(self, path: Path | str) -> Dataset:
        """Return this dataset with truth that is next to it.

        Args:
            path: The truth of a split, the folder of it that `pliant import` writes, or a private
                half.

        Raises:
            CallError: The file or folder is missing.
            SpecError: It cannot be read, or is not the truth of this dataset's queries.
        """
        path = Path(path)
        if not os.path.exists(path):
            raise CallError(
                "truth not found",
                path=path,
                fix="Give its file, its folder or the private half of the dataset: --truth PATH.",
            )
        if path.is_dir():
            files = [path / f"{split}.parquet" for split in self.splits_with_queries()]
            files = [file for file in files if file.is_file()]
            return reduce(Dataset.with_truth, files, self) if files else self.with_private(path)
        split = str(read_footer(path).get("split"))
        asked = self.splits_with_queries()
        if split not in asked:
            raise foreign_truth(path, f"split {split!r}", f"one of {', '.join(asked)}")
        check_truth(path, self.id, self.version, split, self.queries_sha256(split))
        return replace(
            self, files=LayeredFiles(SingleFile(layout.truth_name(split), path), self.files)
        )

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

    def fingerprint(self) -> bytes:
        """Return bytes that differ between datasets with other sequences.

        The table of sequences alone has the same bytes for other image sizes, colours and noise;
        `provenance` tells them apart. Titles and licences make no difference.
        """
        made = {name: self.info[name] for name in ("image_size", "tiers", "provenance")}
        table = self.local(layout.SEQUENCES_TABLE).read_bytes()
        return json.dumps(made, sort_keys=True).encode() + table

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
    def _by_id(self) -> dict[str, SequenceRecord]:
        return {sequence.id: sequence for sequence in self.sequences}

    def sequence(self, sequence_id: str) -> SequenceRecord:
        """Return a sequence by its id.

        Raises:
            SpecError: The dataset has no such sequence.
        """
        return self._named(sequence_id, SpecError)

    def chosen(self, sequence_id: str) -> SequenceRecord:
        """Return the sequence that a person names; `sequence`, with a `CallError`."""
        return self._named(sequence_id, CallError)

    def _named(self, sequence_id: str, refused: type[SpecError | CallError]) -> SequenceRecord:
        if sequence_id not in self._by_id:
            raise refused(
                "the dataset has no such sequence",
                path=self.root,
                found=repr(sequence_id)[:100],
                required=f"such as {next(iter(self._by_id))}" if self._by_id else None,
            )
        return self._by_id[sequence_id]

    def frame(self, sequence_id: str, index: int) -> RecordedFrame:
        """Return a frame by the id of its sequence and its index; its files are read later."""
        sequence = self.sequence(sequence_id)
        check_whole("index", index, 0, sequence.frames - 1)
        return RecordedFrame(sequence, index)

    def frames(self, split: str | None = None, tier: str | None = None) -> list[RecordedFrame]:
        """Return the frames of the dataset, of one split, of one tier.

        Raises:
            CallError: No sequence of the dataset is of this split and tier.
        """
        chosen = [
            each
            for each in self.sequences
            if split in (None, each.split) and tier in (None, each.tier)
        ]
        if not chosen:
            raise CallError(
                "the dataset has no such frames",
                path=self.address,
                found=f"split {split!r}, tier {tier!r}",
                required=f"splits {sorted({each.split for each in self.sequences})}, "
                f"tiers {list(self.tiers)}",
            )
        return [frame for sequence in chosen for frame in sequence]

    def __len__(self) -> int:
        return len(self.sequences)

    def __iter__(self) -> Iterator[SequenceRecord]:
        return iter(self.sequences)

    def __getitem__(self, key: int | str) -> SequenceRecord:
        """Return a sequence by its id, or by its place in `sequences.parquet`."""
        if isinstance(key, str):
            return self.sequence(key)
        number = operator.index(key)
        if not -len(self) <= number < len(self):
            raise IndexError(f"the dataset has {len(self)} sequences, and no sequence {number}")
        return self.sequences[number]

    def __repr__(self) -> str:
        splits = Counter(each.split for each in self.sequences)
        listed = ", ".join(f"{name} {splits[name]}" for name in SPLITS if name in splits)
        return (
            f"Dataset({self.id!r} {self.version}: {len(self)} sequences ({listed}), "
            f"{sum(each.frames for each in self.sequences)} frames, "
            f"tiers {', '.join(self.tiers)})"
        )

    def splits_with_queries(self) -> list[str]:
        """Return the splits that have a queries file, in the order train, val, test."""
        return [name for name in SPLITS if self.has(layout.queries_name(name))]

    def pairs(self, split: str) -> list[QueryPair]:
        """Return a split's queries grouped by image pair, in the order of the file.

        Raises:
            SpecError: The split has no queries, pairs are not ascending, or the rows of one pair
                disagree about its frames.
        """
        return group_queries(
            self.queries(split), self.frame, path=self.root / layout.queries_name(split)
        )

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
            splits = [each for each in SPLITS if self.has(f"{folder}/{each}.parquet")]
            raise SpecError(
                f"the dataset has no {folder} for split {split!r}",
                path=f"{self.address}/{name}",
                required=f"one of {', '.join(splits)}" if splits else None,
            )
        return self.local(name)
