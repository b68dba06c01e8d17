"""The learned matcher: descriptors of both images, a softmax over the target, one answer."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass, replace
from typing import Any

import numpy as np
import numpy.typing as npt
import torch

from pliant.baselines.matcher import Heat
from pliant.baselines.tracing import Rectified, Trace, rectified, rope_traces
from pliant.models.don.candidates import pixel_grid, widened
from pliant.models.don.certainty import Calibration
from pliant.models.don.crossings import with_overlaps
from pliant.models.don.decoding import decode_position, mixture_of_modes, spread_about
from pliant.models.don.described import ViewDescriber
from pliant.models.don.familiarity import Asked, Described, Familiarity
from pliant.models.don.settings import DonSettings
from pliant.models.don.tracing import (
    TracedPlaces,
    TracedView,
    canonical_likelihood,
    enlarged,
    traced_places,
)
from pliant.models.losses.distributional import log_probabilities
from pliant.models.networks.crossing_network import CrossingNetwork
from pliant.models.networks.descriptor_network import (
    DescriptorNetwork,
    sample_descriptors,
)
from pliant.spec.answers import Answers
from pliant.spec.frame import Frame, Pair
from pliant.spec.io.resizing import resize_nearest
from pliant.spec.lru_cache import LRUCache

_KEPT_VIEWS = 8
_KEPT_TRACES = 128
_PIXELS_AT_ONCE = 4096
_NEAR_ANSWER = 2.0  # pixels of the network
_MIRROR_WEIGHT = 1 / 3  # with 1/2, more sheets come out on the wrong side


@dataclass(frozen=True)
class Comparison:
    """The descriptors of N queries against those of the target's candidates.

    Attributes:
        log_p: float (N, M), log probabilities over the candidates, before calibration.
        uv_px: float (M, 2), the candidates, in pixels of the network.
        distance: float64 (N,), squared descriptor distance to the best one times the scale.
        query: float (N, D), the queries' descriptors in the upright source.
    """

    log_p: torch.Tensor
    uv_px: torch.Tensor
    distance: npt.NDArray[np.float64]
    query: torch.Tensor


@dataclass(frozen=True)
class Search(Comparison):
    """What the matcher knows of N queries before it decides.

    Attributes:
        traced: Where a rope's traces carry the queries, or None. They are weighed into `log_p`.
        deciding: float (N, M), what the answers are read from: `log_p`, or one way along a rope
            where `log_p` is the mean of both.
    """

    traced: TracedPlaces | None
    deciding: torch.Tensor

    @property
    def either_way(self) -> bool:
        """Whether they are on a rope whose ends look alike."""
        return self.traced is not None and self.traced.other_way_px is not None


@dataclass(frozen=True)
class _Decided:
    """The one distribution that answers, their widths, the heat map and the confidence come from.

    Attributes:
        source, target: The views as they are answered in.
        found: What was found in them.
        calibration: What holds for them, or None for a network without one.
        position_px: float64 (N, 2), the answers, in pixels of the target as seen.
    """

    source: Rectified
    target: Rectified
    found: Search
    calibration: Calibration | None
    position_px: npt.NDArray[np.float64]


class DonMatcher:
    """Answers with dense descriptors.

    Args:
        network: The trained network.
        settings: The run's settings.
        calibration: Its certainty.
        facts: What the footer also has (run, dataset, steps …).
    """

    name = "don"

    def __init__(
        self,
        network: DescriptorNetwork,
        settings: DonSettings,
        calibration: Calibration | None = None,
        facts: Mapping[str, Any] | None = None,
    ) -> None:
        self.network = network.eval()
        self.size = (settings.width, settings.height)
        self.input = settings.pairs.network_input
        self.settings = settings.answer
        self.calibration = calibration
        self.sharpness = 1.0 if calibration is None else calibration.sharpness
        self.facts = dict(facts or {})
        self.familiarity: Familiarity | None = None
        self.crossings: CrossingNetwork | None = None
        self._views = ViewDescriber(
            self.network,
            self.input,
            self.size,
            settings.answer.rotations,
            settings.answer.mirrored,
        )
        self._rectified: LRUCache[Rectified] = LRUCache(_KEPT_VIEWS)
        self._traces: LRUCache[list[Trace]] = LRUCache(_KEPT_TRACES)

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

    def answer(self, pair: Pair) -> Answers:
        """Answer query pixels; see `Matcher`."""
        source, target, uv_a_px = pair.source, pair.target, pair.uv_a_px
        if len(uv_a_px) == 0:
            return Answers(np.zeros((0, 2), dtype=np.float32))
        decided = self._decided(source, target, uv_a_px)
        answers = decided.target.back(self._answers(decided))
        if self.familiarity is None:
            return answers
        asked = self.asked(decided.source.view, decided.target.view, decided.found)
        return replace(answers, familiarity=self.familiarity.score(asked))

    def _decided(self, source: Frame, target: Frame, uv_a_px: npt.NDArray[np.float32]) -> _Decided:
        """Search for queries in the views as they are answered in, float32 (N, 2), N >= 1."""
        unmasked = source.mask is None or target.mask is None
        from_view, in_view = self.seen(source), self.seen(target)
        found = self.search(from_view, in_view, from_view.forward(uv_a_px))
        calibration = self.calibration
        if calibration is not None:
            calibration = calibration.for_views(
                tilted=from_view.tilted or in_view.tilted,
                unmasked=unmasked,
                either_way=found.either_way,
            ).where(found.log_p, found.uv_px)
        position = self.decoded(found, in_view.view)
        return _Decided(from_view, in_view, found, calibration, position)

    @property
    def finds_masks(self) -> bool:
        """Whether it finds a rope's masks itself where a picture comes without."""
        return self.settings.decode == "trace" and self._views.segments

    def object_mask(self, view: Frame) -> npt.NDArray[np.bool_] | None:
        """Return where a view shows the object, bool (H, W), or None where it is not found."""
        return self._views.segmented(view).mask if self.finds_masks else view.mask

    def seen(self, view: Frame) -> Rectified:
        """Return a view as it is answered in: a rope's with masks, and from straight above."""

        def prepared() -> Rectified:
            masked = self._views.segmented(view) if self.settings.decode == "trace" else view
            return rectified(masked) if self.settings.rectify else Rectified.unchanged(masked)

        return self._rectified.get(view.key, prepared)

    def _answers(self, decided: _Decided) -> Answers:
        """Return what the distribution says of the queries, in pixels of the target as seen."""
        found, calibration = decided.found, decided.calibration
        log_p, uv = found.log_p, found.uv_px
        scale = self._pixel_scale(decided.target.view)
        position = decided.position_px.astype(np.float32)
        if calibration is None:
            return Answers(position)
        visible = calibration.visible(found.distance) if calibration.visible_slope > 0 else None
        flat = calibration.flattened(log_p)
        width = float(np.sqrt(scale[0] * scale[1]))
        if self.settings.distribution == "sigma":
            about = torch.from_numpy(position / scale).float()
            sigma = spread_about(flat, uv, about, calibration.widths)
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

    def heat(self, source: Frame, target: Frame, uv_a_px: npt.NDArray[np.float32]) -> Heat:
        """Return p over the target for one query; see `HeatMatcher`.

        It is the distribution that `answer` describes: the same masks, view from above, traces and
        calibration.
        """
        decided = self._decided(source, target, np.asarray(uv_a_px)[None])
        found, seen = decided.found, decided.target
        flat = (decided.calibration or Calibration()).flattened(found.log_p)[0]
        width, height = self.size
        grid = np.full((height, width), np.nan, dtype=np.float32)
        column, row = found.uv_px.long().numpy().T
        grid[row, column] = flat.numpy()
        heat = resize_nearest(grid, (seen.view.rgb.shape[1], seen.view.rgb.shape[0]))
        if seen.view.mask is not None and self.settings.search == "mask":
            heat = np.where(seen.view.mask, heat, np.float32(np.nan))
        answer = torch.from_numpy(decided.position_px / self._pixel_scale(seen.view)).float()
        near = (found.uv_px - answer).norm(dim=1) <= _NEAR_ANSWER
        mass = float(flat.exp()[near].sum())
        return Heat(
            seen.back_image(heat), "log probability", min(1.0, mass), "probability at the answer"
        )

    def search(
        self, source: Rectified, target: Rectified, uv_a_px: npt.NDArray[np.float32]
    ) -> Search:
        """Compare queries with the target's candidates, and follow traces where they decide.

        Args:
            source: The image the queries are in.
            target: The image to find them in.
            uv_a_px: float32 (N, 2), in pixels of the source's view.
        """
        compared = self.compare(source.view, target.view, uv_a_px)
        traced = None
        if self.settings.decode == "trace":
            scale = self.network.scale.detach().cpu()
            traced = traced_places(
                self._traced(source), self._traced(target), scale * self.sharpness, uv_a_px
            )
        log_p, deciding, uv = compared.log_p, compared.log_p, compared.uv_px
        if traced is not None:
            candidates_px = uv.double().numpy() * self._pixel_scale(target.view)
            deciding = traced.weighed_in(log_p, candidates_px)
            log_p = traced.either_way(deciding, log_p, candidates_px)
        return Search(log_p, uv, compared.distance, compared.query, traced, deciding)

    def compare(self, source: Frame, target: Frame, uv_a_px: npt.NDArray[np.float32]) -> Comparison:
        """Compare the queries' descriptors with those of the target's candidates.

        Args:
            source: The image the queries are in.
            target: The image to find them in.
            uv_a_px: float32 (N, 2), in pixels of the source.
        """
        a, b = self._views.described(source), self._views.described(target)
        width, height = self.size
        query_uv = torch.as_tensor(
            np.asarray(uv_a_px, dtype=np.float64) / self._pixel_scale(source), dtype=torch.float32
        )
        chosen = self._searched(b.mask)
        uv = pixel_grid(height, width, 1, torch.device("cpu"))[chosen]
        total = torch.zeros(len(query_uv), len(uv))
        distance = torch.zeros(len(query_uv))
        queries = []
        with torch.inference_mode():
            scale = self.network.scale.detach().cpu()
            for turn, map_a, map_b in zip(self._views.turns, a.maps, b.maps, strict=True):
                turned = _turned_uv(query_uv, turn, width, height)
                query = sample_descriptors(map_a[None], turned[None])  # (1, N, D)
                queries.append(query[0])
                upright = torch.rot90(map_b, turn, (1, 2))
                rows = upright.flatten(1).T[chosen]  # (M, D)
                total += log_probabilities(query, rows[None], scale)[0]
                gap = torch.cdist(query[0], rows).square().min(dim=1).values
                distance += gap * scale
            turns = len(a.maps)
            mean = total / turns
            if a.mirrored is not None and b.mirrored is not None:
                query = sample_descriptors(a.mirrored[None], query_uv[None])
                rows = b.mirrored.flatten(1).T[chosen]
                mirrored = log_probabilities(query, rows[None], scale)[0]
                mean = (1 - _MIRROR_WEIGHT) * mean + _MIRROR_WEIGHT * mirrored
        log_p = (mean * self.sharpness).log_softmax(dim=1)
        return Comparison(log_p, uv, (distance / turns).double().numpy(), queries[0])

    def decoded(self, found: Search, target: Frame) -> npt.NDArray[np.float64]:
        """Return the positions that a search ends at, float64 (N, 2) in pixels of the target."""
        sharp = decode_position(found.deciding, found.uv_px, self.settings.decode)
        position = sharp.double().numpy() * self._pixel_scale(target)
        return position if found.traced is None else found.traced.refined(position)

    def _traced(self, seen: Rectified) -> TracedView:
        view = seen.view

        def traced() -> list[Trace]:
            own, factor = self._views.described(view), self._pixel_scale(view)
            scale = self.network.scale.detach().cpu() * self.sharpness
            says = canonical_likelihood(self.network, own.maps[0], scale)
            if view.mask is not None:
                given = None if says is None else lambda uv_px: says(uv_px / factor)
                mask, traces = view.mask, rope_traces(view.mask, view.objects, given, seen.nadir)
            elif own.mask is not None:
                found = rope_traces(own.mask, own.objects, says)
                mask, traces = own.mask, enlarged(found, factor)
            else:
                return []
            return (
                traces
                if self.crossings is None
                else with_overlaps(self.crossings, view, mask, traces)
            )

        descriptors = self._views.described(view).maps[0]
        return TracedView(view, descriptors, self._traces.get(view.key, traced))

    def asked(self, source: Frame, target: Frame, compared: Comparison) -> Asked:
        """Return what `Familiarity` looks at.

        Args:
            source: The image the queries are in.
            target: The image to find them in.
            compared: From `compare` or `search` of both.
        """
        source_described, target_described = (
            Described(each.maps[0].numpy(), each.mask)
            for each in (self._views.described(source), self._views.described(target))
        )
        return Asked(source_described, target_described, compared.query.numpy(), compared.distance)

    def descriptor_map(self, view: Frame) -> npt.NDArray[np.float32]:
        """Return a frame's descriptors at the network's size, float32 (h, w, D)."""
        return self._views.described(view).maps[0].permute(1, 2, 0).numpy()

    def canonical_map(self, view: Frame) -> npt.NDArray[np.float32] | None:
        """Return the material coordinates that the canonical head reads off each pixel.

        Args:
            view: A frame.

        Returns:
            float32 (h, w, 2), those of the most probable anchor, at the network's size; None for
            a network without a canonical head.
        """
        head = self.network.canonical
        if head is None:
            return None
        descriptors = self._views.described(view).maps[0]
        with torch.inference_mode():
            rows = descriptors.flatten(1).T.split(_PIXELS_AT_ONCE)
            scale = self.network.scale.detach().cpu()
            best = torch.cat([head.log_probabilities(part, scale).argmax(dim=1) for part in rows])
            return head.anchors[best].view(*descriptors.shape[1:], 2).cpu().numpy()

    def working_mask(self, view: Frame) -> npt.NDArray[np.bool_] | None:
        """Return a frame's mask at the network's size, bool (h, w), or None."""
        return self._views.described(view).mask

    def _searched(self, mask: npt.NDArray[np.bool_] | None) -> torch.Tensor:
        width, height = self.size
        if mask is None or not mask.any() or self.settings.search == "image":
            return torch.arange(width * height)
        wide = widened(torch.from_numpy(mask)[None], self.settings.margin_px)
        return wide.flatten().nonzero()[:, 0]

    def _pixel_scale(self, view: Frame) -> npt.NDArray[np.float64]:
        """Return pixels of a view per network pixel, (u, v)."""
        return np.array([view.rgb.shape[1] / self.size[0], view.rgb.shape[0] / self.size[1]])


def _turned_uv(uv_px: torch.Tensor, turn: int, width: int, height: int) -> torch.Tensor:
    """Return positions in an image turned clockwise by quarter turns (`rot90(image, -turn)`)."""
    u, v = uv_px.unbind(dim=-1)
    for _ in range(turn):
        u, v = height - v, u
        width, height = height, width
    return torch.stack([u, v], dim=-1)
