"""`pliant match` on drawn photographs of ropes that cross themselves: always an answer."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner
from PIL import Image
from scipy import ndimage
from scipy.interpolate import make_interp_spline

from pliant.cli.main import cli
from pliant.spec.arrays import FloatArray, Mask

pytest.importorskip("torch")
pytest.importorskip("cv2")

SIZE = (320, 240)
HALF_PX = 5.0

KINDS = ("no ball", "ball in the mask", "two ropes", "clutter", "no mask")
QUICK = [(0, "no ball"), (0, "two ropes"), (0, "no mask")]
LONG = [(1, kind) for kind in KINDS] + [(0, "ball in the mask"), (0, "clutter")]


def crossing_line(rng: np.random.Generator) -> FloatArray:
    """Return a smooth line that crosses itself at least once, float64 (N, 2), px."""
    turn = np.linspace(0, 2 * np.pi * rng.uniform(1.2, 1.7), 9)
    radius = np.linspace(95, 30, 9) * rng.uniform(0.7, 1.2, 9)
    corners = np.stack([160 + 1.3 * radius * np.cos(turn), 120 + radius * np.sin(turn)], axis=1)
    corners[-1] = corners[0] + rng.uniform(-60, 60, 2) - [corners[0][0] - 160, 0]
    line = make_interp_spline(np.arange(9), corners, k=3)(np.linspace(0, 8, 600))
    return np.asarray(line.clip([10, 10], [309, 229]))


def table(rng: np.random.Generator, *, clutter: bool) -> FloatArray:
    """Return a grainy table, with things lying on it if asked for, float64 (H, W, 3), 0 to 1."""
    grain = ndimage.gaussian_filter(rng.normal(size=(SIZE[1], SIZE[0], 3)), (6, 6, 0))
    picture = rng.uniform(0.2, 0.8, 3) + 0.8 * grain + 0.02 * rng.normal(size=grain.shape)
    rows, columns = np.mgrid[: SIZE[1], : SIZE[0]]
    for _ in range(8 * clutter):
        u, v, radius = rng.uniform(0, SIZE[0]), rng.uniform(0, SIZE[1]), rng.uniform(5, 30)
        stretch = rng.uniform(0.3, 3)
        thing = ((columns - u) * stretch) ** 2 + (rows - v) ** 2 < radius**2
        picture[thing] = rng.random(3) + 0.1 * rng.normal(size=(int(thing.sum()), 3))
    return np.asarray(picture)


def draw_rope(picture: FloatArray, line: FloatArray, rng: np.random.Generator) -> Mask:
    """Draw a twisted rope with light and shadow; return where it is."""
    rows, columns = np.mgrid[: SIZE[1], : SIZE[0]] + 0.5
    colours = rng.random((2, 3))
    covered = np.zeros(rows.shape, np.bool_)
    for number, (u, v) in enumerate(line):
        gap = np.hypot(columns - u, rows - v)
        disc = gap <= HALF_PX
        light = 0.4 + 0.6 * np.sqrt(np.maximum(1 - (gap[disc] / HALF_PX) ** 2, 0))
        picture[(gap <= HALF_PX + 1.5) & ~covered] *= 0.97  # a soft shadow
        picture[disc] = light[:, None] * colours[(number // 10) % 2]
        covered |= disc
    return covered


def photograph(folder: Path, name: str, kind: str, rng: np.random.Generator) -> list[str]:
    """Write a picture and its mask; return the pixel asked about and the mask's path, if any."""
    picture = table(rng, clutter=kind == "clutter")
    line = crossing_line(rng)
    mask = draw_rope(picture, line, rng)
    if kind == "two ropes":
        u = np.linspace(15, 305, 500)
        further = np.stack([u, rng.uniform(20, 220) + 12 * np.sin(u / 30)], axis=1)
        mask |= draw_rope(picture, further.clip(8, None), rng)
    if kind == "ball in the mask":
        rows, columns = np.mgrid[: SIZE[1], : SIZE[0]] + 0.5
        ball = np.hypot(columns - line[0, 0], rows - line[0, 1]) <= 3 * HALF_PX
        picture[ball] = rng.random(3)
        mask |= ball
    pixels = (ndimage.gaussian_filter(picture, (0.6, 0.6, 0)).clip(0, 1) * 255).astype(np.uint8)
    Image.fromarray(pixels).save(folder / f"{name}.png")
    Image.fromarray(mask).save(folder / f"{name}-mask.png")
    u, v = line[300]
    return [f"{u:.1f},{v:.1f}", str(folder / f"{name}-mask.png")]


@pytest.mark.parametrize(
    ("seed", "kind"), QUICK + [pytest.param(*each, marks=pytest.mark.long) for each in LONG]
)
def test_a_rope_that_crosses_itself_is_answered(tmp_path: Path, seed: int, kind: str) -> None:
    rng = np.random.default_rng([seed, KINDS.index(kind)])
    at, source_mask = photograph(tmp_path, "a", kind, rng)
    _, target_mask = photograph(tmp_path, "b", kind, rng)
    arguments = ["match", "don-rope", "--source", "a.png", "--target", "b.png", "--at", at]
    if kind != "no mask":
        arguments += ["--mask-source", source_mask, "--mask-target", target_mask]
    named = [str(tmp_path / each) if each in ("a.png", "b.png") else each for each in arguments]
    ran = CliRunner().invoke(cli, [*named, "--out", str(tmp_path / "found.png"), "--json"])
    assert ran.exit_code == 0, ran.output
    assert ran.exception is None
    found = json.loads(ran.stdout)
    u, v = found["match_px"]
    assert 0 <= u <= SIZE[0]
    assert 0 <= v <= SIZE[1]
    several = any("more than one rope" in each for each in found["warnings"])
    if kind != "no mask":
        assert several == (kind == "two ropes")
