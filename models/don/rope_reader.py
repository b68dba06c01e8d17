"""Encoded pictures, and traces of ropes chosen by a network."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import partial
from pathlib import Path

import torch

from pliant.baselines.shared_cache import SharedCache
from pliant.baselines.tracing import (
    MaskShape,
    Reframed,
    Trace,
    rectified,
    rope_traces,
    untilted,
    with_cut_ends,
)
from pliant.models.don.ball import BallNetwork
from pliant.models.don.crossings import CrossingNetwork, with_overlaps
from pliant.models.don.described import DescribedView, ViewDescriber
from pliant.models.don.prints import other_quarter_turns, turned, turned_by_print, upright_turn
from pliant.models.don.settings import AnswerSettings
from pliant.models.don.table import VisibleTable
from pliant.models.don.tracing import TracedView, canonical_likelihood, enlarged
from pliant.models.networks.descriptor_network import DescriptorNetwork
from pliant.models.networks.mask_network import MaskNetwork
from pliant.spec.arrays import FloatArray, Mask
from pliant.spec.frame import Frame, Pair
from pliant.spec.lru_cache import LRUCache

_KEPT_BYTES = 128 * 2**20
_LEAST_KEPT = 8
_BYTES_PER_PIXEL = 9  # colour, depth and two masks
_KEPT_TRACES = 256
_KEPT_TURNS = 4096
_TILT = 0.70  # the tangent of 35 degrees
_SURER = 0.02  # of a mean log probability, so that a view is not changed for nothing


def _bytes_of(seen: Reframed) -> int:
    """Return about how many bytes a view takes."""
    width, height = seen.view.size
    return _BYTES_PER_PIXEL * width * height


class RopeReader:
    """Brings images to the view that they are answered in, and traces the ropes in them.

    Args:
        network: The network.
        views: What describes images with it.
        settings: How answers are made.

    Attributes:
        crossings: Tells which strand is on top, or None.
    """

    def __init__(
        self, network: DescriptorNetwork, views: ViewDescriber, settings: AnswerSettings
    ) -> None:
        self._network, self._views, self._settings = network, views, settings
        self.crossings: CrossingNetwork | None = None
        self._rectified: LRUCache[Reframed] = LRUCache(_KEPT_BYTES, _bytes_of, least=_LEAST_KEPT)
        self._turns: LRUCache[float] = LRUCache(_KEPT_TURNS)
        self._readings: LRUCache[tuple[list[Trace], MaskShape]] = LRUCache(_KEPT_TRACES)

    def share(self, folder: Path) -> None:
        """Store traces, turns and masks in a folder, where copies in other processes find them."""
        self._turns = SharedCache(_KEPT_TURNS, folder / "turns")
        self._readings = SharedCache(_KEPT_TRACES, folder / "traces")
        self._views.share(folder / "masks")

    def find_masks_with(self, masks: MaskNetwork, ball: BallNetwork | None) -> None:
        """Find objects in pictures, and the ball of a rope, with networks of their own."""
        self._views.masks, self._views.ball = masks, ball

    @property
    def finds_masks(self) -> bool:
        """Whether it finds a rope's masks itself where a picture comes without."""
        return self._settings.decode == "trace" and self._views.segments

    def masked(self, view: Frame) -> Frame:
        """Return a view with masks found in its picture, where it has none.

        Masks of a rope that do not follow the picture's contours are corrected. Where nothing is
        found, or the network predicts no masks, the view stays as it is.
        """
        if self._settings.decode == "trace":
            return self._views.segmented(view)
        return self._views.foreground(view)

    def seen(self, view: Frame) -> Reframed:
        """Return a view as it is answered in: not too small; a rope's from above, with masks."""

        def prepared() -> Reframed:
            masked = self.masked(view)
            seen = self._from_above(masked)
            shown = None if self._settings.blank_square == "no" else self._shown(seen.view)
            if shown is not None:
                upright = partial(upright_turn, seen, shown, self._views.confidence)
                seen = turned(seen, self._turns.get(view.cache_key, upright), shown)
            return replace(seen, segmented=masked is not view)

        return self._rectified.get(view.cache_key, prepared)

    def _from_above(self, view: Frame) -> Reframed:
        """Return a view from straight above, as far as settings ask for it, and not too small.

        The tilt of a rope follows from its widths. For a cloth, the network gets the picture and
        its rectification for a tilt of 35 degrees; the one in which it is more certain of the
        material coordinates is used.
        """
        if self._settings.decode == "trace" and self._settings.rectify:
            return self._large(rectified(view))
        as_it_is = self._large(Reframed.unchanged(view))
        shown = self._shown(view) if self._settings.rectify else None
        if shown is None or not shown.any():
            return as_it_is
        above = self._large(untilted(view, _TILT, shown, view.border_rgb))
        gain = self._views.confidence(above.view) - self._views.confidence(as_it_is.view)
        return above if gain > _SURER else as_it_is

    def _large(self, seen: Reframed) -> Reframed:
        return seen.zoomed(self._shown(seen.view), *self._settings.fill)

    def turned_as(
        self, source: Reframed, target: Reframed, matched: Callable[[Pair], FloatArray]
    ) -> Reframed:
        """Return a cloth's source turned as the target is, where prints say so.

        Args:
            source: From `seen`.
            target: Likewise.
            matched: Where the queries of a pair are in its target, float64 (N, 2), by the network.
        """
        if self._settings.blank_square == "no" or not self._views.given.colour:
            return source
        return turned_by_print(source, target, self._views, matched)

    def ways(self, source: Reframed, target: Reframed) -> list[Reframed]:
        """Return the source turned to each other side, where nothing says how a cloth is turned.

        Args:
            source: From `seen`.
            target: Likewise.
        """
        known = self._settings.blank_square
        if (
            known == "no"
            or source.settled
            or (known == "upright" and not (source.turned or target.turned))
        ):
            return []
        shown = self._shown(source.view)
        return [] if shown is None else other_quarter_turns(source, shown)

    def _shown(self, view: Frame) -> Mask | None:
        """Return where a view shows the object, at any resolution, or None where it is unknown."""
        shown = view.mask if view.objects is None else view.objects
        return self._views.described(view).mask if shown is None else shown

    def traced(self, seen: Reframed, scale: torch.Tensor) -> TracedView:
        """Return a view with its traces.

        Args:
            seen: From `seen`.
            scale: Scalar, inverse temperature.
        """
        view = seen.view
        own = self._views.described(view)
        traces, shape = self._readings.get(view.cache_key, lambda: self._read(seen, own, scale))
        return TracedView(view, own.maps[0], traces, shape)

    def _read(
        self, seen: Reframed, own: DescribedView, scale: torch.Tensor
    ) -> tuple[list[Trace], MaskShape]:
        """Return the traces of a view in its pixels, and the shape of the mask that they follow."""
        view, factor = seen.view, self._views.pixel_scale(seen.view)
        says = canonical_likelihood(self._network, own.maps[0], scale)
        if view.mask is not None:
            given = None if says is None else lambda uv_px: says(uv_px / factor)
            mask, objects = view.mask, view.objects
            table = VisibleTable(view.rgb, mask if objects is None else mask | objects)
            traces = rope_traces(mask, objects, given, seen.nadir, table)
        elif own.mask is not None:
            mask, objects = own.mask, own.objects
            traces = enlarged(rope_traces(mask, objects, says), factor)
        else:
            return [], MaskShape(0, 0, has_ball=False)
        if self.crossings is not None:
            traces = with_overlaps(self.crossings, view, mask, traces)
        traces = with_cut_ends(traces, seen)
        return traces, MaskShape.of(mask, objects)
