"""The array types that the evaluator's signatures speak of."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt

FloatArray = npt.NDArray[np.float64]
RealArray = npt.NDArray[np.floating[Any]]
"""float32 or float64, as a participant wrote it."""
IntArray = npt.NDArray[np.int64]
IndexArray = npt.NDArray[np.integer[Any]]
"""Codes and counts of any integer width."""
BoolArray = npt.NDArray[np.bool_]
StateArray = npt.NDArray[np.uint8]
"""Visibility states as indices into `conventions.VISIBILITY_STATES`."""
