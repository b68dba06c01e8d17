"""The learned matcher: descriptors of both images, a softmax over the target, one answer."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import torch

from pliant.baselines.matcher import Heat
from pliant.baselines.remarks import cut_object_remarks
from pliant.baselines.tracing import Reframed, completed, rope_remarks
from pliant.models.don.certainty import Calibration, decode_position, mixture_of_modes
from pliant.models.don.comparison import Comparison, PairDistribution, Search, compare
from pliant.models.don.described import ViewDescriber
from pliant.models.don.familiarity import (
    DescriptorStatistics,
    Familiarity,
    QueryDescriptors,
    fit_familiarity,
    traced_statistics,
)
from pliant.models.don.rope_reader import RopeReader
from pliant.models.don.settings import DonSettings
from pliant.models.don.sides import GRID_EVERY_PX, grid_of, side_of
from pliant.models.don.tracing import TracedView, traced_places
from pliant.models.networks.descriptor_network import DescriptorNetwork
from pliant.models.networks.print_network import PrintNetwork
from pliant.spec.answers import Answers
from pliant.spec.arrays import BoolArray, Float32Array, FloatArray
from pliant.spec.configuration import settings_to_dict
from pliant.spec.frame import Frame, Pair
from pliant.spec.io.resizing import resize_nearest

_NEAR_ANSWER = 2.0  # pixels of the network


class DonMatcher:
    """Answers with dense descriptors.

    Args:
        network: The trained network.
        settings: The run's settings.
        calibration: Its certainty.
        facts: What the footer also has (run, dataset, steps …).

    Attributes:
        reader: Brings images to the view that they are answered in, and traces ropes.
        familiarity: Says how usual queries are, or None.
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
        answer = settings.answer
        self._views = ViewDescriber(
            self.network,
            self.input,
            self.size,
            answer.rotations,
            mirrored=answer.mirrored,
            plain_table=answer.plain_table,
        )
        self.reader = RopeReader(self.network, self._views, settings.answer)

    def match_prints_with(self, network: PrintNetwork | None) -> None:
        """Match the prints of cloths with a network of their own."""
        self._views.prints = network

    def describe(self) -> Mapping[str, Any]:
        """Return what the footer of a submission says about the method."""
        calibration = None if self.calibration is None else asdict(self.calibration)
        return {
            "name": self.name,
            **self.facts,
            "input": {**asdict(self.input), "width": self.size[0], "height": self.size[1]},
            "answer": settings_to_dict(self.settings),
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
        usual = self.familiarity.descriptors
        statistics = (
            self._traced_statistics(decided)
            if usual is None
            else usual.statistics(self._query_descriptors(decided))
        )
        return replace(answers, familiarity=self.familiarity.score(statistics))

    def fitted_familiarity(self, pairs: Sequence[Pair]) -> Familiarity:
        """Return the familiarity of pairs like those of the training split.

        Args:
            pairs: Pairs with queries, with and without masks as the matcher is to meet them.
        """
        decided = (self._decided(pair.source, pair.target, pair.uv_a_px) for pair in pairs)
        if self.settings.decode == "trace":
            return fit_familiarity(np.concatenate(list(map(self._traced_statistics, decided))))
        asked = list(map(self._query_descriptors, decided))
        usual = DescriptorStatistics.of(asked)
        return fit_familiarity(np.concatenate(list(map(usual.statistics, asked))), usual)

    def _traced_statistics(self, decided: PairDistribution) -> FloatArray:
        source, target = self._both_traced(decided.source, decided.target)
        return traced_statistics(source, target, decided.found.traced, decided.position_px)

    def _query_descriptors(self, decided: PairDistribution) -> QueryDescriptors:
        views = decided.source.view, decided.target.view
        source, target = map(self._views.described, views)
        return QueryDescriptors(source, target, decided.found.query.numpy(), decided.found.distance)

    def share(self, folder: Path) -> None:
        """Store traces, turns and masks in a folder, where copies in other processes find them."""
        self.reader.share(folder)

    def remarks(self, source: Frame, target: Frame) -> list[str]:
        """Return what should be known of two pictures, as sentences; see `RemarkingMatcher`."""
        if self.settings.decode != "trace":
            return cut_object_remarks([self.object_mask(view) for view in (source, target)])
        traced = [self._traced(self.reader.seen(view)) for view in (source, target)]
        shapes = [None if each.view.mask is None else each.shape for each in traced]
        views, traces = [each.view for each in traced], [each.traces for each in traced]
        return rope_remarks(views, shapes, traces)

    def _decided(self, source: Frame, target: Frame, uv_a_px: Float32Array) -> PairDistribution:
        """Search for queries in the views as they are answered in, float32 (N, 2), N >= 1."""
        from_view, in_view = self.reader.seen(source), self.reader.seen(target)
        coarsely = partial(self.answered_by_network, every_px=GRID_EVERY_PX)
        from_view = self.reader.turned_as(from_view, in_view, coarsely)
        unmasked = source.mask is None or target.mask is None
        unmasked |= from_view.segmented or in_view.segmented
        found = self.search(from_view, in_view, from_view.forward(uv_a_px))
        calibration = self.calibration
        if calibration is not None:
            calibration = calibration.for_views(
                tilted=from_view.tilted or in_view.tilted,
                unmasked=unmasked,
                either_way=found.either_way,
            ).where(found.deciding, found.uv_px)
        position = self.decoded(found, in_view.view)
        return PairDistribution(from_view, in_view, found, calibration, position)

    def object_mask(self, view: Frame) -> BoolArray | None:
        """Return where a view shows the object, bool (H, W), or None where it is not found."""
        return self.reader.masked(view).mask

    def _answers(self, decided: PairDistribution) -> Answers:
        """Return what the distribution says of the queries, in pixels of the target as seen."""
        found, calibration = decided.found, decided.calibration
        log_p, uv = found.log_p, found.uv_px
        scale = self._views.pixel_scale(decided.target.view)
        position = decided.position_px.astype(np.float32)
        if calibration is None:
            return Answers(position)
        visible = calibration.visible(found.distance) if calibration.visible_slope > 0 else None
        flat = calibration.flattened(log_p)
        width = float(np.sqrt(scale[0] * scale[1]))
        if self.settings.distribution == "none":
            return Answers(position, visible)
        mixture, used = mixture_of_modes(flat, uv, calibration.widths, calibration.mode_radius_px)
        values = mixture.double().numpy() * [scale[0], scale[1], width, 1.0]
        kept = zip(values.astype(np.float32), used.numpy(), strict=True)
        return Answers(position, visible, modes=[rows[keep] for rows, keep in kept])

    def heat(self, source: Frame, target: Frame, uv_a_px: Float32Array) -> Heat:
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
        answer = torch.from_numpy(decided.position_px / self._views.pixel_scale(seen.view)).float()
        near = (found.uv_px - answer).norm(dim=1) <= _NEAR_ANSWER
        mass = float(flat.exp()[near].sum())
        return Heat(
            seen.back_image(heat), "log probability", min(1.0, mass), "probability at the answer"
        )

    def search(self, source: Reframed, target: Reframed, uv_a_px: Float32Array) -> Search:
        """Compare queries with the target's candidates, and follow traces where they decide.

        Args:
            source: The image the queries are in.
            target: The image to find them in.
            uv_a_px: float32 (N, 2), in pixels of the source's view.
        """
        compared = self.compare(source.view, target.view, uv_a_px)
        if self.settings.decode != "trace":
            log_p = self._over_quarter_turns(compared.log_p, source, target, uv_a_px)
            found = compared.uv_px, compared.distance, compared.query
            return Search(log_p, *found, None, self._on_one_side(compared, source, target, uv_a_px))
        traced = traced_places(*self._both_traced(source, target), self._scale, uv_a_px)
        log_p, deciding, uv = compared.log_p, compared.log_p, compared.uv_px
        if traced is not None:
            candidates_px = uv.double().numpy() * self._views.pixel_scale(target.view)
            deciding = traced.weighted_log_p(log_p, candidates_px)
            log_p = traced.either_way(deciding, log_p, candidates_px)
        return Search(log_p, uv, compared.distance, compared.query, traced, deciding)

    def _on_one_side(
        self, compared: Comparison, source: Reframed, target: Reframed, uv_a_px: Float32Array
    ) -> torch.Tensor:
        """Return log p of queries on the side of a cloth that most of the pair agrees on.

        Args:
            compared: The queries.
            source: The image they are in.
            target: The image to find them in.
            uv_a_px: float32 (N, 2), in pixels of the source's view.
        """
        log_p = compared.log_p
        shown = self._views.described(source.view).mask if self.settings.one_side else None
        if shown is None:
            return log_p
        points, scale = grid_of(shown), self._views.pixel_scale(source.view)
        of_grid = self.compare(
            source.view, target.view, (points * scale).astype(np.float32), every_px=GRID_EVERY_PX
        )
        side = side_of(points, of_grid.log_p, of_grid.uv_px, self.size[0])
        if side is None:
            return log_p
        return (log_p + side.log_weight(uv_a_px / scale, compared.uv_px)).log_softmax(dim=1)

    def _over_quarter_turns(
        self, log_p: torch.Tensor, source: Reframed, target: Reframed, uv_a_px: Float32Array
    ) -> torch.Tensor:
        """Return the mean of p over the ways in which a blank square may be turned, as a logarithm.

        Args:
            log_p: float (N, M), of the source as it is.
            source: The image the queries are in.
            target: The image to find them in.
            uv_a_px: float32 (N, 2), in pixels of the source's view.
        """
        original = source.back(Answers(uv_a_px)).uv_px
        ways = [log_p]
        for way in self.reader.ways(source, target):
            ways.append(self.compare(way.view, target.view, way.forward(original)).log_p)
        return torch.stack(ways).logsumexp(dim=0) - np.log(len(ways)) if len(ways) > 1 else log_p

    def compare(
        self,
        source: Frame,
        target: Frame,
        uv_a_px: Float32Array,
        every_px: int = 1,
        *,
        by_print: bool = True,
    ) -> Comparison:
        """Compare the queries' descriptors with those of the target's candidates.

        Args:
            source: The image the queries are in.
            target: The image to find them in.
            uv_a_px: float32 (N, 2), in pixels of the source.
            every_px: Only the pixels of every so many rows and columns compete.
            by_print: Match the prints too, where both images show one.
        """
        views, sharpness = self._views, self.sharpness
        asked = source, target, uv_a_px
        return compare(views, self.settings, *asked, sharpness, every_px, by_print=by_print)

    @property
    def _scale(self) -> torch.Tensor:
        return self.network.scale.detach().cpu() * self.sharpness

    def _traced(self, seen: Reframed) -> TracedView:
        return self.reader.traced(seen, self._scale)

    def _both_traced(self, source: Reframed, target: Reframed) -> tuple[TracedView, TracedView]:
        """Return both views, whose traces go on where the rope leaves the picture."""
        own, other = self._traced(source), self._traced(target)
        own_traces, other_traces = completed(own.traces, other.traces)
        return replace(own, traces=own_traces), replace(other, traces=other_traces)

    def decoded(self, found: Search, target: Frame) -> FloatArray:
        """Return the positions that a search ends at, float64 (N, 2) in pixels of the target."""
        sharp = decode_position(found.deciding, found.uv_px, self.settings.decode)
        position = sharp.double().numpy() * self._views.pixel_scale(target)
        return position if found.traced is None else found.traced.refined(position)

    def answered_by_network(self, pair: Pair, every_px: int = 1) -> FloatArray:
        """Return what the network alone answers, without traces and prints: float64 (N, 2), px.

        Args:
            pair: The pair.
            every_px: Only the pixels of every so many rows and columns of the target compete.
        """
        asked = pair.source, pair.target, pair.uv_a_px
        found = self.compare(*asked, every_px, by_print=False)
        position = decode_position(found.log_p, found.uv_px, "median")
        return position.double().numpy() * self._views.pixel_scale(pair.target)

    def descriptor_map(self, view: Frame) -> Float32Array:
        """Return a frame's descriptors at the network's size, float32 (h, w, D)."""
        return self._views.described(view).maps[0].permute(1, 2, 0).numpy()

    def canonical_map(self, view: Frame) -> Float32Array | None:
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
        scale = self.network.scale.detach().cpu()
        parts = head.log_probabilities_in_parts(descriptors.flatten(1).T, scale)
        best = torch.cat([part.argmax(dim=1) for part in parts])
        return head.anchors[best].view(*descriptors.shape[1:], 2).cpu().numpy()

    def working_mask(self, view: Frame) -> BoolArray | None:
        """Return a frame's mask at the network's size, bool (h, w), or None."""
        return self._views.described(view).mask
