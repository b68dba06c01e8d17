"""Compares a run with answers that do not use the image.

A network can satisfy a cycle without following anything: by staying where it is (identity) or
by always answering the middle of the object (centroid). An untrained encoder tells what the
propagation does by itself. A run states all three next to its own errors.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

from pliant.models.timecycle.matcher import TimeCycleMatcher
from pliant.models.timecycle.validation import (
    LISTED,
    Stretch,
    curve,
    errors_over_time,
    track_centroid,
    track_identity,
    track_with,
)

RIVALS = ("identity", "centroid", "untrained")


@dataclass(frozen=True)
class Guard:
    """The run against its rivals, on the same stretches and points.

    Attributes:
        curves: Method -> RMSE for each number of frames since the query, px of a picture 640
            wide; `trained` and each of `RIVALS`.
    """

    curves: dict[str, list[float]]

    def beats(self, rival: str, frames: int) -> bool:
        """Return whether the run has the lower error so many frames after the query."""
        return self.curves["trained"][frames - 1] < self.curves[rival][frames - 1]

    @property
    def listed(self) -> list[int]:
        """The numbers of frames that are listed: those after which a point is seen."""
        values = self.curves["trained"]
        return [
            frames
            for frames in LISTED
            if frames <= len(values) and math.isfinite(values[frames - 1])
        ]

    def verdict(self) -> str:
        """Return in words what the run beats and what not."""
        lost = [
            f"{rival} after {frames} frame{'s' if frames > 1 else ''}"
            for frames in self.listed
            for rival in RIVALS
            if not self.beats(rival, frames)
        ]
        if not lost:
            return "The run beats identity, centroid and an untrained encoder at every listed time."
        return "The run does NOT beat " + ", ".join(lost) + "."

    def as_dict(self) -> dict[str, object]:
        """Return the listed figures and the verdict as a JSON object."""
        rmse = {
            name: {str(frames): values[frames - 1] for frames in self.listed}
            for name, values in self.curves.items()
        }
        return {"rmse_px_of_640": rmse, "verdict": self.verdict()}


def compare_with_trivial(
    trained: TimeCycleMatcher, untrained: TimeCycleMatcher, stretches: Sequence[Stretch]
) -> Guard:
    """Measure a run and its rivals on validation stretches.

    Args:
        trained: The run.
        untrained: The same network with the weights it began with.
        stretches: From `draw_stretches`.
    """
    methods = {
        "trained": track_with(trained),
        "identity": track_identity,
        "centroid": track_centroid,
        "untrained": track_with(untrained),
    }
    return Guard(
        {name: curve(errors_over_time(track, stretches)) for name, track in methods.items()}
    )
