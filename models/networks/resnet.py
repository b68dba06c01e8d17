"""ResNet-18 and 34 as fully convolutional networks of stride 8, upsampled to the image.

The classification networks of He et al. (2016) with their last two strides turned into
dilations, so that the grid stays at an eighth of the image, a 1x1 head, and bilinear
upsampling: what Dense Object Nets (Florence et al. 2018) use. Parameter names are those of
torchvision, so that its pretrained files load.
"""

from __future__ import annotations

from typing import Final

import torch
from torch import nn
from torch.nn import functional

DEPTHS: Final = {"resnet18": (2, 2, 2, 2), "resnet34": (3, 4, 6, 3)}
"""Blocks in each of the four stages."""

_STAGES: Final = ((64, 1, 1), (128, 2, 1), (256, 1, 2), (512, 1, 4))
"""Width, stride and dilation of each stage: 4 (stem) x 2 = 8 in all."""


def _conv3(cin: int, cout: int, stride: int = 1, dilation: int = 1) -> nn.Conv2d:
    return nn.Conv2d(cin, cout, 3, stride, padding=dilation, dilation=dilation, bias=False)


class BasicBlock(nn.Module):
    """Two 3x3 convolutions and a shortcut."""

    def __init__(self, cin: int, width: int, stride: int, dilation: int) -> None:
        super().__init__()
        self.conv1 = _conv3(cin, width, stride, dilation)
        self.bn1 = nn.BatchNorm2d(width)
        self.conv2 = _conv3(width, width, 1, dilation)
        self.bn2 = nn.BatchNorm2d(width)
        self.downsample = _shortcut(cin, width, stride)

    def forward(self, x: torch.Tensor) -> torch.Tensor:
        """Map (N, C, h, w) to (N, width, h / stride, w / stride)."""
        y = functional.relu(self.bn1(self.conv1(x)))
        y = self.bn2(self.conv2(y))
        return functional.relu(y + (x if self.downsample is None else self.downsample(x)))


def _shortcut(cin: int, cout: int, stride: int) -> nn.Sequential | None:
    if cin == cout and stride == 1:
        return None
    return nn.Sequential(nn.Conv2d(cin, cout, 1, stride, bias=False), nn.BatchNorm2d(cout))


class ResNetFCN(nn.Module):
    """A dilated ResNet with a descriptor at every pixel.

    Args:
        name: A key of `DEPTHS`.
        channels_in: Channels of the input.
        descriptor_dim: Channels of the output.
    """

    layer1: nn.Sequential
    layer2: nn.Sequential
    layer3: nn.Sequential
    layer4: nn.Sequential

    def __init__(self, name: str, channels_in: int, descriptor_dim: int) -> None:
        super().__init__()
        self.conv1 = nn.Conv2d(channels_in, 64, 7, stride=2, padding=3, bias=False)
        self.bn1 = nn.BatchNorm2d(64)
        channels = 64
        for number, (count, (width, stride, dilation)) in enumerate(
            zip(DEPTHS[name], _STAGES, strict=True), start=1
        ):
            blocks: list[nn.Module] = []
            for index in range(count):
                # torchvision's replace_stride_with_dilation: the first block of a dilated
                # stage still has the dilation of the stage before.
                own = dilation if index or dilation == 1 else max(1, dilation // 2)
                blocks.append(BasicBlock(channels, width, stride if index == 0 else 1, own))
                channels = width
            setattr(self, f"layer{number}", nn.Sequential(*blocks))
        self.head = nn.Conv2d(channels, descriptor_dim, 1, bias=False)

    def forward(self, image: torch.Tensor) -> torch.Tensor:
        """Map images (N, C, h, w) to descriptors (N, D, h, w)."""
        x = functional.relu(self.bn1(self.conv1(image)))
        x = functional.max_pool2d(x, 3, stride=2, padding=1)
        for number in range(1, 5):
            x = getattr(self, f"layer{number}")(x)
        return functional.interpolate(
            self.head(x), size=image.shape[-2:], mode="bilinear", align_corners=False
        )
