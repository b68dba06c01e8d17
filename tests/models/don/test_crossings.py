"""Strands seen at crossings, on ropes painted here: the upper one's rim is unbroken."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
import torch
from scipy.spatial import cKDTree

from pliant.baselines.tracing import Nadir, Trace
from pliant.loaders.views import TrainingFrame
from pliant.models.don.crossing_training import fit_crossings
from pliant.models.don.crossings import (
    CROSSINGS,
    CrossingNetwork,
    crossing_planes,
    distances,
    with_overlaps,
)
from pliant.models.training.checkpoint import load_weights, save_weights
from pliant.spec.frame import Frame
from tests.known import known

SIDE = 96
HALF_PX = 4.0
POINTS = 400


def painted(rng: np.random.Generator) -> tuple[TrainingFrame, np.ndarray, np.ndarray]:
    """Return a looped rope, its middle line, and how far along it each pixel is, 0 to 1."""
    t = np.linspace(-1.35, 1.35, POINTS)
    turn, first_is_upper = rng.uniform(0, 2 * np.pi), bool(rng.random() < 0.5)
    c, s = np.cos(turn), np.sin(turn)
    curve = 26 * np.stack([t**2 - 0.8, t**3 - t], axis=1) @ np.array([[c, s], [-s, c]])
    line = curve + SIDE / 2 + rng.uniform(-4, 4, 2)
    height = np.where(t < 0, 1.0, 0.0) if first_is_upper else np.where(t < 0, 0.0, 1.0)
    y, x = np.mgrid[:SIDE, :SIDE] + 0.5
    rgb = np.full((SIDE, SIDE, 3), rng.uniform(20, 90), np.float64)
    colour = rng.uniform(110, 230, 3)
    part = np.full((SIDE, SIDE), np.nan)
    for passage in (0.0, 1.0):  # the lower one first
        at = line[height == passage]
        gap, number = cKDTree(at).query(np.stack([x, y], axis=-1))
        body = gap < HALF_PX
        shade = np.where(gap < 0.75 * HALF_PX, 1.0, 0.55)  # a dark rim
        rgb[body] = (colour * shade[..., None])[body]
        part[body] = np.linspace(0, 1, POINTS)[height == passage][number[body]]
    rgb += rng.normal(0, 3, rgb.shape)
    visible = np.ones(POINTS, dtype=np.bool_)
    lower = np.flatnonzero(height == 0)
    gap = np.linalg.norm(line[lower, None] - line[None, height == 1], axis=-1).min(axis=1)
    visible[lower] = gap > HALF_PX
    image = rgb.clip(0, 255).astype(np.uint8)
    positions = line.astype(np.float32)
    mask = np.isfinite(part)
    frame = TrainingFrame(
        rgb=image,
        mask=mask,
        objects=mask,
        depth_m=np.ones((SIDE, SIDE), np.float32),
        uv_px=positions,
        visible=visible,
    )
    return frame, line, part


class PaintedStore:
    """As much of a `FrameStore` as the training uses."""

    def __init__(self, count: int, seed: int) -> None:
        rng = np.random.default_rng(seed)
        self.drawn = [painted(rng) for _ in range(count)]
        self.material = np.stack([np.linspace(0, 1, POINTS), np.zeros(POINTS)], axis=1)
        self.frames = [
            SimpleNamespace(surface=SimpleNamespace(m0=part)) for _, _, part in self.drawn
        ]

    def __len__(self) -> int:
        return len(self.drawn)

    def view(self, number: int) -> TrainingFrame:
        return self.drawn[number][0]


def share_right(network: CrossingNetwork, store: PaintedStore) -> float:
    """Return the share of the pixels near both strands whose strand is found."""
    right: list[bool] = []
    for frame, line, part in store.drawn:
        length = float(np.linalg.norm(np.diff(line, axis=0), axis=1).sum())
        view = Frame(frame.rgb, frame.mask)
        trace = Trace(line, length, HALF_PX, 1.0, 0.0, Nadir.of_image(frame.mask.shape))
        (traced,) = with_overlaps(network, view, frame.mask, [trace])
        (overlap,) = traced.overlaps
        assert overlap.half_px == pytest.approx(HALF_PX, rel=0.15)
        places = np.argwhere(frame.mask)[:, ::-1] + 0.5
        near = np.linalg.norm(places - overlap.seen.place_px, axis=1) < 2 * HALF_PX
        true = part[frame.mask] * (POINTS - 1)
        on_first, on_second = (
            abs(true - (each.start + each.stop) / 2) for each in (overlap.first, overlap.second)
        )
        found = overlap.seen.log_odds(places[near]) > 0
        right += (found == (on_first < on_second)[near]).tolist()
    return float(np.mean(right))


@pytest.fixture(scope="module")
def stores() -> tuple[PaintedStore, PaintedStore]:
    """Ropes to learn from, and others."""
    return PaintedStore(130, seed=1), PaintedStore(30, seed=2)


@pytest.mark.long
def test_a_network_learns_which_strand_is_seen(
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


def test_readings_with_the_same_crossing_share_what_is_seen_there() -> None:
    frame, line, _ = painted(np.random.default_rng(3))
    length = float(np.linalg.norm(np.diff(line, axis=0), axis=1).sum())
    lines = [line, line + 0.3, line[::-1].copy(), line + 9.0]
    nadir = Nadir.of_image(frame.mask.shape)
    traces = [Trace(each, length, HALF_PX, 1.0, 0.0, nadir) for each in lines]
    known = with_overlaps(CrossingNetwork().eval(), Frame(frame.rgb, None), frame.mask, traces)
    one, near, other_way, far = (each.overlaps[0] for each in known)
    assert near.seen is one.seen is other_way.seen is not far.seen
    assert near.first == one.first != one.second
    # The second passage of a line is the first one of the line the other way.
    assert other_way.first.start == pytest.approx(POINTS - one.first.stop, abs=1)


def test_a_patch_is_turned_to_its_strand() -> None:
    """A picture that says where each of its pixels is."""
    v, u = np.mgrid[:60, :80] + 0.5
    picture = np.stack([u, v, u * 0], axis=-1).astype(np.float32)
    way, place = np.array([0.6, 0.8]), np.array([40.0, 30.0])
    # A line along the strand, and one that passes it at 4 px, which are 2 half widths.
    across = np.array([-0.8, 0.6])
    along = np.linspace(-20, 20, 5)[:, None] * way
    lines = place + np.stack([along, along + 4 * across])
    planes = crossing_planes(picture, place[None], way[None], lines[None], 2.0)[0].numpy()
    np.testing.assert_allclose(planes[:2, 23:25, 23:25].mean(axis=(1, 2)), place, atol=1e-3)
    np.testing.assert_allclose(planes[:2, 24, 25] - planes[:2, 24, 24], 0.25 * way, atol=1e-3)
    rows = (np.arange(48) - 23.5) / 8  # 6 half widths in 48 pixels
    np.testing.assert_allclose(planes[3, :, 10], abs(rows), atol=1e-4)
    np.testing.assert_allclose(planes[4, :, 30], abs(rows - 2), atol=1e-4)


def test_distances_end_with_their_lines() -> None:
    line = torch.tensor([[[[0.0, 0.0], [4.0, 0.0], [4.0, 3.0]]]])
    places = torch.tensor([[[[2.0, 1.0], [-3.0, 4.0], [5.0, 1.0], [7.0, 7.0]]]])
    assert distances(places, line).flatten().tolist() == pytest.approx([1, 5, 1, 5])
