"""Paths along a mask, sampled from a hidden Markov model of a rope.

The hidden state after t of T equal steps is a pixel of the mask and one of 16 headings. A step
goes a fixed length ahead, keeps its heading or turns by one sixteenth, and is blurred by the
pixel grid; steps that leave the mask are lost, so paths that stay in it gain. What speaks for a
pixel at step t is the evidence of the caller: the likelihood of what is seen there if the pixel
shows the share (t + 1/2) / T of the rope's length. Paths are drawn from the posterior by forward
filtering and backward sampling (Fruehwirth-Schnatter 1994), for several step lengths in
proportion to their marginal likelihoods.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from scipy import sparse
from scipy.ndimage import gaussian_filter1d

from pliant.baselines.tracing.settings import TRACING
from pliant.spec.arrays import FloatArray


@dataclass(frozen=True)
class Evidence:
    """What is known of the pixels of a region.

    Attributes:
        pixels: int64 (N, 2), (row, column) of each pixel of the region.
        on_rope: bool (N,), False where another object hides the rope.
        likelihood: float64 (N, T), > 0, 1 where nothing is known.
    """

    pixels: npt.NDArray[np.int64]
    on_rope: npt.NDArray[np.bool_]
    likelihood: FloatArray


def sampled_paths(evidence: Evidence, length_px: float, count: int) -> list[FloatArray]:
    """Draw paths of a rope from the posterior.

    Args:
        evidence: The region, and what its pixels show.
        length_px: Length of the rope if no part of it hides another, px.
        count: How many paths.

    Returns:
        About `count` paths, float64 (T, 2) each, (u, v) of the region's pixel grid; the
        same in every call. Empty where no path of any of the lengths stays in the region.
    """
    hidden = np.where(
        (np.arange(TRACING.chain_steps) + 0.5) / TRACING.chain_steps < TRACING.hidden_first,
        1.0,
        TRACING.hidden_later,
    )
    likelihood = np.where(evidence.on_rope[:, None], evidence.likelihood, hidden)
    by_step = np.ascontiguousarray(likelihood.T)
    filtered, log_evidence = [], []
    for relative in TRACING.chain_lengths:
        onward = _onward(evidence.pixels, relative * length_px / TRACING.chain_steps)
        forward, value = _forward(onward, by_step)
        filtered.append((onward, forward))
        log_evidence.append(value)
    if max(log_evidence) == -np.inf:
        return []
    share = np.exp(np.array(log_evidence) - max(log_evidence))
    drawn = np.rint(count * share / share.sum()).astype(np.int64)
    rng = np.random.default_rng(0)
    paths = []
    for (onward, forward), number in zip(filtered, drawn, strict=True):
        for _ in range(number):
            states = _backward(onward, forward, rng)
            centres = evidence.pixels[states // TRACING.chain_headings, ::-1] + 0.5
            paths.append(
                gaussian_filter1d(centres, TRACING.chain_smoothing_steps, axis=0, mode="nearest")
            )
    return paths


def _onward(pixels: npt.NDArray[np.int64], step_px: float) -> sparse.csr_array:
    """Return p(next state | state), a row for each next state, (N 16, N 16).

    Steps that leave the region are left out.
    """
    headings = TRACING.chain_headings
    reach = int(np.ceil(step_px + 1.5))
    rows, columns = (pixels + reach).T
    number = np.full(pixels.max(axis=0) + 1 + 2 * reach, -1, dtype=np.int32)
    number[rows, columns] = np.arange(len(pixels))
    down, right = (axis.ravel() for axis in np.mgrid[-reach : reach + 1, -reach : reach + 1])
    # Of each step of whole pixels, the states before and after it, up to their headings.
    steps: dict[int, tuple[npt.NDArray[np.int32], npt.NDArray[np.int32]]] = {}
    origin, arrival, weight = [], [], []
    for heading in range(headings):
        for turn, likely in TRACING.chain_turns:
            angle = 2 * np.pi * (heading + turn / 2) / headings
            gap = (right - step_px * np.cos(angle)) ** 2 + (down - step_px * np.sin(angle)) ** 2
            share = np.exp(-gap / (2 * TRACING.chain_blur_px**2))
            share /= share.sum()
            for k in np.flatnonzero(share > TRACING.chain_least_share).tolist():
                if k not in steps:
                    end = number[rows + down[k], columns + right[k]]
                    start = np.flatnonzero(end >= 0).astype(np.int32)
                    steps[k] = start * headings, end[start] * headings
                before, after = steps[k]
                origin.append(before + heading)
                arrival.append(after + (heading + turn) % headings)
                weight.append(np.full(len(before), likely * share[k]))
    size = len(pixels) * headings
    entries = (np.concatenate(weight), (np.concatenate(arrival), np.concatenate(origin)))
    return sparse.csr_array(entries, shape=(size, size))


def _forward(onward: sparse.csr_array, likelihood: FloatArray) -> tuple[FloatArray, float]:
    """Return p(state at t | evidence up to t), float64 (T, N 16), and log p(evidence).

    Where no path of this length stays in the region, log p(evidence) is -inf.

    Args:
        onward: From `_onward`.
        likelihood: float64 (T, N).
    """
    forward = np.zeros((TRACING.chain_steps, onward.shape[0]))
    log_evidence = 0.0
    for step, seen in enumerate(likelihood):
        state = onward @ forward[step - 1] if step else np.full(onward.shape[0], 1.0)
        of_pixel = state.reshape(len(seen), -1)
        of_pixel *= seen[:, None]
        if not step:
            state /= len(state)
        total = float(state.sum())
        if total == 0:
            return forward, -np.inf
        log_evidence += float(np.log(total))
        np.divide(state, total, out=forward[step])
    return forward, log_evidence


def _backward(
    onward: sparse.csr_array, forward: FloatArray, rng: np.random.Generator
) -> npt.NDArray[np.int64]:
    """Draw one sequence of states from the posterior, int64 (T,)."""
    states = np.empty(TRACING.chain_steps, dtype=np.int64)
    states[-1] = _draw(forward[-1], rng)
    for step in range(TRACING.chain_steps - 2, -1, -1):
        span = slice(*onward.indptr[states[step + 1] : states[step + 1] + 2])
        before = onward.indices[span]
        states[step] = before[_draw(forward[step, before] * onward.data[span], rng)]
    return states


def _draw(weight: FloatArray, rng: np.random.Generator) -> int:
    total = weight.cumsum()  # equal to the one before where the weight is 0: never chosen
    return int(total.searchsorted(rng.random() * total[-1]))
