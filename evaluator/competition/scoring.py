"""What every platform runs: the function behind `pliant evaluate`, by one protocol."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any, Final

from pliant.evaluator.evaluate import evaluate
from pliant.evaluator.hidden_truth import public_scores
from pliant.evaluator.scores import Scores
from pliant.spec.io.jsonfiles import read_json

COMPETITION_JSON: Final = "competition.json"
"""In the reference data: the split and the protocol of the competition."""


def score(submission: Path, reference: Path) -> Scores:
    """Score a submission against a competition's reference data.

    Args:
        submission: The participant's file.
        reference: The unpacked reference data.

    Returns:
        What participants see of the scores of `pliant evaluate --hide-truth`: the rounded
        headline metrics.

    Raises:
        SubmissionError: Something is wrong with the submission; `issues` has it all.
        CallError: It is of another kind than the competition asks for.
        SpecError: The reference data is at fault.
    """
    rules = read_json(reference / COMPETITION_JSON)
    scores = evaluate(submission, reference, protocol=rules["protocol"], hide_truth=True)
    return replace(public_scores(scores), hints=())


def flat_scores(document: Mapping[str, Any]) -> dict[str, float]:
    """Return the metrics of scores.json by one name each.

    Args:
        document: What scores.json holds.

    Returns:
        `rmse_px` over the split, `rope.rmse_px` over a tier, and so on; a metric without a value
        (no answer gave a distribution, say) is left out.
    """
    groups = {"": document["overall"]}
    groups |= {f"{tier}.": values for tier, values in document["tiers"].items()}
    return {
        f"{prefix}{metric}": value
        for prefix, values in groups.items()
        for metric, value in values.items()
        if value is not None
    }
