"""Writes the public and the private half of a dataset, all but their checksums and manifests."""

from __future__ import annotations

import hashlib
import shutil
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from functools import partial
from pathlib import Path, PurePosixPath

from pliant.evaluator.report.pages import render_page
from pliant.publishing.card import is_recorded, write_card
from pliant.publishing.croissant import write_croissant
from pliant.publishing.held_out import (
    listed,
    picture_alone,
    public_document,
    public_info,
    public_sequences,
)
from pliant.publishing.hub_results import write_benchmark
from pliant.publishing.pairs import write_pairs
from pliant.publishing.papers import citation, licence_url, zenodo
from pliant.publishing.settings import PublishSettings
from pliant.spec.dataset import Dataset
from pliant.spec.errors import SpecError
from pliant.spec.io import limits
from pliant.spec.io.jsonfiles import json_bytes, write_json
from pliant.spec.io.parquet import read_table, write_table
from pliant.spec.io.reading import read_bytes
from pliant.spec.io.writing import write_file
from pliant.spec.sequence import SequenceRecord
from pliant.spec.storage import layout
from pliant.spec.storage.packing import FolderToPack, Packer

StageProgress = Callable[[str, int, int], None]
"""Called with (name of the stage, finished sequences, all sequences)."""

_page = partial(render_page, package="pliant.publishing")

_TOP: tuple[str, ...] = (layout.DATASET_JSON, layout.SEQUENCES_TABLE)
_RECORDED: tuple[str, ...] = tuple(
    f"{PurePosixPath(name(0)).parent}/"
    for name in (layout.rgb_name, layout.mask_name, layout.camera_depth_name)
)


class _VerifiedFiles(Mapping[str, bytes]):
    """The files of a sequence's folder, each read when asked for and checked by its checksum.

    Args:
        sequence: The sequence.
        added: Files that are added, or take the place of its own.
    """

    def __init__(self, sequence: SequenceRecord, added: Mapping[str, bytes] = {}) -> None:
        self._folder, self._added = sequence.dir, added
        self._checksums = {entry["path"]: entry["sha256"] for entry in sequence.info["files"]}
        self.sizes = {entry["path"]: int(entry["bytes"]) for entry in sequence.info["files"]}

    def __getitem__(self, name: str) -> bytes:
        if name in self._added:
            return self._added[name]
        sha256 = self._checksums[name]
        limit = limits.max_file_bytes(name)
        data = read_bytes(self._folder / name, limit)
        found = hashlib.sha256(data).hexdigest()
        if found != sha256:
            raise SpecError(
                "the file is not the one that sequence.json lists",
                path=self._folder / name,
                found=f"sha256 {found}",
                required=sha256,
                fix="Run: pliant validate",
            )
        return data

    def __iter__(self) -> Iterator[str]:
        return iter(dict.fromkeys([*self._checksums, *self._added]))

    def __len__(self) -> int:
        return len(self._checksums.keys() | self._added.keys())


def write_public(
    dataset: Dataset, root: Path, settings: PublishSettings, progress: StageProgress
) -> None:
    """Write everything of the public half but its checksums and manifest.

    Args:
        dataset: The dataset, loose.
        root: The half's folder.
        settings: How it is published.
        progress: Called after each sequence.
    """
    hold_out = settings.hold_out
    named = {"id": dataset.id, "version": dataset.version}
    if hold_out:
        write_json(root / layout.DATASET_JSON, public_info(dataset.info, hold_out), "dataset")
        table = read_table(dataset.local(layout.SEQUENCES_TABLE), "sequences")
        table = public_sequences(table, hold_out)
        write_table(root / layout.SEQUENCES_TABLE, table, "sequences", {"dataset": named})
    else:
        _copy(dataset, _TOP, root)
    for split in dataset.splits_with_queries():
        _copy(dataset, [layout.queries_name(split)], root)
        if split not in hold_out and dataset.has(layout.truth_name(split)):
            _copy(dataset, [layout.truth_name(split)], root)
    with Packer(root, named, shard_bytes=settings.shard_bytes) as packer:
        for done, sequence in enumerate(dataset.sequences, 1):
            packer.add(_public_folder(sequence, hold_out))
            progress("Packing", done, len(dataset.sequences))
    public = Dataset.open(root)
    authors = settings.authors or (f"The publishers of {dataset.id}",)
    if (dataset.root / "LICENSE").is_file():
        shutil.copyfile(dataset.root / "LICENSE", root / "LICENSE")
    else:
        url = licence_url(dataset.info["licence"])
        text = _page("licence.md.j2", info=dataset.info, authors=authors, url=url)
        write_file(root / "LICENSE", text)
    write_file(root / "CITATION.cff", citation(dataset.info, authors, settings.url, settings.date))
    write_pairs(public, root)
    write_benchmark(public, root)
    write_json(root / ".zenodo.json", zenodo(dataset.info, authors, settings.url, settings.date))
    write_card(public, root, authors=authors, url=settings.url)
    write_croissant(public, root, authors=authors, url=settings.url, date=settings.date)


def _public_folder(sequence: SequenceRecord, hold_out: Sequence[str]) -> FolderToPack:
    """Return what of a sequence is packed for the public."""
    own = _VerifiedFiles(sequence)
    files: Mapping[str, bytes]
    if sequence.split in hold_out:
        shown = {name: _shown(own[name], sequence.dir / name) for name in own if _is_shown(name)}
        public = {**public_document(sequence.info, held_out=True), "files": listed(shown)}
        files = {**shown, layout.SEQUENCE_JSON: json_bytes(public, "sequence")}
    else:
        document = (sequence.dir / layout.SEQUENCE_JSON).read_bytes()
        if hold_out:
            document = json_bytes(public_document(sequence.info, held_out=False), "sequence")
        files = _VerifiedFiles(sequence, {layout.SEQUENCE_JSON: document})
    return FolderToPack(
        id=sequence.id,
        tier=sequence.tier,
        split=sequence.split,
        shape=None if sequence.split in hold_out else sequence.shape,
        frames=sequence.frames,
        files=files,
        sizes={name: size for name, size in own.sizes.items() if name in files},
    )


def _is_shown(name: str) -> bool:
    """Return whether a file of a held-out sequence is public: what a camera recorded is."""
    return name.startswith(_RECORDED)


def _shown(data: bytes, path: Path) -> bytes:
    return picture_alone(data, str(path)) if path.suffix == ".png" else data


def write_private(
    dataset: Dataset,
    root: Path,
    settings: PublishSettings,
    warnings: Sequence[str],
    progress: StageProgress,
) -> None:
    """Write everything of the private half but its checksums and manifest.

    Args:
        dataset: The dataset, loose.
        root: The half's folder.
        settings: How it is published.
        warnings: What the publisher should know.
        progress: Called after each sequence.
    """
    _copy(dataset, [*_TOP, *map(layout.truth_name, settings.hold_out)], root)
    held = [s for s in dataset.sequences if s.split in settings.hold_out]
    for done, sequence in enumerate(held, 1):
        folder = root / layout.sequence_name(sequence.tier, sequence.id)
        folder.mkdir(parents=True)
        files = _VerifiedFiles(sequence)
        for name in files:
            if not _is_shown(name):
                (folder / name).parent.mkdir(exist_ok=True)
                (folder / name).write_bytes(files[name])
        shutil.copyfile(sequence.dir / layout.SEQUENCE_JSON, folder / layout.SEQUENCE_JSON)
        progress("Setting the answers apart", done, len(held))
    text = _page(
        "private_readme.md.j2",
        info=dataset.info,
        hold_out=settings.hold_out,
        recorded=is_recorded(dataset),
        warnings=warnings,
    )
    write_file(root / "README.md", text)


def _copy(dataset: Dataset, names: Iterable[str], root: Path) -> None:
    for name in names:
        (root / name).parent.mkdir(exist_ok=True)
        shutil.copyfile(dataset.local(name), root / name)
