"""Dense features of DINOv2 and DINOv3 (Oquab et al. 2023; Siméoni et al. 2025)."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Final

import numpy as np

from pliant.baselines.adapters.descriptors import DescriptorMatcher
from pliant.baselines.modern.loading import images_for, library, normalised, pretrained
from pliant.spec.errors import CallError


class Dino(DescriptorMatcher):
    """Patch features of a vision transformer, nearest by cosine and refined below a patch.

    Args:
        weights: A folder, or an id on the Hugging Face Hub, such as `facebook/dinov2-base` or
            `facebook/dinov3-vits16-pretrain-lvd1689m`.
        device: A torch device.
        size: Width and height that images are resized to; larger ones give finer patches. None
            keeps the images' size, rounded up to whole patches.
        layer: Which hidden state: -1 is the last, with its normalisation.
    """

    library: Final = "transformers"

    def __init__(
        self,
        weights: str,
        device: str = "cpu",
        size: Sequence[int] | None = None,
        layer: int = -1,
    ) -> None:
        transformers = library(self.library, "dino", "pip install 'pliant[modern]'")
        self._model = pretrained(transformers.AutoModel, weights).to(device).eval()
        config = self._model.config
        if not isinstance(getattr(config, "patch_size", None), int):
            raise CallError(
                "this model has no patches",
                where=f"weights={weights}",
                found=type(self._model).__name__,
                required="a vision transformer, such as facebook/dinov2-base",
            )
        self._patch, self._layer = config.patch_size, layer
        facts = {
            "model": type(self._model).__name__,
            "version": transformers.__version__,
            "weights": weights,
            "layer": layer,
        }
        images = images_for(device, size, self._patch)
        super().__init__(self._features, "dino", images, facts=facts)

    def _features(self, image: Any) -> Any:
        """Return the patch features, (h, w, D), of an image (1, 3, H, W), 0 to 1."""
        import torch

        last = self._layer == -1
        with torch.inference_mode():
            found = self._model(pixel_values=normalised(image), output_hidden_states=not last)
        tokens = found.last_hidden_state if last else found.hidden_states[self._layer]
        rows, columns = (side // self._patch for side in image.shape[-2:])
        patches = tokens[0, -rows * columns :]  # class and register tokens come first
        return patches.reshape(rows, columns, -1).float().cpu().numpy().astype(np.float32)
