"""A method in one file, to copy.

    cp baselines/template.py mine.py
    pliant predict mine.py:Template --data DATA --out mine.parquet --set radius_px=8

It answers with the pixel of the object whose surroundings look most like the query's. Replace
`describe_pixels` and `answer` by your own; nothing has to be registered, and no base class is
needed. `docs/add-a-method.md` explains each part.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
import numpy.typing as npt
from PIL import Image, ImageFilter

from pliant.baselines import Answers, Pair

# Import heavy libraries (torch, OpenCV) inside `__init__`: `pliant methods` imports this file too.


class Template:
    """Nearest neighbour of blurred colours.

    The arguments of the constructor are what `--set KEY=VALUE` gives. With `--workers N` the object
    is pickled and sent to N processes.

    Args:
        radius_px: Radius of the smallest of the squares that a pixel is described by, >= 1.
    """

    # The name appears in reports and leaderboards.
    name = "template"

    def __init__(self, radius_px: int = 2) -> None:
        self.radius_px = radius_px

    def describe(self) -> Mapping[str, Any]:
        """Return facts for the submission's footer: settings, versions, weights."""
        return {"radius_px": self.radius_px}

    def answer(self, pair: Pair) -> Answers:
        """Answer the N queries of one image pair.

        Args:
            pair: `source` and `target`, two frames that may differ in size. A frame has `rgb` uint8
                (H, W, 3); `mask` bool (H, W) of the object, None where masks are withheld;
                `depth_m` float32 (H, W) and `camera`, or None; and `cache_key`, a name under which
                you can cache what you computed for it. `uv_a_px` float32 (N, 2) are the queries in
                the source, (u right, v down); the centre of the first pixel is (0.5, 0.5).

        Returns:
            One finite position per query, float32 (N, 2), in pixels of the target. `Answers` also
            takes `visible` (N,), the probability that the point is seen, and `sigma_px` (N,).
        """
        source, target, uv_a_px = pair.source, pair.target, pair.uv_a_px
        described = describe_pixels(source.rgb, self.radius_px)
        searched = describe_pixels(target.rgb, self.radius_px)
        # Array index [row, column] = floor of (v, u); back again: plus 0.5.
        columns, rows = np.floor(uv_a_px).astype(np.int64).T
        queries = described[rows, columns]  # (N, C)
        on_object = np.ones(target.rgb.shape[:2], bool) if target.mask is None else target.mask
        candidates = np.argwhere(on_object)  # (M, 2), row and column
        if len(candidates) == 0:  # nothing to choose from: the middle of the image
            middle = np.array(target.rgb.shape[1::-1], np.float32) / 2
            return Answers(uv_px=np.tile(middle, (len(uv_a_px), 1)))
        features = searched[candidates[:, 0], candidates[:, 1]]  # (M, C)
        best = [np.square(features - query).sum(axis=1).argmin() for query in queries]
        return Answers(uv_px=(candidates[best, ::-1] + 0.5).astype(np.float32).reshape(-1, 2))

    # Optional, each used where it exists (protocols in baselines/matcher.py):
    #   match(source, target) -> Matches          your own keypoints, `--kind matches`
    #   track(views, uv_px) -> Iterator[Answers]  every frame of an episode, one by one
    #   heat(source, target, uv_a_px) -> Heat     heat map and confidence of `pliant match`


def describe_pixels(rgb: npt.NDArray[np.uint8], radius_px: int) -> npt.NDArray[np.float32]:
    """Return a descriptor of every pixel, float32 (H, W, 12): mean colours of four squares."""
    image = Image.fromarray(rgb)
    blurred = [image.filter(ImageFilter.BoxBlur(radius_px * 3**level)) for level in range(4)]
    return np.concatenate([np.asarray(each, np.float32) for each in blurred], axis=2)
