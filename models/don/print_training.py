"""Learns to describe prints, from frames of blank cloths that are painted again in every step.

The truth says which part of the cloth each pixel shows. So any print can be painted on two frames,
with the brightness that folds and light give the blank cloth there. No print is shown twice: what
the network can learn is not a print, but how to find any. Both pictures are turned, enlarged,
seen in other light, blurred and made noisy, with masks that are too wide or too narrow.
The back of a cloth has the print too, a paler one, or none.
"""

from __future__ import annotations

from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from typing import Final

import cv2
import numpy as np
import numpy.typing as npt
import torch

from pliant.loaders.frame_store import FrameStore
from pliant.loaders.views import draw_points
from pliant.models.don.painted_tables import painted_table
from pliant.models.losses.distributional import log_probabilities
from pliant.models.losses.matches import all_bins
from pliant.models.networks.descriptor_network import sample_descriptors
from pliant.models.networks.print_network import PrintNetwork, print_planes
from pliant.models.training.loop import StepProgress
from pliant.models.training.optimiser import learning_rate, make_optimiser
from pliant.models.training.processes import bfloat16_is_native
from pliant.models.training.settings import OptimiserSettings
from pliant.spec.arrays import BoolArray, Float32Array, Mask
from pliant.spec.io.resizing import resize_nearest

_PAIRS: Final = 3  # of a step
_QUERIES: Final = 96
_OPTIMISER: Final = OptimiserSettings(kind="muon", learning_rate=1e-3, matrix_rate=0.01)
_BIN_PX: Final = 2
_SIGMA_PX: Final = 1.5
_PRINT_SIDE: Final = 256
_SCALES: Final = (0.65, 1.3)
_BLURRED: Final = 0.4
_WRONG_MASK: Final = 0.5
_SAME_BACK: Final = 0.5
_TURN_RAD: Final = 0.4
_LANDMARKS: Final = 0.6
_KNOWN_PX: Final = (10.0, 35.0)  # standard deviation of what is known of a place beforehand,
_OFF: Final = 0.7  # and the error of the guess, as a share of it
_CLOUDY: Final = 0.35  # so that a pattern that repeats has places that can be told apart


@dataclass(frozen=True)
class _Sheet:
    """A frame of a blank cloth.

    Attributes:
        rgb: float32 (h, w, 3), 0 to 1.
        mask: bool (h, w).
        material: float32 (h, w, 2), the part of the cloth that a pixel shows, 0 to 1.
        front: bool (h, w), whether it is seen from the side that most pixels show.
        uv_px: float32 (P, 2), the points in the picture.
        visible: bool (P,).
    """

    rgb: Float32Array
    mask: Mask
    material: Float32Array
    front: BoolArray
    uv_px: Float32Array
    visible: BoolArray


def fit_prints(
    stores: Sequence[FrameStore], *, steps: int, seed: int, progress: StepProgress | None = None
) -> PrintNetwork:
    """Train a network that describes prints.

    Args:
        stores: Frames of blank cloths, each store of one tier, all of one size.
        steps: Steps of 3 pairs, in bfloat16 where the processor has it.
        seed: Seed of all draws.
        progress: Called after each step.
    """
    sheets = [[_sheet(store, number) for number in range(len(store))] for store in stores]
    rng = np.random.default_rng(seed)
    share = np.array([len(each) for each in sheets], dtype=np.float64)
    with torch.random.fork_rng(devices=[]):
        torch.manual_seed(seed)
        network = PrintNetwork()
        optimiser = make_optimiser(network, _OPTIMISER)

        def pairs() -> list[tuple[_Picture, _Picture]]:
            chosen = rng.choice(len(sheets), _PAIRS, p=share / share.sum())
            return [_painted_pair(sheets[k], rng) for k in chosen]

        with ThreadPoolExecutor(1) as painter:  # while the network learns from those of before
            following = painter.submit(pairs)
            for step in range(steps):
                painted, following = following.result(), painter.submit(pairs)
                rate = learning_rate(_OPTIMISER, step, steps)
                for group in optimiser.param_groups:
                    group["lr"] = rate * group["ratio"]
                loss = _loss(network, painted)
                optimiser.zero_grad()
                loss.backward()
                torch.nn.utils.clip_grad_norm_(network.parameters(), _OPTIMISER.clip_norm)
                optimiser.step()
                if progress is not None:
                    progress(step + 1, {"loss": loss.item()})
    return network.eval()


def _sheet(store: FrameStore, number: int) -> _Sheet:
    frame, surface = store.view(number), store.frames[number].surface
    assert surface is not None  # a store's frames have dense truth
    material = np.stack([resize_nearest(m, store.size) for m in (surface.m0, surface.m1)], axis=2)
    material = np.nan_to_num(material).astype(np.float32)
    steps = [cv2.blur(cv2.Sobel(material, cv2.CV_32F, *way), (3, 3)) for way in ((1, 0), (0, 1))]
    turned = steps[0][..., 0] * steps[1][..., 1] - steps[0][..., 1] * steps[1][..., 0]
    mirrored = turned > 0
    front = mirrored == (mirrored[frame.mask].mean() >= 0.5 if frame.mask.any() else True)
    rgb = frame.rgb.astype(np.float32) / 255
    return _Sheet(rgb, frame.mask, material, front, frame.uv_px, frame.visible)


@dataclass(frozen=True)
class _Picture:
    """A painted picture: planes float32 (4, h, w), mask bool (h, w), points float32 (Q, 2)."""

    planes: Float32Array
    mask: Mask
    uv_px: Float32Array


def _painted_pair(sheets: Sequence[_Sheet], rng: np.random.Generator) -> tuple[_Picture, _Picture]:
    """Return two frames with one new print."""
    pair = [sheets[k] for k in rng.integers(0, len(sheets), 2)]
    points = draw_points(rng, pair[0].visible & pair[1].visible, _QUERIES)
    front = _print(rng)
    paler = 1.0 if rng.random() < _SAME_BACK else rng.uniform(0, 0.7)
    mean = front.mean(axis=(0, 1), keepdims=True)
    sides = front, (mean + paler * (front - mean)).astype(np.float32)
    angle = rng.uniform(0, 2 * np.pi)
    first, second = (
        _pictured(sheet, sides, points, angle + rng.normal(0, _TURN_RAD), rng) for sheet in pair
    )
    return first, second


def _print(rng: np.random.Generator) -> Float32Array:
    """Return a print, float32 (_PRINT_SIDE, _PRINT_SIDE, 3), 0 to 1."""
    side = _PRINT_SIDE
    pattern = painted_table(side, side, rng)
    if rng.random() < _LANDMARKS:
        pattern = _with_landmarks(pattern, rng)
    if rng.random() >= _CLOUDY:
        return pattern
    clouds = rng.random((int(rng.integers(3, 12)),) * 2 + (3,), dtype=np.float32)
    smooth = cv2.resize(clouds, (side, side), interpolation=cv2.INTER_CUBIC)
    share = rng.choice([0.3, 0.6, 1.0])
    return np.asarray((pattern + share * (smooth - pattern)).clip(0, 1), dtype=np.float32)


def _with_landmarks(pattern: Float32Array, rng: np.random.Generator) -> Float32Array:
    """Return a print with a few large ellipses and rectangles on it."""
    pattern = np.ascontiguousarray(pattern)
    for _ in range(int(rng.integers(1, 6))):
        colour = rng.random(3).tolist()
        centre = rng.integers(0, _PRINT_SIDE, 2).tolist()
        axes = (_PRINT_SIDE * rng.uniform(0.03, 0.2, 2)).astype(int).tolist()
        if rng.random() < 0.5:
            cv2.ellipse(pattern, centre, axes, rng.uniform(0, 360), 0, 360, colour, -1)
        else:
            box = cv2.boxPoints((centre, [2 * k for k in axes], rng.uniform(0, 360)))
            cv2.fillConvexPoly(pattern, box.astype(np.int32), colour)
    return pattern


def _pictured(
    sheet: _Sheet,
    sides: tuple[Float32Array, Float32Array],
    points: npt.NDArray[np.intp],
    angle: float,
    rng: np.random.Generator,
) -> _Picture:
    column, row = (sheet.material * _PRINT_SIDE - 0.5).transpose(2, 0, 1)
    painted = [
        cv2.remap(side, column, row, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
        for side in sides
    ]
    light = sheet.rgb.mean(axis=2)
    light = light / max(float(np.median(light[sheet.mask])) if sheet.mask.any() else 1.0, 0.05)
    cloth = np.where(sheet.front[..., None], *painted) * light[..., None]
    picture = np.where(sheet.mask[..., None], cloth, sheet.rgb)
    picture = _relit(picture.clip(0, 1).astype(np.float32), rng)
    places = np.where(sheet.visible[points, None], sheet.uv_px[points], np.float32(-1e3))
    return _turned(picture, sheet.mask, places, angle, rng)


def _relit(picture: Float32Array, rng: np.random.Generator) -> Float32Array:
    """Return a picture in other light, blurred or with noise."""
    picture = picture * np.exp(rng.normal(0, 0.2) + rng.normal(0, 0.06, 3))
    picture = picture.clip(0, 1) ** np.exp(rng.normal(0, 0.2))
    if rng.random() < _BLURRED:
        picture = np.asarray(cv2.GaussianBlur(picture, (0, 0), rng.uniform(0.3, 1.0)), np.float32)
    noise = 0.06 * rng.random() ** 2 * rng.standard_normal(picture.shape)
    return np.asarray((picture + noise).clip(0, 1), dtype=np.float32)


def _turned(
    picture: Float32Array, mask: Mask, uv_px: Float32Array, angle: float, rng: np.random.Generator
) -> _Picture:
    """Return a picture turned and enlarged about the middle of the cloth, with another mask."""
    height, width = mask.shape
    rows, columns = np.nonzero(mask)
    middle = np.array([columns.mean(), rows.mean()]) if len(rows) else np.array([width, height]) / 2
    scale = np.exp(rng.uniform(*np.log(_SCALES)))
    turn = scale * np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
    shift = np.array([width, height]) / 2 + rng.normal(0, 8, 2) - turn @ middle
    places = uv_px @ turn.T + shift
    corner = shift + turn @ [0.5, 0.5] - 0.5  # OpenCV has the first pixel's centre at 0
    matrix = np.concatenate([turn, corner[:, None]], axis=1)
    seen = cv2.warpAffine(picture, matrix, (width, height), borderMode=cv2.BORDER_REPLICATE)
    shown = cv2.warpAffine(mask.astype(np.float32), matrix, (width, height)) > 0.5
    if rng.random() < _WRONG_MASK:
        grow = cv2.dilate if rng.random() < 0.5 else cv2.erode
        kernel = np.ones((3, 3), np.uint8)
        shown = grow(shown.astype(np.uint8), kernel, iterations=int(rng.integers(1, 3))) > 0
    return _Picture(
        print_planes(np.asarray(seen, dtype=np.float32), shown), shown, places.astype(np.float32)
    )


def _loss(network: PrintNetwork, pairs: Sequence[tuple[_Picture, _Picture]]) -> torch.Tensor:
    """Return the mean cross-entropy of the points of pairs, both ways."""
    pictures = [each for pair in pairs for each in pair]
    planes = torch.from_numpy(np.stack([each.planes for each in pictures]))
    with torch.autocast("cpu", torch.bfloat16, enabled=bfloat16_is_native("cpu")):
        described = network(planes)
    described = described.float()
    uv_px = torch.from_numpy(np.stack([each.uv_px for each in pictures]))
    mask = torch.from_numpy(np.stack([each.mask for each in pictures]))
    size = uv_px.new_tensor(described.shape[:1:-1])
    inside = ((uv_px >= 0) & (uv_px < size)).all(dim=2)
    other = torch.arange(len(pictures)).view(-1, 2).flip(1).flatten()
    counts = inside & inside[other]
    pool = all_bins(described, mask, _BIN_PX)
    query = sample_descriptors(described, uv_px)[other]
    total, asked = 0.0 * described.sum(), 0
    for n, on_cloth in enumerate(pool.on_object):
        if not (on_cloth.any() and counts[n].any()):
            continue
        there, place = pool.uv_px[n, on_cloth], uv_px[n, counts[n]]
        rows = pool.descriptors[n, on_cloth]
        log_p = log_probabilities(query[n, counts[n]][None], rows[None], network.scale)[0]
        log_p = (log_p + _known_before(place, there)).log_softmax(dim=1)
        total = total - (_target(place, there) * log_p).sum()
        asked += len(place)
    return total / max(asked, 1)


def _known_before(place: torch.Tensor, there: torch.Tensor) -> torch.Tensor:
    """Return log p of places before the print is looked at, float (Q, M), up to a constant.

    It is that of a network of blank cloths: Gaussian, about a guess whose error is in part one for
    all points of the picture.

    Args:
        place: float (Q, 2), where the points are.
        there: float (M, 2), the bins.
    """
    low, high = _KNOWN_PX
    spread = low * (high / low) ** float(torch.rand(()))
    error = (torch.randn_like(place) + torch.randn(2)) / 2**0.5
    return -torch.cdist(place + _OFF * spread * error, there).square() / (2 * spread**2)


def _target(place: torch.Tensor, there: torch.Tensor) -> torch.Tensor:
    """Return the distribution about true places (Q, 2) over bins (M, 2), float (Q, M)."""
    return (-torch.cdist(place, there).square() / (2 * _SIGMA_PX**2)).softmax(dim=1)
