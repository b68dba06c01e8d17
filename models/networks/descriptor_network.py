"""Networks by name: an image in, a descriptor at every pixel out."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, Final, Literal, Self

import torch
from pydantic import model_validator
from torch import nn
from torch.nn import functional

from pliant.loaders.inputs import NetworkInput
from pliant.models.networks.canonical import CanonicalHead
from pliant.models.networks.pretrained import load_pretrained
from pliant.models.networks.resnet import DEPTHS, ResNetFCN
from pliant.models.networks.unet import UNet
from pliant.models.training.settings import Channels
from pliant.spec.configuration import Settings
from pliant.spec.constraints import Bounds, OneOf, Refused

ORIENTATION_CHANNELS: Final = 3
"""Direction (u, v) and sine, as `pliant.loaders.orientation` has them."""

FOREGROUND_CHANNELS: Final = 2
"""Logits of the queried object's mask and of the mask of all objects."""


class NetworkSettings(Settings):
    """The network's architecture and outputs.

    Attributes:
        name: `unet`, `resnet18` or `resnet34`.
        descriptor_dim: Channels D of a descriptor.
        widths: U-Net: channels of each level, finest first.
        global_blocks: U-Net: attention blocks at the coarsest level.
        patch: U-Net: pixels a side that share one position of the finest level.
        pretrained: Weights to start from: a run's folder (also of another size or input), a
            `.safetensors` file (or a `.pt`/`.pth` state dictionary); empty for none.
    """

    name: Annotated[str, OneOf(("unet", *DEPTHS))] = "unet"
    descriptor_dim: Channels = 16
    widths: Annotated[tuple[int, ...], Bounds(8, 1024, multiple_of=8)] = (24, 48, 96, 160)
    global_blocks: Annotated[int, Bounds(0, 64)] = 2
    patch: Literal[1, 2, 4] = 1
    pretrained: str = ""

    @model_validator(mode="after")
    def _check(self) -> Self:
        if not 2 <= len(self.widths) <= 8 or self.widths[-1] % 32:
            raise Refused("two to eight multiples of 8, the last one of 32", "widths")
        return self


@dataclass(frozen=True)
class NetworkOutput:
    """What a network says of N images.

    Attributes:
        descriptors: float32 (N, D, h, w).
        orientation: float32 (N, 3, h, w), see `pliant.loaders.orientation`; (N, 0, h, w) of a
            network without it.
        foreground: float32 (N, 2, h, w), logits of the queried object and of all objects;
            (N, 0, h, w) of a network without them.
    """

    descriptors: torch.Tensor
    orientation: torch.Tensor
    foreground: torch.Tensor


class DescriptorNetwork(nn.Module):
    """A backbone and the learned scale of the distributional loss.

    Attributes:
        foreground: Whether the network predicts masks.

    Args:
        settings: Which network, and the weights to start from.
        seen: Its input.
        initial_scale: First value of the scale (inverse temperature), > 0.
        learn_scale: False keeps it there.
        orientation: Also output the orientation of the material at every pixel.
        foreground: Also put out where the queried object and where any object is.
        canonical: The head that maps descriptors to material coordinates, or None.

    Raises:
        CallError: The pretrained weights cannot be found or do not fit.
    """

    def __init__(
        self,
        settings: NetworkSettings,
        seen: NetworkInput,
        *,
        initial_scale: float = 1.0,
        learn_scale: bool = True,
        orientation: bool = False,
        foreground: bool = False,
        canonical: CanonicalHead | None = None,
    ) -> None:
        super().__init__()
        self.foreground = foreground
        self._heads = [ORIENTATION_CHANNELS * orientation, FOREGROUND_CHANNELS * foreground]
        channels_out = settings.descriptor_dim + sum(self._heads)
        self.canonical = canonical
        self.backbone: nn.Module
        if settings.name == "unet":
            shape = settings.widths, settings.global_blocks, settings.patch
            self.backbone = UNet(seen.channels, channels_out, *shape)
        else:
            self.backbone = ResNetFCN(settings.name, seen.channels, channels_out)
        log_scale = torch.log(torch.tensor(float(initial_scale)))
        self.log_scale = nn.Parameter(log_scale, requires_grad=learn_scale)
        if settings.pretrained:
            load_pretrained(self, settings.name, settings.pretrained, seen)

    def forward(self, image: torch.Tensor) -> torch.Tensor:
        """Map images (N, C, h, w) to descriptors (N, D, h, w), float32."""
        return self.described(image).descriptors

    def described(self, image: torch.Tensor) -> NetworkOutput:
        """Map images (N, C, h, w) to all that the network puts out."""
        out: torch.Tensor = self.backbone(image).float()
        dim = out.shape[1] - sum(self._heads)
        descriptors, orientation, foreground = out.split([dim, *self._heads], dim=1)
        return NetworkOutput(descriptors, orientation, foreground)

    @property
    def scale(self) -> torch.Tensor:
        """Inverse temperature of p = softmax(-scale * squared distance), a scalar."""
        return self.log_scale.exp()


def pixel_grid(height: int, width: int, step: int, device: torch.device) -> torch.Tensor:
    """Return the centres of cells of `step` x `step` pixels, row-major: float (h w, 2) as (u, v).

    Args:
        height: Rows of cells.
        width: Columns of cells.
        step: Side of a cell, px.
        device: Where to.
    """
    v, u = torch.meshgrid(
        torch.arange(height, device=device), torch.arange(width, device=device), indexing="ij"
    )
    return (torch.stack([u, v], dim=-1).reshape(-1, 2) + 0.5) * step


def sample_descriptors(descriptors: torch.Tensor, uv_px: torch.Tensor) -> torch.Tensor:
    """Return descriptors between pixels, bilinearly; pixel (0, 0) has its centre at (0.5, 0.5).

    Args:
        descriptors: float (N, D, h, w).
        uv_px: float (N, Q, 2), (u, v) in pixels of the map.

    Returns:
        float (N, Q, D).
    """
    size = uv_px.new_tensor([descriptors.shape[-1], descriptors.shape[-2]])
    grid = uv_px / size * 2 - 1  # align_corners=False puts -1 and 1 at the image's edges
    sampled = functional.grid_sample(
        descriptors, grid[:, None], mode="bilinear", padding_mode="border", align_corners=False
    )  # (N, D, 1, Q)
    return sampled[:, :, 0].transpose(1, 2)
