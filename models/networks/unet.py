"""A small U-Net with a global view at the bottom."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise

import torch
from torch import nn
from torch.nn import functional

_GROUPS = 8


class ConvBlock(nn.Module):
    """Two 3x3 convolutions, each with group normalisation and SiLU; a residual around both.

    Group rather than batch normalisation: a step then does not depend on what else is in the
    batch, nor on how a batch is shared out over processes.
    """

    def __init__(self, channels_in: int, channels_out: int) -> None:
        super().__init__()
        self.conv1 = nn.Conv2d(channels_in, channels_out, 3, padding=1, bias=False)
        self.norm1 = nn.GroupNorm(_GROUPS, channels_out)
        self.conv2 = nn.Conv2d(channels_out, channels_out, 3, padding=1, bias=False)
        self.norm2 = nn.GroupNorm(_GROUPS, channels_out)
        self.skip = (
            nn.Identity()
            if channels_in == channels_out
            else nn.Conv2d(channels_in, channels_out, 1, bias=False)
        )

    def forward(self, x: torch.Tensor) -> torch.Tensor:
        """Map (N, C_in, h, w) to (N, C_out, h, w)."""
        y = functional.silu(self.norm1(self.conv1(x)))
        return functional.silu(self.norm2(self.conv2(y)) + self.skip(x))


class GlobalBlock(nn.Module):
    """Self-attention over all positions, then a small MLP.

    Which end of a rope a pixel belongs to is decided far away from it: no stack of 3x3
    convolutions of this size sees that far.
    """

    def __init__(self, channels: int, heads: int = 4) -> None:
        super().__init__()
        self.heads = heads
        self.norm1 = nn.LayerNorm(channels)
        self.qkv = nn.Linear(channels, 3 * channels)
        self.out = nn.Linear(channels, channels)
        self.norm2 = nn.LayerNorm(channels)
        self.mlp = nn.Sequential(
            nn.Linear(channels, 2 * channels), nn.SiLU(), nn.Linear(2 * channels, channels)
        )

    def forward(self, tokens: torch.Tensor) -> torch.Tensor:
        """Map (N, T, C) to (N, T, C)."""
        n, t, c = tokens.shape
        qkv = self.qkv(self.norm1(tokens)).reshape(n, t, 3, self.heads, c // self.heads)
        q, k, v = qkv.permute(2, 0, 3, 1, 4)  # (N, heads, T, C / heads) each
        mixed = functional.scaled_dot_product_attention(q, k, v)
        tokens = tokens + self.out(mixed.transpose(1, 2).reshape(n, t, c))
        return tokens + self.mlp(self.norm2(tokens))


class UNet(nn.Module):
    """Encoder, global blocks at the coarsest level, decoder with skips.

    Args:
        channels_in: Channels of the input.
        descriptor_dim: Channels of the output.
        widths: Channels of each level, finest first; multiples of 8, the last one of 32.
        global_blocks: Attention blocks at the coarsest level.
        patch: Side of the pixel block that becomes one position of the finest level (1 or 2);
            the output is upsampled back.
    """

    def __init__(
        self,
        channels_in: int,
        descriptor_dim: int,
        widths: Sequence[int] = (24, 48, 96, 160),
        global_blocks: int = 2,
        patch: int = 1,
    ) -> None:
        super().__init__()
        self.patch = patch
        first = channels_in * patch * patch
        self.encoder = nn.ModuleList(ConvBlock(a, b) for a, b in pairwise([first, *widths]))
        self.position = nn.Conv2d(widths[-1], widths[-1], 3, padding=1, groups=widths[-1])
        self.globals = nn.ModuleList(GlobalBlock(widths[-1]) for _ in range(global_blocks))
        self.decoder = nn.ModuleList(
            ConvBlock(fine + coarse, fine) for fine, coarse in reversed(list(pairwise(widths)))
        )
        # No bias: it would shift all descriptors alike, and distances do not see that.
        self.head = nn.Conv2d(widths[0], descriptor_dim * patch * patch, 1, bias=False)

    def forward(self, image: torch.Tensor) -> torch.Tensor:
        """Map images (N, C, h, w) to descriptors (N, D, h, w); any h and w."""
        height, width = image.shape[-2:]
        step = self.patch << (len(self.encoder) - 1)
        pad = (0, -width % step, 0, -height % step)
        x = functional.pad(image, pad, mode="replicate") if any(pad) else image
        if self.patch > 1:
            x = functional.pixel_unshuffle(x, self.patch)
        levels = []
        for depth, block in enumerate(self.encoder):
            x = block(functional.max_pool2d(x, 2) if depth else x)
            levels.append(x)
        if len(self.globals):
            x = x + self.position(x)  # a convolution over zero padding tells where the border is
            n, c, h, w = x.shape
            tokens = x.flatten(2).transpose(1, 2)
            for block in self.globals:
                tokens = block(tokens)
            x = tokens.transpose(1, 2).reshape(n, c, h, w)
        for block, skip in zip(self.decoder, reversed(levels[:-1]), strict=True):
            x = functional.interpolate(x, scale_factor=2, mode="bilinear", align_corners=False)
            x = block(torch.cat([x, skip], dim=1))
        x = self.head(x)
        if self.patch > 1:
            x = functional.pixel_shuffle(x, self.patch)
        return x[..., :height, :width]
