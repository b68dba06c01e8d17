"""Validation during a run: the matcher's errors on held-out pairs, by the evaluator's metrics."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from pliant.evaluator.metrics.errors import endpoint_error_px, rmse_px
from pliant.loaders.frame_store import FrameStore
from pliant.loaders.order import sample_generator
from pliant.models.don.matcher import DonMatcher
from pliant.spec.arrays import BoolArray, Float32Array, RealArray
from pliant.spec.errors import CallError
from pliant.spec.frame import Pair

VALIDATION_STREAM = 1


@dataclass(frozen=True, eq=False, repr=False)
class ValidationPair(Pair):
    """Two frames at one size, with queries and their truth in pixels of that size.

    Attributes:
        source: The frame the queries are in.
        target: The frame to find them in.
        uv_a_px: float32 (Q, 2), queries, on surface visible in the source.
        uv_b_px: float32 (Q, 1 + S, 2), the truth and its symmetry partners.
        visible: bool (Q, 1 + S), which of those the camera sees.
    """

    uv_b_px: Float32Array
    visible: BoolArray

    def without_masks(self) -> ValidationPair:
        """Return the pair as a method meets it that is given no masks."""
        source, target = self.source.without_masks(), self.target.without_masks()
        return replace(self, source=source, target=target)


def draw_validation_pairs(
    store: FrameStore, pairs: int, queries: int, seed: int
) -> list[ValidationPair]:
    """Draw pairs of frames, the same ones for the same seed.

    Args:
        store: Frames of the validation split.
        pairs: How many pairs.
        queries: Queries a pair, fewer where fewer points are visible.
        seed: Seed of the draws.

    Raises:
        CallError: The split has fewer than two frames.
    """
    if len(store) < 2:
        raise CallError(
            "validation draws pairs of frames",
            path=store.root,
            where=store.where,
            found="1 frame",
            required="2 frames or more",
            fix="Generate more sequences of this split, or set validation.split.",
        )
    drawn = []
    for number in range(pairs):
        rng = sample_generator(seed, number, VALIDATION_STREAM)
        a, b = (int(frame) for frame in rng.choice(len(store), size=2, replace=False))
        view_a, view_b = store.view(a), store.view(b)
        usable = view_a.visible & np.isfinite(view_b.uv_px).all(axis=1)
        candidates = np.flatnonzero(usable)
        if len(candidates) == 0:
            continue
        points = rng.choice(candidates, size=min(queries, len(candidates)), replace=False)
        orbit = np.column_stack([points, store.partners[points]])  # (Q, 1 + S)
        drawn.append(
            ValidationPair(
                source=view_a.replace(),
                target=view_b.replace(),
                uv_a_px=view_a.uv_px[points],
                uv_b_px=np.nan_to_num(view_b.uv_px[orbit]),
                visible=view_b.visible[orbit] & np.isfinite(view_b.uv_px[orbit]).all(axis=2),
            )
        )
    if not drawn:
        raise CallError(
            "no validation pair has a visible point",
            path=store.root,
            where=store.where,
            found=f"{pairs} pairs tried",
        )
    return drawn


def validate(
    matcher: DonMatcher, pairs: Sequence[ValidationPair], full_size: tuple[int, int]
) -> dict[str, float]:
    """Return the matcher's errors on the pairs, in the dataset's own pixels.

    Args:
        matcher: The matcher.
        pairs: From `draw_validation_pairs`.
        full_size: (W, H) of the dataset's images.

    Returns:
        `rmse_px` pooled over points visible in both frames, `rmse_px_mean_over_pairs`,
        `median_px`, `pck_8px`; with symmetries also `symmetric_rmse_px`, each answer against
        the nearest visible partner; `criterion_px`, the symmetric RMSE where there is one. Where
        traces carry the answers, also the figures of the network alone, as `network_rmse_px` …:
        traces answer well with a network that has learned nothing.
    """
    figures = _figures(pairs, full_size, lambda pair: matcher.answer(pair).uv_px)
    figures["criterion_px"] = figures.get("symmetric_rmse_px", figures["rmse_px"])
    if matcher.settings.decode == "trace":
        alone = _figures(pairs, full_size, matcher.answered_by_network)
        figures |= {f"network_{name}": value for name, value in alone.items()}
    return figures


def _figures(
    pairs: Sequence[ValidationPair],
    full_size: tuple[int, int],
    answer: Callable[[ValidationPair], RealArray],
) -> dict[str, float]:
    """Return the errors of one way to answer, on the points visible in both frames of pairs.

    Raises:
        CallError: There is no such point.
    """
    strict, symmetric = [], []
    for pair in pairs:
        seen = pair.visible[:, 0]
        if not seen.any():
            continue
        scale = np.array(full_size) / np.array(pair.target.rgb.shape[1::-1])
        found, truth = answer(pair) * scale, pair.uv_b_px * scale
        errors = np.stack(
            [endpoint_error_px(found, truth[:, slot]) for slot in range(truth.shape[1])], axis=1
        )  # (Q, 1 + S)
        strict.append(errors[seen, 0])
        symmetric.append(np.where(pair.visible, errors, np.inf)[seen].min(axis=1))
    if not strict:
        raise CallError("no validation pair shows a point in both frames")
    pooled = np.concatenate(strict)
    figures = {
        "rmse_px": rmse_px(pooled),
        "rmse_px_mean_over_pairs": float(np.mean([rmse_px(each) for each in strict])),
        "median_px": float(np.median(pooled)),
        "pck_8px": float(np.mean(pooled <= 8.0)),
    }
    if pairs[0].visible.shape[1] > 1:
        figures["symmetric_rmse_px"] = rmse_px(np.concatenate(symmetric))
    return figures
