"""`pliant publish`: pack a dataset, withhold the test labels, write its documents, link the halves.

Both halves are made in temporary folders next to their places and renamed at the end.
"""

from __future__ import annotations

import shutil
import tempfile
from collections.abc import Callable, Sequence
from contextlib import ExitStack
from dataclasses import dataclass, field
from importlib.metadata import version
from pathlib import Path

from pliant.publishing.halves import Progress, write_private, write_public
from pliant.publishing.held_out import guessable, shown_answers
from pliant.publishing.settings import PublishSettings
from pliant.spec.conventions import SPLITS
from pliant.spec.dataset import Dataset
from pliant.spec.errors import CallError
from pliant.spec.storage import layout
from pliant.spec.storage.manifest import Half, write_checksums, write_manifest

Finish = Callable[[Path, Path | None], None]
"""Adds files to the private half: called with both folders while they are still temporary, before
the private half's checksums are written."""


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
        show = progress or (lambda what, done, total: None)
        write_public(dataset, public_half, settings, show)
        if private_half is not None:
            write_private(dataset, private_half, settings, warnings, show)
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
        raise CallError("the output is inside the dataset", path=place, fix="Name another place.")


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


def _workplace(place: Path) -> tempfile.TemporaryDirectory[str]:
    """Return a temporary folder next to a place, to be renamed to it."""
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
