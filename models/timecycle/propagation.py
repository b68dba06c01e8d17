"""Carrying points through the frames of an episode.

For every new frame, the descriptor of a point is the mean of what was under it in the first
frame and in the last few frames; the cells that look most like it compete in a softmax; the
mean of their positions is where the point is now. The same reading in the first frame, where
the place is known, gives the part of the error that comes of reading between cells, and is
taken off: what does not move stays where it is.

Neighbours move together: with `smooth`, support points on the object of the first frame are carried
too, and each point moves by the mean of the support points that are near it, in the first frame and
in the last one.
"""

from __future__ import annotations

from collections import deque

import numpy as np
import torch
from torch.nn import functional

from pliant.models.networks.descriptor_network import sample_descriptors
from pliant.models.timecycle.settings import PropagationSettings
from pliant.spec.arrays import BoolArray


class Propagator:
    """Carries points from a first frame through the frames that follow it.

    Args:
        first: float (D, h, w), unit descriptors of the first frame.
        xy: float (N, 2), where the points are in it, cells.
        settings: How it is done.
        temperature: Of the softmax, where the settings name none.
        support: bool (h, w), the first frame's cells on the object, where `smooth` puts its support
            points; None smooths nothing.
    """

    def __init__(
        self,
        first: torch.Tensor,
        xy: torch.Tensor,
        settings: PropagationSettings,
        temperature: float,
        support: BoolArray | None = None,
    ) -> None:
        self.settings = settings
        self._asked = len(xy)
        if settings.smooth > 0 and support is not None:
            rows, columns = np.nonzero(support)
            centres = np.stack([columns, rows], axis=1) + 0.5
            xy = torch.cat([xy, torch.from_numpy(centres).to(xy)])
        self._start = xy
        self.temperature = settings.temperature or temperature
        self.first = self._refined(first)
        self.xy = xy
        self._look = self._under(self.first, xy)  # (N, D)
        self._context: deque[torch.Tensor] = deque(maxlen=max(1, settings.context))
        self._context.append(self._look)
        self._offset = xy - self._read(self.first, self._look, xy, None)

    def step(
        self,
        frame: torch.Tensor,
        searched: BoolArray | None = None,
        expected: torch.Tensor | None = None,
    ) -> torch.Tensor:
        """Take in the next frame.

        Args:
            frame: float (D, h, w), its unit descriptors.
            searched: bool (h, w), the cells where points may be, or None for all.
            expected: float (N + S, 2), where the points and the support points are expected,
                cells; None where they were last.

        Returns:
            float (N, 2), where the points are in it, cells.
        """
        refined = self._refined(frame)
        look = self._look
        if self.settings.context:
            share = self.settings.first_weight
            recent = torch.stack(list(self._context)).mean(dim=0)
            look = functional.normalize(share * look + (1 - share) * recent, dim=1)
        allowed = None
        if searched is not None and searched.any():
            wide = torch.from_numpy(searched)[None, None].float()
            allowed = functional.interpolate(wide, refined.shape[-2:], mode="nearest")[0, 0] > 0
        near = self.xy if expected is None else expected
        found = self._read(refined, look, near, allowed) + self._offset
        if len(found) > self._asked:
            found = self._smoothed(found)
        height, width = frame.shape[-2:]
        found[:, 0].clamp_(0, width)
        found[:, 1].clamp_(0, height)
        self.xy = found
        self._context.append(self._under(refined, found))
        return found[: self._asked]

    def scores(self, frame: torch.Tensor, searched: BoolArray | None = None) -> torch.Tensor:
        """Return log probabilities of the points over the cells of a frame, float (N, h, w).

        Args:
            frame: float (D, h, w), its unit descriptors.
            searched: bool (h, w), the cells where points may be, or None for all; others get -inf.
        """
        logits = (self._look @ frame.flatten(1)) / self.temperature
        if searched is not None:
            logits[:, ~torch.from_numpy(searched).flatten()] = -torch.inf
        return logits.log_softmax(dim=1).unflatten(1, frame.shape[-2:])

    def _smoothed(self, found: torch.Tensor) -> torch.Tensor:
        """Return positions (N, 2) that move as the support points around them do on average."""
        moved = (found - self.xy)[self._asked :]
        start, last = (torch.cdist(at, at[self._asked :]).square() for at in (self._start, self.xy))
        square = start + last  # (N, S)
        weight = (-square / (2 * self.settings.smooth**2)).softmax(dim=1)
        return self.xy + weight @ moved

    def _refined(self, frame: torch.Tensor) -> torch.Tensor:
        """Return descriptors on a finer grid, of unit length again."""
        if self.settings.refine == 1:
            return frame
        fine = functional.interpolate(
            frame[None], scale_factor=self.settings.refine, mode="bilinear", align_corners=False
        )
        return functional.normalize(fine[0], dim=0)

    def _under(self, refined: torch.Tensor, xy: torch.Tensor) -> torch.Tensor:
        """Return the unit descriptors under positions, (N, D)."""
        found = sample_descriptors(refined[None], xy[None] * self.settings.refine)[0]
        return functional.normalize(found, dim=1)

    def _read(
        self,
        refined: torch.Tensor,
        look: torch.Tensor,
        near: torch.Tensor,
        allowed: torch.Tensor | None,
    ) -> torch.Tensor:
        """Return where descriptors are found in a frame, (N, 2) cells."""
        height, width = refined.shape[-2:]
        fine = self.settings.refine
        logits = (look @ refined.flatten(1)) / self.temperature  # (N, h w)
        u = (torch.arange(width) + 0.5) / fine
        v = (torch.arange(height) + 0.5) / fine
        cells = torch.stack([u.repeat(height), v.repeat_interleave(width)], dim=1)  # (h w, 2)
        barred = torch.zeros_like(logits, dtype=torch.bool)
        distance = torch.cdist(near, cells)
        if self.settings.prior > 0:
            logits = logits - distance.square() / (2 * self.settings.prior**2)
        if self.settings.radius > 0:
            reach = self.settings.radius * max(width, height) / fine
            # The nearest cells always stay in, however small the radius.
            floor = distance.topk(min(self.settings.top_k, len(cells)), largest=False).values
            barred |= distance > floor[:, -1:].clamp(min=reach)
        if allowed is not None:
            off = barred | ~allowed.flatten()
            barred = torch.where(off.all(dim=1, keepdim=True), barred, off)
        logits = logits.masked_fill(barred, -torch.inf)
        best = logits.topk(min(self.settings.top_k * fine**2, len(cells)), dim=1)
        weight = best.values.softmax(dim=1)
        return (weight[..., None] * cells[best.indices]).sum(dim=1)
