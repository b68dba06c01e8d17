"""Over and under at crossings, on ropes painted here: the upper strand's rim is unbroken."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
import torch
from scipy.spatial import cKDTree

from pliant.baselines.tracing import Nadir, Trace, self_crossings
from pliant.loaders.views import TrainingFrame
from pliant.models.don.crossing_training import fit_crossings
from pliant.models.don.crossings import CROSSINGS, with_overlaps
from pliant.models.networks.crossing_network import CrossingNetwork, crossing_patches
from pliant.models.training.checkpoint import load_weights, save_weights
from pliant.spec.frame import Frame
from tests.known import known

SIDE = 96
HALF_PX = 4.0
POINTS = 400


def painted(rng: np.random.Generator) -> tuple[TrainingFrame, np.ndarray, bool]:
    """Return a looped rope, its middle line, and whether its first passage is the upper one."""
    t = np.linspace(-1.35, 1.35, POINTS)
    turn, first_is_upper = rng.uniform(0, 2 * np.pi), bool(rng.random() < 0.5)
    c, s = np.cos(turn), np.sin(turn)
    curve = 26 * np.stack([t**2 - 0.8, t**3 - t], axis=1) @ np.array([[c, s], [-s, c]])
    line = curve + SIDE / 2 + rng.uniform(-4, 4, 2)
    height = np.where(t < 0, 1.0, 0.0) if first_is_upper else np.where(t < 0, 0.0, 1.0)
    y, x = np.mgrid[:SIDE, :SIDE] + 0.5
    rgb = np.full((SIDE, SIDE, 3), rng.uniform(20, 90), np.float64)
    colour = rng.uniform(110, 230, 3)
    mask = np.zeros((SIDE, SIDE), dtype=np.bool_)
    for passage in (0.0, 1.0):  # the lower one first
        at = line[height == passage]
        gap, _ = cKDTree(at).query(np.stack([x, y], axis=-1))
        body = gap < HALF_PX
        shade = np.where(gap < 0.75 * HALF_PX, 1.0, 0.55)  # a dark rim
        rgb[body] = (colour * shade[..., None])[body]
        mask |= body
    rgb += rng.normal(0, 3, rgb.shape)
    visible = np.ones(POINTS, dtype=np.bool_)
    lower = np.flatnonzero(height == 0)
    gap = np.linalg.norm(line[lower, None] - line[None, height == 1], axis=-1).min(axis=1)
    visible[lower] = gap > HALF_PX
    image = rgb.clip(0, 255).astype(np.uint8)
    positions = line.astype(np.float32)
    frame = TrainingFrame(
        rgb=image,
        mask=mask,
        objects=mask,
        depth_m=np.ones((SIDE, SIDE), np.float32),
        uv_px=positions,
        visible=visible,
    )
    return frame, line, first_is_upper


class PaintedStore:
    """As much of a `FrameStore` as the training uses."""

    def __init__(self, count: int, seed: int) -> None:
        rng = np.random.default_rng(seed)
        self.drawn = [painted(rng) for _ in range(count)]
        self.material = np.stack([np.linspace(0, 1, POINTS), np.zeros(POINTS)], axis=1)
        self.frames = [SimpleNamespace(key=str(k)) for k in range(count)]

    def __len__(self) -> int:
        return len(self.drawn)

    def view(self, number: int) -> TrainingFrame:
        return self.drawn[number][0]


def share_right(network: CrossingNetwork, store: PaintedStore) -> float:
    right = []
    for frame, line, first_is_upper in store.drawn:
        length = float(np.linalg.norm(np.diff(line, axis=0), axis=1).sum())
        view = Frame(frame.rgb, frame.mask)
        trace = Trace(line, length, HALF_PX, 1.0, 0.0, Nadir.of_image(frame.mask.shape))
        (traced,) = with_overlaps(network, view, frame.mask, [trace])
        (overlap,) = traced.overlaps
        assert overlap.half_px == pytest.approx(HALF_PX, rel=0.15)
        right.append((overlap.upper.start < overlap.lower.start) == first_is_upper)
    return float(np.mean(right))


@pytest.fixture(scope="module")
def stores() -> tuple[PaintedStore, PaintedStore]:
    """Ropes to learn from, and others."""
    return PaintedStore(130, seed=1), PaintedStore(30, seed=2)


@pytest.mark.long
def test_a_network_learns_which_strand_is_on_top(
    stores: tuple[PaintedStore, PaintedStore], tmp_path: Path
) -> None:
    seen: Any
    seen, unseen = stores
    network = known(fit_crossings([seen], seed=0))
    assert share_right(network, unseen) > 0.9
    save_weights(tmp_path / CROSSINGS, network.state_dict())
    loaded = CrossingNetwork()
    load_weights(loaded, tmp_path / CROSSINGS)
    assert share_right(loaded, unseen) == share_right(network, unseen)


def test_too_few_crossings_train_nothing() -> None:
    stores: Any = [PaintedStore(5, seed=1)]
    assert fit_crossings(stores, seed=0) is None


def test_exchanged_strands_exchange_the_sign() -> None:
    frame, line, _ = painted(np.random.default_rng(3))
    (met,) = self_crossings(line, 20)
    picture = frame.rgb.astype(np.float32) / 255
    torch.manual_seed(0)
    network = CrossingNetwork().eval()
    one, other = (
        network(crossing_patches(picture, met.place_px[None], ways[None], HALF_PX))
        for ways in (met.ways, met.ways[::-1].copy())
    )
    assert float(one.detach()) == pytest.approx(-float(other.detach()), abs=1e-5)
    assert abs(float(one.detach())) > 1e-4


def test_a_patch_is_turned_to_its_strand() -> None:
    """A picture that says where each of its pixels is."""
    v, u = np.mgrid[:60, :80] + 0.5
    picture = np.stack([u, v, u * 0], axis=-1).astype(np.float32)
    ways = np.array([[[0.6, 0.8], [1.0, 0.0]]])
    patches = crossing_patches(picture, np.array([[40.0, 30.0]]), ways, 2.0)
    middle = patches.picture[0, :, :2, 15:17, 15:17].mean(dim=(2, 3))
    np.testing.assert_allclose(middle, [[40, 30], [40, 30]], atol=1e-3)
    steps = patches.picture[0, :, :2, 16, 17] - patches.picture[0, :, :2, 16, 16]
    np.testing.assert_allclose(steps, 0.5 * ways[0], atol=1e-3)  # 4 * 2 px in 16 pixels
    np.testing.assert_allclose(patches.angle[0], [-np.arctan2(0.8, 0.6), np.arctan2(0.8, 0.6)])
