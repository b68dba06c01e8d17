"""One batch of Dense Object Nets: descriptors of all views, every ordered pair, the losses."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import torch
from torch.nn import functional

from pliant.models.don.candidates import all_bins, object_and_background, widened
from pliant.models.don.settings import LossSettings
from pliant.models.losses.contrastive import Hinge, contrastive_loss, draw_non_matches
from pliant.models.losses.distributional import distributional_loss, log_probabilities
from pliant.models.losses.lipschitz_space import (
    draw_patch,
    lipschitz_space_loss,
    penalty_weight,
    soft_argmax,
)
from pliant.models.losses.lipschitz_time import lipschitz_time_loss
from pliant.models.losses.matches import Candidates, NonMatches, Targets
from pliant.models.losses.orientation import orientation_loss
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
    B, V, Q, R, _ = batch["uv_px"].shape
    descriptors = out.descriptors
    mask = batch["mask"].flatten(0, 1)
    at_points = batch["uv_px"][:, :, :, 0].flatten(0, 1)
    own = sample_descriptors(descriptors, at_points).view(B, V, Q, -1)
    # others[t] are the source views of target view t.
    others = torch.tensor([[s for s in range(V) if s != t] for t in range(V)], device=mask.device)
    sources = own[:, others].reshape(B * V, (V - 1) * Q, -1)  # (N, q, D), N = B V
    slots = R if settings.symmetric else 1
    target_uv = batch["uv_px"][:, :, None, :, :slots].expand(-1, -1, V - 1, -1, -1, -1)
    in_source = batch["visible"][:, others, :, 0].reshape(B * V, (V - 1) * Q)
    in_target = batch["visible"][:, :, None, :, :slots].expand(-1, -1, V - 1, -1, -1)
    in_target = in_target.reshape(B * V, (V - 1) * Q, slots)
    # A query counts if its point is seen in both views; partners add modes, never queries.
    counts = in_source & in_target[..., 0]
    targets = Targets(
        target_uv.reshape(B * V, (V - 1) * Q, slots, 2), in_target & counts[..., None]
    )
    parts: Figures = {}
    if settings.kind == "distributional":
        parts[settings.kind] = distributional_loss(
            sources,
            _competitors(descriptors, mask, settings, generator),
            targets,
            scale=scale,
            sigma_px=settings.sigma_at(progress),
            direction=settings.direction,
            chunk=settings.chunk or None,
        )
    else:
        parts[settings.kind] = contrastive_loss(
            sources,
            sample_descriptors(descriptors, targets.uv_px[:, :, 0]),
            counts,
            _non_matches(descriptors, mask, (V - 1) * Q, settings, generator),
            targets,
            Hinge(settings.margin, settings.guard_px, settings.squared, settings.hard_scaling),
            settings.chunk or None,
        )
    mu = penalty_weight(progress, *settings.space_mu)
    if settings.space_weight > 0:
        pixels = _space_pixels(batch, settings, generator)
        parts["lipschitz_space"] = _space(descriptors, mask, V, scale, pixels, settings, mu)
    if settings.time_weight > 0:
        pool = _competitors(descriptors, mask, settings, generator)
        log_p = log_probabilities(sources, pool.descriptors, scale)
        views = torch.arange(V, device=mask.device)[:, None].expand_as(others)
        parts["lipschitz_time"] = lipschitz_time_loss(
            soft_argmax(log_p, pool.uv_px).view(-1, Q, 2),
            batch["uv_px"][:, others, :, 0].reshape(-1, Q, 2),
            batch["action_px"][:, views, others].flatten(),
            in_source.view(-1, Q),
            lipschitz=settings.time_constant,
            mu=mu,
        )
    in_view = batch["visible"][..., 0].flatten(0, 1)
    if settings.orientation_weight > 0:
        parts["orientation"] = orientation_loss(
            sample_descriptors(out.orientation, at_points),
            batch["orientation"].flatten(0, 1),
            in_view,
            reversible=slots > 1,
        )
    if settings.canonical_weight > 0 and canonical is not None:
        material = batch["material"][:, None, :, :slots].expand(-1, V, -1, -1, -1)
        parts["canonical"] = canonical_loss(
            canonical,
            own.flatten(0, 1),
            material.flatten(0, 1),
            in_view,
            scale=scale,
            sigma_m=settings.canonical_sigma_at(progress),
        )
    if settings.foreground_weight > 0:
        both = torch.stack([batch["mask"], batch["objects"]], dim=2).flatten(0, 1)
        parts["foreground"] = functional.binary_cross_entropy_with_logits(
            out.foreground, both.float()
        )
    loss = parts[settings.kind]
    for name, weight in _weights(settings).items():
        if name in parts:
            loss = loss + weight * parts[name]
    return loss, {name: part.detach() for name, part in parts.items()}


def _weights(settings: LossSettings) -> dict[str, float]:
    """Return the weight of each part that is added to the main loss."""
    return {
        "lipschitz_space": settings.space_weight,
        "lipschitz_time": settings.time_weight,
        "orientation": settings.orientation_weight,
        "canonical": settings.canonical_weight,
        "foreground": settings.foreground_weight,
    }


def _non_matches(
    descriptors: torch.Tensor,
    mask: torch.Tensor,
    queries: int,
    settings: LossSettings,
    generator: torch.Generator | None,
) -> NonMatches:
    drawn = draw_non_matches(mask, queries, settings.non_matches, generator)  # (N, q, K)
    rows = descriptors.flatten(2).transpose(1, 2)  # (N, h w, D)
    index = drawn.flatten(1)[..., None].expand(-1, -1, rows.shape[-1])
    width = mask.shape[-1]
    return NonMatches(
        rows.gather(1, index).view(*drawn.shape, -1),
        torch.stack([drawn % width, drawn // width], dim=-1) + 0.5,
    )


def _competitors(
    descriptors: torch.Tensor,
    mask: torch.Tensor,
    settings: LossSettings,
    generator: torch.Generator | None,
) -> Candidates:
    mask = widened(mask, settings.mask_margin_px)
    if settings.background < 0 or settings.bin_px > 1:
        return all_bins(descriptors, mask, settings.bin_px)
    return object_and_background(descriptors, mask, settings.background, generator)


@dataclass(frozen=True)
class _SpacePixels:
    """Pixels of each view for the Lipschitz condition in space.

    Attributes:
        uv_px: float (B V, P, 2).
        valid: bool (B V, P).
        near: bool (B V, P, P), which pairs count; None for all.
    """

    uv_px: torch.Tensor
    valid: torch.Tensor
    near: torch.Tensor | None


def _space_pixels(
    batch: Mapping[str, torch.Tensor], settings: LossSettings, generator: torch.Generator | None
) -> _SpacePixels:
    if settings.space_pairs == "disc":
        mask = batch["mask"].flatten(0, 1)
        uv, valid = draw_patch(mask, settings.space_radius_px, settings.space_pixels, generator)
        return _SpacePixels(uv, valid, None)
    seen = batch["visible"][..., 0]
    views = seen.shape[1]
    both = seen & seen.roll(-1, 1)  # here and in the view that it is predicted into
    near = (batch["distance_m"] <= settings.space_reach_m)[:, None].expand(-1, views, -1, -1)
    return _SpacePixels(
        batch["uv_px"][:, :, :, 0].flatten(0, 1), both.flatten(0, 1), near.flatten(0, 1)
    )


def _space(
    descriptors: torch.Tensor,
    mask: torch.Tensor,
    views: int,
    scale: torch.Tensor,
    pixels: _SpacePixels,
    settings: LossSettings,
    mu: float,
) -> torch.Tensor:
    """Return the Lipschitz loss of some pixels of each view, predicted into the next view."""
    query = sample_descriptors(descriptors, pixels.uv_px)
    following = torch.arange(len(mask), device=mask.device).view(-1, views).roll(-1, 1).flatten()
    target = all_bins(descriptors[following], mask[following])
    seen = target.on_object.any(dim=1, keepdim=True)
    usable = target.on_object | ~seen
    log_p = log_probabilities(query, target.descriptors, scale, usable)
    return lipschitz_space_loss(
        soft_argmax(log_p, target.uv_px),
        pixels.uv_px,
        pixels.valid & seen,
        pixels.near,
        lipschitz=settings.space_constant,
        mu=mu,
    )
