"""Points of one picture found in another, with what makes the answers doubtful."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Final, Protocol, runtime_checkable

import numpy as np
import numpy.typing as npt

from pliant.baselines.answers import checked_answers, checked_heat, placed_errors
from pliant.baselines.matcher import UNFAMILIAR, Heat, HeatMatcher, Matcher, RemarkingMatcher
from pliant.baselines.pixels import lies_on
from pliant.spec.arrays import FloatArray
from pliant.spec.errors import CallError, SubmissionError
from pliant.spec.frame import Frame, Pair

_LEAST_SIDE_PX: Final = 16
_LEAST_SPREAD: Final = 2.0  # standard deviation of grey levels, below which a picture is blank
_NEAR_SHARE: Final = 0.02  # of the target's longer side


@dataclass(frozen=True)
class PointMatch:
    """Where a method sees one point.

    Attributes:
        uv_a_px: float32 (2,), the query, pixels of the view.
        uv_b_px: float32 (2,), the match, pixels of the view.
        visible: Probability that the point is visible in the target, or None.
        sigma_px: Standard deviation that the method gives its answer, or None.
        modes: float32 (M, 4), the modes of the answer, or None.
        familiarity: How much the query is like the training data, 0 to 1, or None.
        heat: The method's belief over the target, or None where it has none to show.
    """

    uv_a_px: npt.NDArray[np.float32]
    uv_b_px: npt.NDArray[np.float32]
    visible: float | None = None
    sigma_px: float | None = None
    modes: npt.NDArray[np.float32] | None = None
    familiarity: float | None = None
    heat: Heat | None = None

    @property
    def mixture(self) -> npt.NDArray[np.float32]:
        """The answer's density, float32 (M, 4): u, v, standard deviation, weight; M = 0 for none.

        Rings and the confidence are drawn from it.
        """
        if self.modes is not None:
            return self.modes
        if self.sigma_px is None:
            return np.zeros((0, 4), np.float32)
        return np.array([[*self.uv_b_px, self.sigma_px, 1.0]], np.float32)

    def probability_within(self, radius_px: float) -> float:
        """Return the probability of the density within a distance of the answer, 0 to 1."""
        from scipy.special import chndtr

        u, v, sigma, weight = self.mixture.astype(np.float64).T
        square = (u - self.uv_b_px[0]) ** 2 + (v - self.uv_b_px[1]) ** 2
        # Of a round normal density, squared distances over the variance are noncentral chi-squared.
        share = chndtr((radius_px / sigma) ** 2, 2, square / sigma**2)
        return float(np.clip((weight * share).sum() / weight.sum(), 0.0, 1.0))


@dataclass(frozen=True)
class PhotoMatch:
    """Where a method sees points of a picture in another one.

    Attributes:
        method: Its name.
        points: The points.
        scale_a: (u, v), pixels of the source picture per pixel of its view.
        scale_b: Likewise of the target.
        near_px: What is near an answer, in pixels of the target's view: 2 % of its longer side.
        blank: What is wrong with the pictures, in words; empty if nothing is.
        remarks: What the method says of the pictures and their masks.
        notes: What the method did by itself, in sentences.
    """

    method: str
    points: list[PointMatch]
    scale_a: FloatArray
    scale_b: FloatArray
    near_px: float
    blank: str = ""
    remarks: Sequence[str] = ()
    notes: Sequence[str] = ()

    def confidence(self, point: PointMatch) -> float | None:
        """Return how sure an answer is, 0 to 1, or None where the method does not say.

        It is the probability that the answer's own density puts near the answer, or the confidence
        of a heat map where there is no density; 0 for a blank picture, and multiplied by the
        familiarity of a point that is unlike the training data.
        """
        if self.blank:
            return 0.0
        if not len(point.mixture) and point.heat is None:
            return None
        if len(point.mixture):
            own = point.probability_within(self.near_px)
        else:
            assert point.heat is not None
            own = point.heat.confidence
        strange = point.familiarity is not None and point.familiarity < UNFAMILIAR
        return own * (point.familiarity or 0.0 if strange else 1.0)

    def confidence_is(self, point: PointMatch) -> str | None:
        """Return what the confidence is, in words."""
        if len(point.mixture):
            near_px = self.near_px * float(np.sqrt(self.scale_b.prod()))
            return f"probability within {near_px:.0f} px of the answer"
        return None if point.heat is None else point.heat.confidence_label

    def warnings(self) -> list[str]:
        """Return sentences on what makes the answers doubtful."""
        found = [*([self.blank] if self.blank else []), *self.remarks]
        strange = sum(
            point.familiarity is not None and point.familiarity < UNFAMILIAR
            for point in self.points
        )
        if strange:
            count = len(self.points)
            which = f"{strange} of {count} points" if count > 1 else "the point"
            found.append(
                f"The pictures or {which} are unlike what {self.method} was trained on "
                f"(familiarity below {UNFAMILIAR}): do not trust the answer."
            )
        return found

    def as_dict(self) -> dict[str, Any]:
        """Return the match as a JSON object, positions in pixels of the pictures."""
        points = [self._point(point) for point in self.points]
        document: dict[str, Any] = {"method": self.method, "warnings": self.warnings()}
        return {**document, **points[0]} if len(points) == 1 else {**document, "points": points}

    def _point(self, point: PointMatch) -> dict[str, Any]:
        width = float(np.sqrt(self.scale_b.prod()))
        found: dict[str, Any] = {
            "query_px": [round(float(x), 3) for x in point.uv_a_px * self.scale_a],
            "match_px": [round(float(x), 3) for x in point.uv_b_px * self.scale_b],
            "visible": point.visible,
            "sigma_px": None if point.sigma_px is None else point.sigma_px * width,
            "confidence": self.confidence(point),
            "confidence_is": self.confidence_is(point),
            "familiarity": point.familiarity,
        }
        if point.modes is not None:
            names = ("u", "v", "sigma", "weight")
            scaled = point.modes * [*self.scale_b, width, 1.0]
            found["modes"] = [dict(zip(names, map(float, mode), strict=True)) for mode in scaled]
        return found


def match_photo(
    matcher: Matcher,
    source: Frame,
    target: Frame,
    at_px: Sequence[tuple[float, float]],
    *,
    sizes: tuple[tuple[int, int], tuple[int, int]] | None = None,
) -> PhotoMatch:
    """Match points.

    Args:
        matcher: The method.
        source: The picture the points are in.
        target: The picture to find them in.
        at_px: (u, v) of each in the source picture, centre of the first pixel at (0.5, 0.5).
        sizes: (width, height) of the two pictures, if the views are reduced.

    Raises:
        CallError: A pixel is outside the source picture or its mask.
        SubmissionError: The method gave something else than answers, a heat map or remarks.
    """
    views = [np.array(view.rgb.shape[1::-1], np.float64) for view in (source, target)]
    whole = [np.array(size, np.float64) for size in sizes or views]
    scale_a, scale_b = (size / view for size, view in zip(whole, views, strict=True))
    uv_a_px = (np.array(at_px, np.float64).reshape(-1, 2) / scale_a).astype(np.float32)
    _check_queries(source, uv_a_px, at_px, whole[0])
    masks = (("source", source.mask), ("target", target.mask))
    shown = " and ".join(f"the {side}{' (no mask)' * (mask is None)}" for side, mask in masks)
    with placed_errors(matcher.name, shown):
        found = matcher.answer(Pair(source, target, uv_a_px))
    answers = checked_answers(found, len(uv_a_px), matcher.name, "these pictures")
    heat = None  # of a single point: a method may take seconds for each
    if len(at_px) == 1 and isinstance(matcher, HeatMatcher):
        with placed_errors(matcher.name, shown):
            given = matcher.heat(source, target, uv_a_px[0])
        heat = checked_heat(given, target.rgb.shape[:2], matcher.name)
    points = [
        PointMatch(
            uv_a_px=uv_a_px[k],
            uv_b_px=answers.uv_px[k],
            visible=None if answers.visible is None else float(answers.visible[k]),
            sigma_px=None if answers.sigma_px is None else float(answers.sigma_px[k]),
            modes=None if answers.modes is None else answers.modes[k],
            familiarity=None if answers.familiarity is None else float(answers.familiarity[k]),
            heat=heat,
        )
        for k in range(len(at_px))
    ]
    near_px = _NEAR_SHARE * float(max(target.rgb.shape[:2]))
    blank = _blank(source, target, [bool((scale > 1).any()) for scale in (scale_a, scale_b)])
    found_masks = [_found_mask(matcher, view) for view in (source, target)]
    remarks = _remarks(matcher, source, target)
    remarks += _beside_object(matcher.name, found_masks[0], uv_a_px)
    notes = [
        f"{matcher.name} found the object in the {side} ({share:.1%} of the picture)."
        for side, mask in zip(("source", "target"), found_masks, strict=True)
        if mask is not None
        for share in [np.count_nonzero(mask) / mask.size]
    ]
    return PhotoMatch(matcher.name, points, scale_a, scale_b, near_px, blank, remarks, notes)


def _remarks(matcher: Matcher, source: Frame, target: Frame) -> list[str]:
    """Return what a method remarks on two pictures."""
    if not isinstance(matcher, RemarkingMatcher):
        return []
    found = matcher.remarks(source, target)
    if not isinstance(found, list) or not all(isinstance(each, str) for each in found):
        raise SubmissionError(
            f"the method {matcher.name!r} returned no list of remarks",
            found=type(found).__name__,
            required="a list of sentences, empty if there are none",
        )
    return found


@runtime_checkable
class MaskFinder(Protocol):
    """A method that finds the object in a picture that comes without a mask."""

    def object_mask(self, view: Frame) -> npt.NDArray[np.bool_] | None:
        """Return where a view shows the object, bool (H, W), or None where it is not found."""
        ...


def _found_mask(matcher: Matcher, view: Frame) -> npt.NDArray[np.bool_] | None:
    """Return where a method found the object in a picture without a mask, or None."""
    if view.mask is not None or not isinstance(matcher, MaskFinder):
        return None
    mask = matcher.object_mask(view)
    return mask if mask is not None and mask.any() else None


def _beside_object(
    method: str, mask: npt.NDArray[np.bool_] | None, uv_px: npt.NDArray[np.float32]
) -> list[str]:
    """Return what should be known of queries that are not near the object that the method found."""
    if mask is None:
        return []
    beside = sum(not _is_near(mask, uv, _NEAR_SHARE * max(mask.shape)) for uv in uv_px)
    if not beside:
        return []
    which = f"{beside} of {len(uv_px)} points" if len(uv_px) > 1 else "The point"
    return [
        f"{which} {'is' if beside == 1 else 'are'} not on the object that {method} found in "
        "the source: choose a point of the object, or give its mask."
    ]


def _is_near(mask: npt.NDArray[np.bool_], uv_px: npt.NDArray[np.float32], reach_px: float) -> bool:
    """Return whether a pixel of a mask is within a distance of a place."""
    low = np.maximum(np.floor(uv_px - reach_px), 0).astype(np.int64)
    high = np.ceil(uv_px + reach_px).astype(np.int64)
    rows, columns = np.nonzero(mask[low[1] : high[1], low[0] : high[0]])
    away = np.hypot(columns + low[0] + 0.5 - uv_px[0], rows + low[1] + 0.5 - uv_px[1])
    return bool((away <= reach_px).any())


def grid_points(
    matcher: Matcher, view: Frame, count: int, size: tuple[int, int]
) -> list[tuple[float, float]]:
    """Return points of a regular grid that are on the object.

    Args:
        matcher: The method, which may find the object itself. Where nobody knows the object, the
            grid covers the picture.
        view: The source, perhaps reduced.
        count: About how many points.
        size: (width, height) of the picture.

    Returns:
        (u, v) in pixels of the picture.
    """
    height, width = view.rgb.shape[:2]
    mask = _found_mask(matcher, view) if view.mask is None else view.mask
    if mask is None or not mask.any():
        mask = np.ones((height, width), np.bool_)
    step = max(1.0, float(np.sqrt(np.count_nonzero(mask) / count)))
    places: list[tuple[float, float]] = []
    while not places:  # a wide grid may miss a thin object
        rows, columns = (np.arange(step / 2, side, step) for side in (height, width))
        places = [(float(u), float(v)) for v in rows for u in columns if mask[int(v), int(u)]]
        step = max(1.0, step / 2)
    places = places[:: max(1, len(places) // count)]
    scale = (size[0] / width, size[1] / height)
    return [(u * scale[0], v * scale[1]) for u, v in places]


def _check_queries(
    source: Frame,
    uv_px: npt.NDArray[np.float32],
    at_px: Sequence[tuple[float, float]],
    size: FloatArray,
) -> None:
    inside = lies_on(uv_px, np.ones(source.rgb.shape[:2], np.bool_))
    shown = source.mask if source.objects is None else source.objects
    on = inside if shown is None else lies_on(uv_px, shown)
    for number, at in enumerate(at_px):
        found = f"{at[0]:g},{at[1]:g}"
        if not inside[number]:
            raise CallError(
                "the query pixel is outside the source picture",
                where="--at",
                found=found,
                required=f"0 <= U < {size[0]:g}, 0 <= V < {size[1]:g}",
            )
        if not on[number]:
            raise CallError(
                "the query pixel is not on the object of the source mask",
                where="--at",
                found=found,
                fix="Choose another pixel; if the mask is black on the object, invert it.",
            )


def _blank(source: Frame, target: Frame, reduced: Sequence[bool]) -> str:
    """Return what is wrong with pictures that show nothing, as a sentence."""
    named = zip(("source", "target"), (source, target), reduced, strict=True)
    for name, view, smaller in named:
        height, width = view.rgb.shape[:2]
        if min(height, width) < _LEAST_SIDE_PX:
            why = " after its reduction to --max-size" if smaller else ""
            return f"The {name} is only {width}x{height} px{why}: there is nothing to compare."
        if float(view.rgb.mean(axis=-1).std()) < _LEAST_SPREAD:
            return f"The {name} is of one colour or nearly so: there is nothing to compare."
    return ""
