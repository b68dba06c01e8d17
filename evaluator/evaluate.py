"""Scores a submission by a named protocol."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, Final

import numpy as np

from pliant.evaluator.protocols.protocol import Protocol, read_protocol
from pliant.evaluator.report.examples import choose_examples
from pliant.evaluator.scorers import Groups, PairTable, ScoringContext, Summary, scorers_of
from pliant.evaluator.scorers.match_scoring import score_matches
from pliant.evaluator.scorers.surfaces import Surfaces
from pliant.evaluator.scores import SCORES_VERSION, Scores, pair_table, tool_versions
from pliant.evaluator.statistics.bootstrap import Clusters, intervals
from pliant.evaluator.statistics.ratios import ratios_of
from pliant.evaluator.submission.answers import Answers
from pliant.evaluator.submission.blocks import check_truth, read_blocks
from pliant.evaluator.submission.hints import TruthHints, hints_without_truth
from pliant.evaluator.submission.in_memory import Given
from pliant.evaluator.submission.loading import Loaded, load, load_in_memory
from pliant.evaluator.submission.matches import Matches
from pliant.evaluator.submission.problems import Problems
from pliant.evaluator.submission.scratch import MEMORY_LIMIT_BYTES, Scratch
from pliant.spec.dataset import Dataset
from pliant.spec.errors import CallError, SubmissionError
from pliant.spec.io.checksums import sha256_file
from pliant.spec.storage import layout

Progress = Callable[[int, int], None]

_ROWS_WITH_IMAGES: Final = 1 << 13


def evaluate(
    submission: Path | str,
    data: Dataset | Path | str,
    *,
    truth: Path | str | None = None,
    protocol: str | None = None,
    allow_missing: bool = False,
    hide_truth: bool = False,
    memory_limit_bytes: int = MEMORY_LIMIT_BYTES,
    progress: Progress | None = None,
) -> Scores:
    """Score a submission.

    Args:
        submission: The submission's file.
        data: The dataset, or its folder.
        truth: The split's truth, or the private half of a published dataset, which also brings
            the surfaces; None takes the dataset's own.
        protocol: Name of a protocol; None takes `standard` for answers, `matches` for matches.
        allow_missing: Score a query without an answer as the worst value instead of refusing.
        hide_truth: Cap every error at the image diagonal, for scores that participants of a
            competition see: uncapped errors tell single answers. Hints that need the truth are
            left out too. See `public_scores`.
        memory_limit_bytes: Arrays as long as the split go to temporary files beyond this.
        progress: Called with (pairs scored, pairs in all) now and then.

    Returns:
        The scores.

    Raises:
        SubmissionError: Something is wrong with the submission; `issues` has it all.
        SpecError: The dataset or the truth is at fault.
        CallError: No such protocol, or one for another kind of submission.
    """
    dataset = data if isinstance(data, Dataset) else Dataset.open(data)
    if truth is not None and Path(truth).is_dir():
        dataset, truth = dataset.with_private(truth), None
    rules = None if protocol is None else read_protocol(protocol)
    problems = Problems(submission)
    with Scratch(memory_limit_bytes) as scratch:
        loaded = load(Path(submission), dataset, problems, scratch, allow_missing=allow_missing)
        return _scored(loaded, problems, dataset, truth, rules, scratch, progress, hide_truth)


def evaluate_answers(
    data: Dataset | Path | str,
    split: str,
    answers: Given,
    *,
    method: str = "answers in memory",
    truth: Path | str | None = None,
    protocol: str | None = None,
    allow_missing: bool = False,
    progress: Progress | None = None,
) -> Scores:
    """Score answers that are in memory, as `evaluate` scores the file that holds them.

    Args:
        data: The dataset, or its folder.
        split: The split that is answered.
        answers: The positions alone, float32 or float64 (R, 2), pixels, in the order of the
            split's queries; or a mapping or `pyarrow.Table` with the columns of a submission
            (`u`, `v`, and where given `visible`, `sigma`, `modes`). With the columns `pair_id`
            and `query_id` the rows may be in any order.
        method: Name of the method in the scores.
        truth: As for `evaluate`.
        protocol: As for `evaluate`.
        allow_missing: As for `evaluate`.
        progress: As for `evaluate`.

    Raises:
        SubmissionError: Something is wrong with the answers; `issues` has it all.
        SpecError: The dataset or the truth is at fault.
        CallError: No such protocol or split, or the answers are not columns of one length.
    """
    dataset = data if isinstance(data, Dataset) else Dataset.open(data)
    if truth is not None and Path(truth).is_dir():
        dataset, truth = dataset.with_private(truth), None
    rules = None if protocol is None else read_protocol(protocol)
    problems = Problems(method)
    with Scratch() as scratch:
        loaded = load_in_memory(
            answers, dataset, split, method, problems, scratch, allow_missing=allow_missing
        )
        return _scored(loaded, problems, dataset, truth, rules, scratch, progress, False)


def _scored(
    loaded: Loaded | None,
    problems: Problems,
    dataset: Dataset,
    truth: Path | str | None,
    chosen: Protocol | None,
    scratch: Scratch,
    progress: Progress | None,
    hide_truth: bool,
) -> Scores:
    """Score a submission that was read; refuse one with problems."""
    if loaded is None:
        raise _refusal(problems)
    kind = loaded.submission.kind
    rules = chosen or read_protocol("matches" if kind == "matches" else "standard")
    if kind != rules.kind:
        raise CallError(
            f"protocol {rules.name} scores submissions of kind {rules.kind}",
            path=problems.path,
            found=f"kind {kind}",
            fix="Use --protocol matches for keypoint matches, another for answers.",
        )
    split = loaded.submission.split
    truth_path = _truth_path(dataset, split, truth)
    if rules.kind == "answers":
        queries_sha256 = str(loaded.submission.footer["queries_sha256"])
        check_truth(truth_path, dataset.id, dataset.version, split, queries_sha256)
    return _score(loaded, dataset, truth_path, rules, scratch, progress, hide_truth)


def _refusal(problems: Problems) -> SubmissionError:
    issues = problems.issues()
    codes = ", ".join(f"{code} {total:,}" for code, total in problems.totals.items())
    return SubmissionError(
        "the submission cannot be scored",
        issues=issues,
        path=problems.path,
        found=f"{problems.total:,} problem{'s' if problems.total > 1 else ''} ({codes})",
        fix=f"The first: {issues[0].where + ': ' if issues[0].where else ''}{issues[0].message}",
    )


def _score(
    loaded: Loaded,
    dataset: Dataset,
    truth: Path,
    protocol: Protocol,
    scratch: Scratch,
    progress: Progress | None,
    hide_truth: bool,
) -> Scores:
    queries = loaded.queries
    table = PairTable(queries.pairs)
    groups = Groups.of(queries)
    summary = Summary()
    surfaces = Surfaces(dataset, _search_px(protocol))
    hints: tuple[str, ...] = ()
    if isinstance(loaded.answers, Matches):
        score_matches(
            loaded.answers, queries, protocol.metrics, table, groups, summary, surfaces, progress
        )
        coverage = float((np.diff(loaded.answers.starts) > 0).mean())
    else:
        context = ScoringContext(dataset, queries, loaded.answers, table, scratch, surfaces)
        hints = _score_answers(context, truth, protocol, groups, summary, progress, hide_truth)
        coverage = loaded.answers.answered / queries.rows
    ratios = ratios_of(protocol.metrics)
    for ratio in ratios:
        above, below = ratio.terms(table.columns)
        for index, name in groups:
            mask = groups.masks[index]
            value = ratio.finish(np.array(above[mask].sum()), np.array(below[mask].sum()))
            summary.set(name, ratio.name, float(value))
    clusters = Clusters.of(queries.sequence_a, queries.tier, len(queries.tiers))
    found = intervals(ratios, table.columns, clusters, protocol.bootstrap)
    document = _document(loaded, dataset, truth, protocol, groups, summary, coverage, found, table)
    if hide_truth:
        document["hide_truth"] = True
    examples = () if hide_truth else choose_examples(loaded.answers, queries, table.columns, truth)
    return Scores(document, pair_table(queries, table.columns), examples, hints)


def _score_answers(
    context: ScoringContext,
    truth: Path,
    protocol: Protocol,
    groups: Groups,
    summary: Summary,
    progress: Progress | None,
    hide_truth: bool,
) -> tuple[str, ...]:
    """Run the scorers over the blocks of a split; return hints about the answers."""
    scorers = scorers_of(protocol.metrics, context)
    wanted = sorted({column for scorer in scorers for column in scorer.truth_columns})
    answers: Answers = context.answers
    if "distribution" in protocol.metrics and "symmetry" not in protocol.metrics:
        has = answers.sigma_px is not None or answers.modes is not None
        wanted = wanted if has else [name for name in wanted if name != "alternatives"]
    blocks = read_blocks(
        context.queries,
        truth,
        answers,
        truth_columns=wanted,
        query_pixels=any(scorer.query_pixels for scorer in scorers),
        # Where surface images are read too, they take the time: shorter blocks show progress.
        block_rows=_ROWS_WITH_IMAGES if _has_images(context.dataset) else None,
        cap_errors=hide_truth,
    )
    hints = None if hide_truth else TruthHints(answers, context.queries)
    for block in blocks:
        if hints is not None:
            hints.update(block)
        for scorer in scorers:
            scorer.update(block)
        if progress is not None:
            progress(block.pairs.stop, context.queries.pairs)
    for scorer in scorers:
        scorer.finish(groups, summary)
    found = () if hints is None else hints.found()
    return (*hints_without_truth(answers, context.queries), *found)


def _ordered(values: Mapping[str, float | None]) -> dict[str, float | None]:
    """Return metrics in the order a reader looks for them: quantiles after the mean, and so on."""
    quantiles = [n for n in values if n == "median_px" or (n[0] == "p" and n[1:2].isdigit())]
    after = {"mean_px": quantiles, "jump_rate": [n for n in values if n.startswith("stretch_")]}
    after["nll"] = [name for name in ("ece", "ause") if name in values]
    moved = {name for names in after.values() for name in names}
    order: list[str] = []
    for name in values:
        if name not in moved:
            order += [name, *after.pop(name, [])]
    order += [name for names in after.values() for name in names]
    return {name: values[name] for name in order}


def _truth_path(dataset: Dataset, split: str, given: Path | str | None) -> Path:
    """Return the truth file: the one given, the dataset's own, or where that would be."""
    if given is not None:
        return Path(given)
    name = layout.truth_name(split)
    return dataset.local(name) if dataset.has(name) else dataset.root / name


def _has_images(dataset: Dataset) -> bool:
    return any(sequence.has(layout.depth_name(0)) for sequence in dataset.sequences[-1:])


def _search_px(protocol: Protocol) -> int:
    return int(protocol.metrics.get("geodesic", {}).get("search_px", 1))


def _document(
    loaded: Loaded,
    dataset: Dataset,
    truth: Path,
    protocol: Protocol,
    groups: Groups,
    summary: Summary,
    coverage: float,
    found: list[dict[str, list[float]]],
    table: PairTable,
) -> dict[str, Any]:
    """Return what scores.json holds."""
    submission, queries = loaded.submission, loaded.queries
    counts: Mapping[str, Any] = table.columns

    def total(name: str) -> int:
        return int(counts[name].sum()) if name in counts else 0

    sequences = [len(np.unique(queries.sequence_a[mask])) for mask in groups.masks]
    return {
        "scores_version": SCORES_VERSION,
        "protocol": protocol.name,
        "protocol_version": protocol.version,
        "protocol_sha256": protocol.sha256,
        "headline": list(protocol.headline),
        "dataset": {
            "id": dataset.id,
            "version": dataset.version,
            "title": dataset.info["title"],
            "image_size": list(queries.size),
            "queries_sha256": submission.footer["queries_sha256"],
            "truth_sha256": sha256_file(truth) if protocol.kind == "answers" else None,
        },
        "split": queries.split,
        "submission": {
            "file": submission.name,
            "sha256": submission.sha256(),
            "kind": submission.kind,
            "rows": submission.rows,
            "columns": sorted(submission.columns),
            "method": dict(submission.footer["method"]),
        },
        "coverage": coverage,
        "counts": {
            "pairs": queries.pairs,
            "queries": queries.rows,
            "counted": total("counted"),
            "sequences": dict(zip(groups.names, sequences, strict=True)),
        },
        "overall": _ordered(summary.values.get(groups.names[0], {})),
        "tiers": {name: _ordered(summary.values.get(name, {})) for name in groups.names[1:]},
        "intervals": {
            "level": protocol.bootstrap["level"],
            "overall": found[0],
            "tiers": dict(zip(groups.names[1:], found[1:], strict=True)),
        },
        "curves": summary.curves,
        "slices": summary.slices,
        "notes": summary.notes,
        "tools": tool_versions(),
    }
