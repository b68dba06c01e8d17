"""The learned matcher: descriptors of both images, a softmax over the target, one answer."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
import torch

from pliant.baselines.lru_cache import LRUCache
from pliant.baselines.matcher import Answers, Heat, View
from pliant.loaders.inputs import NetworkInput
from pliant.loaders.views import resize_depth, resize_mask, resize_rgb
from pliant.models.don.candidates import pixel_grid, widened
from pliant.models.don.decoding import Widths, decode_position, mixture_of_modes, spread_about
from pliant.models.losses.distributional import log_probabilities
from pliant.models.networks.canonical import PREFIX, CanonicalHead
from pliant.models.networks.descriptor_network import (
    DescriptorNetwork,
    build_network,
    sample_descriptors,
)
from pliant.models.settings import AnswerSettings, DonSettings
from pliant.models.training.checkpoint import BEST, load_best, read_weights_file
from pliant.spec.configuration import read_settings
from pliant.spec.errors import CallError, TrainingError

CONFIG = "config.yaml"
RUN_FACTS = "run.json"
CALIBRATION = "calibration.json"

_KEPT_VIEWS = 8


@dataclass(frozen=True)
class Calibration:
    """What validation says about the answers' certainty.

    Attributes:
        temperature: Divides the scale of p: above 1 flattens it.
        sigma_floor_px: Smallest spread of a mode, network pixels.
        spread: Times the spread of a mode.
        blur_px: Taken off the spread of a mode in squares before, network pixels.
        power: Exponent of what remains of it.
        stray: Probability that the answer is anywhere on the object.
        mode_radius_px: What lies this near to a peak is one mode with it, network pixels.
        visible_at: Squared descriptor distance to the best candidate at which a point is as
            likely visible as hidden, in units of the network's scale.
        visible_slope: Slope of that logistic curve, per unit of log distance; 0 gives no
            `visible` at all (the validation split hides no point).
        figures: What was measured, for the record.
        sharpness: Multiplies log p before everything else: contrastive networks learn no scale.
    """

    temperature: float = 1.0
    sigma_floor_px: float = 0.5
    stray: float = 0.01
    visible_at: float = 1.0
    visible_slope: float = 0.0
    figures: Mapping[str, float] | None = None
    spread: float = 1.0
    blur_px: float = 0.0
    power: float = 1.0
    mode_radius_px: float = 4.0
    sharpness: float = 1.0

    @property
    def widths(self) -> Widths:
        """What standard deviation a variance of the calibrated p stands for."""
        return Widths(self.sigma_floor_px, self.spread, self.blur_px, self.power)


@dataclass(frozen=True)
class _Described:
    """A frame's descriptors, one map a quarter turn."""

    maps: list[torch.Tensor]  # (D, h, w) or, turned an odd number of times, (D, w, h)
    mask: npt.NDArray[np.bool_] | None  # (h, w)
    full_size: tuple[int, int]


class DonMatcher:
    """Answers with dense descriptors.

    Args:
        network: The trained network, in evaluation mode.
        size: (w, h) of its input.
        seen: Its input.
        settings: How it answers.
        calibration: Its certainty.
        facts: What the footer says besides (run, dataset, steps …).
    """

    name = "don"

    def __init__(
        self,
        network: DescriptorNetwork,
        size: tuple[int, int],
        seen: NetworkInput,
        settings: AnswerSettings,
        calibration: Calibration | None = None,
        facts: Mapping[str, Any] | None = None,
    ) -> None:
        self.network = network.eval()
        self.size = size
        self.input = seen
        self.settings = settings
        self.calibration = calibration
        self.sharpness = 1.0 if calibration is None else calibration.sharpness
        self.facts = dict(facts or {})
        self._described: LRUCache[_Described] = LRUCache(_KEPT_VIEWS)

    def describe(self) -> Mapping[str, Any]:
        """Return what the footer of a submission says about the method."""
        calibration = None if self.calibration is None else asdict(self.calibration)
        return {
            "name": self.name,
            **self.facts,
            "input": {**asdict(self.input), "width": self.size[0], "height": self.size[1]},
            "answer": asdict(self.settings),
            "calibration": calibration,
            "torch": torch.__version__,
        }

    def answer(self, source: View, target: View, uv_a_px: npt.NDArray[np.float32]) -> Answers:
        """Answer query pixels; see `Matcher`."""
        if len(uv_a_px) == 0:
            return Answers(np.zeros((0, 2), dtype=np.float32))
        log_p, uv, distance = self.log_probabilities(source, target, uv_a_px)
        scale = self._pixel_scale(target)
        sharp = decode_position(log_p, uv, self.settings.decode)
        position = (sharp.double().numpy() * scale).astype(np.float32)
        calibration = self.calibration
        if calibration is None:
            return Answers(position)
        visible = None
        if calibration.visible_slope > 0:
            visible = visible_probability(distance, calibration)
        flat = self.flattened(log_p, calibration)
        width = float(np.sqrt(scale[0] * scale[1]))
        if self.settings.distribution == "sigma":
            sigma = spread_about(flat, uv, sharp, calibration.widths)
            return Answers(position, visible, (sigma.numpy() * width).astype(np.float32))
        modes = None
        if self.settings.distribution == "modes":
            mixture, used = mixture_of_modes(
                flat, uv, calibration.widths, calibration.mode_radius_px
            )
            values = mixture.double().numpy() * [scale[0], scale[1], width, 1.0]
            kept = zip(values.astype(np.float32), used.numpy(), strict=True)
            modes = [rows[keep] for rows, keep in kept]
        return Answers(position, visible, None, modes)

    def heat(self, source: View, target: View, uv_a_px: npt.NDArray[np.float32]) -> Heat:
        """Return p over the target for one query; see `HeatMatcher`."""
        log_p, uv, _ = self.log_probabilities(source, target, np.asarray(uv_a_px)[None])
        flat = self.flattened(log_p, self.calibration or Calibration())[0]
        width, height = self.size
        grid = np.full((height, width), np.nan, dtype=np.float32)
        column, row = uv.long().numpy().T
        grid[row, column] = flat.numpy()
        full_height, full_width = target.rgb.shape[:2]
        rows = ((np.arange(full_height) + 0.5) * height / full_height).astype(np.intp)
        columns = ((np.arange(full_width) + 0.5) * width / full_width).astype(np.intp)
        heat = grid[np.ix_(rows, columns)]
        if target.mask is not None and self.settings.search == "mask":
            heat = np.where(target.mask, heat, np.nan)
        best = uv[int(flat.argmax())]
        near = (uv - best).norm(dim=1) <= 2.0
        mass = float(flat.exp()[near].sum())
        return Heat(heat, "log probability", min(1.0, mass), "probability of the peak")

    def log_probabilities(
        self, source: View, target: View, uv_a_px: npt.NDArray[np.float32]
    ) -> tuple[torch.Tensor, torch.Tensor, npt.NDArray[np.float64]]:
        """Return p over the target's candidates, before calibration.

        Args:
            source: The image the queries are in.
            target: The image to find them in.
            uv_a_px: float32 (N, 2), in pixels of the source.

        Returns:
            log_p float (N, M); uv_px float (M, 2), candidates in network pixels; distance
            float64 (N,), squared descriptor distance to the best one times the scale.
        """
        a, b = self._descriptors(source), self._descriptors(target)
        width, height = self.size
        query_uv = torch.as_tensor(
            np.asarray(uv_a_px, dtype=np.float64) / self._pixel_scale(source), dtype=torch.float32
        )
        chosen = self._searched(b.mask)
        uv = pixel_grid(height, width, 1, torch.device("cpu"))[chosen]
        total = torch.zeros(len(query_uv), len(uv))
        distance = torch.zeros(len(query_uv))
        with torch.inference_mode():
            scale = self.network.scale.detach().cpu()
            for turn, map_a, map_b in zip(self._turns, a.maps, b.maps, strict=True):
                turned = _turned_uv(query_uv, turn, width, height)
                query = sample_descriptors(map_a[None], turned[None])  # (1, N, D)
                upright = torch.rot90(map_b, turn, (1, 2))
                rows = upright.flatten(1).T[chosen]  # (M, D)
                every = torch.ones(1, len(rows), dtype=torch.bool)
                total += log_probabilities(query, rows[None], every, scale)[0]
                gap = torch.cdist(query[0], rows).square().min(dim=1).values
                distance += gap * scale
        turns = len(a.maps)
        return (
            (total * (self.sharpness / turns)).log_softmax(dim=1),
            uv,
            (distance / turns).double().numpy(),
        )

    @staticmethod
    def flattened(log_p: torch.Tensor, calibration: Calibration) -> torch.Tensor:
        """Return log p after temperature and stray probability."""
        flat = (log_p / calibration.temperature).softmax(dim=1)
        stray = calibration.stray
        return ((1 - stray) * flat + stray / log_p.shape[1]).log()

    def descriptor_map(self, view: View) -> npt.NDArray[np.float32]:
        """Return a frame's descriptors at the network's size, float32 (h, w, D)."""
        return self._descriptors(view).maps[0].permute(1, 2, 0).numpy()

    def working_mask(self, view: View) -> npt.NDArray[np.bool_] | None:
        """Return a frame's mask at the network's size, bool (h, w), or None."""
        return self._descriptors(view).mask

    def _descriptors(self, view: View) -> _Described:
        # A key names a frame, and two frames of other sizes never share one.
        return self._described.get(view.key, lambda: self._describe_view(view))

    def _describe_view(self, view: View) -> _Described:
        rgb = resize_rgb(view.rgb, self.size) if self.input.colour else None
        depth_m = None
        if self.input.depth and view.depth_m is not None:
            depth_m = resize_depth(view.depth_m, self.size)
        mask, objects = (self._resized(each) for each in (view.mask, view.objects))
        if mask is None and self.input.masks and self.network.foreground:
            mask, objects = self._predicted_masks(self.input.image(rgb, depth_m))
        image = torch.from_numpy(self.input.image(rgb, depth_m, mask, objects))
        maps = []
        with torch.inference_mode():
            for turn in self._turns:
                maps.append(self.network(self._turned(image, turn))[0].cpu())
        return _Described(maps, mask, (view.rgb.shape[1], view.rgb.shape[0]))

    def _turned(self, image: torch.Tensor, turn: int) -> torch.Tensor:
        return torch.rot90(image, -turn, (1, 2))[None].to(self.network.log_scale.device)

    def _resized(self, mask: npt.NDArray[np.bool_] | None) -> npt.NDArray[np.bool_] | None:
        if mask is None:
            return None
        small = resize_mask(mask, self.size)
        if not small.any() and mask.any():  # thinner than half a pixel everywhere
            small = _touched(mask, self.size)
        return small

    def _predicted_masks(
        self, image: npt.NDArray[np.float32]
    ) -> tuple[npt.NDArray[np.bool_], npt.NDArray[np.bool_]]:
        """Return where the network itself sees the queried object, and any object."""
        with torch.inference_mode():
            out = self.network.described(self._turned(torch.from_numpy(image), 0))
        mask, objects = (out.foreground[0] > 0).cpu().numpy()
        return mask, objects

    @property
    def _turns(self) -> range:
        return range(0, 4, 4 // self.settings.rotations)

    def _searched(self, mask: npt.NDArray[np.bool_] | None) -> torch.Tensor:
        width, height = self.size
        if mask is None or not mask.any() or self.settings.search == "image":
            return torch.arange(width * height)
        wide = widened(torch.from_numpy(mask)[None], self.settings.margin_px)
        return wide.flatten().nonzero()[:, 0]

    def _pixel_scale(self, view: View) -> npt.NDArray[np.float64]:
        """Return pixels of a view per network pixel, (u, v)."""
        return np.array([view.rgb.shape[1] / self.size[0], view.rgb.shape[0] / self.size[1]])


def _touched(mask: npt.NDArray[np.bool_], size: tuple[int, int]) -> npt.NDArray[np.bool_]:
    rows, columns = np.nonzero(mask)
    small = np.zeros((size[1], size[0]), dtype=np.bool_)
    small[rows * size[1] // mask.shape[0], columns * size[0] // mask.shape[1]] = True
    return small


def _turned_uv(uv_px: torch.Tensor, turn: int, width: int, height: int) -> torch.Tensor:
    """Return positions in an image turned clockwise by quarter turns (`rot90(image, -turn)`)."""
    u, v = uv_px.unbind(dim=-1)
    for _ in range(turn):
        u, v = height - v, u
        width, height = height, width
    return torch.stack([u, v], dim=-1)


def visible_probability(
    distance: npt.NDArray[np.float64], calibration: Calibration
) -> npt.NDArray[np.float32]:
    """Return the probability that a point is visible, from its best descriptor distance.

    Args:
        distance: float64 (N,), from `DonMatcher.log_probabilities`.
        calibration: Threshold and slope of the logistic curve in the log distance.

    Returns:
        float32 (N,); 0.5 at the threshold.
    """
    log_ratio = np.log(np.maximum(distance, 1e-12) / calibration.visible_at)
    exponent = np.clip(calibration.visible_slope * log_ratio, -60.0, 60.0)
    return (1.0 / (1.0 + np.exp(exponent))).astype(np.float32)


def load_matcher(run: Path | str) -> DonMatcher:
    """Return the matcher of a finished (or running) training run.

    Args:
        run: The run's folder.

    Raises:
        CallError: It is no run's folder.
        TrainingError: The run has no validated weights yet, or a file of it is damaged.
    """
    run = Path(run)
    if not (run / CONFIG).is_file():
        raise CallError("this is no training run", path=run, required=f"a folder with {CONFIG}")
    settings = read_settings(DonSettings, run / CONFIG)
    canonical = None
    if settings.loss.canonical_weight > 0:
        anchors = read_weights_file(run / BEST)[PREFIX + "anchors"]
        canonical = CanonicalHead(settings.network.descriptor_dim, len(anchors))
    network = build_network(
        replace(settings.network, pretrained=""),
        settings.pairs.network_input,
        orientation=settings.loss.orientation_weight > 0,
        foreground=settings.loss.foreground_weight > 0,
        canonical=canonical,
    )
    load_best(network, run)
    facts = _read_json(run / RUN_FACTS) if (run / RUN_FACTS).is_file() else {}
    calibration = None
    if (run / CALIBRATION).is_file():
        try:
            calibration = Calibration(**_read_json(run / CALIBRATION))
        except TypeError as error:
            raise TrainingError(
                "the calibration is damaged", path=run / CALIBRATION, found=str(error)
            ) from error
    return DonMatcher(
        network,
        (settings.width, settings.height),
        settings.pairs.network_input,
        settings.answer,
        calibration,
        facts,
    )


def _read_json(path: Path) -> dict[str, Any]:
    try:
        document = json.loads(path.read_text())
    except (OSError, ValueError) as error:
        raise TrainingError("the file cannot be read", path=path, found=str(error)) from error
    if not isinstance(document, dict):
        raise TrainingError("the file holds no JSON object", path=path)
    return document
