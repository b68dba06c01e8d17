"""The contrastive walk: from a copy of a frame to another frame, and back to another copy.

Source: Shrivastava and Owens, Self-Supervised Any-Point Tracking by Contrastive Random Walks
(arXiv 2409.16288), after Jabri, Owens and Efros (2020). A pixel x of a copy A walks to the pixels
m of another frame of its clip, and home to the pixels y of a copy B of its own frame,

    p(y) = sum_m p(m | x) p(y | m),    p(m | x) = softmax_m( -scale * ||f_x - g_m||^2 ),

over all pixels of the object (global matching). The loss is the cross entropy with a Gaussian about
the place where B shows the pixel of x (label warping): each copy is turned, scaled and bent in its
own way, so a network that encodes only the image position does not return. A walk from A to
B at once counts likewise. Whole frames are described, so descriptors may say where on the object a
pixel is, which a patch that was cut out of its frame cannot.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import torch
from torch.nn import functional

from pliant.models.networks.descriptor_network import pixel_grid
from pliant.models.timecycle.settings import WalkSettings

_FLOOR = 1e-9
_HOME_PX = 4.0


@dataclass(frozen=True)
class Copies:
    """Warped copies of frames.

    Attributes:
        images: float (B, C, H, W); what comes in from outside repeats the border.
        mask: bool (B, H, W), the object.
        origin_px: float (B, H, W, 2), which place (u, v) of the frame each pixel shows.
    """

    images: torch.Tensor
    mask: torch.Tensor
    origin_px: torch.Tensor


def warped_copies(
    images: torch.Tensor, mask: torch.Tensor, settings: WalkSettings, generator: torch.Generator
) -> Copies:
    """Turn, scale, move and bend each frame in its own way.

    Args:
        images: float (B, C, H, W).
        mask: bool (B, H, W), the object.
        settings: How much.
        generator: Source of randomness, on the device of the images.
    """
    count, _, height, width = images.shape
    device = images.device
    draws = 2 * torch.rand(count, 4, generator=generator, device=device) - 1
    angle = draws[:, 0] * math.radians(settings.turn_deg)
    scale = (1 + settings.scale) ** draws[:, 1]
    size = torch.tensor([width, height], device=device, dtype=torch.float32)
    centred = pixel_grid(height, width, 1, device).view(height, width, 2) - size / 2
    moved = centred - (settings.shift * size * draws[:, 2:])[:, None, None]
    cos, sin = angle.cos() / scale, angle.sin() / scale
    back = torch.stack([torch.stack([cos, -sin], -1), torch.stack([sin, cos], -1)], dim=1)
    origin = (moved.flatten(1, 2) @ back).view(count, height, width, 2) + size / 2
    knots = torch.randn(
        count, 2, settings.knots - 1, settings.knots, generator=generator, device=device
    )
    bends = functional.interpolate(knots, (height, width), mode="bicubic", align_corners=True)
    strength = settings.bend_px * torch.rand(count, 1, 1, 1, generator=generator, device=device)
    origin = origin + strength * bends.permute(0, 2, 3, 1)
    grid = 2 * origin / size - 1
    shown = functional.grid_sample(images, grid, padding_mode="border", align_corners=False)
    covered = functional.grid_sample(
        mask[:, None].float(), grid, mode="nearest", align_corners=False
    )
    return Copies(shown, covered[:, 0] > 0.5, origin)


def walk_losses(
    described: tuple[torch.Tensor, torch.Tensor, torch.Tensor],
    copies: tuple[Copies, Copies],
    between: torch.Tensor,
    scale: torch.Tensor,
    settings: WalkSettings,
    generator: torch.Generator,
) -> dict[str, torch.Tensor]:
    """Return the losses of a batch of walks.

    Args:
        described: float (B, D, H, W) each, descriptors of copy A, of the other frame and of copy B.
        copies: A, where walks begin, and B, where they end.
        between: bool (B, H, W), the object in the other frame.
        scale: Scalar, inverse temperature.
        settings: How many walks, how wide their targets.
        generator: Source of randomness, on the device of the descriptors.

    Returns:
        `direct`, the mean Kullback-Leibler divergence of walks from A to B; `walk`, that of walks
        through the other frame; `walk_home`, without gradient, the share of these whose most
        probable end is within 4 px of the right one. All 0 where no clip shows the object.
    """
    parts = []
    for n, (mask_a, mask_m, mask_b) in enumerate(
        zip(copies[0].mask, between, copies[1].mask, strict=True)
    ):
        a = _some(mask_a, settings.walks, generator)
        m = _some(mask_m, 4 * settings.walks, generator)
        b = mask_b.flatten().nonzero()[:, 0]
        if min(len(a), len(m), len(b)) == 0:
            continue
        begin, end = (c.origin_px[n].view(-1, 2)[i] for c, i in zip(copies, (a, b), strict=True))
        gap = torch.cdist(begin, end)  # (walks, ends), px of the frame
        shown = gap.amin(dim=1) < settings.sigma_px
        if not shown.any():
            continue
        indices = (a[shown], m, b)
        f, g, h = (each[n].flatten(1).T[i] for each, i in zip(described, indices, strict=True))
        parts.append(_losses(f, g, h, gap[shown], scale, settings.sigma_px))
    if not parts:
        parts = [torch.stack([each.sum() * 0 for each in described])]
    direct, walk, home = torch.stack(parts).mean(dim=0)
    return {"direct": direct, "walk": walk, "walk_home": home.detach()}


def _some(mask: torch.Tensor, count: int, generator: torch.Generator) -> torch.Tensor:
    """Return the numbers of up to `count` pixels of a mask, drawn without replacement."""
    index = mask.flatten().nonzero()[:, 0]
    order = torch.randperm(len(index), generator=generator, device=index.device)
    return index[order[:count]]


def _losses(
    f: torch.Tensor,
    g: torch.Tensor,
    h: torch.Tensor,
    gap: torch.Tensor,
    scale: torch.Tensor,
    sigma_px: float,
) -> torch.Tensor:
    """Return (direct, walk, walk_home) of the walks of one clip.

    Args:
        f: float (W, D), descriptors of the starts.
        g: float (M, D), of the pixels between.
        h: float (E, D), of the ends.
        gap: float (W, E), distances of the ends from where each start belongs.
        scale: Inverse temperature.
        sigma_px: Width of the target.
    """
    log_target = (gap.square() / (-2 * sigma_px**2)).log_softmax(dim=1)
    target = log_target.exp()
    at_once = _log_p(f, h, scale)
    through = (_log_p(f, g, scale).exp() @ _log_p(g, h, scale).exp()).clamp_min(_FLOOR).log()
    direct, walk = ((target * (log_target - each)).sum(dim=1).mean() for each in (at_once, through))
    ends = gap.gather(1, through.argmax(dim=1, keepdim=True))
    return torch.stack([direct, walk, (ends < _HOME_PX).float().mean()])


def _log_p(f: torch.Tensor, g: torch.Tensor, scale: torch.Tensor) -> torch.Tensor:
    return (-scale * torch.cdist(f, g).square()).log_softmax(dim=1)
