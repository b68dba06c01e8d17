"""Keypoint matching of `transformers`: LightGlue, EfficientLoFTR, MatchAnything and others."""

from __future__ import annotations

from typing import Any, Final

import numpy as np

from pliant.baselines.adapters.images import to_array
from pliant.baselines.adapters.interpolation import Interpolation
from pliant.baselines.adapters.sparse import SparseMatcher
from pliant.baselines.modern.loading import library, pretrained
from pliant.spec.answers import Matches
from pliant.spec.frame import Frame


class KeypointMatching(SparseMatcher):
    """Networks that `transformers` loads as AutoModelForKeypointMatching.

    The library rounds its keypoints down to whole pixels; here the network's own positions are
    taken, and half a pixel is added: they count from the centre of the first pixel.

    Args:
        weights: A folder, or an id on the Hugging Face Hub, such as `ETH-CVG/lightglue_superpoint`,
            `zju-community/efficientloftr` or `zju-community/matchanything_eloftr`.
        device: A torch device.
        threshold: Least score of a match, 0 to 1.
        interpolation: How queries follow from the matches: `nearest`, `affine` or `thin-plate`.
    """

    library: Final = "transformers"
    name = "keypoint-matching"

    def __init__(
        self,
        weights: str,
        device: str = "cpu",
        threshold: float = 0.2,
        interpolation: Interpolation = "affine",
    ) -> None:
        transformers = library(self.library, self.name, "pip install 'pliant[modern]'")
        self._processor = pretrained(transformers.AutoImageProcessor, weights)
        model = pretrained(transformers.AutoModelForKeypointMatching, weights)
        self._model = model.to(device).eval()
        self._device, self._threshold = device, threshold
        facts = {
            "implementation": f"transformers {type(model).__name__}",
            "version": transformers.__version__,
            "weights": weights,
            "threshold": threshold,
        }
        super().__init__(self._matches, self.name, interpolation, facts=facts)

    def _matches(self, source: Frame, target: Frame) -> Matches:
        import torch

        inputs = self._processor([source.rgb, target.rgb], return_tensors="pt").to(self._device)
        with torch.inference_mode():
            found = self._model(**inputs)
        height, width = inputs["pixel_values"].shape[-2:]
        # Relative positions of the pair's keypoints, (2, K, 2): index over the side.
        at = to_array(found.keypoints)[0] + 0.5 / np.array([width, height])
        matches = to_array(found.matches)[0].astype(np.int64)  # (2, K)
        score = to_array(found.matching_scores)[0]
        first, second = self._indices(matches, score[0])
        return Matches(
            (at[0][first] * source.rgb.shape[1::-1]).astype(np.float32),
            (at[1][second] * target.rgb.shape[1::-1]).astype(np.float32),
            score[0][first].astype(np.float32),
        )

    def _indices(self, matches: Any, score: Any) -> tuple[Any, Any]:
        """Return the matched keypoints of both images.

        Detectors match keypoint k to keypoint `matches[0, k]`. Networks without a detector list
        matches, so that both keypoints of a match have one place.
        """
        good = (matches[0] >= 0) & (score > self._threshold)
        if hasattr(self._model, "keypoint_detector"):
            first = np.flatnonzero(good)
            return first, matches[0][first]
        both = np.flatnonzero(good & (matches[1] >= 0))
        return both, both
