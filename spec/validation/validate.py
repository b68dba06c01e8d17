"""`pliant validate`: every rule of the specification, all problems in one pass."""

from __future__ import annotations

import multiprocessing
from collections.abc import Iterator
from concurrent.futures import ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from pliant.spec.conventions import SPEC_VERSION, SPLITS
from pliant.spec.errors import CallError, Issue
from pliant.spec.io.jsonfiles import is_newer_minor
from pliant.spec.model import Tier
from pliant.spec.opening import is_name, require_dataset_folder, sample_or
from pliant.spec.progress import Progress
from pliant.spec.storage import layout
from pliant.spec.storage.files import LocalFiles
from pliant.spec.storage.packed import PackedFiles
from pliant.spec.validation.findings import Findings
from pliant.spec.validation.issue_codes import ISSUE_CODES
from pliant.spec.validation.rules.context import Context
from pliant.spec.validation.rules.files import read_document
from pliant.spec.validation.rules.listing import check_checksums, check_listing
from pliant.spec.validation.rules.packed import check_any_sequence, check_index
from pliant.spec.validation.rules.queries import check_split_queries
from pliant.spec.validation.rules.result import SequenceResult, compare_frames
from pliant.spec.validation.rules.structure import check_root
from pliant.spec.validation.rules.tiers import check_tiers

DEFAULT_LIMIT = 200


@dataclass(frozen=True)
class Report:
    """The outcome of a validation.

    Attributes:
        root: The dataset.
        quick: True if images and geometry were left alone.
        issues: The problems, sorted by file; at most the limit asked for.
        counts: Issue code -> how many there are, listed or not.
        errors: How many problems make the dataset invalid.
        sequences: Sequences checked.
        frames: Frames checked.
    """

    root: Path
    quick: bool
    issues: list[Issue]
    counts: dict[str, int]
    errors: int
    sequences: int
    frames: int

    @property
    def total(self) -> int:
        """How many problems there are, listed or not."""
        return sum(self.counts.values())

    @property
    def valid(self) -> bool:
        """True if nothing breaks a rule (warnings do not)."""
        return self.errors == 0

    def as_dict(self) -> dict[str, Any]:
        """Return the report as a JSON object."""
        return {
            "dataset": str(self.root),
            "spec_version": SPEC_VERSION,
            "quick": self.quick,
            "valid": self.valid,
            "sequences": self.sequences,
            "frames": self.frames,
            "total": self.total,
            "listed": len(self.issues),
            "counts": self.counts,
            "issues": [issue.as_dict() for issue in self.issues],
        }


def validate(
    root: Path | str,
    *,
    quick: bool = False,
    workers: int = 1,
    limit: int = DEFAULT_LIMIT,
    progress: Progress | None = None,
) -> Report:
    """Check a dataset against the specification.

    Args:
        root: The dataset's folder.
        quick: Check structure, schemas, tables' keys and checksums only; decode no image,
            recompute nothing.
        workers: Processes; the outcome does not depend on it.
        limit: So many problems are listed in words; all are counted.
        progress: Called after each sequence.

    Returns:
        All problems found.

    Raises:
        CallError: The folder is not there, or an argument makes no sense.
    """
    if "://" in str(root):
        raise CallError(
            "only a folder on this machine can be validated",
            path=root,
            fix="Download the dataset, and name its folder.",
        )
    root = Path(sample_or(root))
    require_dataset_folder(root)
    if workers < 1 or limit < 1:
        raise CallError("workers and limit must be at least 1", found=(workers, limit))
    findings = Findings(listed_per_code=limit)
    folders = check_root(root, findings)
    context = _read_context(root, quick, findings)
    sequences = frames = 0
    if context is not None:
        if (root / layout.INDEX_TABLE).exists():
            packed = check_index(context, findings)
            if packed is None:
                return _report(root, quick, findings, limit, 0, 0)
            ids = [name for _, name in packed]
            context = replace(context, files=PackedFiles(LocalFiles(root), ids))
            for tier, name in packed:
                if is_name(tier) and is_name(name):
                    folders.setdefault(tier, set()).add(name)
        if not check_checksums(context, findings):
            return _report(root, quick, findings, limit, 0, 0)
        rows = check_listing(context, folders, findings)
        row_of = {(row["tier"], name): row for name, row in rows.items()}
        tasks = [
            (context, tier, name, row_of.get((tier, name)))
            for tier, names in sorted(folders.items())
            for name in sorted(names)
        ]
        checked: list[SequenceResult] = []
        digests: dict[str, tuple[bytes, str]] = {}
        for result in _run(tasks, workers):
            sequences += 1
            frames += result.frames
            findings.merge(result.findings)
            _compare_points(result, digests, findings)
            if result.split is not None:
                checked.append(result)
            if progress is not None:
                progress(sequences, len(tasks))
        compare_frames(checked, findings)
        known = {result.id: result for result in checked}
        for split in SPLITS:
            paths = (root / layout.queries_name(split), root / layout.truth_name(split))
            if any(path.exists() or path.is_symlink() for path in paths):
                findings.merge(check_split_queries(context, split, known))
    return _report(root, quick, findings, limit, sequences, frames)


def _read_context(root: Path, quick: bool, findings: Findings) -> Context | None:
    path = root / layout.DATASET_JSON
    if path.is_symlink() or not path.is_file():
        return None
    problems = findings.at(layout.DATASET_JSON)
    info = read_document(path, "dataset", problems)
    if info is None:
        return None
    if is_newer_minor(info["spec_version"]):
        text = f"found {info['spec_version']}; this validator knows {SPEC_VERSION}"
        problems.add("SPEC_VERSION_NEWER", "spec_version", text)
    for split in info.get("held_out", ()):
        if split not in info["splits"]:
            problems.add("SPLIT_UNKNOWN", "held_out", f"{split} is none of {info['splits']}")
    before = findings.counts["TIER_INVALID"]
    tiers = [Tier.from_document(entry) for entry in info["tiers"]]
    check_tiers(tiers, problems)
    if findings.counts["TIER_INVALID"] > before:
        return None
    return Context.of(root, info, tiers, quick)


_Task = tuple[Context, str, str, dict[str, Any] | None]


def _run(tasks: list[_Task], workers: int) -> Iterator[SequenceResult]:
    """Check the sequences, in processes of their own if asked for; yield in order."""
    if workers == 1 or len(tasks) < 2:
        for task in tasks:
            yield check_any_sequence(*task)
        return
    spawn = multiprocessing.get_context("spawn")
    with ProcessPoolExecutor(min(workers, len(tasks)), mp_context=spawn) as pool:
        futures = [pool.submit(check_any_sequence, *task) for task in tasks]
        for task, future in zip(tasks, futures, strict=True):
            try:
                yield future.result()
            except BrokenProcessPool:
                yield _crashed(task[1], task[2])


def _crashed(tier: str, name: str) -> SequenceResult:
    result = SequenceResult(name, tier)
    result.findings.add(
        "FILE_UNREADABLE",
        f"{layout.SEQUENCES_DIR}/{tier}/{name}",
        "",
        "a process that read this sequence, or another one, was killed by the system; run again "
        "with --workers 1",
    )
    return result


def _compare_points(
    result: SequenceResult, digests: dict[str, tuple[bytes, str]], findings: Findings
) -> None:
    """Points of one id must be one material point in every sequence of a tier."""
    if result.points_digest is None:
        return
    digest, first = digests.setdefault(result.tier, (result.points_digest, result.id))
    if digest != result.points_digest:
        path = f"{layout.sequence_name(result.tier, result.id)}/{layout.POINTS_TABLE}"
        findings.add("POINTS_DIFFER", path, "", f"other points than those of {first}")


def _report(
    root: Path, quick: bool, findings: Findings, limit: int, sequences: int, frames: int
) -> Report:
    order = {code: index for index, code in enumerate(findings.counts)}
    # Keep some of every code: the first of each, then the second of each …
    rank: dict[str, int] = {}
    ranked = []
    for issue in findings.listed():
        rank[issue.code] = rank.get(issue.code, -1) + 1
        ranked.append((rank[issue.code], order[issue.code], issue))
    issues = [issue for _, _, issue in sorted(ranked)[:limit]]
    return Report(
        root=root,
        quick=quick,
        issues=sorted(issues, key=lambda issue: (issue.path, issue.where, issue.code)),
        counts=dict(sorted(findings.counts.items())),
        errors=sum(
            n for code, n in findings.counts.items() if ISSUE_CODES[code].severity == "error"
        ),
        sequences=sequences,
        frames=frames,
    )
