"""The point trackers TAPIR and BootsTAPIR (Doersch et al. 2023, 2024), by the package `tapnet`."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Final

import numpy as np
import numpy.typing as npt

from pliant.baselines.adapters.trackers import TrackerMatcher
from pliant.baselines.modern.loading import images_for, library, state_dict


class Tapir(TrackerMatcher):
    """TAPIR in PyTorch. A point's visibility is that it is neither hidden nor uncertain.

    Args:
        weights: A file such as `bootstapir_checkpoint_v2.pt`.
        device: A torch device.
        size: Width and height, px, that frames are resized to: the package's refinement takes
            square frames. Rounded up to a multiple of 8.
        pyramid_level: Of the network: 1 for BootsTAPIR, 0 for TAPIR.
        window: Most frames of a clip, >= 2; None gives all at once.
        batch: Most points of a call.
    """

    library: Final = "tapnet"

    def __init__(
        self,
        weights: str,
        device: str = "cpu",
        size: int = 256,
        pyramid_level: int = 1,
        window: int | None = None,
        batch: int | None = None,
    ) -> None:
        install = "pip install git+https://github.com/google-deepmind/tapnet"
        package = library("tapnet.torch.tapir_model", "tapir", install)
        model = package.TAPIR(pyramid_level=pyramid_level)
        model.load_state_dict(state_dict(weights, device))
        self._model = model.to(device).eval()
        self._facts = {"weights": weights, "pyramid_level": pyramid_level}
        super().__init__(self._tracks, "tapir", images_for(device, (size, size), 8), window, batch)

    def describe(self) -> Mapping[str, Any]:
        """Return the facts for the submission's footer."""
        return {**super().describe(), **self._facts}

    def _tracks(self, frames: Any, points: npt.NDArray[np.float32]) -> tuple[Any, Any]:
        import torch

        queries = np.concatenate(
            [np.zeros_like(points[:, :1]), points[:, ::-1]], axis=1
        )  # (t, y, x)
        video = 2 * frames.permute(0, 2, 3, 1)[None] - 1  # (1, T, H, W, 3)
        with torch.inference_mode():
            found = self._model(video, frames.new_tensor(queries)[None])
        hidden, far = found["occlusion"].sigmoid(), found["expected_dist"].sigmoid()
        visible = ((1 - hidden) * (1 - far))[0].T  # (T, N)
        return found["tracks"][0].transpose(0, 1), visible
