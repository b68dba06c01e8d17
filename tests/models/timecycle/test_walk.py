"""The contrastive walk: copies by their places, losses by hand and against a loop, and as a run."""

from __future__ import annotations

import math
from pathlib import Path

import pytest
import torch

from pliant.models.timecycle import report
from pliant.models.timecycle.matcher import load_timecycle
from pliant.models.timecycle.settings import WalkSettings
from pliant.models.timecycle.trainer import train_timecycle
from pliant.models.timecycle.walk import Copies, walk_losses, warped_copies
from pliant.spec.dataset import Dataset
from tests.known import known
from tests.models.tiny_runs import timecycle

H, W = 12, 16
ONE = torch.ones(())
FULL = torch.ones(1, H, W, dtype=torch.bool)


def generator() -> torch.Generator:
    return torch.Generator().manual_seed(7)


def places() -> torch.Tensor:
    """Where each pixel's centre is, (1, H, W, 2)."""
    v, u = torch.meshgrid(torch.arange(H) + 0.5, torch.arange(W) + 0.5, indexing="ij")
    return torch.stack([u, v], dim=-1)[None]


def still() -> Copies:
    return Copies(torch.zeros(1, 1, H, W), FULL, places())


def test_each_pixel_of_a_copy_shows_its_origin() -> None:
    """The picture's two channels are its places, so bilinear reading gives them back."""
    picture = places().permute(0, 3, 1, 2).repeat(6, 1, 1, 1)
    copies = warped_copies(picture, FULL.repeat(6, 1, 1), WalkSettings(bend_px=1.0), generator())
    inside = ((copies.origin_px > 1) & (copies.origin_px < torch.tensor([W - 1, H - 1]))).all(-1)
    seen = copies.images.permute(0, 2, 3, 1)
    assert inside.sum() > 300
    torch.testing.assert_close(seen[inside], copies.origin_px[inside], atol=1e-3, rtol=0)
    assert copies.mask[inside].all()
    outside = ((copies.origin_px < 0) | (copies.origin_px > torch.tensor([W, H]))).any(-1)
    assert outside.any()
    assert not copies.mask[outside].any()


def test_copies_without_a_change_are_the_frames() -> None:
    same = WalkSettings(turn_deg=0, scale=0, shift=0, bend_px=0)
    picture = torch.rand(2, 3, H, W, generator=generator())
    copies = warped_copies(picture, FULL.repeat(2, 1, 1), same, generator())
    torch.testing.assert_close(copies.images, picture, atol=1e-5, rtol=0)
    torch.testing.assert_close(copies.origin_px, places().repeat(2, 1, 1, 1))


def test_a_turn_is_the_same_for_pixels_and_their_names() -> None:
    """Descriptors that are the origin's place bring every walk home, however copies are warped."""
    settings = WalkSettings(bend_px=1.0)
    a, b = (warped_copies(torch.zeros(1, 1, H, W), FULL, settings, generator()) for _ in "ab")
    between = places().permute(0, 3, 1, 2)
    described = (a.origin_px.permute(0, 3, 1, 2), between, b.origin_px.permute(0, 3, 1, 2))
    found = walk_losses(described, (a, b), FULL, 50 * ONE, settings, generator())
    assert float(found["walk_home"]) > 0.95


def test_walks_over_equal_pixels_end_anywhere() -> None:
    """KL(q || uniform) = log E - H(q), with q the Gaussian about each start."""
    settings = WalkSettings(walks=H * W, sigma_px=2.0)
    flat = torch.ones(1, 4, H, W)
    found = walk_losses((flat, flat, flat), (still(), still()), FULL, ONE, settings, generator())
    gap = torch.cdist(places().view(-1, 2), places().view(-1, 2))
    q = (-gap.square() / 8).softmax(dim=1)
    expected = (q * (q.log() + math.log(H * W))).sum(dim=1).mean()
    assert float(found["direct"]) == pytest.approx(float(expected), abs=1e-4)
    assert float(found["walk"]) == pytest.approx(float(expected), abs=1e-4)


def test_losses_agree_with_a_loop_over_the_object() -> None:
    settings = WalkSettings(walks=H * W, sigma_px=1.5)
    maps = torch.randn(3, 5, H, W, generator=generator())
    masks = torch.rand(3, H, W, generator=generator()) < 0.2
    a, b = (Copies(maps[:1], masks[n][None], places()) for n in (0, 2))
    found = walk_losses(
        (maps[:1], maps[1:2], maps[2:]), (a, b), masks[1:2], ONE, settings, generator()
    )
    direct, walk = [], []
    ends = masks[2].nonzero()
    for start in masks[0].nonzero():
        distance = (ends - start).float().norm(dim=1)
        if distance.min() >= 1.5:
            continue
        f = maps[0, :, start[0], start[1]]
        h, g = maps[2][:, masks[2]], maps[1][:, masks[1]]
        target = torch.exp(-(distance**2) / 4.5)
        target = target / target.sum()

        def p(x: torch.Tensor, ys: torch.Tensor) -> torch.Tensor:
            e = torch.exp(-((ys - x[:, None]) ** 2).sum(dim=0))
            return e / e.sum()

        through = sum(w * p(g[:, i], h) for i, w in enumerate(p(f, g)))
        direct.append((target * (target / p(f, h)).log()).sum())
        walk.append((target * (target / through).log()).sum())
    assert len(walk) > 10
    assert float(found["direct"]) == pytest.approx(float(sum(direct) / len(direct)), rel=1e-4)
    assert float(found["walk"]) == pytest.approx(float(sum(walk) / len(walk)), rel=1e-4)


def test_clips_without_the_object_count_nothing() -> None:
    maps = torch.randn(1, 4, H, W, requires_grad=True)
    gone = Copies(maps, ~FULL, places())
    found = walk_losses((maps,) * 3, (gone, gone), FULL, ONE, WalkSettings(), generator())
    loss = found["walk"] + found["direct"]
    loss.backward()
    assert loss.item() == 0
    assert not known(maps.grad).any()


def test_a_run_of_walks_alone_answers(
    tiny_episode: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(report, "write_timecycle_report", lambda *_: None)
    dataset = Dataset.open(tiny_episode)
    settings = timecycle(
        "clips.length=2",
        "lift=8",
        "losses={similarity: 0, skip: 0, long: 0, self_cycle: 0}",
        "walk.weight=1",
        "propagation.stride=2",
    )
    train_timecycle(dataset, tmp_path / "run", settings)
    logged = (tmp_path / "run").rglob("*.json")
    assert any("walk_home" in path.read_text() for path in logged)
    assert load_timecycle(tmp_path / "run").stride == 2
