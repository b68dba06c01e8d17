"""The matcher of a TimeCycle run: pairs in one step, episodes frame by frame."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np
import torch

from pliant.baselines.matcher import Heat
from pliant.models.timecycle.network import TimeCycleNetwork
from pliant.models.timecycle.propagation import Propagator
from pliant.models.timecycle.settings import PropagationSettings, TimeCycleSettings
from pliant.models.training.checkpoint import load_best
from pliant.models.training.run_folder import CONFIG, RUN_FACTS, read_run_json
from pliant.spec.answers import Answers
from pliant.spec.arrays import BoolArray, Float32Array, FloatArray
from pliant.spec.configuration import read_settings, settings_to_dict
from pliant.spec.frame import Frame, Pair
from pliant.spec.io.resizing import resize_mask, resize_nearest, resize_rgb
from pliant.spec.lru_cache import LRUCache

_KEPT_VIEWS = 256  # a stretch of frames is read in many ways when the read-out is chosen


class TimeCycleMatcher:
    """Answers with the affinities of a TimeCycle encoder.

    Args:
        network: The trained network.
        settings: The run's settings.
        facts: What the footer says in addition (dataset, steps …).
    """

    name = "timecycle"

    def __init__(
        self,
        network: TimeCycleNetwork,
        settings: TimeCycleSettings,
        facts: Mapping[str, Any] | None = None,
    ) -> None:
        self.network = network.eval()
        self.settings = settings
        self.size = (settings.width, settings.height)
        self.facts = dict(facts or {})
        self._encoded: LRUCache[torch.Tensor] = LRUCache(_KEPT_VIEWS)

    def read_by(self, propagation: PropagationSettings) -> TimeCycleMatcher:
        """Return a matcher with other read-out settings that shares this one's encoded frames."""
        read = TimeCycleMatcher(
            self.network, self.settings.replace(propagation=propagation), self.facts
        )
        read._encoded = self._encoded
        return read

    @property
    def stride(self) -> int:
        """Pixels of the network along a side of a cell."""
        return self.settings.propagation.stride

    def describe(self) -> Mapping[str, Any]:
        """Return what the footer of a submission says about the method."""
        return {
            "name": self.name,
            **self.facts,
            "input": {
                **asdict(self.settings.clips.network_input),
                "width": self.size[0],
                "height": self.size[1],
            },
            "propagation": settings_to_dict(self.settings.propagation),
            "torch": torch.__version__,
        }

    def answer(self, pair: Pair) -> Answers:
        """Answer query pixels in one step, wherever in the target they may be; see `Matcher`."""
        source, target, uv_a_px = pair.source, pair.target, pair.uv_a_px
        if len(uv_a_px) == 0:
            return Answers(np.zeros((0, 2), dtype=np.float32))
        anywhere = self.settings.propagation.replace(radius=0.0, prior=0.0, smooth=0.0)
        return Answers(self.carry(self.propagator(source, uv_a_px, anywhere), target))

    def track(self, views: Iterable[Frame], uv_px: Float32Array) -> Iterator[Answers]:
        """Carry points through consecutive frames; see `TrackMatcher`."""
        frames = iter(views)
        first = next(frames)
        propagator = self.propagator(first, uv_px)
        for view in frames:
            yield Answers(self.carry(propagator, view))

    def propagator(
        self, first: Frame, uv_px: Float32Array, settings: PropagationSettings | None = None
    ) -> Propagator:
        """Return what carries points of a frame.

        Args:
            first: The frame.
            uv_px: float32 (N, 2), where they are in it.
            settings: How; None as the matcher's own settings say.
        """
        with torch.inference_mode():
            return Propagator(
                self._encode(first),
                self.cells(uv_px, first),
                settings or self.settings.propagation,
                self.settings.temperature,
                self._searched(first),
            )

    def carry(
        self, propagator: Propagator, view: Frame, expected: torch.Tensor | None = None
    ) -> Float32Array:
        """Return where points are in the next frame, float32 (N, 2), pixels.

        Args:
            propagator: Carries them.
            view: The frame.
            expected: float (N + S, 2), where they and their support are expected, cells; None
                where they were last.
        """
        with torch.inference_mode():
            found = propagator.step(self._encode(view), self._searched(view), expected)
        return self.pixels(found, view)

    def heat(self, source: Frame, target: Frame, uv_a_px: Float32Array) -> Heat:
        """Return the affinity of one query over the target's cells; see `HeatMatcher`."""
        propagator = self.propagator(source, np.asarray(uv_a_px)[None])
        with torch.inference_mode():
            searched = self._searched(target)
            cells = propagator.scores(self._encode(target), searched)[0].numpy()
        best = float(np.exp(cells.max()))
        if searched is not None:
            cells = np.where(searched, cells, np.float32(np.nan))
        heat = resize_nearest(cells, (target.rgb.shape[1], target.rgb.shape[0]))
        return Heat(heat, "log affinity", min(1.0, best), "affinity of the best cell")

    def _encode(self, view: Frame) -> torch.Tensor:
        """Return a frame's unit descriptors, (D, h, w) on the CPU."""

        def encode() -> torch.Tensor:
            given = (
                None if each is None else resize_mask(each, self.size, keep_thin=True)
                for each in (view.mask, view.objects)
            )
            seen = self.settings.clips.network_input
            image = torch.from_numpy(seen.image(resize_rgb(view.rgb, self.size), None, *given))
            device = next(self.network.parameters()).device
            with torch.inference_mode():
                return self.network.encode(image[None].to(device), self.stride)[0].cpu()

        return self._encoded.get(view.cache_key, encode)

    def _searched(self, view: Frame) -> BoolArray | None:
        """Return the cells that touch the object, where the settings look there alone."""
        if self.settings.propagation.search == "image" or view.mask is None:
            return None
        mask = resize_mask(view.mask, self.size)
        height, width = self.size[1] // self.stride, self.size[0] // self.stride
        touched = mask.reshape(height, self.stride, width, self.stride).any(axis=(1, 3))
        return touched if touched.any() else None

    def cells(self, uv_px: Float32Array, view: Frame) -> torch.Tensor:
        """Return pixels of a view in cells, float32 (N, 2)."""
        scaled = np.asarray(uv_px, dtype=np.float64) / self._scale(view)
        return torch.as_tensor(scaled, dtype=torch.float32)

    def pixels(self, xy: torch.Tensor, view: Frame) -> Float32Array:
        """Return cells in pixels of a view, float32 (N, 2)."""
        return (xy.double().numpy() * self._scale(view)).astype(np.float32)

    def _scale(self, view: Frame) -> FloatArray:
        """Return pixels of a view per cell, (u, v)."""
        cells = np.array(self.size) / self.stride
        return np.array([view.rgb.shape[1], view.rgb.shape[0]]) / cells


def load_timecycle(run: Path, /, **options: Any) -> TimeCycleMatcher:
    """Return the matcher of a TimeCycle run.

    Args:
        run: The run's folder.
        options: Fields of `PropagationSettings`, instead of those of the run's config.

    Raises:
        CallError: Its config is damaged, or it has no such option.
        TrainingError: The run has no validated weights yet, or they do not fit.
    """
    settings = read_settings(TimeCycleSettings, run / CONFIG)
    settings = settings.replace(propagation=settings.propagation.replace(**options))
    network = TimeCycleNetwork(settings.replace(network=settings.network.replace(pretrained="")))
    load_best(network, run)
    return TimeCycleMatcher(network, settings, read_run_json(run / RUN_FACTS))
