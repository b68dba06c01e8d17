"""Where the matches of queries are, and what competes with them."""

from __future__ import annotations

from dataclasses import dataclass

import torch


@dataclass(frozen=True)
class Candidates:
    """M competing pixels (or bins) in each of N images.

    Attributes:
        descriptors: float (N, M, D).
        uv_px: float (N, M, 2), their centres in the network's pixels.
        on_object: bool (N, M), where the target distribution may have mass.
    """

    descriptors: torch.Tensor
    uv_px: torch.Tensor
    on_object: torch.Tensor


@dataclass(frozen=True)
class Targets:
    """The true positions of Q queries in each of N images.

    Attributes:
        uv_px: float (N, Q, R, 2), the match and its symmetry partners, R >= 1.
        valid: bool (N, Q, R), which of them exist and are visible.
    """

    uv_px: torch.Tensor
    valid: torch.Tensor


@dataclass(frozen=True)
class NonMatches:
    """K places per query that are not its match.

    Attributes:
        descriptors: float (N, Q, K, D).
        uv_px: float (N, Q, K, 2), where they are.
    """

    descriptors: torch.Tensor
    uv_px: torch.Tensor
