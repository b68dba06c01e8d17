"""Compares the scores of a submission with those of trivial answers.

Three controls are computed from the queries and the truth alone: `identity` answers the query's
own pixel; `centroid` the middle of the true positions of the pair's other visible queries; `random`
the true position of one of them. The last two approximate the controls of these names, which
answer the middle of the object's mask and any pixel of it, without reading an image.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Final

import numpy as np

from pliant.evaluator.metrics.blocks import Block
from pliant.evaluator.metrics.errors import endpoint_error_px
from pliant.spec.arrays import FloatArray

CONTROLS: Final = {
    "identity": "answering with the query's own pixel",
    "random": "answering with a random place on the object",
    "centroid": "answering with the middle of the object",
    "oracle": "answering with the truth",
}
"""Control -> what it does. Controls are not methods: pages show them apart and never rank them."""

REASONS: Final = {
    "identity": "frames that change little make standing still a strong answer",
    "centroid": "the middle of the object is nearer than the answers are",
    "random": "any place on the object is as near as the answers are",
}
"""Control -> what it says about a method that it beats."""

_MOST_KEPT: Final = 400_000
_MARGIN: Final = 0.999  # a control that is scored itself does not beat itself


class Controls:
    """Compares a submission's errors with those of controls.

    Args:
        rows: Queries of the split.
    """

    def __init__(self, rows: int) -> None:
        self._step = max(1, rows // _MOST_KEPT)
        self._errors: dict[str, list[FloatArray]] = {name: [] for name in ("method", *REASONS)}

    def update(self, block: Block) -> None:
        """Add the rows of a block whose point is visible in the target."""
        if block.uv_a_px is None:
            return
        counted = block.counted
        count = block.pair_counted.astype(np.int64)
        axes = [block.sum_by_pair(np.where(counted, axis, 0.0)) for axis in block.true_px.T]
        total = np.stack(axes, axis=1)
        chosen = block.counted_rows
        kept = np.arange(0, len(chosen), self._step)
        of_pair, at = block.pair[chosen[kept]], block.true_px[chosen[kept]]
        size = count[of_pair]
        first = (np.cumsum(count) - count)[of_pair]
        other = first + (kept - first + np.maximum(size // 2, 1)) % size
        answers = {
            "identity": block.uv_a_px[chosen[kept]],
            "centroid": (total[of_pair] - at) / np.maximum(size - 1, 1)[:, None],
            "random": block.true_px[chosen[other]],
        }
        own = block.error_px[chosen[kept]]
        self._errors["method"].append(own)
        for name, answer in answers.items():
            error = endpoint_error_px(answer, at)
            if name != "identity":  # a pair's only point has no others
                error = np.where(size > 1, error, own)
            self._errors[name].append(error)

    def sentence(self, method: str) -> str | None:
        """Return which controls beat the submission, and what follows; None for none.

        Args:
            method: Name of the method; a control is not compared with itself.
        """
        errors = {name: np.concatenate(parts) for name, parts in self._errors.items() if parts}
        if not len(errors.get("method", ())):
            return None
        measures: dict[str, Callable[[FloatArray], float]] = {
            "RMSE": lambda error: float(np.sqrt(np.mean(error**2))),
            "median error": lambda error: float(np.median(error)),
        }
        found = []
        for name, reason in REASONS.items():
            better = [
                f"{what} {value:.3g} px against {own:.3g} px"
                for what, measure in measures.items()
                if (value := measure(errors[name])) < _MARGIN * (own := measure(errors["method"]))
            ]
            if better and name != method:
                found.append(f"the control `{name}` is better ({', '.join(better)}): {reason}")
        return "; ".join(found) or None
