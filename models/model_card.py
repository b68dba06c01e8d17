"""The card of a shipped model: what it is, its data, recipe, scores and limits."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from pliant.evaluator.report.cells import heading, score_cell
from pliant.evaluator.report.pages import render_page
from pliant.evaluator.report.verdict import joined
from pliant.models.don.settings import FurtherSet
from pliant.spec.text import duration


def model_card(
    *,
    name: str,
    settings: Mapping[str, Any],
    facts: Mapping[str, Any],
    dataset: Mapping[str, Any],
    parameters: int,
    training_s: float | None,
    reports: Sequence[Mapping[str, Any]] = (),
    further: Sequence[Mapping[str, Any]] = (),
    stage: str = "",
) -> str:
    """Return the card as Markdown.

    Args:
        name: The model's name.
        settings: The run's config.
        facts: Its `run.json`.
        dataset: `dataset.json` of its training set.
        parameters: Number of weights.
        training_s: Wall time of the training, seconds, or None.
        reports: The documents of `scores.json` of its evaluations.
        further: `dataset.json` of each other set that it was trained on.
        stage: The stage of a recipe that the run is; empty for a run of its own.
    """
    return render_page(
        "model_card.md.j2",
        package="pliant.models",
        name=name,
        kind=str(settings.get("kind", "don")),
        tiers=_tiers(str(facts["tier"]), settings.get("also", ())),
        settings={"threads": 0, "precision": "", "validation": {}, **settings},
        answer={"decode": "", "search": "", **settings.get("answer", {})},
        facts={"network": "", "mean_of": (), **facts},
        figures=facts.get("validation", {}),
        dataset=dataset,
        config=_generated(dataset)["provenance"].get("config"),
        parameters=parameters,
        training_time="not recorded" if training_s is None else duration(training_s),
        reports=reports,
        further=[_generated(each) for each in further],
        stage=stage,
        inline=_inline,
        span=lambda values: f"{values[0]:g} to {values[1]:g}",
        heading=heading,
        score_cell=score_cell,
    )


def _generated(dataset: Mapping[str, Any]) -> Mapping[str, Any]:
    """Return a `dataset.json` that has a config only if it is one of `pliant generate`.

    The config of other datasets is free: the card cannot describe it.
    """
    provenance = dataset["provenance"]
    if {"splits", "frames", "camera", "look"} <= (provenance.get("config") or {}).keys():
        return dataset
    return {**dataset, "provenance": {**provenance, "config": None}}


def _tiers(first: str, also: Sequence[str]) -> str:
    """Return the tiers of a training and of its other sets, `DATA#TIER` each, as a phrase."""
    others = (FurtherSet.parse(each).tier or first for each in also)
    tiers = [f"`{tier}`" for tier in sorted({first, *others})]
    return f"{'tiers' if len(tiers) > 1 else 'tier'} {joined(tiers)}"


def _inline(values: Mapping[str, Any]) -> str:
    return ", ".join(f"{key} {_plain(value)}" for key, value in values.items() if value != "")


def _plain(value: Any) -> str:
    if isinstance(value, list):
        return f"[{', '.join(_plain(item) for item in value)}]"
    if isinstance(value, bool):
        return "yes" if value else "no"
    return f"{value:g}" if isinstance(value, float) else str(value)
