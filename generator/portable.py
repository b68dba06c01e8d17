"""Elementary functions and products whose last bit does not depend on the processor.

NumPy computes sine, cosine, arctangent and powers of arrays by other code where the processor has
AVX-512, and BLAS chooses its kernels for `@`, `dot` and `numpy.linalg.norm` by processor too. The
results differ in the last bit, and a simulation with contacts makes centimetres of that. Whatever
decides where an object or the camera is uses these functions, so that a seed gives the same poses
on every x86-64 processor with FMA. `tests/generator/test_portable.py` generates with NumPy's and
BLAS's code for an older processor and compares.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike

from pliant.generator.compiled import elementwise
from pliant.spec.arrays import FloatArray


@elementwise
def sin(x: float) -> float:
    """Return the sine of angles in rad: float64 of the shape of `x`."""
    return math.sin(x)


@elementwise
def cos(x: float) -> float:
    """Return the cosine of angles in rad: float64 of the shape of `x`."""
    return math.cos(x)


@elementwise
def arctan2(y: float, x: float) -> float:
    """Return the angle of (x, y) in rad, -pi to pi: float64 of the common shape."""
    return math.atan2(y, x)


def product(rows: ArrayLike, matrix: ArrayLike) -> FloatArray:
    """Return `rows @ matrix`: float64 (..., m) from (..., n) and (n, m)."""
    result: FloatArray = np.einsum("...i,ij->...j", np.asarray(rows), np.asarray(matrix))
    return result


def norm(vector: FloatArray) -> float:
    """Return the Euclidean length of a vector, float64 (n,)."""
    return math.sqrt(float((vector * vector).sum()))
