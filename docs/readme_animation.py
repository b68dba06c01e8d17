"""Draw the animation of README.md: a query moves along a rope, a shipped model follows on another.

    python docs/readme_animation.py docs/pictures/readme.webp [--method don-rope] [--pair 0]

It uses the sample dataset of the package. Left the query; right the heat map of the method, its
answer (cross) and the true position (circle).
"""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
from matplotlib import colormaps
from PIL import Image, ImageDraw
from scipy.ndimage import gaussian_filter, maximum_filter

import pliant
from pliant.baselines.matcher import Heat, HeatMatcher
from pliant.spec.frame import Frame, Pair
from pliant.spec.sequence import RecordedFrame

WIDTH_PX, HEIGHT_PX, MARGIN_PX, GAP_PX, STEPS, PAUSE_MS = 440, 330, 10, 6, 36, 140
Pixels = npt.NDArray[np.float32]


def path_along(source: RecordedFrame, target: RecordedFrame) -> tuple[Pixels, Pixels]:
    """Return pixels (N, 2) of points along the rope's centre line, visible in both frames."""
    points = source.sequence.points()
    line = np.array([kind == "centreline" for kind in points["kind"].to_pylist()])
    ends, seen = [], line
    for frame in (source, target):
        table = frame.correspondences
        ends.append(np.stack([table["u_px"].to_numpy(), table["v_px"].to_numpy()], axis=1))
        seen = seen & np.array([state == "visible" for state in table["visibility"].to_pylist()])
    (rows,) = np.nonzero(seen)
    rows = rows[np.argsort(points["m0"].to_numpy()[rows])]
    chosen = rows[np.linspace(1, len(rows) - 2, STEPS).round().astype(int)]
    return ends[0][chosen], ends[1][chosen]


class Window:
    """A window of a view around its objects, as wide as the picture at most."""

    def __init__(self, view: Frame) -> None:
        assert view.objects is not None
        rows, columns = view.objects.nonzero()
        size = np.array(view.rgb.shape[1::-1])
        low = np.array([columns.min(), rows.min()]) - MARGIN_PX
        high = np.array([columns.max(), rows.max()]) + 1 + MARGIN_PX
        self.scale = max((high - low) / (WIDTH_PX, HEIGHT_PX))  # pixels of the view per one drawn
        self.scale = min(self.scale, *(size / (WIDTH_PX, HEIGHT_PX)))
        self.size = self.scale * np.array([WIDTH_PX, HEIGHT_PX])
        self.corner = np.clip((low + high - self.size) / 2, 0, size - self.size)

    def cut(self, rgb: npt.NDArray[Any]) -> Image.Image:
        """Return the window of a picture (H, W, 3), enlarged."""
        box = (*self.corner, *(self.corner + self.size))
        picture = Image.fromarray(np.clip(rgb, 0, 255).astype(np.uint8))
        return picture.transform(
            (WIDTH_PX, HEIGHT_PX), Image.Transform.EXTENT, box, Image.Resampling.BICUBIC
        )

    def mark(self, picture: Image.Image, uv: Pixels, colour: str, *, cross: bool) -> None:
        """Draw a cross or a circle at a pixel of the original picture."""
        u, v = (uv - self.corner) / self.scale
        pen, r = ImageDraw.Draw(picture), 8
        for ink, width in (("black", 6), (colour, 3)):
            if cross:
                pen.line([u - r, v - r, u + r, v + r], fill=ink, width=width)
                pen.line([u - r, v + r, u + r, v - r], fill=ink, width=width)
            else:
                pen.ellipse([u - r, v - r, u + r, v + r], outline=ink, width=width)


def overlay(view: Frame, heat: Heat) -> npt.NDArray[Any]:
    """Return the dimmed picture under a heat map, widened by 2 px so that it can be seen."""
    top = heat.values - np.nanmax(heat.values)
    share = np.exp(top) if heat.label.startswith("log") else heat.values / np.nanmax(heat.values)
    strength = gaussian_filter(maximum_filter(np.nan_to_num(share), 5), 1.5) ** 0.4
    colours = colormaps["inferno"](0.3 + 0.7 * strength)[..., :3] * 255
    weight = np.clip(strength * 1.4, 0, 1)[..., None]
    shown: npt.NDArray[Any] = weight * colours + (1 - weight) * (0.5 * view.rgb + 30)
    return shown


def main() -> None:
    """Draw the animation."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("out", type=Path)
    parser.add_argument("--method", default="don-rope")
    parser.add_argument("--pair", type=int, default=0, help="pair of the test split")
    options = parser.parse_args()
    pair = pliant.load("sample").pairs("test")[options.pair]
    source, target = pair.source, pair.target
    method = pliant.open_method(options.method)
    assert isinstance(method, HeatMatcher)
    queries, truth = path_along(pair.source, pair.target)
    answers = method.answer(Pair(source, target, queries)).uv_px
    windows = Window(source), Window(target)
    frames = []
    for query, answer, true in zip(queries, answers, truth, strict=True):
        left = windows[0].cut(source.rgb)
        right = windows[1].cut(overlay(target, method.heat(source, target, query)))
        windows[0].mark(left, query, "#ffd400", cross=False)
        windows[1].mark(right, true, "#ffd400", cross=False)
        windows[1].mark(right, answer, "#4be1ff", cross=True)
        frame = Image.new("RGB", (2 * WIDTH_PX + GAP_PX, HEIGHT_PX), "white")
        frame.paste(left, (0, 0))
        frame.paste(right, (WIDTH_PX + GAP_PX, 0))
        frames.append(frame)
    loop = [*frames, *frames[-2:0:-1]]
    options.out.parent.mkdir(parents=True, exist_ok=True)
    loop[0].save(
        options.out, save_all=True, append_images=loop[1:], duration=PAUSE_MS, loop=0, quality=70
    )


if __name__ == "__main__":
    main()
