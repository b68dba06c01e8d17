"""Matchers around a backbone written by hand, whose descriptors are known, and pairs for them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import torch
from torch import nn

from pliant.loaders.frame_store import FrameStore
from pliant.loaders.inputs import NetworkInput
from pliant.models.don.matcher import DonMatcher
from pliant.models.don.settings import AnswerSettings, DonSettings
from pliant.models.don.validation import ValidationPair, draw_validation_pairs
from pliant.models.networks.descriptor_network import DescriptorNetwork, NetworkSettings
from pliant.spec.dataset import Dataset
from tests.known import known

SIZE = (80, 60)


def planted(
    backbone: nn.Module, size: tuple[int, int], answer: AnswerSettings, *, scale: float = 20.0
) -> DonMatcher:
    """Return a matcher that asks `backbone` for descriptors, at a size (w, h)."""
    network = DescriptorNetwork(
        NetworkSettings(widths=(8, 32)), NetworkInput(), initial_scale=scale
    )
    network.backbone = backbone
    return DonMatcher(network, DonSettings(width=size[0], height=size[1], answer=answer))


class ColourIsPlace(nn.Module):
    """The sheet's red and green say where on it a pixel is: a perfect descriptor by hand."""

    def forward(self, image: torch.Tensor) -> torch.Tensor:
        return image[:, :2] * 4


def by_colour(settings: AnswerSettings | None = None, scale: float = 8.0) -> DonMatcher:
    return planted(ColourIsPlace(), SIZE, settings or AnswerSettings(), scale=scale)


def drawn(dataset: Dataset, pairs: int, queries: int, seed: int = 3) -> list[ValidationPair]:
    store = FrameStore(dataset, "sheet", "train", SIZE)
    return draw_validation_pairs(store, pairs, queries, seed)


def within(pair: ValidationPair) -> ValidationPair:
    """The pair without the points on the sheet's rim, whose colours are mixed with the table's."""
    keep = np.ones(len(pair.uv_a_px), bool)
    for view, uv in ((pair.source, pair.uv_a_px), (pair.target, pair.uv_b_px[:, 0])):
        for shift in ((-2, 0), (2, 0), (0, -2), (0, 2)):
            column, row = np.floor(uv + shift).astype(int).T
            keep &= known(view.mask)[row, column]
    return replace(
        pair, uv_a_px=pair.uv_a_px[keep], uv_b_px=pair.uv_b_px[keep], visible=pair.visible[keep]
    )
