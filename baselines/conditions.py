"""The inputs of a method in a track: the picture, and masks that are exact, damaged or absent.

A method that is given exact masks can score well without looking at pictures. Therefore a benchmark
passes the image alone, or masks with the faults of a segmenter. As a control, it passes the same
masks with a blank picture: that score comes from the masks alone.
"""

from __future__ import annotations

import functools
import zlib
from collections.abc import Callable, Iterable, Iterator, Mapping
from typing import Any, Final, Literal, cast

import numpy as np
import numpy.typing as npt
from scipy import ndimage

from pliant.baselines.matcher import KeypointMatcher, Matcher, TrackMatcher
from pliant.spec.answers import Answers, Matches
from pliant.spec.arrays import BoolArray, FloatArray
from pliant.spec.frame import Frame, Pair
from pliant.spec.lru_cache import LRUCache

Masks = Literal["none", "segmenter", "given"]

BLANK_VALUE: Final = 150
"""Grey level of a blank picture."""

RAGGED_PX: Final = 2.0
"""Standard deviation of a damaged contour from the true one."""

_WAVE_PX: Final = 4.0
_HOLES: Final = 2.0
_HOLE_RADIUS_PX: Final = (3.0, 7.0)
_CUT_SHARE: Final = 0.5
_CUT_RADIUS_PX: Final = (8.0, 16.0)
_SPECK_RADIUS_PX: Final = (2.0, 4.0)
_NOISE_PER_SPECK: Final = 4.0
_NOISE_PER_PX: Final = 8.0
_KEPT_FRAMES: Final = 64


def blank(frame: Frame) -> Frame:
    """Return a frame with a uniformly grey picture, the same for all frames, and its masks."""
    return frame.replace(rgb=np.full_like(frame.rgb, BLANK_VALUE), depth_m=None)


def segmented(frame: Frame) -> Frame:
    """Return a frame whose masks are damaged as those of a segmenter are.

    The contour deviates smoothly by 2 px (standard deviation) and by another pixel for each 8 grey
    levels of noise in the picture; there are two holes on average, of 3 to 7 px radius; in every
    second frame the end that is farthest along the object is missing, 8 to 16 px of it; a noisy
    picture adds specks around the object. A frame always gets the same damage, which depends on its
    key (on its picture, where it has none).

    Args:
        frame: A frame; without masks it is returned as it is.
    """
    if frame.mask is None:
        return frame
    rng = np.random.default_rng(zlib.crc32(frame.key.encode() or frame.rgb.tobytes()))
    noise = noise_of(frame.rgb)
    wave = ndimage.gaussian_filter(rng.standard_normal(frame.mask.shape), _WAVE_PX)
    wave *= (RAGGED_PX + noise / _NOISE_PER_PX) / wave.std()
    objects = frame.mask if frame.objects is None else frame.objects
    lost = _lost(rng, frame.mask)
    specks = _specks(rng, objects, rng.poisson(noise / _NOISE_PER_SPECK))
    mask = _ragged(frame.mask, wave) & ~lost | specks
    damaged = None
    if frame.objects is not None:
        damaged = _ragged(frame.objects, wave) & ~lost | mask
    return frame.replace(mask=mask, objects=damaged)


def _ragged(mask: BoolArray, wave: FloatArray) -> BoolArray:
    """Move the contour of a mask outwards by `wave`, float64 (H, W), pixels."""
    inside, outside = ndimage.distance_transform_edt(mask), ndimage.distance_transform_edt(~mask)
    moved: BoolArray = inside - outside + wave > 0
    return moved


def _lost(rng: np.random.Generator, mask: BoolArray) -> BoolArray:
    """Return which pixels holes and a missing end take away, bool (H, W)."""
    places = np.argwhere(mask)
    if not len(places):
        return np.zeros_like(mask)
    centres = [places[k] for k in rng.integers(0, len(places), rng.poisson(_HOLES))]
    radii = list(rng.uniform(*_HOLE_RADIUS_PX, len(centres)))
    if rng.random() < _CUT_SHARE:
        centres.append(_end(mask))
        radii.append(rng.uniform(*_CUT_RADIUS_PX))
    return _discs(mask.shape, centres, radii)


def _specks(rng: np.random.Generator, objects: BoolArray, count: int) -> BoolArray:
    """Return discs at random places of the objects' box, bool (H, W)."""
    places = np.argwhere(objects)
    if not len(places):
        return np.zeros_like(objects)
    centres = rng.uniform(places.min(axis=0), places.max(axis=0), (count, 2))
    return _discs(objects.shape, list(centres), list(rng.uniform(*_SPECK_RADIUS_PX, count)))


def _discs(
    shape: tuple[int, ...], centres: list[npt.NDArray[Any]], radii: list[float]
) -> BoolArray:
    rows, columns = np.ogrid[: shape[0], : shape[1]]
    found = np.zeros(shape, np.bool_)
    for (row, column), radius in zip(centres, radii, strict=True):
        found |= (rows - row) ** 2 + (columns - column) ** 2 <= radius**2
    return found


def _end(mask: BoolArray) -> npt.NDArray[np.int64]:
    """Return (row, column) of the pixel farthest along the mask from its first pixel.

    The mask is walked step by step in quarter resolution: in the largest part of a rope this finds
    an end, in that of a cloth a corner.
    """
    coarse = mask[::4, ::4]
    parts, count = ndimage.label(coarse, np.ones((3, 3)))
    if not count:
        return np.argwhere(mask)[0]
    part = parts == 1 + int(np.argmax(np.bincount(parts.ravel())[1:]))
    reached = np.zeros_like(part)
    last = np.argwhere(part)[0]
    reached[tuple(last)] = True
    while True:
        grown = ndimage.binary_dilation(reached, np.ones((3, 3))) & part
        new = np.argwhere(grown & ~reached)
        if not len(new):
            return last * 4
        last, reached = new[0], grown


def noise_of(rgb: npt.NDArray[np.uint8]) -> float:
    """Return the standard deviation of a picture's noise, grey levels of 255.

    After Immerkaer (Fast Noise Variance Estimation, 1996), with the median over rows, so that
    texture and edges of the object count little.

    Args:
        rgb: uint8 (H, W, 3), sRGB; grey is the mean of the three.
    """
    grey = rgb.mean(axis=2)
    kernel = np.array([[1, -2, 1], [-2, 4, -2], [1, -2, 1]])
    response = np.abs(ndimage.convolve(grey, kernel))
    return float(np.median(response.mean(axis=1)) * np.sqrt(np.pi / 2) / 6)


def with_inputs(matcher: Matcher, masks: Masks, *, is_blank: bool = False) -> Matcher:
    """Return a method whose input frames are changed.

    Args:
        matcher: The method. The result supports the same optional protocols (own keypoint matches,
            tracking), and caches the last 64 changed frames by their key.
        masks: `none`, `segmenter` (damaged) or `given` (as they are).
        is_blank: Replace every picture by the same grey.
    """
    steps: list[Callable[[Frame], Frame]] = []
    if masks == "none":
        steps.append(Frame.without_masks)
    if masks == "segmenter":
        steps.append(segmented)
    if is_blank:
        steps.append(blank)
    if not steps:
        return matcher
    kind: type[WithInputs] = WithInputs
    if isinstance(matcher, KeypointMatcher):
        kind = KeypointsWithInputs
    elif isinstance(matcher, TrackMatcher):
        kind = TrackerWithInputs
    facts = {"mask_quality": "segmenter"} if masks == "segmenter" else {}
    return kind(matcher, facts | ({"picture": "blank"} if is_blank else {}), steps)


class WithInputs:
    """A method that gets changed frames; made by `with_inputs`."""

    def __init__(
        self, inner: Matcher, facts: Mapping[str, Any], steps: list[Callable[[Frame], Frame]]
    ) -> None:
        self.name = inner.name
        self._inner = inner
        self._facts = dict(facts)
        self._steps = steps
        self._frames: LRUCache[Frame] = LRUCache(_KEPT_FRAMES)

    def describe(self) -> Mapping[str, Any]:
        """Return the method's description, and the changes of its inputs."""
        return {**self._inner.describe(), **self._facts}

    def answer(self, pair: Pair) -> Answers:
        """Run the method on changed frames."""
        return self._inner.answer(
            Pair(self._changed(pair.source), self._changed(pair.target), pair.uv_a_px)
        )

    def _changed(self, frame: Frame) -> Frame:
        def changed() -> Frame:
            return functools.reduce(lambda seen, step: step(seen), self._steps, frame)

        return self._frames.get(frame.cache_key, changed)


class KeypointsWithInputs(WithInputs):
    """One with keypoint matches of its own."""

    def match(self, source: Frame, target: Frame) -> Matches:
        """Run the method's own matching on changed frames."""
        inner = cast(KeypointMatcher, self._inner)
        return inner.match(self._changed(source), self._changed(target))


class TrackerWithInputs(WithInputs):
    """One that tracks points through episodes."""

    def track(self, views: Iterable[Frame], uv_px: npt.NDArray[np.float32]) -> Iterator[Answers]:
        """Run the method's tracking on changed frames."""
        return cast(TrackMatcher, self._inner).track(map(self._changed, views), uv_px)
