"""One batch of Dense Object Nets: descriptors of all views, every ordered pair, the losses."""

from __future__ import annotations

from collections.abc import Mapping

import torch
from torch.nn import functional

from pliant.models.don.candidates import (
    Candidates,
    all_bins,
    object_and_background,
    pixel_grid,
    widened,
)
from pliant.models.losses.contrastive import contrastive_loss, draw_non_matches
from pliant.models.losses.distributional import distributional_loss, log_probabilities
from pliant.models.losses.lipschitz_space import (
    draw_patch,
    lipschitz_space_loss,
    penalty_weight,
    soft_argmax,
)
from pliant.models.losses.lipschitz_time import lipschitz_time_loss
from pliant.models.losses.orientation import orientation_loss
from pliant.models.networks.canonical import CanonicalHead, canonical_loss
from pliant.models.networks.descriptor_network import NetworkOutput, sample_descriptors
from pliant.models.settings import LossSettings

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
            (B, V, Q, R), action_px (B, V, V); orientation (B, V, Q, 3), material (B, Q, R, 2)
            and objects (B, V, h, w) for the losses that need them.
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
    target_uv = target_uv.reshape(B * V, (V - 1) * Q, slots, 2)
    in_source = batch["visible"][:, others, :, 0].reshape(B * V, (V - 1) * Q)
    in_target = batch["visible"][:, :, None, :, :slots].expand(-1, -1, V - 1, -1, -1)
    in_target = in_target.reshape(B * V, (V - 1) * Q, slots)
    # A query counts if its point is seen in both views; partners add modes, never queries.
    counts = in_source & in_target[..., 0]
    target_valid = in_target & counts[..., None]
    chunk = settings.chunk or None

    figures: Figures = {}
    if settings.kind == "distributional":
        pool = _competitors(descriptors, mask, settings, generator)
        loss = distributional_loss(
            sources,
            pool.descriptors,
            pool.uv_px,
            pool.valid,
            pool.on_object,
            target_uv,
            target_valid,
            scale=scale,
            sigma_px=settings.sigma_at(progress),
            direction=settings.direction,
            chunk=chunk,
        )
    else:
        width = mask.shape[-1]
        drawn = draw_non_matches(mask, (V - 1) * Q, settings.non_matches, generator)  # (N, q, K)
        rows = descriptors.flatten(2).transpose(1, 2)  # (N, h w, D)
        index = drawn.flatten(1)[..., None].expand(-1, -1, rows.shape[-1])
        non_match = rows.gather(1, index).view(*drawn.shape, -1)
        non_match_uv = torch.stack([drawn % width, drawn // width], dim=-1) + 0.5
        match = sample_descriptors(descriptors, target_uv[:, :, 0])
        loss = contrastive_loss(
            sources,
            match,
            counts,
            non_match,
            non_match_uv,
            target_uv,
            target_valid,
            margin=settings.margin,
            guard_px=settings.guard_px,
            squared=settings.squared,
            hard_scaling=settings.hard_scaling,
            chunk=chunk,
        )
    figures[settings.kind] = loss.detach()
    if settings.space_weight > 0:
        space = _space(descriptors, mask, V, scale, settings, progress, generator)
        figures["lipschitz_space"] = space.detach()
        loss = loss + settings.space_weight * space
    if settings.time_weight > 0:
        pool = _competitors(descriptors, mask, settings, generator)
        log_p = log_probabilities(sources, pool.descriptors, pool.valid, scale)
        predicted = soft_argmax(log_p, pool.uv_px).view(B * V * (V - 1), Q, 2)
        source_uv = batch["uv_px"][:, others, :, 0].reshape(B * V * (V - 1), Q, 2)
        targets = torch.arange(V, device=mask.device)[:, None].expand_as(others)
        action = batch["action_px"][:, targets, others].flatten()
        time = lipschitz_time_loss(
            predicted,
            source_uv,
            action,
            in_source.view(B * V * (V - 1), Q),
            lipschitz=settings.time_constant,
            mu=penalty_weight(progress, *settings.space_mu),
        )
        figures["lipschitz_time"] = time.detach()
        loss = loss + settings.time_weight * time
    in_view = batch["visible"][..., 0].flatten(0, 1)
    if settings.orientation_weight > 0:
        lies = orientation_loss(
            sample_descriptors(out.orientation, at_points),
            batch["orientation"].flatten(0, 1),
            in_view,
            reversible=slots > 1,
        )
        figures["orientation"] = lies.detach()
        loss = loss + settings.orientation_weight * lies
    if settings.canonical_weight > 0 and canonical is not None:
        material = batch["material"][:, None, :, :slots].expand(-1, V, -1, -1, -1)
        found = canonical_loss(
            canonical,
            own.flatten(0, 1),
            material.flatten(0, 1),
            in_view,
            scale=scale,
            sigma_m=settings.canonical_sigma_at(progress),
        )
        figures["canonical"] = found.detach()
        loss = loss + settings.canonical_weight * found
    if settings.foreground_weight > 0:
        both = torch.stack([batch["mask"], batch["objects"]], dim=2).flatten(0, 1)
        seen = functional.binary_cross_entropy_with_logits(out.foreground, both.float())
        figures["foreground"] = seen.detach()
        loss = loss + settings.foreground_weight * seen
    return loss, figures


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


def _space(
    descriptors: torch.Tensor,
    mask: torch.Tensor,
    views: int,
    scale: torch.Tensor,
    settings: LossSettings,
    progress: float,
    generator: torch.Generator | None,
) -> torch.Tensor:
    """Return the Lipschitz loss of one patch of each view, predicted into the next view."""
    patch_uv, valid = draw_patch(mask, settings.space_radius_px, settings.space_pixels, generator)
    query = sample_descriptors(descriptors, patch_uv)
    following = torch.arange(len(mask), device=mask.device).view(-1, views).roll(-1, 1).flatten()
    target, target_mask = descriptors[following], mask[following]
    height, width = mask.shape[-2:]
    usable = target_mask.flatten(1)
    usable = torch.where(usable.any(dim=1, keepdim=True), usable, torch.ones_like(usable))
    log_p = log_probabilities(query, target.flatten(2).transpose(1, 2), usable, scale)
    grid = pixel_grid(height, width, 1, mask.device)[None].expand(len(mask), -1, -1)
    return lipschitz_space_loss(
        soft_argmax(log_p, grid),
        patch_uv,
        valid & target_mask.flatten(1).any(dim=1, keepdim=True),
        lipschitz=settings.space_constant,
        mu=penalty_weight(progress, *settings.space_mu),
    )
