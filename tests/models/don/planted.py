"""Matchers around a backbone written by hand, whose descriptors are known."""

from __future__ import annotations

from torch import nn

from pliant.loaders.inputs import NetworkInput
from pliant.models.don.matcher import DonMatcher
from pliant.models.don.settings import AnswerSettings, DonSettings
from pliant.models.networks.descriptor_network import NetworkSettings, build_network


def planted(
    backbone: nn.Module, size: tuple[int, int], answer: AnswerSettings, *, scale: float = 20.0
) -> DonMatcher:
    """Return a matcher that asks `backbone` for descriptors, at a size (w, h)."""
    network = build_network(NetworkSettings(widths=(8, 32)), NetworkInput(), initial_scale=scale)
    network.backbone = backbone
    return DonMatcher(network, DonSettings(width=size[0], height=size[1], answer=answer))
