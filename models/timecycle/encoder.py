"""Encoders: an image in, a unit descriptor for every cell of 8x8 pixels out."""

from __future__ import annotations

from typing import Final

import torch
from torch import nn
from torch.nn import functional

from pliant.models.networks.pretrained import load_pretrained
from pliant.models.networks.resnet import ResNetFCN
from pliant.models.timecycle.settings import EncoderSettings

STRIDE: Final = 8
"""Pixels of a frame along a side of a cell."""

_GROUP: Final = 8


class SmallResNet(nn.Module):
    """A ResNet of three stages for CPUs, normalised in groups.

    Group normalisation does not mix the frames of a batch and is the same in training and
    afterwards. Borders are replicated: zeros there would tell a cell where in the frame it is,
    and a network that knows the place need not look at what is there.

    Args:
        widths: Channels of the three stages.
        dim: Channels of the output.
    """

    def __init__(self, widths: tuple[int, ...], dim: int) -> None:
        super().__init__()
        first, second, third = widths
        self.stem = nn.Sequential(_conv(3, first, 5, stride=2), _norm(first), nn.ReLU())
        self.layer1 = _Block(first, first, stride=2)
        self.layer2 = _Block(first, second, stride=2)
        self.layer3 = nn.Sequential(_Block(second, third, dilation=2), _Block(third, third))
        self.head = nn.Conv2d(third, dim, 1)

    def forward(self, image: torch.Tensor) -> torch.Tensor:
        """Map images (N, 3, H, W) to (N, D, H / 8, W / 8)."""
        head: torch.Tensor = self.head(self.layer3(self.layer2(self.layer1(self.stem(image)))))
        return head


class ResNetEncoder(nn.Module):
    """The first three stages of a ResNet, the third at stride 1, and a 1x1 projection.

    Args:
        name: `resnet18`, `resnet34` or `resnet50`.
        dim: Channels of the output.
    """

    def __init__(self, name: str, dim: int) -> None:
        super().__init__()
        self.backbone = ResNetFCN(name, 3, dim)
        del self.backbone.layer4
        channels = 1024 if name == "resnet50" else 256
        self.backbone.head = nn.Conv2d(channels, dim, 1, bias=False)

    def forward(self, image: torch.Tensor) -> torch.Tensor:
        """Map images (N, 3, H, W) to (N, D, H / 8, W / 8)."""
        net = self.backbone
        x = functional.relu(net.bn1(net.conv1(image)))
        x = functional.max_pool2d(x, 3, stride=2, padding=1)
        head: torch.Tensor = net.head(net.layer3(net.layer2(net.layer1(x))))
        return head


class _Block(nn.Module):
    """Two 3x3 convolutions with a shortcut."""

    def __init__(self, cin: int, cout: int, stride: int = 1, dilation: int = 1) -> None:
        super().__init__()
        self.conv1 = _conv(cin, cout, 3, stride=stride)
        self.norm1 = _norm(cout)
        self.conv2 = _conv(cout, cout, 3, dilation=dilation)
        self.norm2 = _norm(cout)
        self.shortcut = (
            nn.Identity() if cin == cout and stride == 1 else _conv(cin, cout, 1, stride=stride)
        )

    def forward(self, x: torch.Tensor) -> torch.Tensor:
        y = self.norm2(self.conv2(functional.relu(self.norm1(self.conv1(x)))))
        return functional.relu(y + self.shortcut(x))


def _conv(cin: int, cout: int, size: int, stride: int = 1, dilation: int = 1) -> nn.Conv2d:
    return nn.Conv2d(
        cin,
        cout,
        size,
        stride,
        padding=dilation * (size // 2),
        dilation=dilation,
        padding_mode="replicate" if size > 1 else "zeros",
        bias=False,
    )


def _norm(channels: int) -> nn.GroupNorm:
    return nn.GroupNorm(channels // _GROUP, channels)


def build_encoder(settings: EncoderSettings) -> nn.Module:
    """Return an encoder with its first weights.

    Args:
        settings: Which one.

    Raises:
        CallError: The pretrained weights cannot be read.
    """
    if settings.name == "small":
        return SmallResNet(settings.widths, settings.dim)
    encoder = ResNetEncoder(settings.name, settings.dim)
    if settings.pretrained:
        load_pretrained(encoder.backbone, settings.pretrained)
    return encoder
