"""`pliant publish`: pack a dataset, take out what is held out, write its papers, tie the halves.

Both halves are made in temporary folders beside their places and renamed at the end.
"""

from __future__ import annotations

import hashlib
import shutil
import tempfile
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import ExitStack
from dataclasses import dataclass, field
from importlib.metadata import version
from pathlib import Path

from pliant.publishing.card import write_card
from pliant.publishing.croissant import check_croissant, write_croissant
from pliant.publishing.held_out import (
    guessable,
    listed,
    picture_alone,
    public_document,
    public_info,
    public_sequences,
    shown_answers,
)
from pliant.publishing.papers import citation, licence_text, private_readme
from pliant.publishing.webdataset import write_webdataset
from pliant.spec.conventions import SPLITS
from pliant.spec.dataset import Dataset
from pliant.spec.errors import CallError, SpecError
from pliant.spec.io import limits
from pliant.spec.io.jsonfiles import json_bytes, write_json
from pliant.spec.io.parquet import read_table, write_table
from pliant.spec.io.reading import read_bytes
from pliant.spec.sequence import SequenceRecord
from pliant.spec.storage import layout
from pliant.spec.storage.manifest import Half, write_checksums, write_manifest
from pliant.spec.storage.packing import SHARD_BYTES, FolderToPack, Packer

Progress = Callable[[str, int, int], None]
"""Called with (what is being done, sequences done, sequences in all)."""

Finish = Callable[[Path, Path | None], None]
"""Adds files to the private half: called with both folders while they are still temporary, before
the private half's checksums are written."""

_LEAST_SHARD_BYTES = 2**16


@dataclass(frozen=True)
class PublishSettings:
    """How a dataset is published.

    Attributes:
        hold_out: Splits whose answers go into the private half.
        shard_bytes: About how large a shard becomes.
        webdataset: Whether to write the frames as tar files too.
        authors: Who publishes it; empty names the dataset itself.
        url: Where it will be hosted, or None.
        date: Day of the release, YYYY-MM-DD, or None: then the papers carry none, and equal data
            gives equal bytes on any day.
    """

    hold_out: tuple[str, ...] = ()
    shard_bytes: int = SHARD_BYTES
    webdataset: bool = False
    authors: tuple[str, ...] = ()
    url: str | None = None
    date: str | None = None

    def __post_init__(self) -> None:
        for split in self.hold_out:
            if split not in SPLITS:
                raise CallError(
                    "unknown split", where="--hold-out", found=split, required=", ".join(SPLITS)
                )
        if self.shard_bytes < _LEAST_SHARD_BYTES:
            raise CallError(
                "shards would be too small",
                where="--shard-size",
                found=f"{self.shard_bytes} bytes",
                required=f">= {_LEAST_SHARD_BYTES}",
            )
        if self.date is not None and not _is_day(self.date):
            raise CallError(
                "this is no day", where="--date", found=self.date, required="YYYY-MM-DD"
            )


@dataclass(frozen=True)
class Published:
    """What was published.

    Attributes:
        public: The public half.
        private: The private half, None if nothing was held out.
        checksums_sha256: Of the public half's `SHA256SUMS`.
        private_sha256: Of the private half's, or None.
        sequences: Sequences published.
        frames: Frames published.
        bytes: Size of the public half.
        shards: Its Parquet shards.
        warnings: What the publisher should know.
    """

    public: Path
    private: Path | None
    checksums_sha256: str
    private_sha256: str | None
    sequences: int
    frames: int
    bytes: int
    shards: int
    warnings: list[str] = field(default_factory=list)

    def as_dict(self) -> dict[str, object]:
        """Return it as a JSON object."""
        return {
            **self.__dict__,
            "public": str(self.public),
            "private": None if self.private is None else str(self.private),
        }


def publish(
    source: Path,
    out: Path,
    settings: PublishSettings | None = None,
    *,
    private: Path | None = None,
    progress: Progress | None = None,
    finish: Finish | None = None,
) -> Published:
    """Publish a dataset.

    Args:
        source: The dataset: a folder, loose, whole, every checksum as listed.
        out: The public half; a new or empty folder.
        settings: How; None holds nothing out.
        private: The private half; None takes the public one's name with `-private` behind.
        progress: Called after each sequence.
        finish: Adds files to the private half.

    Returns:
        What was written, with warnings.

    Raises:
        CallError: A folder or a split cannot be served.
        SpecError: The dataset is damaged: a file is missing or is not what its checksum says.
    """
    settings = settings or PublishSettings()
    dataset = _open(source, settings)
    out = out.absolute()
    private = None if not settings.hold_out else (private or out.with_name(f"{out.name}-private"))
    places = [out] if private is None else [private.absolute(), out]
    for place in places:
        _check_place(place, source)
    warnings = _warnings(dataset, settings)
    with ExitStack() as stack:
        made = [Path(stack.enter_context(_workplace(place))) for place in places]
        public_half = made[-1]
        private_half = made[0] if private is not None else None
        _write_public(dataset, public_half, settings, progress)
        if private_half is not None:
            _write_private(dataset, private_half, settings, warnings, progress)
            if finish is not None:
                finish(public_half, private_half)
        sums = _tie(dataset, public_half, private_half, settings)
        facts = Published(
            public=out,
            private=private,
            checksums_sha256=sums[0],
            private_sha256=sums[1],
            sequences=len(dataset.sequences),
            frames=sum(sequence.frames for sequence in dataset.sequences),
            bytes=sum(p.stat().st_size for p in public_half.rglob("*") if p.is_file()),
            shards=sum(1 for name in layout.SHARD_DIRS for _ in public_half.glob(f"{name}/*")),
            warnings=warnings,
        )
        _rename(made, places)
    return facts


def _open(source: Path, settings: PublishSettings) -> Dataset:
    dataset = Dataset.open(source)
    if not (source / layout.SEQUENCES_DIR).is_dir():
        raise CallError(
            "only a loose dataset can be published, and this one is packed",
            path=source,
            required=f"a folder with {layout.SEQUENCES_DIR}/",
            fix="Publish the folder that `pliant generate` or `pliant import` wrote.",
        )
    if dataset.held_out:
        raise CallError(
            "this is a public half already",
            path=source,
            found=f"held_out {dataset.held_out}",
            fix="Publish the dataset it was made of.",
        )
    for split in settings.hold_out:
        for name in (layout.queries_name(split), layout.truth_name(split)):
            if not dataset.has(name):
                raise CallError(
                    f"split {split!r} cannot be held out: there is nothing to ask or to answer",
                    path=source / name,
                    required="queries and truth of the split",
                )
    return dataset


def _check_place(place: Path, source: Path) -> None:
    if place.exists() and (not place.is_dir() or any(place.iterdir())):
        raise CallError(
            "the output exists already", path=place, fix="Name a new or an empty folder."
        )
    inside = source.resolve()
    if place.resolve() == inside or inside in place.resolve().parents:
        raise CallError("the output lies inside the dataset", path=place, fix="Name another place.")


def _warnings(dataset: Dataset, settings: PublishSettings) -> list[str]:
    warnings = []
    seeds = guessable(dataset, settings.hold_out) if settings.hold_out else []
    if seeds:
        warnings.append(
            f"the held-out sequences were generated from a seed that can be guessed ({seeds[0]}): "
            "the published files do not tell it, but who tries small numbers with the same "
            "settings finds it, and the answers with it. Generate a set for a competition with a "
            "secret seed: --seed $(python -c 'import secrets; print(secrets.randbits(62))')"
        )
    for split in settings.hold_out:
        shown, visible = shown_answers(dataset, split)
        if shown:
            warnings.append(
                f"{shown:,} of the {visible:,} visible answers of split {split} stand as query "
                "pixels of the same frame in another pair: somebody may snap to them"
            )
    return warnings


def _is_day(text: str) -> bool:
    from datetime import date

    try:
        return date.fromisoformat(text).isoformat() == text
    except ValueError:
        return False


def _workplace(place: Path) -> tempfile.TemporaryDirectory[str]:
    """Return a temporary folder beside a place, to be renamed to it."""
    try:
        place.parent.mkdir(parents=True, exist_ok=True)
        return tempfile.TemporaryDirectory(
            prefix=f".{place.name}.", dir=place.parent, ignore_cleanup_errors=True
        )
    except OSError as error:
        raise CallError("the output cannot be written", path=place, found=error.strerror) from error


def _rename(made: Sequence[Path], places: Sequence[Path]) -> None:
    """Give the finished folders their names: the private half first, none without the other."""
    done: list[Path] = []
    try:
        for folder, place in zip(made, places, strict=True):
            folder.chmod(0o755 if folder is made[-1] else 0o700)
            if place.exists():
                place.rmdir()
            folder.rename(place)
            done.append(place)
    except BaseException:
        for place in done:
            shutil.rmtree(place, ignore_errors=True)
        raise


class _Verified(Mapping[str, bytes]):
    """The files of a sequence's folder, each read when asked for and held to its checksum."""

    def __init__(self, sequence: SequenceRecord, document: Mapping[str, object]) -> None:
        self._sequence = sequence
        self.listed: dict[str, tuple[str, int]] = {
            entry["path"]: (entry["sha256"], entry["bytes"])
            for entry in document["files"]  # type: ignore[attr-defined]
        }

    def __getitem__(self, name: str) -> bytes:
        sha256, _ = self.listed[name]
        path = self._sequence.dir / name
        limit = limits.MAX_TABLE_BYTES if name.endswith(".parquet") else limits.MAX_IMAGE_FILE_BYTES
        data = read_bytes(path, limit)
        found = hashlib.sha256(data).hexdigest()
        if found != sha256:
            raise SpecError(
                "the file is not the one that sequence.json lists",
                path=path,
                found=f"sha256 {found}",
                required=sha256,
                fix="Run: pliant validate",
            )
        return data

    def __iter__(self) -> Iterator[str]:
        return iter(self.listed)

    def __len__(self) -> int:
        return len(self.listed)


class _With(Mapping[str, bytes]):
    """Files, and some of them replaced or added."""

    def __init__(self, files: Mapping[str, bytes], added: Mapping[str, bytes]) -> None:
        self._files, self._added = files, added

    def __getitem__(self, name: str) -> bytes:
        return self._added[name] if name in self._added else self._files[name]

    def __iter__(self) -> Iterator[str]:
        return iter({**dict.fromkeys(self._files), **dict.fromkeys(self._added)})

    def __len__(self) -> int:
        return len(set(self._files) | set(self._added))


def _write_public(
    dataset: Dataset, root: Path, settings: PublishSettings, progress: Progress | None
) -> None:
    """Write everything of the public half but its checksums and manifest."""
    hold_out = settings.hold_out
    named = {"id": dataset.id, "version": dataset.version}
    if hold_out:
        write_json(root / layout.DATASET_JSON, public_info(dataset.info, hold_out), "dataset")
        table = read_table(dataset.local(layout.SEQUENCES_TABLE), "sequences")
        write_table(
            root / layout.SEQUENCES_TABLE,
            public_sequences(table, hold_out),
            "sequences",
            {"dataset": named},
        )
    else:
        for name in (layout.DATASET_JSON, layout.SEQUENCES_TABLE):
            shutil.copyfile(dataset.local(name), root / name)
    for split in dataset.splits_with_queries():
        names = [layout.queries_name(split)]
        if split not in hold_out and dataset.has(layout.truth_name(split)):
            names.append(layout.truth_name(split))
        for name in names:
            (root / name).parent.mkdir(exist_ok=True)
            shutil.copyfile(dataset.local(name), root / name)
    with Packer(root, named, shard_bytes=settings.shard_bytes) as packer:
        for done, sequence in enumerate(dataset.sequences, 1):
            packer.add(_public_folder(sequence, hold_out))
            if progress is not None:
                progress("Packing", done, len(dataset.sequences))
    public = Dataset.open(root)
    if settings.webdataset:
        write_webdataset(
            public,
            root,
            shard_bytes=settings.shard_bytes,
            progress=None
            if progress is None
            else lambda done, total: progress("Writing tar files", done, total),
        )
    authors = settings.authors or (f"The publishers of {dataset.id}",)
    own_licence = dataset.root / "LICENSE"
    if own_licence.is_file():
        shutil.copyfile(own_licence, root / "LICENSE")
    else:
        _write_text(root / "LICENSE", licence_text(dataset.info, authors))
    _write_text(root / "CITATION.cff", citation(dataset.info, authors, settings.url, settings.date))
    write_card(public, root, authors=authors, url=settings.url)
    write_croissant(public, root, authors=authors, url=settings.url, date=settings.date)
    check_croissant(root)


def _public_folder(sequence: SequenceRecord, hold_out: Sequence[str]) -> FolderToPack:
    """Return what of a sequence is packed for the public."""
    document = sequence.info
    files = _Verified(sequence, document)
    plain = (sequence.dir / layout.SEQUENCE_JSON).read_bytes()
    packed: Mapping[str, bytes]
    if sequence.split in hold_out:
        names = [layout.rgb_name(frame) for frame in range(sequence.frames)]
        pictures = {name: picture_alone(files[name], str(sequence.dir / name)) for name in names}
        public = {**public_document(document, held_out=True), "files": listed(pictures)}
        packed = {**pictures, layout.SEQUENCE_JSON: json_bytes(public, "sequence")}
    elif hold_out:
        public = public_document(document, held_out=False)
        packed = _With(files, {layout.SEQUENCE_JSON: json_bytes(public, "sequence")})
    else:
        packed = _With(files, {layout.SEQUENCE_JSON: plain})
    sizes = {name: size for name, (_, size) in files.listed.items() if name in packed}
    return FolderToPack(
        sequence.id,
        sequence.tier,
        sequence.split,
        sequence.shape,
        sequence.frames,
        packed,
        sizes,
    )


def _write_private(
    dataset: Dataset,
    root: Path,
    settings: PublishSettings,
    warnings: Sequence[str],
    progress: Progress | None,
) -> None:
    """Write everything of the private half but its checksums and manifest."""
    for name in (layout.DATASET_JSON, layout.SEQUENCES_TABLE):
        shutil.copyfile(dataset.local(name), root / name)
    for split in settings.hold_out:
        name = layout.truth_name(split)
        (root / name).parent.mkdir(exist_ok=True)
        shutil.copyfile(dataset.local(name), root / name)
    held = [s for s in dataset.sequences if s.split in settings.hold_out]
    for done, sequence in enumerate(held, 1):
        folder = layout.sequence_dir(root, sequence.tier, sequence.id)
        folder.mkdir(parents=True)
        files = _Verified(sequence, sequence.info)
        for name in files:
            if name.startswith("rgb/"):
                continue
            (folder / name).parent.mkdir(exist_ok=True)
            (folder / name).write_bytes(files[name])
        shutil.copyfile(sequence.dir / layout.SEQUENCE_JSON, folder / layout.SEQUENCE_JSON)
        if progress is not None:
            progress("Setting the answers apart", done, len(held))
    _write_text(root / "README.md", private_readme(dataset.info, settings.hold_out, warnings))


def _tie(
    dataset: Dataset, public: Path, private: Path | None, settings: PublishSettings
) -> tuple[str, str | None]:
    """Write checksums and manifests; return the sha256 of the lists of both halves."""
    own = write_checksums(public)
    other = None if private is None else write_checksums(private)
    tools = {name: version(name) for name in ("pliant", "pyarrow", "pillow")}
    halves: list[tuple[Path, Half, str, str | None]] = [(public, "public", own, other)]
    if private is not None and other is not None:
        halves.append((private, "private", other, own))
    for root, half, mine, its in halves:
        write_manifest(
            root,
            half,
            dataset={"id": dataset.id, "version": dataset.version},
            held_out=[split for split in SPLITS if split in settings.hold_out],
            checksums_sha256=mine,
            other_sha256=its,
            tools=tools,
        )
    return own, other


def _write_text(path: Path, text: str) -> None:
    path.write_bytes(text.encode("utf-8"))
