"""Learns to find a rope and its ball, or a cloth, in a picture, from frames of training splits.

Every sample is a part of a picture, turned, enlarged and mirrored at random. Object, ball and
background get new colours on their own, and sometimes strands get the background's; in a part of
the samples the background is drawn (noise of several sizes, stripes), with a soft shadow. So the
shape and the edges of an object have to tell it from the table, not the colours of a renderer.
Other objects in a picture count as the table. Later cycles, at a lower rate, show pictures in other
light too: with bands of shadow, without colour, on tables with chequers and stripes, and on painted
ones (`painted_tables.py`). Trained on these from the start, a network loses as much where the light
is even as it gains.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
import torch
from torch.nn import functional

from pliant.models.don.painted_tables import painted_table
from pliant.models.networks.mask_network import CLOTH_SIDE, ROPE_SIDE, MaskNetwork, at_side
from pliant.models.training.loop import StepProgress
from pliant.models.training.processes import bfloat16_is_native
from pliant.spec.frame import Frame

_SHAPE: Final = (256, 320)  # rows, columns of a sample, as the network sees it
_BATCH: Final = 6
_RATE, _LATER_RATE = 3e-3, 1.2e-3
_NEW_BACKGROUND: Final = 0.4
_NEW_COLOURS: Final = 0.6
_NEW_BALL: Final = 0.6
_BLURRED: Final = 0.3
_MOST_NOISE: Final = 0.1
_LIT_UNEVENLY: Final = 0.35
_PATTERNED: Final = 0.4  # of the backgrounds that are drawn
_PAINTED: Final = 0.35
_GREY, _PALE = 0.15, 0.3  # samples without colour, and those with no more than a part of it


@dataclass(frozen=True)
class Sampling:
    """How samples of a kind of object are drawn.

    Attributes:
        side: Pixels of the longer side of a picture as the network sees it.
        scales: Least and largest enlargement of a sample.
        whole: Show whole pictures, not what is around a pixel of the object.
        camouflaged: Probability that some strands have the table's colour.
    """

    side: int
    scales: tuple[float, float]
    whole: bool
    camouflaged: float


SAMPLINGS: Final = {
    "rope": Sampling(ROPE_SIDE, (0.5, 1.6), whole=False, camouflaged=0.15),
    "cloth": Sampling(CLOTH_SIDE, (0.8, 1.2), whole=True, camouflaged=0.0),
}


def fit_masks(
    sets: Sequence[Sequence[Frame]],
    *,
    steps: int,
    later: Sequence[int] = (),
    later_sets: Sequence[Sequence[Frame]] = (),
    widen: bool = False,
    seed: int,
    sampling: Sampling,
    progress: StepProgress | None = None,
) -> MaskNetwork:
    """Train a network that finds masks.

    Args:
        sets: Pictures with masks, those of training splits. A sample is of a set drawn at
            random, so that a few pictures of another renderer count as much as many of one.
        steps: Steps of 6 samples, in bfloat16 where the processor has it; 1,500 take 10 to 25
            minutes on one core, of the wider network 20 to 40.
        later: Steps of each cycle that follows, with pictures in other light and without colour.
        later_sets: Further sets, which only these cycles see.
        widen: Double the channels for the last cycle.
        seed: Seed of all draws.
        sampling: How samples are drawn, `SAMPLINGS` of the kind of object.
        progress: Called after each step.
    """
    rng = np.random.default_rng(seed)
    with torch.random.fork_rng(devices=[]):
        torch.manual_seed(seed)
        network = MaskNetwork()
        done = 0
        for cycle, count in enumerate((steps, *later)):
            if widen and cycle == len(later):
                network = network.widened()
            rate = _LATER_RATE if cycle else _RATE
            shown = [*sets, *later_sets] if cycle else sets
            optimiser = torch.optim.AdamW(network.parameters(), lr=rate, weight_decay=0.02)
            schedule = torch.optim.lr_scheduler.OneCycleLR(optimiser, rate, total_steps=count)
            for _ in range(count):
                drawn = [shown[k] for k in rng.integers(0, len(shown), _BATCH)]
                chosen = [frames[rng.integers(len(frames))] for frames in drawn]
                samples = torch.stack([_sample(frame, rng, sampling) for frame in chosen])
                truth = samples[:, 3:]
                pictures = coloured(samples[:, :3], truth, sampling.camouflaged, relit=cycle > 0)
                with torch.autocast("cpu", torch.bfloat16, enabled=bfloat16_is_native("cpu")):
                    logits = network(pictures)
                loss = _loss(logits.float(), truth)
                optimiser.zero_grad()
                loss.backward()
                optimiser.step()
                schedule.step()
                done += 1
                if progress is not None:
                    progress(done, {"loss": loss.item()})
    return network.eval()


def _loss(logits: torch.Tensor, truth: torch.Tensor) -> torch.Tensor:
    """Return binary cross-entropy plus one minus the Dice coefficient, for (N, 2, h, w)."""
    entropy = functional.binary_cross_entropy_with_logits(logits, truth)
    p = logits.sigmoid()
    both = 2 * (p * truth).sum(dim=(2, 3)) + 1
    return entropy + 1 - (both / ((p + truth).sum(dim=(2, 3)) + 1)).mean()


def _sample(frame: Frame, rng: np.random.Generator, sampling: Sampling) -> torch.Tensor:
    """Return a part of a picture with its masks, without and with the ball, float (5, h, w)."""
    assert frame.mask is not None
    objects = frame.mask if frame.objects is None else frame.objects
    planes = [frame.rgb / 255, frame.mask[..., None], objects[..., None]]
    whole = at_side(np.concatenate(planes, axis=2).astype(np.float32), sampling.side)
    height, width = whole.shape[:2]
    rows, columns = np.nonzero(whole[..., 4] > 0.5)
    centre = rng.uniform(0, [width, height])
    if sampling.whole:
        centre = np.array([width, height]) / 2 + rng.normal(0, 20, 2)
    elif len(rows) and rng.random() < 0.9:
        k = rng.integers(len(rows))
        centre = np.array([columns[k], rows[k]]) + rng.normal(0, 60, 2)
    scale = np.exp(rng.uniform(*np.log(sampling.scales)))
    angle = rng.uniform(0, 2 * np.pi)
    cosine, sine = np.cos(angle) / scale, np.sin(angle) / scale
    turn = np.array([[cosine, -sine], [sine, cosine]]) @ np.diag([rng.choice([-1, 1]), 1])
    half = np.array(_SHAPE[::-1]) / 2
    unit = np.array([width, height]) / 2
    matrix = np.concatenate([turn * half / unit[:, None], (centre / unit - 1)[:, None]], axis=1)
    grid = functional.affine_grid(
        torch.from_numpy(matrix[None]).float(), [1, 5, *_SHAPE], align_corners=False
    )
    image = torch.from_numpy(whole.transpose(2, 0, 1))[None]
    beyond = "border" if sampling.whole else "reflection"
    return functional.grid_sample(image, grid, padding_mode=beyond, align_corners=False)[0]


def coloured(
    rgb: torch.Tensor, truth: torch.Tensor, camouflaged: float, *, relit: bool
) -> torch.Tensor:
    """Return pictures (N, 3, h, w) in other colours, with some other backgrounds.

    Args:
        rgb: float (N, 3, h, w), 0 to 1.
        truth: float (N, 2, h, w), masks without and with the ball.
        camouflaged: Probability that some strands have the table's colour.
        relit: Show some with shadows, without colour, and on tables with a pattern.
    """
    count = len(rgb)
    each = (count, 1, 1, 1)
    own, objects = truth[:, :1], truth[:, 1:]
    table = torch.where(
        torch.rand(each) < _NEW_BACKGROUND, _backgrounds(rgb, objects, patterned=relit), rgb
    )
    if relit:
        table = _painted(table, objects)
    new = torch.rand(each) < _NEW_COLOURS
    front = torch.where(new, _mixed(rgb), rgb)
    table = torch.where(new, _mixed(table), table)
    hidden = torch.rand(each) < camouflaged
    front = torch.where(hidden, _with_strands_of(table, front, own, 1 - objects), front)
    ball = torch.where(torch.rand(each) < _NEW_BALL, _mixed(rgb), front)
    picture = own * front + (objects - own) * ball + (1 - objects) * table
    picture = picture * torch.exp(0.25 * torch.randn(count, 3, 1, 1) * torch.rand(each))
    if relit:
        picture = _faded(picture * _light(picture))
    picture = picture.clamp(0.0, 1.0) ** torch.exp(0.3 * torch.randn(each))
    blurred = functional.avg_pool2d(picture, 3, 1, 1)
    picture = torch.where(torch.rand(each) < _BLURRED, blurred, picture)
    noise = torch.randn_like(picture) * _MOST_NOISE * torch.rand(each).square()
    return (picture + noise).clamp(0.0, 1.0)


def _light(rgb: torch.Tensor) -> torch.Tensor:
    """Return the light of pictures (N, 1, h, w), 0 to 1: in some a band of shadow crosses all.

    Its edges are between half a pixel and 60 px wide; a wide band darkens one side of a picture.
    """
    count, _, height, width = rgb.shape
    each = (count, 1, 1)
    y, x = torch.meshgrid(torch.arange(height), torch.arange(width), indexing="ij")
    angle = 2 * torch.pi * torch.rand(each)
    inside = (x - width / 2) * angle.cos() + (y - height / 2) * angle.sin()
    inside = inside - 0.3 * width * torch.randn(each)
    soft = 0.5 * 120 ** torch.rand(each)
    band = (inside / soft).sigmoid() * ((20 * 20 ** torch.rand(each) - inside) / soft).sigmoid()
    dark = 0.8 * torch.rand(each) * (torch.rand(each) < _LIT_UNEVENLY)
    return (1 - dark * band)[:, None]


def _faded(rgb: torch.Tensor) -> torch.Tensor:
    """Return pictures of which some have lost their colour, or a part of it."""
    each = (len(rgb), 1, 1, 1)
    drawn, share = torch.rand(each), torch.rand(each)
    share = torch.where(drawn < _GREY, 0.0, torch.where(drawn < _PALE, share, 1.0))
    grey = rgb.mean(dim=1, keepdim=True)
    return grey + share * (rgb - grey)


def _mixed(rgb: torch.Tensor) -> torch.Tensor:
    """Return pictures with channels mixed at random and another brightness."""
    count = len(rgb)
    mixing = torch.eye(3) + 0.4 * torch.randn(count, 3, 3)
    mixed = torch.einsum("nchw,ndc->ndhw", rgb, mixing) + 0.2 * torch.randn(count, 3, 1, 1)
    return mixed.clamp(0.0, 1.0)


def _with_strands_of(
    table: torch.Tensor, front: torch.Tensor, own: torch.Tensor, around: torch.Tensor
) -> torch.Tensor:
    """Return pictures in which the darker or the lighter strands of a rope have the table's colour.

    Args:
        table: float (N, 3, h, w), pictures of the table.
        front: float (N, 3, h, w), pictures of the rope.
        own: float (N, 1, h, w), the rope's mask.
        around: float (N, 1, h, w), the table's mask.
    """

    def mean(values: torch.Tensor, where: torch.Tensor) -> torch.Tensor:
        return (values * where).sum((2, 3), True) / where.sum((2, 3), True).clamp_min(1)

    light = front.mean(dim=1, keepdim=True)
    side = torch.randint(0, 2, (len(front), 1, 1, 1)) * 2 - 1
    strands = (side * (light - mean(light, own)) > 0).float()
    shade = light / mean(light, own * strands).clamp_min(0.02)
    return torch.where(strands > 0, mean(table, around) * shade, front)


def _pattern(
    x: torch.Tensor, y: torch.Tensor, angle: torch.Tensor, period: torch.Tensor
) -> torch.Tensor:
    """Return stripes or chequers with edges, (N, h, w), -1 to 1; in some samples 0.

    Args:
        x: float (h, w), column of each pixel.
        y: float (h, w), row.
        angle: float (N, 1, 1), direction in which the pattern changes, rad.
        period: float (N, 1, 1), px.
    """
    along = torch.sin((x * angle.cos() + y * angle.sin()) * 2 * torch.pi / period)
    across = torch.sin((y * angle.cos() - x * angle.sin()) * 2 * torch.pi / period)
    drawn = torch.rand_like(angle)
    chequered = torch.where(drawn < _PATTERNED / 2, along * across, along)
    return torch.where(drawn < _PATTERNED, (20 * chequered).tanh(), 0.0)


def _backgrounds(rgb: torch.Tensor, objects: torch.Tensor, *, patterned: bool) -> torch.Tensor:
    """Return backgrounds of noise and stripes, with a shadow next to the objects."""
    count, _, height, width = rgb.shape
    drawn = torch.rand(count, 3, 1, 1).expand(count, 3, height, width)
    for side in (3, 9, 28, 80):
        noise = torch.randn(count, 3, side, side)
        noise = torch.where(torch.rand(count, 1, 1, 1) < 0.7, noise.mean(1, keepdim=True), noise)
        strength = 0.2 * torch.rand(count, 1, 1, 1).square()
        smooth = functional.interpolate(noise, (height, width), mode="bilinear")
        drawn = drawn + strength * smooth
    y, x = torch.meshgrid(torch.arange(height), torch.arange(width), indexing="ij")
    angle, period = torch.rand(count, 1, 1) * torch.pi, 6 + 60 * torch.rand(count, 1, 1)
    wave = torch.sin((x * angle.cos() + y * angle.sin()) * 2 * torch.pi / period)[:, None]
    drawn = drawn + 0.25 * torch.rand(count, 1, 1, 1).square() * wave
    if patterned:
        drawn = drawn + _pattern(x, y, angle, period)[:, None] * 0.3 * torch.randn(count, 3, 1, 1)
    return (drawn * _shadow(objects)).clamp(0.0, 1.0)


def _painted(table: torch.Tensor, objects: torch.Tensor) -> torch.Tensor:
    """Return backgrounds of which some are tables with a drawn pattern, in the objects' shadow."""
    rng = np.random.default_rng(int(torch.randint(2**31, ())))
    count, _, height, width = table.shape
    light, tables = _shadow(objects), table.clone()
    for k in np.flatnonzero(rng.random(count) < _PAINTED):
        drawn = torch.from_numpy(painted_table(height, width, rng).transpose(2, 0, 1))
        tables[k] = drawn * light[k]
    return tables


def _shadow(objects: torch.Tensor) -> torch.Tensor:
    """Return the light (N, 1, h, w), 0.4 to 1, that soft shadows next to objects leave."""
    shift = tuple(int(k) for k in torch.randint(-9, 10, (2,)))
    shadow = functional.avg_pool2d(objects.roll(shift, (2, 3)), 9, 1, 4)
    return 1 - 0.6 * torch.rand(len(objects), 1, 1, 1) * shadow
