"""Networks by name: an image in, a descriptor at every pixel out."""

from __future__ import annotations

from collections.abc import Callable
from typing import Annotated, Final, Literal

import torch
from torch import nn
from torch.nn import functional

from pliant.models.networks.resnet import DEPTHS, ResNetFCN
from pliant.models.networks.unet import UNet
from pliant.spec.configuration import configuration
from pliant.spec.constraints import Bounds, Count, Natural, OneOf, Refused
from pliant.spec.errors import CallError

ORIENTATION_CHANNELS: Final = 3
"""Direction (u, v) and sine, as `pliant.loaders.orientation` has them."""


@configuration(frozen=True)
class NetworkSettings:
    """Which network, and what it puts out.

    Attributes:
        name: `unet`, `resnet18`, `resnet34` or `resnet50`.
        descriptor_dim: Channels D of a descriptor, >= 1.
        normalise: True for descriptors of unit length.
        widths: U-Net: channels of each level, finest first.
        global_blocks: U-Net: attention blocks at the coarsest level.
        patch: U-Net: pixels a side that share one position of the finest level.
        pretrained: Weights to start from: a `.safetensors` file (or a `.pt`/`.pth` state
            dictionary), `hub:REPO:NAME` for torch.hub, `timm:NAME` for timm; empty for none.
    """

    name: Annotated[str, OneOf(("unet", *DEPTHS))] = "unet"
    descriptor_dim: Count = 16
    normalise: bool = False
    widths: Annotated[tuple[int, ...], Bounds(8, multiple_of=8)] = (24, 48, 96, 160)
    global_blocks: Natural = 2
    patch: Literal[1, 2, 4] = 1
    pretrained: str = ""

    def __post_init__(self) -> None:
        if len(self.widths) < 2 or self.widths[-1] % 32:
            raise Refused("at least two multiples of 8, the last one of 32", "widths")


def _unet(settings: NetworkSettings, channels_in: int, channels_out: int) -> nn.Module:
    return UNet(
        channels_in,
        channels_out,
        settings.widths,
        settings.global_blocks,
        settings.patch,
    )


def _resnet(settings: NetworkSettings, channels_in: int, channels_out: int) -> nn.Module:
    return ResNetFCN(settings.name, channels_in, channels_out)


NETWORKS: Final[dict[str, Callable[[NetworkSettings, int, int], nn.Module]]] = {
    "unet": _unet,
    **dict.fromkeys(DEPTHS, _resnet),
}
"""Name -> what builds it from settings, channels in and channels out."""


class DescriptorNetwork(nn.Module):
    """A backbone, optional normalisation, and the learned scale of the distributional loss.

    Args:
        settings: Which network.
        channels_in: Channels of the input.
        initial_scale: First value of the scale (inverse temperature), > 0.
        learn_scale: False keeps it there.
        orientation: Also put out how the material lies at every pixel, see `described`.
    """

    def __init__(
        self,
        settings: NetworkSettings,
        channels_in: int,
        *,
        initial_scale: float = 1.0,
        learn_scale: bool = True,
        orientation: bool = False,
    ) -> None:
        super().__init__()
        self.normalise = settings.normalise
        self.descriptor_dim = settings.descriptor_dim
        channels_out = settings.descriptor_dim + (ORIENTATION_CHANNELS if orientation else 0)
        self.backbone = NETWORKS[settings.name](settings, channels_in, channels_out)
        log_scale = torch.log(torch.tensor(float(initial_scale)))
        self.log_scale = nn.Parameter(log_scale, requires_grad=learn_scale)

    def forward(self, image: torch.Tensor) -> torch.Tensor:
        """Map images (N, C, h, w) to descriptors (N, D, h, w), float32."""
        return self.described(image)[0]

    def described(self, image: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor]:
        """Map images (N, C, h, w) to descriptors (N, D, h, w) and orientation (N, 3, h, w).

        The latter is what `pliant.loaders.orientation` describes; a network built without it has
        no such channels: (N, 0, h, w).
        """
        out: torch.Tensor = self.backbone(image).float()
        descriptors, orientation = out[:, : self.descriptor_dim], out[:, self.descriptor_dim :]
        if self.normalise:
            descriptors = functional.normalize(descriptors, dim=1)
        return descriptors, orientation

    @property
    def scale(self) -> torch.Tensor:
        """Inverse temperature of p = softmax(-scale * squared distance), a scalar."""
        return self.log_scale.exp()


def build_network(
    settings: NetworkSettings,
    channels_in: int,
    *,
    initial_scale: float = 1.0,
    learn_scale: bool = True,
    orientation: bool = False,
) -> DescriptorNetwork:
    """Return a network with its starting weights.

    Args:
        settings: Which network, and where its weights start.
        channels_in: Channels of the input.
        initial_scale: First value of the scale (inverse temperature).
        learn_scale: False keeps it there.
        orientation: Also put out how the material lies at every pixel.

    Raises:
        CallError: The pretrained weights cannot be found or do not fit.
    """
    network = DescriptorNetwork(
        settings,
        channels_in,
        initial_scale=initial_scale,
        learn_scale=learn_scale,
        orientation=orientation,
    )
    if settings.pretrained:
        from pliant.models.networks.pretrained import load_pretrained

        loaded = load_pretrained(network.backbone, settings.pretrained, network.log_scale)
        if loaded == 0:
            raise CallError(
                "none of the pretrained weights fits this network",
                where="network.pretrained",
                found=settings.pretrained,
                required=f"weights of {settings.name}",
            )
    return network


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
