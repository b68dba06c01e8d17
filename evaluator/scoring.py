"""Scores a submission that was read: its blocks pass the metrics, and the sums become figures."""

from __future__ import annotations

from collections.abc import Iterable
from importlib.metadata import version
from pathlib import Path
from typing import Any, Final

import numpy as np

from pliant.evaluator.controls import Controls
from pliant.evaluator.examples import Example, choose_examples
from pliant.evaluator.metrics.base import (
    OVERALL,
    Groups,
    Metric,
    NoSettings,
    PairTable,
    ScoringContext,
    Summary,
)
from pliant.evaluator.metrics.blocks import BLOCK_ROWS, read_blocks, read_tables
from pliant.evaluator.metrics.causes import CAUSES_VERSION, Causes, CausesSettings
from pliant.evaluator.metrics.localisation import Counts
from pliant.evaluator.metrics.matches import match_blocks
from pliant.evaluator.metrics.surfaces import Surfaces, prefetched
from pliant.evaluator.protocols.protocol import Protocol, metric_class, recorded
from pliant.evaluator.scores import SCORES_VERSION, Scores, pair_table
from pliant.evaluator.statistics.bootstrap import intervals
from pliant.evaluator.statistics.crossing import Crossing
from pliant.evaluator.statistics.ratios import Ratio
from pliant.evaluator.submission.answers import PlacedAnswers, PlacedMatches, coordinate_hints
from pliant.evaluator.submission.loading import Loaded
from pliant.evaluator.truth_hints import TruthHints
from pliant.spec.dataset import Dataset
from pliant.spec.io.reading import sha256_file
from pliant.spec.progress import Progress
from pliant.spec.storage import layout

_PAIRS_WITH_IMAGES: Final = 1024
"""Where surface images are read, they take the time: shorter blocks show progress, and leave less
to the last of several processes."""


def score(
    loaded: Loaded,
    dataset: Dataset,
    truth: Path,
    protocol: Protocol,
    *,
    hide_truth: bool,
    progress: Progress | None,
    workers: int = 1,
) -> Scores:
    """Score a submission.

    Args:
        loaded: A submission in which nothing is wrong.
        dataset: The dataset.
        truth: The split's truth file.
        protocol: A protocol for submissions of this kind.
        hide_truth: As for `evaluate`.
        progress: As for `evaluate`.
        workers: As for `evaluate`.

    Raises:
        SpecError: The dataset or the truth is at fault.
    """
    queries = loaded.queries
    has_images = any(each.has(layout.depth_name(0)) for each in dataset.sequences[-1:])
    answers = loaded.answers if isinstance(loaded.answers, PlacedAnswers) else None
    has_causes = has_images and answers is not None and not hide_truth
    context = _context(loaded, dataset, protocol, has_causes)
    metrics: list[Metric[Any]] = [Counts(NoSettings(), context)]
    for family, settings in protocol.settings.items():
        metrics.append(metric_class(family)(settings, context))
    causes = hints = controls = None
    if answers is not None and not hide_truth:
        if has_causes:
            causes = Causes(CausesSettings(), context)
            metrics.append(causes)
        hints, controls = TruthHints(answers, queries), Controls(queries.rows)
    observers: list[Metric[Any] | TruthHints | Controls] = [*metrics]
    observers += [each for each in (hints, controls) if each is not None]
    tables = None
    if isinstance(loaded.answers, PlacedMatches):
        footprints = protocol.settings["matches"].visible_within_footprints
        blocks = match_blocks(loaded.answers, context, footprints)
    else:
        truth_columns = sorted({column for each in metrics for column in each.truth_columns})
        query_pixels = not hide_truth or any(each.query_pixels for each in metrics)
        tables = read_tables(queries, truth, truth_columns, query_pixels=query_pixels)
        rows = min(BLOCK_ROWS, _PAIRS_WITH_IMAGES * -(-queries.rows // queries.pairs))
        blocks = read_blocks(
            queries, tables, loaded.answers, rows if has_images else None, cap_errors=hide_truth
        )
    if workers > 1 and has_images and (has_causes or "geodesic" in protocol.settings):
        blocks = prefetched(blocks, context.surfaces, queries, workers)
    for block in blocks:
        for each in observers:
            each.update(block)
        if progress is not None:
            progress(block.pairs.stop, queries.pairs)
    summary = _summary(loaded, protocol, context, metrics)
    method = str(loaded.submission.footer["method"]["name"])
    if controls is not None and (said := controls.sentence(method)) is not None:
        summary.notes["controls"] = said
    document = {
        **_provenance(loaded, dataset, truth, protocol),
        **_results(loaded, protocol, context, summary),
        "tools": {name: version(name) for name in ("pliant", "numpy", "pyarrow")},
        **({"hide_truth": True} if hide_truth else {}),
    }
    columns = context.table.columns
    examples: tuple[Example, ...] = ()
    if answers is not None and tables is not None and not hide_truth:
        codes = None if causes is None else causes.codes
        examples = choose_examples(answers, queries, columns, tables, codes)
    sentences = [] if answers is None else coordinate_hints(answers, queries)
    sentences += [] if hints is None else hints.found()
    return Scores(document, pair_table(queries, columns), examples, tuple(sentences))


def _context(
    loaded: Loaded, dataset: Dataset, protocol: Protocol, has_causes: bool
) -> ScoringContext:
    queries, settings, answers = loaded.queries, protocol.settings, loaded.answers
    names = [x for r in protocol.ratios.values() for x in (r.numerator, r.denominator)]
    search_px = settings["geodesic"].search_px if "geodesic" in settings else 1
    reach_px = CausesSettings().precise * max(queries.size) if has_causes else 0
    silhouettes = "slices" in settings and bool(settings["slices"].silhouette_px)
    surfaces = Surfaces(dataset, search_px, reach_px, silhouettes=silhouettes)
    rows = answers.answers if isinstance(answers, PlacedMatches) else answers
    return ScoringContext(dataset, queries, rows, PairTable(queries.pairs, names), surfaces)


def _summary(
    loaded: Loaded,
    protocol: Protocol,
    context: ScoringContext,
    metrics: Iterable[Metric[Any]],
) -> Summary:
    """Return the metrics' own results and the quotient of every ratio, by group."""
    queries, answers = loaded.queries, loaded.answers
    starts = answers.starts if isinstance(answers, PlacedMatches) else queries.starts
    summary, groups = Summary(), Groups.of(queries, starts)
    for metric in metrics:
        metric.finish(groups, summary)
    for ratio in protocol.ratios.values():
        above, below = ratio.terms(context.table.columns)
        for index, name in groups:
            mask = groups.masks[index]
            value = ratio.finish(np.array(above[mask].sum()), np.array(below[mask].sum()))
            summary.set(name, ratio.name, float(value))
    return summary


def _results(
    loaded: Loaded, protocol: Protocol, context: ScoringContext, summary: Summary
) -> dict[str, Any]:
    """Return the part of scores.json that says what was found."""
    queries, answers, columns = loaded.queries, loaded.answers, context.table.columns
    ratios: list[Ratio] = list(protocol.ratios.values())
    crossing = Crossing.of(queries.sequence_a, queries.sequence_b, queries.tier, len(queries.tiers))
    overall_intervals, *tier_intervals = intervals(ratios, columns, crossing, protocol.bootstrap)
    sizes = crossing.sizes()
    sequences = {OVERALL: int(sizes.sum()), **dict(zip(queries.tiers, sizes.tolist(), strict=True))}

    def values(group: str) -> dict[str, float | None]:
        found = summary.values.get(group, {})
        return {figure: found[figure] for figure in protocol.figures if figure in found}

    if isinstance(answers, PlacedMatches):
        coverage = float((np.diff(answers.starts) > 0).mean())
    else:
        coverage = answers.answered / queries.rows
    document = {
        "coverage": coverage,
        "counts": {
            "pairs": queries.pairs,
            "queries": queries.rows,
            "counted": int(columns["counted"].sum()),
            "sequences": sequences,
        },
        "overall": values(OVERALL),
        "tiers": {tier: values(tier) for tier in queries.tiers},
        "intervals": {
            "level": protocol.bootstrap.level,
            "overall": overall_intervals,
            "tiers": dict(zip(queries.tiers, tier_intervals, strict=True)),
        },
        "curves": summary.curves,
        "slices": summary.slices,
        "notes": summary.notes,
    }
    if summary.causes:
        tiers = {group: found for group, found in summary.causes.items() if group != OVERALL}
        overall = summary.causes[OVERALL]
        document["causes"] = {"version": CAUSES_VERSION, "overall": overall, "tiers": tiers}
    return document


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
        **recorded(protocol),
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
            "sha256": submission.sha256,
            "kind": submission.kind,
            "rows": submission.rows,
            "columns": sorted(submission.columns),
            "method": dict(submission.footer["method"]),
        },
    }
