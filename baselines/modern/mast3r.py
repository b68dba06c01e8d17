"""Matches of MASt3R (Leroy, Cabon and Revaud 2024), by the package `mast3r`."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Final

import numpy as np

from pliant.baselines.adapters.interpolation import Interpolation
from pliant.baselines.adapters.sparse import SparseMatcher
from pliant.baselines.modern.loading import images_for, library, pretrained
from pliant.spec.answers import Matches
from pliant.spec.frame import Frame

_PATCH: Final = 16
_INSTALL: Final = (
    "git clone --recursive https://github.com/naver/mast3r, its requirements, and its folder in "
    "PYTHONPATH"
)


class Mast3r(SparseMatcher):
    """Reciprocal nearest neighbours of MASt3R's descriptors, interpolated to the queries.

    Args:
        weights: A file, or an id on the Hugging Face Hub, such as
            `naver/MASt3R_ViTLarge_BaseDecoder_512_catmlpdpt_metric`.
        device: A torch device.
        size: Width and height, px, that images are resized to, rounded up to multiples of 16. The
            published network was trained on 512x384 and flatter.
        step: Distance, px, of the pixels that matches start from.
        interpolation: How queries follow from the matches: `nearest`, `affine` or `thin-plate`.
    """

    library: Final = "mast3r"

    def __init__(
        self,
        weights: str,
        device: str = "cpu",
        size: Sequence[int] = (512, 384),
        step: int = 8,
        interpolation: Interpolation = "affine",
    ) -> None:
        network = library("mast3r.model", "mast3r", _INSTALL).AsymmetricMASt3R
        self._nearest = library("mast3r.fast_nn", "mast3r", _INSTALL).fast_reciprocal_NNs
        self._model = pretrained(network, weights).to(device).eval()
        self._device, self._step = device, step
        self._images = images_for(device, size, _PATCH, "index")
        facts = {"implementation": "mast3r", "weights": weights, "size": list(size), "step": step}
        super().__init__(self._matches, "mast3r", interpolation, facts=facts)

    def _matches(self, source: Frame, target: Frame) -> Matches:
        import torch

        given = [self._given(view, number) for number, view in enumerate((source, target))]
        with torch.inference_mode():
            described = [each["desc"][0] for each in self._model(*given)]
        found = self._nearest(
            *described,
            subsample_or_initxy1=self._step,
            device=self._device,
            dist="dot",
            block_size=2**13,
        )
        uv_a, uv_b = (
            self._images.from_function(np.asarray(at), view).astype(np.float32)
            for at, view in zip(found, (source, target), strict=True)
        )
        return Matches(uv_a, uv_b, np.ones(len(uv_a), np.float32))

    def _given(self, view: Frame, number: int) -> dict[str, Any]:
        """Return an image as the network takes it, -1 to 1, with its shape and a name."""
        image = 2 * self._images.image(view) - 1
        shape = image.new_tensor(image.shape[-2:]).int()[None]
        return {"img": image, "true_shape": shape, "idx": number, "instance": str(number)}
