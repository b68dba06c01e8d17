"""Trains the ball network: a rope's ball against ends, knots and crossings.

Pictures are shown as they are, and in other colours and light, as to the network for masks. In the
mask that is found in each, the candidates near the true ball are right and all others are wrong;
the right ones also teach the ball's place and radius. From a part of these masks the ball is taken
away, as it is missing where it looks like the table.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Final, NamedTuple

import numpy as np
import torch
from scipy import ndimage
from torch.nn import functional

from pliant.models.don.ball import REACH, BallCandidates, BallNetwork, distances_px
from pliant.models.don.mask_training import SAMPLINGS, coloured
from pliant.models.don.one_rope import resized
from pliant.models.don.segmentation import denoised, picture_as, shown
from pliant.models.networks.mask_network import MaskNetwork
from pliant.models.networks.patches import fit_patches, recoloured, rotations
from pliant.models.training.loop import StepProgress
from pliant.spec.arrays import Mask, Rgb
from pliant.spec.frame import Frame

PICTURES: Final = 4000
"""Pictures that candidates are drawn from."""

_AS_IT_IS: Final = 1 / 3  # share of the pictures in their own colours and light
_LACKING: Final = 0.4  # share of the masks whose ball is taken away
_NEAR: Final = 2.0  # largest distance of a right candidate to the ball, half widths of the rope
_EPOCHS: Final = 12
_TURN_RAD, _SCALE, _SHIFT = 0.3, 0.12, 0.06  # standard deviations of a patch's changes


def fit_ball(
    masks: MaskNetwork,
    sets: Sequence[Sequence[Frame]],
    *,
    pictures: int = PICTURES,
    seed: int,
    progress: StepProgress | None = None,
) -> BallNetwork | None:
    """Train a network that finds the ball of a rope.

    Args:
        masks: Finds ropes, trained.
        sets: Pictures with masks, those of training splits; each comes from a set drawn at random.
        pictures: How many are drawn; 4,000 take 25 minutes on one core.
        seed: Seed of all draws.
        progress: Called after each picture.

    Returns:
        The network; None where no ball was seen, or nothing but balls.
    """
    rng = np.random.default_rng(seed)
    with torch.random.fork_rng(devices=[]):
        torch.manual_seed(seed)
        drawn = list(_candidates(masks, sets, pictures, rng, progress))
        right = torch.cat([each.near for each in drawn]) if drawn else torch.zeros(0)
        if not 0 < right.sum() < len(right):
            return None
        seen = torch.cat([each.seen for each in drawn])
        balls = torch.cat([each.balls for each in drawn])
        network = BallNetwork()

        def loss(rows: torch.Tensor) -> torch.Tensor:
            shown, truth = _changed(seen[rows], balls[rows])
            odds, found = network(shown)
            apart = functional.smooth_l1_loss(found, truth, reduction="none").mean(dim=1)
            near = right[rows]
            return functional.binary_cross_entropy_with_logits(odds, near) + (near * apart).mean()

        fit_patches(network, loss, len(right), epochs=_EPOCHS)
        return network


class _Candidates(NamedTuple):
    """The candidates of a picture: patches (N, 4, h, w), 1 for those near the ball, the balls."""

    seen: torch.Tensor
    near: torch.Tensor
    balls: torch.Tensor


def _candidates(
    masks: MaskNetwork,
    sets: Sequence[Sequence[Frame]],
    pictures: int,
    rng: np.random.Generator,
    progress: StepProgress | None,
) -> Iterator[_Candidates]:
    for number in range(pictures):
        frames = sets[rng.integers(len(sets))]
        frame = frames[rng.integers(len(frames))]
        assert frame.mask is not None
        objects = frame.mask if frame.objects is None else frame.objects
        rgb = frame.rgb if rng.random() < _AS_IT_IS else _relit(frame.rgb, frame.mask, objects)
        rgb = denoised(rgb)
        found = shown(rgb, masks.found(rgb).max(axis=0))
        if progress is not None:
            progress(number + 1, {})
        if found is None:
            continue
        ball = resized(objects & ~frame.mask, found.shape)
        if rng.random() < _LACKING:
            found = _without(ball, found, rng)
        picture = picture_as(found, rgb)
        candidates = BallCandidates.of(found, picture)
        if candidates is not None:
            gap_px = ndimage.distance_transform_edt(~ball)[tuple(candidates.place.T)]
            near = ball.any() & (gap_px <= _NEAR * candidates.half_px)
            balls = (
                candidates.relative_to_candidates(ball) if ball.any() else np.zeros((len(near), 3))
            )
            yield _Candidates(
                candidates.patches(picture),
                torch.from_numpy(near).float(),
                torch.from_numpy(balls).float(),
            )


def _without(ball: Mask, found: Mask, rng: np.random.Generator) -> Mask:
    """Return a mask without a disc about where the ball is; some of the ball may stay."""
    if not ball.any():
        return found
    radius_px = np.sqrt(ball.sum() / np.pi)
    middle = np.argwhere(ball).mean(axis=0) + rng.normal(0, 0.3 * radius_px, 2)
    kept = distances_px(middle, found.shape) > rng.uniform(0.9, 1.5) * radius_px
    return np.asarray(found & kept)


def _relit(rgb: Rgb, mask: Mask, objects: Mask) -> Rgb:
    """Return a picture in other colours and light."""
    truth = torch.from_numpy(np.stack([mask, objects]).astype(np.float32))[None]
    picture = torch.from_numpy(rgb.transpose(2, 0, 1).astype(np.float32) / 255)[None]
    changed = coloured(picture, truth, SAMPLINGS["rope"].camouflaged, relit=True)[0]
    return np.asarray((changed.permute(1, 2, 0) * 255).round().numpy(), dtype=np.uint8)


def _changed(seen: torch.Tensor, balls: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor]:
    """Return patches (N, 4, h, w) in other colours, mirrored, turned, enlarged and moved a bit.

    With them the balls (N, 3), as a `BallNetwork` returns them.
    """
    count = len(seen)
    seen = torch.cat([recoloured(seen[:, None, :3])[:, 0], seen[:, 3:]], dim=1)
    mirrored = torch.rand(count) < 0.5
    seen = torch.where(mirrored[:, None, None, None], seen.flip(2), seen)
    aside = torch.where(mirrored, -balls[:, 1], balls[:, 1])
    angle, scale = _TURN_RAD * torch.randn(count), torch.exp(_SCALE * torch.randn(count))
    turn = scale[:, None, None] * rotations(angle)
    shift = _SHIFT * torch.randn(count, 2)
    grid = functional.affine_grid(
        torch.cat([turn, shift[..., None]], dim=2), list(seen.shape), align_corners=False
    )
    seen = functional.grid_sample(seen, grid, padding_mode="border", align_corners=False)
    # The grid leads from changed places to those before.
    before = torch.stack([balls[:, 0], aside], dim=1) - REACH * shift
    places = torch.linalg.solve(turn, before)
    return seen, torch.cat([places, balls[:, 2:] / scale[:, None]], dim=1)
