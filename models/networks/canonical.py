"""Canonical head: which material point a pixel shows, asked of its descriptor alone.

Every anchor, a point of the material, has a learned embedding e_k, a function of its material
coordinate m_k. A descriptor f is classified among the anchors (continuous surface embeddings,
Neverova et al. 2020; DensePose-CSE, arXiv 2011.12438):

    p(k | f) = softmax_k( -scale * ||f - e_k||^2 ),

and trained with cross-entropy against a Gaussian of the distance on the material,

    q(k) = mean over the symmetry orbit m of  softmax_k( -d(m, m_k)^2 / (2 sigma^2) ).

Every visible point supervises its own image, with no pair of images.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Final

import numpy as np
import torch
from torch import nn

from pliant.spec.arrays import RealArray
from pliant.spec.model import MaterialObject

_AT_ONCE: Final = 1024  # their probabilities over the anchors fit into the processor's cache

PREFIX: Final = "canonical."
"""How the names of the head's tensors begin in a network's state dictionary."""

_OCTAVES: Final = 6
_HIDDEN: Final = 64


class CanonicalHead(nn.Module):
    """Embeddings of material points, in the space of the descriptors.

    Args:
        dim: Channels D of a descriptor.
        anchors: Number of anchors A.
    """

    anchors: torch.Tensor
    scale_m: torch.Tensor
    period: torch.Tensor

    def __init__(self, dim: int, anchors: int) -> None:
        super().__init__()
        # Buffers: a run answers without the dataset that it was trained on.
        self.register_buffer("anchors", torch.zeros(anchors, 2))
        self.register_buffer("scale_m", torch.ones(2))
        self.register_buffer("period", torch.zeros(2))
        features = 2 * (1 + 2 * _OCTAVES) + 4
        self.layers = nn.Sequential(
            nn.Linear(features, _HIDDEN),
            nn.SiLU(),
            nn.Linear(_HIDDEN, _HIDDEN),
            nn.SiLU(),
            nn.Linear(_HIDDEN, dim),
        )

    @classmethod
    def of_object(cls, dim: int, described: MaterialObject, material: RealArray) -> CanonicalHead:
        """Return a head whose anchors are points of an object's surface.

        Args:
            dim: Channels D of a descriptor.
            described: The object.
            material: float (A, 2), material coordinates of its points.
        """
        head = cls(dim, len(material))
        coordinates = described.material
        head.anchors.copy_(torch.from_numpy(np.asarray(material, dtype=np.float32)))
        head.scale_m.copy_(torch.tensor([each.metres_per_unit for each in coordinates]))
        head.period.copy_(torch.tensor([each.period or 0.0 for each in coordinates]))
        return head

    def embeddings(self) -> torch.Tensor:
        """Return the anchors' embeddings, float (A, D)."""
        out: torch.Tensor = self.layers(self._features(self.anchors))
        return out

    def _features(self, material: torch.Tensor) -> torch.Tensor:
        """Return Fourier features: of an angle its cosine and sine, of a length six octaves."""
        columns = []
        for axis in range(2):
            x = material[:, axis : axis + 1]
            angular = bool(self.period[axis] > 0)
            t = x * 0 if angular else x
            columns += [2 * t - 1]
            for octave in range(_OCTAVES):
                columns += [(2**octave * math.pi * t).sin(), (2**octave * math.pi * t).cos()]
            turn = x * (2 * math.pi / self.period[axis]) if angular else x * 0
            columns += [turn.cos(), turn.sin()]
        return torch.cat(columns, dim=1)

    def log_probabilities(self, descriptors: torch.Tensor, scale: torch.Tensor) -> torch.Tensor:
        """Return log p over the anchors.

        Args:
            descriptors: float (N, D).
            scale: Scalar, inverse temperature.

        Returns:
            float (N, A).
        """
        squared = torch.cdist(descriptors, self.embeddings()).square()
        return (-scale * squared).log_softmax(dim=-1)

    def log_probabilities_in_parts(
        self, descriptors: torch.Tensor, scale: torch.Tensor
    ) -> Iterator[torch.Tensor]:
        """Yield `log_probabilities` of a few descriptors at a time, without gradients.

        Args:
            descriptors: float (N, D).
            scale: Scalar, inverse temperature.
        """
        for part in descriptors.split(_AT_ONCE):
            with torch.inference_mode():
                log_p = self.log_probabilities(part, scale)
            yield log_p

    def squared_distance_m2(self, material: torch.Tensor) -> torch.Tensor:
        """Return squared distances on the material to the anchors, m^2.

        Args:
            material: float (..., 2).

        Returns:
            float (..., A).
        """
        squared = material.new_zeros(())
        for axis, period in enumerate(self.period.tolist()):
            step = material[..., axis, None] - self.anchors[:, axis]  # (..., A)
            if period > 0:
                step -= period * (step / period).round()
            squared = squared + step.mul_(self.scale_m[axis]).square_()
        return squared

    def target(self, material: torch.Tensor, sigma_m: float) -> torch.Tensor:
        """Return q over the anchors (it has no gradient).

        Args:
            material: float (N, R, 2), the points and their symmetry partners.
            sigma_m: Width of the Gaussians, metres.

        Returns:
            float (N, A), rows sum to 1.
        """
        with torch.no_grad():
            exponent = self.squared_distance_m2(material) / (-2 * sigma_m**2)  # (N, R, A)
            return exponent.softmax(dim=-1).mean(dim=1)


def canonical_loss(
    head: CanonicalHead,
    descriptors: torch.Tensor,
    material: torch.Tensor,
    visible: torch.Tensor,
    *,
    scale: torch.Tensor,
    sigma_m: float,
) -> torch.Tensor:
    """Return the mean cross-entropy of the visible points.

    Args:
        head: The head.
        descriptors: float (N, Q, D), at the points.
        material: float (N, Q, R, 2), their material coordinates and those of their partners.
        visible: bool (N, Q).
        scale: Scalar, inverse temperature.
        sigma_m: Width of the target, metres.

    Returns:
        Scalar; 0 without a visible point.
    """
    log_p = head.log_probabilities(descriptors[visible], scale)
    q = head.target(material[visible], sigma_m)
    return -(q * log_p).sum() / visible.sum().clamp_min(1)
