"""Episodes (in preparation)."""

from __future__ import annotations

import numpy as np
from pliant.generator.rope.posing import RopeBody
from pliant.generator.subject import Pose
from pliant.spec.errors import GenerationError


class Episode:
    """One episode."""

    def __init__(self, body: RopeBody, shape: str, rng: np.random.Generator) -> None:
        self._body, self._shape, self._rng = body, shape, rng

    def pose(self, frame: int) -> Pose:
        """Return a frame."""
        raise GenerationError("rope episodes are not available", where=f"frame {frame}")
