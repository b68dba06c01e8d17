"""The ball of a rope, where a network sees it in the picture: in the mask, or beyond its end."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import numpy as np
import pytest
import torch
from scipy import ndimage

from pliant.models.don.ball import BallCandidates, BallNetwork, ball_in
from pliant.models.don.ball_training import _changed, fit_ball
from pliant.models.networks.mask_network import ROPE_SIDE, MaskNetwork
from pliant.models.networks.patches import PATCH
from pliant.spec.arrays import Float32Array, Mask, Rgb
from pliant.spec.frame import Frame
from tests.known import known

HEIGHT, WIDTH, HALF_PX = 240, 320, 6.0
ENDS = {"left": (120, 40), "right": (120, 280)}  # (row, column)


class GreenBall(BallNetwork):
    """Takes what is green near the middle of a patch, and out of the rope there, for a ball."""

    def forward(self, seen: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor]:
        green = (seen[:, 1] - torch.maximum(seen[:, 0], seen[:, 2])).clip(min=0)
        odds = 100 * green[:, 13:19, 15:23].mean(dim=(1, 2)) - 3
        at = (torch.arange(PATCH) + 0.5) / PATCH * 16 - 8
        amount = green.sum(dim=(1, 2)) + 1e-9
        ahead, aside = ((green.sum(dim=d) * at).sum(dim=1) / amount for d in (1, 2))
        area = amount / green.flatten(1).amax(dim=1).clip(min=1e-9) * (16 / PATCH) ** 2
        return odds, torch.stack([ahead, aside, (area / torch.pi).sqrt()], dim=1)


def disc(row: int, column: int, radius_px: float) -> Mask:
    rows, columns = np.indices((HEIGHT, WIDTH))
    return np.asarray(np.hypot(rows - row, columns - column) <= radius_px)


def drawn(*, knot: bool = True) -> Mask:
    """Return a straight rope, and in its middle a knot that is thicker than a ball."""
    line = np.ones((HEIGHT, WIDTH), dtype=np.bool_)
    line[120, 40:281] = False
    rope = np.asarray(ndimage.distance_transform_edt(line) <= HALF_PX)
    return rope | disc(120, 160, 14) if knot else rope


def green(where: Mask) -> Float32Array:
    """Return a picture in which only something is green."""
    picture = np.full((HEIGHT, WIDTH, 3), 0.5, dtype=np.float32)
    picture[where] = [0.1, 0.8, 0.1]
    return picture


class Doubtful(BallNetwork):
    """Says of each candidate that it may be a ball, so that the odds have a given sum.

    Args:
        log_odds: The logarithm of the sum.
    """

    def __init__(self, log_odds: float) -> None:
        super().__init__()
        self._log_odds = log_odds

    def forward(self, seen: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor]:
        count = len(seen)
        return torch.full((count,), self._log_odds - np.log(count)), torch.full((count, 3), 2.0)


@pytest.mark.parametrize(("log_odds", "there"), [(0.9, False), (1.1, True)])
def test_candidates_that_may_be_a_ball_count_together(log_odds: float, *, there: bool) -> None:
    specks = np.zeros((HEIGHT, WIDTH), np.bool_)
    specks[20:100:10, 20:300:40] = True
    for mask in (drawn(), drawn() | specks):
        assert ball_in(green(~mask), mask, Doubtful(log_odds)).any() == there


@pytest.mark.parametrize("end", ENDS)
def test_a_ball_that_the_mask_covers_is_cut_out_and_the_knot_stays(end: str) -> None:
    ball = disc(*ENDS[end], 12)
    found = ball_in(green(ball), drawn() | ball, GreenBall())
    assert (found & ball).sum() > 0.7 * (found | ball).sum()


@pytest.mark.parametrize("end", ENDS)
@pytest.mark.parametrize(("row", "radius_px"), [(120, 20), (114, 14), (127, 17)])
def test_a_ball_that_the_mask_lacks_is_where_the_network_sees_it(
    end: str, row: int, radius_px: int
) -> None:
    ball = disc(row, 24 if end == "left" else 296, radius_px)
    found = ball_in(green(ball), drawn(), GreenBall())
    assert (found & ball).sum() > 0.8 * (found | ball).sum()


@pytest.mark.parametrize("row", [40, 200])
@pytest.mark.parametrize("radius_px", [12, 20])
def test_a_ball_is_found_where_something_covers_the_rope_next_to_it(
    row: int, radius_px: int
) -> None:
    """No end and no thick place of the mask is near it."""
    ball = disc(row, 220, radius_px)
    found = ball_in(green(ball), drawn(), GreenBall())
    assert (found & ball).sum() > 0.8 * (found | ball).sum()


def test_where_the_network_sees_none_a_knot_is_none() -> None:
    nothing = np.zeros((HEIGHT, WIDTH), dtype=np.bool_)
    assert not ball_in(green(nothing), drawn(), GreenBall()).any()
    assert not ball_in(green(nothing), nothing, GreenBall()).any()


def test_a_patch_has_the_rope_on_its_left_at_the_same_width() -> None:
    for turns in range(4):
        mask = np.rot90(drawn(knot=False), turns)
        picture = np.zeros((*mask.shape, 3), dtype=np.float32)
        candidates = known(BallCandidates.of(np.ascontiguousarray(mask), picture))
        assert len(candidates.place) == 2
        patches = candidates.patches(picture).numpy()
        assert patches.shape == (2, 4, PATCH, PATCH)
        half = PATCH // 2
        assert (patches[:, 3, half - 1 : half + 1, : half - 2] > 0.9).all()
        assert (patches[:, 3, :, half + 3 :] < 0.1).all()
        across = patches[:, 3, :, 4].sum(axis=1) / PATCH * 16  # half widths of the rope
        np.testing.assert_allclose(across, 2.2, atol=0.35)


def test_a_ball_seen_from_any_candidate_is_drawn_where_it_is() -> None:
    ball = disc(60, 200, 15)
    candidates = known(BallCandidates.of(drawn(knot=False), green(ball)))
    assert len(candidates.place) == 3  # both ends, and the circle
    for number, seen in enumerate(candidates.relative_to_candidates(ball)):
        found = candidates.ball(number, *seen.tolist())
        assert (found & ball).sum() > 0.9 * (found | ball).sum()


def test_changed_patches_show_the_changed_ball() -> None:
    count, across = 64, (np.arange(PATCH) + 0.5) / PATCH * 16 - 8
    balls = np.random.default_rng(0).uniform([-2, -2, 1.5], [2, 2, 3], (count, 3))
    away = (across - balls[:, :1]) ** 2, (across - balls[:, 1:2]) ** 2
    seen = np.zeros((count, 4, PATCH, PATCH), dtype=np.float32)
    seen[:, 3] = away[0][:, None] + away[1][:, :, None] <= balls[:, 2, None, None] ** 2
    torch.manual_seed(0)
    shown, truth = _changed(torch.from_numpy(seen), torch.from_numpy(balls).float())
    mask = shown[:, 3].numpy().astype(float)
    area = mask.sum(axis=(1, 2))
    middle = [(mask.sum(axis=axis) * across).sum(axis=1) / area for axis in (1, 2)]
    radius = np.sqrt(area / np.pi) * 16 / PATCH
    np.testing.assert_allclose(np.stack([*middle, radius], axis=1), truth, atol=0.2)


class TrueMasks(MaskNetwork):
    """Finds the rope of the frame that was drawn last, and every other ball."""

    last: Frame

    def __init__(self) -> None:
        super().__init__()
        self.asked = 0

    def found(self, rgb: Rgb, side: int = ROPE_SIDE) -> Float32Array:
        rope, objects = known(self.last.mask), known(self.last.objects)
        self.asked += 1
        return np.stack([rope, objects if self.asked % 2 else rope]).astype(np.float32)


class Drawn(list[Frame]):
    """Frames that pass the one that is drawn on to the masks."""

    def __init__(self, masks: TrueMasks, frames: Iterable[Frame]) -> None:
        super().__init__(frames)
        self.masks = masks

    def __getitem__(self, number: Any) -> Any:
        self.masks.last = super().__getitem__(number)
        return self.masks.last


def painted(rng: np.random.Generator) -> Frame:
    """Return a frame of a rope with or without a round ball and with a square knot."""
    rope, ball = drawn(knot=False), np.zeros((HEIGHT, WIDTH), dtype=np.bool_)
    rope[104:137, 144:177] = True
    if rng.random() < 0.6:
        ball = disc(*ENDS["left"], 18)
    colours = rng.uniform(
        [[0, 0, 0], [90, 90, 90], [170, 170, 170]], [[60] * 3, [150] * 3, [255] * 3]
    )
    rng.shuffle(colours)
    rgb = np.broadcast_to(colours[0], (HEIGHT, WIDTH, 3)).copy()
    rgb[rope], rgb[ball] = colours[1], colours[2]
    quarters = int(rng.integers(4))
    rgb, rope, ball = (np.ascontiguousarray(np.rot90(each, quarters)) for each in (rgb, rope, ball))
    return Frame(rgb.astype(np.uint8), mask=rope & ~ball, objects=rope | ball)


@pytest.mark.long
def test_training_learns_what_a_ball_looks_like(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("pliant.models.don.ball_training._relit", lambda rgb, *_: rgb)  # quicker
    rng = np.random.default_rng(0)
    masks = TrueMasks()
    frames = Drawn(masks, (painted(rng) for _ in range(80)))
    network = known(fit_ball(masks, [frames], pictures=400, seed=1))
    right = 0
    for frame in (painted(rng) for _ in range(30)):
        rope, objects = known(frame.mask), known(frame.objects)
        found = ball_in(frame.rgb.astype(np.float32) / 255, objects, network)
        ball = objects & ~rope
        right += bool(
            (found & ball).sum() > 0.5 * (found | ball).sum() if ball.any() else not found.any()
        )
    assert right >= 27


def test_without_a_ball_nothing_is_learnt() -> None:
    masks = TrueMasks()
    shown = [painted(np.random.default_rng(k)) for k in range(6)]
    bare = Drawn(masks, (each.replace(mask=each.objects) for each in shown))
    assert fit_ball(masks, [bare], pictures=4, seed=0) is None


def test_a_rope_that_is_thick_next_to_cables_is_no_ball() -> None:
    """All of it is deeper than a ball on the cables, whose width most of the mask has."""
    thin = np.zeros((HEIGHT, WIDTH), dtype=np.bool_)
    for row in (12, 24, 36, 48, 200, 212, 224):
        thin[row - 2 : row + 3, 10:310] = True
    ball = disc(*ENDS["right"], 12)
    found = ball_in(green(ball), drawn(knot=False) | ball | thin, GreenBall())
    assert (found & ball).sum() > 0.5 * (found | ball).sum()
