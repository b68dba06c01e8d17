"""Making the stated certainty true: temperature, spread, stray share and the visible threshold.

All are chosen on the validation split by the evaluator's own definitions: the mixture's
negative log likelihood of the truth, and for `visible` a logistic curve in the log of the
best descriptor distance, shifted so that 0.5 is the threshold with the fewest errors.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import torch

from pliant.evaluator.metrics.calibration import expected_calibration_error, reliability_bins
from pliant.evaluator.metrics.errors import endpoint_error_px
from pliant.evaluator.metrics.mixtures import Mixtures, negative_log_likelihood, probability_within
from pliant.evaluator.protocols.protocol import read_protocol
from pliant.models.don.certainty import Calibration, Widths, mean_log_sigma, mixture_of_modes
from pliant.models.don.matcher import DonMatcher
from pliant.models.don.validation import ValidationPair
from pliant.spec.arrays import BoolArray, FloatArray

TEMPERATURES = (0.5, 0.7, 1.0, 1.4, 2.0, 4.0, 8.0)
MODE_RADII_PX = (4.0, 9.0, 14.0)
STRAYS = (0.0, 0.01, 0.03, 0.06, 0.12, 0.25)
WIDTHS = {
    "spread": (0.25, 0.35, 0.5, 0.7, 0.85, 1.0, 1.2, 1.4, 1.7, 2.0, 2.5, 3.0),
    "blur_px": (0.0, 0.5, 0.8, 1.1, 1.3, 1.5, 1.8),
    "power": (0.7, 1.0, 1.4, 1.8, 2.2, 2.6),
    "sigma_floor_px": (0.1, 0.2, 0.3, 0.45, 0.7, 1.0, 1.5, 2.2),
}
"""What is tried; the widths, which cost little, for every temperature and radius."""

SHARPNESS = np.geomspace(1.0, 1e5, 31)
"""What `fit_sharpness` tries."""

_ECE_WEIGHT = 10.0
_PAIRS_A_GROUP = 60  # of like log_sigma; with 20, a group's calibration does not carry over
_MOST_GROUPS = 6
_UNMASKED_PAIRS = 100
_LEAST_PAIRS = 10  # of views from above and of tilted ones, to measure them apart


@dataclass(frozen=True)
class _Pair:
    """One pair's probabilities and truth, of the points visible in the target."""

    log_p: torch.Tensor  # (Q, M)
    log_sigma: float  # `mean_log_sigma` of what the answers are read from
    uv: torch.Tensor  # (M, 2)
    answer: FloatArray  # (Q, 2), full-size pixels
    truth: FloatArray  # (Q, 2), full-size pixels


def calibrate(
    matcher: DonMatcher, pairs: Sequence[ValidationPair], full_size: tuple[int, int]
) -> Calibration:
    """Choose the calibration of a matcher.

    Args:
        matcher: The matcher; its own calibration is not looked at.
        pairs: Pairs of the validation split.
        full_size: (W, H) of the dataset's images.

    Returns:
        The calibration, with what was measured on the same pairs in `figures`.
    """
    searched = _searched(matcher, pairs, full_size)
    distances, hidden = searched.distances, searched.hidden
    sharp = _fit_visible(Calibration(sharpness=matcher.sharpness), distances, hidden)
    best = _fit_by_kind(sharp, searched.pairs, matcher.size, full_size)
    if matcher.reader.finds_masks:
        bare = [pair.without_masks() for pair in pairs[:_UNMASKED_PAIRS]]
        found = _searched(matcher, bare, full_size).pairs
        best = _changed(best, "unmasked", _fit_by_kind(sharp, found, matcher.size, full_size))
    if best.visible_slope == 0:
        return best
    shown = ~hidden
    said = best.visible(distances) >= 0.5
    visible = {
        "visible_accuracy": float(np.mean(said == shown)),
        "visible_share": float(np.mean(shown)),
    }
    return replace(best, figures={**(best.figures or {}), **visible})


@dataclass(frozen=True)
class _Searched:
    """Pairs by kind, and what is known of all N queries.

    Attributes:
        pairs: `straight`, seen from above; `tilted`, of which a view was rectified; `either_way`,
            of ropes whose ends look alike.
        distances: float64 (N,), as `Comparison.distance`.
        hidden: bool (N,), whether the target hides the point.
    """

    pairs: Mapping[str, list[_Pair]]
    distances: FloatArray
    hidden: BoolArray


def _searched(
    matcher: DonMatcher, pairs: Sequence[ValidationPair], full_size: tuple[int, int]
) -> _Searched:
    kept: dict[str, list[_Pair]] = {"straight": [], "tilted": [], "either_way": []}
    distances, hidden = [], []
    for pair in pairs:
        source, target = map(matcher.reader.seen, (pair.source, pair.target))
        found = matcher.search(source, target, source.forward(pair.uv_a_px))
        seen = pair.visible[:, 0]
        distances.append(found.distance)
        hidden.append(~seen)
        if not seen.any():
            continue
        own = np.array(full_size) / np.array(target.view.rgb.shape[1::-1])
        answer = matcher.decoded(found, target.view)[seen] * own
        truth = target.forward(pair.uv_b_px[seen, 0]).astype(np.float64) * own
        kind = "tilted" if source.tilted or target.tilted else "straight"
        kind = "either_way" if found.either_way else kind
        shown = torch.from_numpy(seen)
        log_sigma = mean_log_sigma(found.deciding[shown], found.uv_px)
        kept[kind].append(_Pair(found.log_p[shown], log_sigma, found.uv_px, answer, truth))
    return _Searched(kept, np.concatenate(distances), np.concatenate(hidden))


def _fit_by_kind(
    start: Calibration,
    pairs: Mapping[str, list[_Pair]],
    size: tuple[int, int],
    full_size: tuple[int, int],
) -> Calibration:
    """Return a calibration for each kind of `_Searched` that has enough pairs."""
    straight, apart = pairs["straight"], {}
    for kind in ("tilted", "either_way"):
        if min(len(straight), len(pairs[kind])) < _LEAST_PAIRS:
            straight = straight + pairs[kind]
        else:
            apart[kind] = pairs[kind]
    best = _fit_by_log_sigma(start, straight, size, full_size)
    for kind, own in apart.items():
        best = _changed(best, kind, _fit_by_log_sigma(start, own, size, full_size))
    return best


def _fit_by_log_sigma(
    start: Calibration, pairs: Sequence[_Pair], size: tuple[int, int], full_size: tuple[int, int]
) -> Calibration:
    """Return a calibration for each group of pairs, from the least doubtful to the most."""
    log_sigmas = np.array([pair.log_sigma for pair in pairs])
    groups = np.clip(len(pairs) // _PAIRS_A_GROUP, 1, _MOST_GROUPS)
    fitted: Calibration | None = None
    above = np.inf
    for chosen in reversed(np.array_split(np.argsort(log_sigmas, kind="stable"), groups)):
        own = _fit_distribution(start, [pairs[index] for index in chosen], size, full_size)
        highest = float(log_sigmas[chosen].max())
        if fitted is not None:
            own = replace(own, doubt_above=(highest + above) / 2, doubtful=fitted)
        fitted, above = own, float(log_sigmas[chosen].min())
    assert fitted is not None  # there is one group at least
    return fitted


def _fit_distribution(
    start: Calibration, pairs: Sequence[_Pair], size: tuple[int, int], full_size: tuple[int, int]
) -> Calibration:
    """Return the best temperature, stray share and widths for some pairs, and their figures."""
    scale = np.array(full_size) / np.array(size)
    modes = _Modes(pairs)

    def cost(calibration: Calibration) -> float:
        measured = _measure(modes, calibration, scale, full_size)
        return measured["nll"] + _ECE_WEIGHT * measured["ece"]

    tried = [
        _best_widths(replace(start, temperature=heat, mode_radius_px=radius), cost)
        for heat, radius in itertools.product(TEMPERATURES, MODE_RADII_PX)
    ]
    best = min(tried, key=cost)
    best = min((_changed(best, "stray", value) for value in STRAYS), key=cost)
    best = _best_widths(_best_widths(best, cost), cost)
    return replace(best, figures=_measure(modes, best, scale, full_size))


def fit_sharpness(matcher: DonMatcher, pairs: Sequence[ValidationPair]) -> float:
    """Return the factor of log p under which the true pixels are most likely.

    A contrastive network with a margin of 0.5 separates descriptors by about that distance: a
    softmax of scale 1 over thousands of pixels is then nearly flat, and its mean or median is the
    middle of the object, however good the descriptors are.

    Args:
        matcher: The matcher; its sharpness is 1.
        pairs: Pairs of the validation split.
    """
    kept = []
    for pair in pairs:
        found = matcher.compare(pair.source, pair.target, pair.uv_a_px)
        seen = torch.from_numpy(pair.visible[:, 0])
        factor = np.array(matcher.size) / np.array(pair.target.rgb.shape[1::-1])
        truth = torch.from_numpy((pair.uv_b_px[:, 0] * factor).astype(np.float32))
        nearest = torch.cdist(truth, found.uv_px).argmin(dim=1)
        kept.append((found.log_p[seen], nearest[seen, None]))

    def loss(sharpness: float) -> float:
        terms = [(log_p * sharpness).log_softmax(dim=1).gather(1, at) for log_p, at in kept]
        return -float(torch.cat(terms).mean())

    return min((float(value) for value in SHARPNESS), key=loss)


class _Modes:
    """The modes of all pairs' N points, found once for each way of finding them.

    Attributes:
        answer: float64 (N, 2), full-size pixels.
        truth: float64 (N, 2), full-size pixels.
    """

    def __init__(self, pairs: Sequence[_Pair]) -> None:
        self._pairs = pairs
        self.answer = np.concatenate([pair.answer for pair in pairs])
        self.truth = np.concatenate([pair.truth for pair in pairs])
        self._found: dict[tuple[float, float, float], FloatArray] = {}

    def of(self, calibration: Calibration) -> FloatArray:
        """Return the points' modes, float64 (N, K, 4), weight 0 where a mode is not used."""
        key = (calibration.temperature, calibration.stray, calibration.mode_radius_px)
        if key not in self._found:
            found = []
            for pair in self._pairs:
                flat = calibration.flattened(pair.log_p)
                modes, _ = mixture_of_modes(flat, pair.uv, Widths(0.0), calibration.mode_radius_px)
                found.append(modes.double().numpy())
            self._found[key] = np.concatenate(found)
        return self._found[key]


def _best_widths(start: Calibration, cost: Callable[[Calibration], float]) -> Calibration:
    """Return the best widths of the modes, chosen one after the other."""
    best = start
    for name, values in WIDTHS.items():
        best = min((_changed(best, name, value) for value in values), key=cost)
    return best


def _changed(calibration: Calibration, name: str, value: float | Calibration) -> Calibration:
    changes: dict[str, Any] = {name: value}
    return replace(calibration, **changes)


def _measure(
    modes: _Modes, calibration: Calibration, scale: FloatArray, full_size: tuple[int, int]
) -> dict[str, float]:
    """Return `nll` and `ece` of the mixtures, as the standard protocol defines them."""
    rules = read_protocol("standard").settings["distribution"]
    width = float(np.sqrt(scale[0] * scale[1]))
    own = modes.of(calibration)
    used = own[..., 3] > 0
    values = own[used] * [scale[0], scale[1], 1.0, 1.0]
    variance = torch.from_numpy(values[:, 2] ** 2)
    values[:, 2] = calibration.widths.of(variance).numpy() * width
    mixtures = Mixtures(
        row=np.nonzero(used)[0],
        uv_px=values[:, :2],
        sigma_px=np.maximum(values[:, 2], rules.sigma_floor_px),
        weight=values[:, 3],
        rows=len(own),
    )
    area = float(full_size[0] * full_size[1])
    losses = negative_log_likelihood(
        mixtures, modes.truth, outlier_weight=rules.outlier_weight, area_px2=area
    )
    radius = rules.ece_radius_px
    confidence = probability_within(mixtures, modes.answer, radius)
    happened = endpoint_error_px(modes.answer, modes.truth) <= radius
    bins = reliability_bins(confidence, happened, rules.ece_bins)
    return {"nll": float(np.mean(losses)), "ece": expected_calibration_error(bins)}


def _fit_visible(calibration: Calibration, distance: FloatArray, hidden: BoolArray) -> Calibration:
    """Return the calibration with the logistic curve of `visible`.

    With no hidden point (or no visible one) there is nothing to learn: slope 0.
    """
    if hidden.all() or not hidden.any():
        return replace(calibration, visible_slope=0.0)
    x = np.log(np.maximum(distance, 1e-12))
    order = np.argsort(x)
    # Below the threshold visible, above hidden: wrong for a cut after each sorted value.
    hidden_below = np.cumsum(hidden[order])
    seen_below = np.cumsum(~hidden[order])
    cut = int(np.argmin(hidden_below - seen_below))
    threshold = float(x[order[cut]])
    if cut + 1 < len(x):
        threshold = (threshold + float(x[order[cut + 1]])) / 2
    slopes = np.geomspace(0.25, 16.0, 25)
    exponent = np.clip(np.outer(slopes, x - threshold), -60, 60)  # (slopes, N)
    log_loss = np.where(hidden, np.logaddexp(0, -exponent), np.logaddexp(0, exponent)).mean(axis=1)
    return replace(
        calibration,
        visible_at=float(np.exp(threshold)),
        visible_slope=float(slopes[int(np.argmin(log_loss))]),
    )
