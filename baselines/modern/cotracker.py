"""The point tracker CoTracker3 (Karaev et al. 2024), by the package `cotracker`."""

from __future__ import annotations

from typing import Any, Final

import numpy as np
import numpy.typing as npt

from pliant.baselines.adapters.images import Images
from pliant.baselines.adapters.trackers import TrackerMatcher
from pliant.baselines.modern.loading import library, state_dict

_WINDOW: Final = 60
"""Frames that the offline network sees at once."""


class CoTracker(TrackerMatcher):
    """CoTracker3, offline. It resizes frames itself.

    Args:
        weights: The file `scaled_offline.pth`.
        device: A torch device.
        window: Most frames of a clip, >= 2; longer episodes go on from the last frame's answers.
        batch: Most points of a call.
    """

    library: Final = "cotracker"

    def __init__(
        self, weights: str, device: str = "cpu", window: int = _WINDOW, batch: int | None = None
    ) -> None:
        install = "pip install git+https://github.com/facebookresearch/co-tracker"
        predictor = library("cotracker.predictor", "cotracker", install)
        self._model = predictor.CoTrackerPredictor(
            checkpoint=None, offline=True, v2=False, window_len=_WINDOW
        )
        self._model.model.load_state_dict(state_dict(weights, device))
        self._model = self._model.to(device).eval()
        images = Images(device=device, coordinates="index")
        super().__init__(self._tracks, "cotracker", images, window, batch, {"weights": weights})

    def _tracks(self, frames: Any, points: npt.NDArray[np.float32]) -> tuple[Any, Any]:
        queries = np.concatenate([np.zeros_like(points[:, :1]), points], axis=1)  # (t, x, y)
        asked = frames.new_tensor(queries)[None]
        tracks, visible = self._model(255 * frames[None], queries=asked)
        return tracks, visible.float()
