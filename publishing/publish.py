"""`pliant publish`: pack a dataset, withhold the test labels, write its documents, link the halves.

Both halves are made in temporary folders next to their places and renamed at the end.
"""

from __future__ import annotations

from contextlib import ExitStack
from dataclasses import dataclass, field
from functools import partial
from importlib.metadata import version
from pathlib import Path

from pliant.publishing.halves import StageProgress, write_private, write_public
from pliant.publishing.held_out import scores_reveal, shown_answers
from pliant.publishing.papers import licence_url
from pliant.publishing.settings import PublishSettings
from pliant.spec.conventions import SPLITS
from pliant.spec.dataset import Dataset
from pliant.spec.errors import CallError, SpecError
from pliant.spec.io.staging import is_left_alone, next_to, refuse_existing, staged, staged_both
from pliant.spec.secrets import seed_weakness
from pliant.spec.storage import layout
from pliant.spec.storage.manifest import write_checksums, write_manifest
from pliant.spec.validation.validate import validate


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
    truth: Path | None = None,
    progress: StageProgress | None = None,
) -> Published:
    """Publish a dataset.

    Args:
        source: The dataset: a folder, loose, whole, without links, every checksum as listed.
        out: The public half; a new or empty folder.
        settings: How; None holds nothing out.
        private: The private half; None takes the public one's name with `-private` behind.
        truth: Of imported pictures, the answers that `pliant import` wrote: the file, or its
            folder; None takes the dataset's name with `-truth` behind.
        progress: Called after each sequence.

    Returns:
        What was written, with warnings.

    Raises:
        CallError: A folder or a split cannot be served, or a held-out split could be generated
            again by anybody.
        SpecError: The dataset is damaged, or contains links.
    """
    settings = settings or PublishSettings()
    dataset = _open(source, settings, truth or next_to(source, "-truth"))
    out = out.absolute()
    private = None if not settings.hold_out else (private or next_to(out, "-private"))
    if private is not None and not is_left_alone(private.absolute(), out):
        _check_place(private.absolute(), source)
    _check_place(out, source)
    show = progress or (lambda what, done, total: None)
    _check_contents(source, show)
    warnings = _warnings(dataset, settings)
    with ExitStack() as stack:
        private_half = None
        if private is None:
            public_half = stack.enter_context(staged(out, new=True))
        else:
            public_half, private_half = stack.enter_context(staged_both(out, private))
        public_half.chmod(0o755)
        write_public(dataset, public_half, settings, show)
        if private_half is not None:
            private_half.chmod(0o700)
            write_private(dataset, private_half, settings, warnings, show)
        sums = _tie(dataset, public_half, private_half, settings)
        return Published(
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


def _open(source: Path, settings: PublishSettings, truth: Path) -> Dataset:
    dataset = Dataset.open(source)
    if not (source / layout.SEQUENCES_DIR).is_dir():
        raise CallError(
            "only a loose dataset can be published, and this one is packed",
            path=source,
            required=f"a folder with {layout.SEQUENCES_DIR}/",
            fix="Publish the folder that `pliant generate` or `pliant import` wrote.",
        )
    for split in dataset.held_out:  # imported pictures: their answers are in another folder
        if split not in settings.hold_out:
            raise CallError(
                f"the answers of split {split!r} are not in the dataset and stay held out",
                path=source,
                required=f"--hold-out {split}",
            )
    if dataset.held_out:
        dataset = dataset.with_truth(truth)
    for split in settings.hold_out:
        for name in (layout.queries_name(split), layout.truth_name(split)):
            if not dataset.has(name):
                raise CallError(
                    f"split {split!r} cannot be held out: its queries or its truth are missing",
                    path=source / name,
                    required="queries and truth of the split",
                )
    return dataset


def _check_place(place: Path, source: Path) -> None:
    refuse_existing(place)
    inside = source.resolve()
    if place.resolve() == inside or inside in place.resolve().parents:
        raise CallError("the output is inside the dataset", path=place, fix="Name another place.")


def _check_contents(source: Path, progress: StageProgress) -> None:
    """Refuse a dataset that `validate --quick` refuses, as it does one that contains links."""
    report = validate(
        source, quick=True, progress=lambda done, total: progress("Validating", done, total)
    )
    errors = [issue for issue in report.issues if issue.severity == "error"]
    if errors:
        raise SpecError(
            "the dataset is not valid and is not published",
            path=source,
            found=f"{report.errors:,} error{'s' if report.errors > 1 else ''}, the first: "
            f"{errors[0]}",
            fix="Run: pliant validate",
        )


def _warnings(dataset: Dataset, settings: PublishSettings) -> list[str]:
    warnings = []
    licence = dataset.info["licence"]
    if licence_url(licence) is None and not (dataset.root / "LICENSE").is_file():
        warnings.append(
            f"the licence is {licence}, which states no terms of use: put them into "
            f"{dataset.root / 'LICENSE'}, or name a licence of the SPDX list"
        )
    weakness = seed_weakness(dataset.info, dataset.root) if settings.hold_out else None
    if weakness is not None:
        if not settings.answers_are_public:
            raise CallError(
                "anybody can generate the held-out answers again",
                path=dataset.root,
                found=weakness,
                required="a secret seed of 64 bits or more",
                fix="Generate the set with --secret-seed. To publish this one nevertheless: "
                "--answers-are-public.",
            )
        warnings.append(f"the held-out answers are public: {weakness}")
    for split in settings.hold_out:
        shown, visible = shown_answers(dataset, split)
        if shown:
            warnings.append(
                f"{shown:,} of the {visible:,} visible answers of split {split} are query pixels "
                "of the same frame in another pair, so that answers can be moved to the nearest. "
                "Import pictures with --pair-list and let each be a source only or a target only, "
                "and tracks with --queries first"
            )
        if (text := scores_reveal(dataset, split, visible)) is not None:
            warnings.append(text)
    return warnings


def _tie(
    dataset: Dataset, public: Path, private: Path | None, settings: PublishSettings
) -> tuple[str, str | None]:
    """Write checksums and manifests; return the sha256 of the lists of both halves."""
    own = write_checksums(public)
    other = None if private is None else write_checksums(private)
    write = partial(
        write_manifest,
        dataset={"id": dataset.id, "version": dataset.version},
        held_out=[split for split in SPLITS if split in settings.hold_out],
        tools={name: version(name) for name in ("pliant", "pyarrow", "pillow")},
    )
    write(public, "public", checksums_sha256=own, other_sha256=other)
    if private is not None and other is not None:
        write(private, "private", checksums_sha256=other, other_sha256=own)
    return own, other
