"""The dense warps of RoMa and RoMa v2 (Edstedt et al. 2024, 2025), by `romatch` and `romav2`."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any, Final

from PIL import Image

from pliant.baselines.adapters.dense import DenseMatcher
from pliant.baselines.adapters.images import Images
from pliant.baselines.modern.loading import library, state_dict
from pliant.spec.errors import CallError


class Roma(DenseMatcher):
    """RoMa's warp and certainty. It resizes images itself.

    Args:
        weights: The file `roma_outdoor.pth` or `roma_indoor.pth`; `default` takes the package's
            own, from the web.
        backbone: The file of DINOv2's weights; `default` takes them from the web.
        device: A torch device.
        indoor: Whether the weights are those for indoor scenes.
    """

    library: Final = "romatch"

    def __init__(
        self,
        weights: str,
        backbone: str = "default",
        device: str = "cpu",
        indoor: bool = False,
    ) -> None:
        package = library(self.library, "roma", "pip install romatch")
        import torch

        given = [
            None if each == "default" else state_dict(each, device) for each in (weights, backbone)
        ]
        make = package.roma_indoor if indoor else package.roma_outdoor
        precision = torch.float16 if device.startswith("cuda") else torch.float32
        self._model = make(device, weights=given[0], dinov2_weights=given[1], amp_dtype=precision)
        self._device = device
        facts = {"weights": weights, "backbone": backbone, "indoor": indoor}
        super().__init__(self._warp, "roma", Images(coordinates="normalised"), "warp", facts)

    def _warp(self, source: Any, target: Any) -> tuple[Any, Any]:
        """Return the target position of each source pixel, -1 to 1, and the certainty."""
        images = Image.fromarray(source), Image.fromarray(target)
        warp, certainty = self._model.match(*images, device=self._device)
        # (1, h, 2w, 4) where the model also gives the way back, in its right half.
        width = warp.shape[2] // (2 if self._model.symmetric else 1)
        return warp[0, :, :width, 2:], certainty[0, :, :width]


class RomaV2(DenseMatcher):
    """RoMa v2's warp and overlap. It resizes images itself, and runs on a GPU where there is one.

    Args:
        weights: The file `romav2.0.1.pt`; `default` takes the package's own, from the web. The code
            of DINOv3 comes from torch's hub either way.
        setting: `turbo`, `fast`, `base` or `precise`: the size, and whether it is refined twice.
    """

    library: Final = "romav2"

    def __init__(self, weights: str, setting: str = "base") -> None:
        package = library(self.library, "roma-v2", "pip install romav2")
        with _weights_of(None if weights == "default" else state_dict(weights, "cpu")):
            self._model = package.RoMaV2()
        try:
            self._model.apply_setting(setting)
        except TypeError as error:
            raise CallError(
                "there is no such setting", found=setting, required="turbo, fast, base or precise"
            ) from error
        facts = {"weights": weights, "setting": setting}
        super().__init__(self._warp, "roma-v2", Images(coordinates="normalised"), "warp", facts)

    def _warp(self, source: Any, target: Any) -> tuple[Any, Any]:
        """Return the target position of each source pixel, -1 to 1, and how surely it is there."""
        found = self._model.match(source, target)
        return found["warp_AB"][0], found["overlap_AB"][0]


@contextmanager
def _weights_of(values: dict[str, Any] | None) -> Iterator[None]:
    """Give a constructor weights that it asks torch's hub for; None leaves the hub alone."""
    import torch

    asked = torch.hub.load_state_dict_from_url
    if values is not None:
        torch.hub.load_state_dict_from_url = lambda *_, **__: values
    try:
        yield
    finally:
        torch.hub.load_state_dict_from_url = asked
