"""One batch of Dense Object Nets: descriptors of all views, every ordered pair, the losses."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import torch
from torch.nn import functional

from pliant.models.don.settings import LossSettings
from pliant.models.losses.contrastive import Hinge, contrastive_loss, draw_non_matches
from pliant.models.losses.distributional import distributional_loss, log_probabilities
from pliant.models.losses.matches import (
    Candidates,
    NonMatches,
    Targets,
    all_bins,
    object_and_background,
)
from pliant.models.losses.regularisers import (
    lipschitz_space_loss,
    lipschitz_time_loss,
    orientation_loss,
    penalty_weight,
    soft_argmax,
    stretch_loss,
)
from pliant.models.networks.canonical import CanonicalHead, canonical_loss
from pliant.models.networks.descriptor_network import NetworkOutput, sample_descriptors

Figures = dict[str, torch.Tensor]


def don_loss(
    out: NetworkOutput,
    scale: torch.Tensor,
    batch: Mapping[str, torch.Tensor],
    settings: LossSettings,
    *,
    canonical: CanonicalHead | None = None,
    progress: float = 0.0,
    generator: torch.Generator | None = None,
) -> tuple[torch.Tensor, Figures]:
    """Return the loss of a batch and its parts.

    Each view is the target once, and the other views of its sample are its sources.

    Args:
        out: What the network puts out for the B V views, in the batch's order.
        scale: Scalar, inverse temperature.
        batch: A batch of `PairDataset`: mask (B, V, h, w), uv_px (B, V, Q, R, 2), visible
            (B, V, Q, R), action_px (B, V, V); orientation (B, V, Q, 3), material (B, Q, R, 2),
            distance_m (B, Q, Q) and objects (B, V, h, w) for the losses that need them.
        settings: What to minimise.
        canonical: The canonical head, for its loss.
        progress: Share of the training done, 0 to 1 (for growing penalties).
        generator: Source of randomness.

    Returns:
        The scalar to minimise, and named parts of it for the log.
    """
    seen = _gathered(out.descriptors, batch, settings)
    mu = penalty_weight(progress, *settings.space_mu)
    parts: Figures = {settings.kind: _matching(seen, scale, settings, progress, generator)}
    if settings.space_weight > 0:
        pixels = _space_pixels(batch, settings.space_reach_m)
        parts["lipschitz_space"] = _space(seen, scale, pixels, settings, mu)
    if settings.time_weight > 0:
        parts["lipschitz_time"] = _time(seen, batch, scale, settings, mu, generator)
    in_view = batch["visible"][..., 0].flatten(0, 1)
    if settings.orientation_weight > 0:
        parts["orientation"] = orientation_loss(
            sample_descriptors(out.orientation, batch["uv_px"][:, :, :, 0].flatten(0, 1)),
            batch["orientation"].flatten(0, 1),
            in_view,
            reversible=seen.slots > 1,
        )
    if settings.canonical_weight > 0 and canonical is not None:
        material = batch["material"][:, None, :, : seen.slots].expand(-1, seen.views, -1, -1, -1)
        parts["canonical"] = canonical_loss(
            canonical,
            seen.own.flatten(0, 1),
            material.flatten(0, 1),
            in_view,
            scale=scale,
            sigma_m=settings.canonical_sigma_at(progress),
        )
    if settings.stretch_weight > 0 and canonical is not None:
        parts["stretch"] = stretch_loss(
            canonical,
            seen.own.flatten(0, 1),
            batch["material"][:, None, :, 0].expand(-1, seen.views, -1, -1).flatten(0, 1),
            in_view,
            scale=scale,
            reach_m=settings.stretch_reach_m,
        )
    if settings.foreground_weight > 0:
        both = torch.stack([batch["mask"], batch["objects"]], dim=2).flatten(0, 1)
        parts["foreground"] = functional.binary_cross_entropy_with_logits(
            out.foreground, both.float()
        )
    loss = parts[settings.kind]
    for name, weight in settings.weights.items():
        if name in parts:
            loss = loss + weight * parts[name]
    return loss, {name: part.detach() for name, part in parts.items()}


@dataclass(frozen=True)
class _Gathered:
    """A batch by target views, N = B V of them, each asked for q = (V - 1) Q points.

    Attributes:
        descriptors: float (N, D, h, w).
        mask: bool (N, h, w).
        own: float (B, V, Q, D), the points' descriptors in each view.
        others: int64 (V, V - 1), the source views of each target view.
        sources: float (N, q, D), the points' descriptors in the source views.
        in_source: bool (N, q), which of them are seen there.
        targets: Where they are in the target view. A query counts if its point is seen in both
            views; partners add modes, never queries.
        counts: bool (N, q), which queries count.
    """

    descriptors: torch.Tensor
    mask: torch.Tensor
    own: torch.Tensor
    others: torch.Tensor
    sources: torch.Tensor
    in_source: torch.Tensor
    targets: Targets
    counts: torch.Tensor

    @property
    def views(self) -> int:
        """V."""
        return self.own.shape[1]

    @property
    def slots(self) -> int:
        """Places of a point and those of its symmetry partners that are taken into account."""
        return self.targets.uv_px.shape[2]


def _gathered(
    descriptors: torch.Tensor, batch: Mapping[str, torch.Tensor], settings: LossSettings
) -> _Gathered:
    B, V, Q, R, _ = batch["uv_px"].shape
    mask = batch["mask"].flatten(0, 1)
    at_points = batch["uv_px"][:, :, :, 0].flatten(0, 1)
    own = sample_descriptors(descriptors, at_points).view(B, V, Q, -1)
    others = torch.tensor([[s for s in range(V) if s != t] for t in range(V)], device=mask.device)
    slots = R if settings.symmetric else 1
    target_uv = batch["uv_px"][:, :, None, :, :slots].expand(-1, -1, V - 1, -1, -1, -1)
    in_source = batch["visible"][:, others, :, 0].reshape(B * V, (V - 1) * Q)
    in_target = batch["visible"][:, :, None, :, :slots].expand(-1, -1, V - 1, -1, -1)
    in_target = in_target.reshape(B * V, (V - 1) * Q, slots)
    counts = in_source & in_target[..., 0]
    return _Gathered(
        descriptors=descriptors,
        mask=mask,
        own=own,
        others=others,
        sources=own[:, others].reshape(B * V, (V - 1) * Q, -1),
        in_source=in_source,
        targets=Targets(
            target_uv.reshape(B * V, (V - 1) * Q, slots, 2), in_target & counts[..., None]
        ),
        counts=counts,
    )


def _matching(
    seen: _Gathered,
    scale: torch.Tensor,
    settings: LossSettings,
    progress: float,
    generator: torch.Generator | None,
) -> torch.Tensor:
    """Return the main loss: distributional or contrastive."""
    if settings.kind == "distributional":
        return distributional_loss(
            seen.sources,
            _competitors(seen, settings, generator),
            seen.targets,
            scale=scale,
            sigma_px=settings.sigma_at(progress),
            direction=settings.direction,
            chunk=settings.chunk or None,
        )
    at_match = sample_descriptors(seen.descriptors, seen.targets.uv_px[:, :, 0])
    queries = seen.sources.shape[1]
    uv = draw_non_matches(seen.mask, queries, settings.non_matches, generator)  # (N, q, K, 2)
    there = sample_descriptors(seen.descriptors, uv.flatten(1, 2)).unflatten(1, uv.shape[1:3])
    return contrastive_loss(
        seen.sources,
        at_match,
        seen.counts,
        NonMatches(there, uv),
        seen.targets,
        Hinge(settings.margin, settings.guard_px, settings.squared, settings.hard_scaling),
        settings.chunk or None,
    )


def _competitors(
    seen: _Gathered, settings: LossSettings, generator: torch.Generator | None
) -> Candidates:
    if settings.background < 0 or settings.bin_px > 1:
        return all_bins(seen.descriptors, seen.mask, settings.bin_px)
    return object_and_background(seen.descriptors, seen.mask, settings.background, generator)


@dataclass(frozen=True)
class _SpacePixels:
    """Pixels of each view for the Lipschitz condition in space.

    Attributes:
        uv_px: float (B V, P, 2).
        valid: bool (B V, P).
        near: bool (B V, P, P), which pairs count.
    """

    uv_px: torch.Tensor
    valid: torch.Tensor
    near: torch.Tensor


def _space_pixels(batch: Mapping[str, torch.Tensor], reach_m: float) -> _SpacePixels:
    seen = batch["visible"][..., 0]
    views = seen.shape[1]
    both = seen & seen.roll(-1, 1)  # here and in the view that it is predicted into
    near = (batch["distance_m"] <= reach_m)[:, None].expand(-1, views, -1, -1)
    return _SpacePixels(
        batch["uv_px"][:, :, :, 0].flatten(0, 1), both.flatten(0, 1), near.flatten(0, 1)
    )


def _space(
    seen: _Gathered, scale: torch.Tensor, pixels: _SpacePixels, settings: LossSettings, mu: float
) -> torch.Tensor:
    """Return the Lipschitz loss of some pixels of each view, predicted into the next view."""
    query = sample_descriptors(seen.descriptors, pixels.uv_px)
    number = torch.arange(len(seen.mask), device=seen.mask.device)
    following = number.view(-1, seen.views).roll(-1, 1).flatten()
    target = all_bins(seen.descriptors[following], seen.mask[following])
    shown = target.on_object.any(dim=1, keepdim=True)
    usable = target.on_object | ~shown
    log_p = log_probabilities(query, target.descriptors, scale, usable)
    return lipschitz_space_loss(
        soft_argmax(log_p, target.uv_px),
        pixels.uv_px,
        pixels.valid & shown,
        pixels.near,
        lipschitz=settings.space_constant,
        mu=mu,
    )


def _time(
    seen: _Gathered,
    batch: Mapping[str, torch.Tensor],
    scale: torch.Tensor,
    settings: LossSettings,
    mu: float,
    generator: torch.Generator | None,
) -> torch.Tensor:
    """Return the Lipschitz loss of every point, predicted from each other view."""
    pool = _competitors(seen, settings, generator)
    log_p = log_probabilities(seen.sources, pool.descriptors, scale)
    views = torch.arange(seen.views, device=seen.mask.device)[:, None].expand_as(seen.others)
    points = batch["uv_px"].shape[2]
    return lipschitz_time_loss(
        soft_argmax(log_p, pool.uv_px).view(-1, points, 2),
        batch["uv_px"][:, seen.others, :, 0].reshape(-1, points, 2),
        batch["action_px"][:, views, seen.others].flatten(),
        seen.in_source.view(-1, points),
        lipschitz=settings.time_constant,
        mu=mu,
    )
