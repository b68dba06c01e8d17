"""What a method answers for an image pair: positions of queries, or its own keypoint matches."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
import numpy.typing as npt

MAX_POSITION_PX: Final = 1e6
"""|u| and |v| of an answer. A position outside the image is an answer like any other and is
scored by its distance; a number beyond this bound is invalid."""

MAX_SIGMA_PX: Final = 1e6
"""Largest standard deviation."""

MAX_MODES: Final = 64
"""Largest number of modes of one answer."""

WEIGHT_TOLERANCE: Final = 1e-3
"""The weights of an answer's modes sum to 1 within this."""


@dataclass(frozen=True)
class Answers:
    """Where a method sees N query pixels in the target image.

    Attributes:
        uv_px: float32 (N, 2), finite.
        visible: float32 (N,), probabilities, or None.
        sigma_px: float32 (N,), > 0, or None.
        modes: one float32 (M_i, 4) array per query of (u, v, sigma, weight), or None.
        familiarity: float32 (N,), 0 to 1: the share of the queries of its training domain that
            are at least as unusual as this one, or None. Not part of a submission's rows.
    """

    uv_px: npt.NDArray[np.float32]
    visible: npt.NDArray[np.float32] | None = None
    sigma_px: npt.NDArray[np.float32] | None = None
    modes: list[npt.NDArray[np.float32]] | None = None
    familiarity: npt.NDArray[np.float32] | None = None

    def rows(self, rows: npt.NDArray[np.int64]) -> Answers:
        """Return the answers to some of the queries, int64 (M,), in that order."""
        return Answers(
            self.uv_px[rows],
            None if self.visible is None else self.visible[rows],
            None if self.sigma_px is None else self.sigma_px[rows],
            None if self.modes is None else [self.modes[row] for row in rows],
            None if self.familiarity is None else self.familiarity[rows],
        )


@dataclass(frozen=True)
class Matches:
    """A sparse method's own keypoint matches.

    Attributes:
        uv_a_px: float32 (M, 2), keypoints in the source image.
        uv_b_px: float32 (M, 2), their matches in the target image.
        score: float32 (M,), higher is better.
    """

    uv_a_px: npt.NDArray[np.float32]
    uv_b_px: npt.NDArray[np.float32]
    score: npt.NDArray[np.float32]
