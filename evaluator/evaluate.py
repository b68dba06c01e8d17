"""Scores a submission by a named protocol."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any, Final

import numpy as np

from pliant.evaluator.controls import Controls
from pliant.evaluator.metrics.base import (
    OVERALL,
    Groups,
    Metric,
    NoSettings,
    PairTable,
    ScoringContext,
    Summary,
)
from pliant.evaluator.metrics.causes import CAUSES_VERSION, Causes, CausesSettings
from pliant.evaluator.metrics.localisation import Counts
from pliant.evaluator.metrics.matches import match_blocks
from pliant.evaluator.metrics.surfaces import Surfaces
from pliant.evaluator.protocols.protocol import Protocol, metric_class, read_protocol
from pliant.evaluator.report.examples import Example, choose_examples
from pliant.evaluator.scores import SCORES_VERSION, Scores, pair_table, tool_versions
from pliant.evaluator.statistics.bootstrap import Clusters, intervals
from pliant.evaluator.submission.answers import MEMORY_LIMIT_BYTES, Answers, Scratch
from pliant.evaluator.submission.blocks import check_truth, read_blocks
from pliant.evaluator.submission.hints import TruthHints, hints_without_truth
from pliant.evaluator.submission.loading import Given, Loaded, load, load_in_memory
from pliant.evaluator.submission.matches import Matches
from pliant.evaluator.submission.problems import Problems
from pliant.spec.dataset import Dataset
from pliant.spec.errors import CallError, SubmissionError
from pliant.spec.io.reading import sha256_file
from pliant.spec.storage import layout

Progress = Callable[[int, int], None]

_ROWS_WITH_IMAGES: Final = 1 << 13


def evaluate(
    submission: Path | str,
    data: Dataset | Path | str,
    *,
    truth: Path | str | None = None,
    protocol: str | Protocol | None = None,
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
        protocol: A protocol or its name; None takes `standard` for answers, `matches` for matches.
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
    rules = read_protocol(protocol) if isinstance(protocol, str) else protocol
    problems = Problems(submission)
    scratch = Scratch(memory_limit_bytes)
    loaded = load(Path(submission), dataset, problems, scratch, allow_missing=allow_missing)
    return _scored(loaded, problems, dataset, truth, rules, scratch, progress, hide_truth)


def evaluate_answers(
    data: Dataset | Path | str,
    split: str,
    answers: Given,
    *,
    method: str = "answers in memory",
    truth: Path | str | None = None,
    protocol: str | Protocol | None = None,
    allow_missing: bool = False,
    progress: Progress | None = None,
) -> Scores:
    """Score answers that are in memory, as `evaluate` scores the file that contains them.

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
    rules = read_protocol(protocol) if isinstance(protocol, str) else protocol
    problems = Problems(method)
    scratch = Scratch()
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
    codes = ", ".join(f"{code} {total:,}" for code, total in problems.counts.items())
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
    queries, settings = loaded.queries, protocol.settings
    ratios = list(protocol.ratios.values())
    matches = loaded.answers if isinstance(loaded.answers, Matches) else None
    answers = loaded.answers if isinstance(loaded.answers, Answers) else loaded.answers.answers
    table = PairTable(queries.pairs, [x for r in ratios for x in (r.numerator, r.denominator)])
    search_px = settings["geodesic"].search_px if "geodesic" in settings else 1
    explained = CausesSettings()
    surfaces = Surfaces(dataset, search_px, explained.precise * max(queries.size))
    context = ScoringContext(dataset, queries, answers, table, scratch, surfaces)
    metrics: list[Metric[Any]] = [Counts(NoSettings(), context)]
    metrics += [metric_class(family)(values, context) for family, values in settings.items()]
    causes = None
    if matches is None and not hide_truth and _has_images(dataset):
        causes = Causes(explained, context)
        metrics.append(causes)
    hints = controls = None
    if matches is not None:
        coverage = float((np.diff(matches.starts) > 0).mean())
        blocks = match_blocks(matches, context, settings["matches"].visible_within_footprints)
    else:
        coverage = answers.answered / queries.rows
        blocks = read_blocks(
            queries,
            truth,
            answers,
            truth_columns=sorted({column for each in metrics for column in each.truth_columns}),
            query_pixels=not hide_truth or any(each.query_pixels for each in metrics),
            # Where surface images are read too, they take the time: shorter blocks show progress.
            block_rows=_ROWS_WITH_IMAGES if _has_images(dataset) else None,
            cap_errors=hide_truth,
        )
        if not hide_truth:
            hints, controls = TruthHints(answers, queries), Controls(queries.rows)
    watching = [each for each in (*metrics, hints, controls) if each is not None]
    for block in blocks:
        for each in watching:
            each.update(block)
        if progress is not None:
            progress(block.pairs.stop, queries.pairs)
    summary = Summary()
    groups = Groups.of(queries, queries.starts if matches is None else matches.starts)
    for metric in metrics:
        metric.finish(groups, summary)
    for ratio in ratios:
        above, below = ratio.terms(table.columns)
        for index, name in groups:
            mask = groups.masks[index]
            value = ratio.finish(np.array(above[mask].sum()), np.array(below[mask].sum()))
            summary.set(name, ratio.name, float(value))
    clusters = Clusters.of(queries.sequence_a, queries.tier, len(queries.tiers))
    found = intervals(ratios, table.columns, clusters, protocol.bootstrap)
    sequences = [len(np.unique(queries.sequence_a[mask])) for mask in groups.masks]
    overall, *tiers = (
        {figure: values[figure] for figure in protocol.figures if figure in values}
        for values in (summary.values.get(name, {}) for name in groups.names)
    )
    method = str(loaded.submission.footer["method"]["name"])
    if controls is not None and (said := controls.sentence(method)) is not None:
        summary.notes["controls"] = said
    document = {
        **_provenance(loaded, dataset, truth, protocol),
        "coverage": coverage,
        "counts": {
            "pairs": queries.pairs,
            "queries": queries.rows,
            "counted": int(table.columns["counted"].sum()),
            "sequences": dict(zip(groups.names, sequences, strict=True)),
        },
        "overall": overall,
        "tiers": dict(zip(groups.names[1:], tiers, strict=True)),
        "intervals": {
            "level": protocol.bootstrap.level,
            "overall": found[0],
            "tiers": dict(zip(groups.names[1:], found[1:], strict=True)),
        },
        "curves": summary.curves,
        "slices": summary.slices,
        "notes": summary.notes,
        "tools": tool_versions(),
    }
    if hide_truth:
        document["hide_truth"] = True
    if summary.causes:
        document["causes"] = {
            "version": CAUSES_VERSION,
            "overall": summary.causes.pop(OVERALL),
            "tiers": summary.causes,
        }
    examples: tuple[Example, ...] = ()
    if not hide_truth:
        codes = None if causes is None else causes.codes
        examples = choose_examples(loaded.answers, queries, table.columns, truth, codes)
    sentences = [] if matches is not None else hints_without_truth(answers, queries)
    sentences += [] if hints is None else hints.found()
    return Scores(document, pair_table(queries, table.columns), examples, tuple(sentences))


def _truth_path(dataset: Dataset, split: str, given: Path | str | None) -> Path:
    """Return the truth file: the one given, the dataset's own, or where that would be."""
    if given is not None:
        return Path(given)
    name = layout.truth_name(split)
    return dataset.local(name) if dataset.has(name) else dataset.root / name


def _has_images(dataset: Dataset) -> bool:
    return any(sequence.has(layout.depth_name(0)) for sequence in dataset.sequences[-1:])


def _provenance(
    loaded: Loaded, dataset: Dataset, truth: Path, protocol: Protocol
) -> dict[str, Any]:
    """Return the part of scores.json that says what was scored, and how."""
    submission, queries = loaded.submission, loaded.queries
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
    }
