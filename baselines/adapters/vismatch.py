"""The pairwise matchers of the package `vismatch`, over 50 networks, by the names it gives them.

`vismatch` is installed by the user, next to Pliant; it downloads the weights of a network when the
method is made.
"""

from __future__ import annotations

import importlib
from importlib.metadata import PackageNotFoundError, version
from typing import Any, Final

from pliant.baselines.adapters.images import Images
from pliant.baselines.adapters.sparse import SparseMatcher, match_images
from pliant.baselines.pixels import lies_on, searched_mask
from pliant.spec.answers import Matches
from pliant.spec.errors import CallError, MissingExtraError
from pliant.spec.frame import Frame

PREFIX: Final = "vismatch:"
"""`vismatch:NAME` is a method's name."""


def open_vismatch(
    name: str,
    device: str = "cpu",
    keypoints: int = 2048,
    size: tuple[int, int] | None = None,
    neighbours: int = 8,
) -> SparseMatcher:
    """Return a matcher of `vismatch`; queries are interpolated between its matches.

    Matches off the object are left out where its mask is given. The package's filter by a
    homography is left out, since the objects are not planes.

    Args:
        name: The name of a model of `vismatch`, such as `sift-nn` or `roma`.
        device: A torch device.
        keypoints: Most keypoints of an image.
        size: (width, height), px, that images are resized to; None leaves them.
        neighbours: Matches around a query that an affine map is fitted to; 1 takes the nearest.

    Raises:
        CallError: There is no such model.
        MissingExtraError: `vismatch` is not installed.
    """
    try:
        library = importlib.import_module("vismatch")
    except ModuleNotFoundError as error:
        raise MissingExtraError(PREFIX + name, "vismatch", "pip install vismatch") from error
    if name not in library.available_models:
        raise CallError(
            f"vismatch has no model {name!r}", required=", ".join(sorted(library.available_models))
        )
    matcher = library.get_matcher(name, device=device, max_num_keypoints=keypoints)
    matcher.skip_ransac = True

    def found_in(source: Any, target: Any) -> tuple[Any, ...]:
        found = matcher(source[0], target[0])
        score = found["matched_confidences"]
        pairs = found["matched_kpts0"], found["matched_kpts1"]
        return pairs if score is None else (*pairs, score)

    called = PREFIX + name
    images = Images(size and (int(size[0]), int(size[1])), device=device, coordinates="index")

    def match_objects(source: Frame, target: Frame) -> Matches:
        found = match_images(found_in, images, called, source, target)
        on = lies_on(found.uv_a_px, searched_mask(source))
        on &= lies_on(found.uv_b_px, searched_mask(target))
        return Matches(found.uv_a_px[on], found.uv_b_px[on], found.score[on])

    facts = {"implementation": f"vismatch {name}", "version": _version(), "keypoints": keypoints}
    return SparseMatcher(match_objects, called, neighbours, facts=facts)


def _version() -> str:
    try:
        return version("vismatch")
    except PackageNotFoundError:  # a copy of its source
        return "unknown"
