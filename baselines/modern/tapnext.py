"""The point tracker TAPNext (Zholus et al. 2025), by the package `tapnet`."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Final

import numpy as np
import numpy.typing as npt

from pliant.baselines.adapters.trackers import TrackerMatcher
from pliant.baselines.modern.loading import images_for, library, state_dict


class TapNext(TrackerMatcher):
    """TAPNext in PyTorch, one frame at a time. Its positions count from the image's corner.

    Args:
        weights: A PyTorch file such as `bootstapnext_ckpt.pt`, or its `.npz` of JAX.
        device: A torch device.
        size: Width and height, px, that frames are resized to: those of training.
        window: Most frames of a clip, >= 2; None gives all at once.
        batch: Most points of a call.
    """

    library: Final = "tapnet"

    def __init__(
        self,
        weights: str,
        device: str = "cpu",
        size: int = 256,
        window: int | None = None,
        batch: int | None = None,
    ) -> None:
        install = "pip install git+https://github.com/google-deepmind/tapnet"
        package = library("tapnet.tapnext.tapnext_torch", "tapnext", install)
        model = package.TAPNext(image_size=(size, size))
        if weights.endswith(".npz"):
            utils = library("tapnet.tapnext.tapnext_torch_utils", "tapnext", install)
            model = utils.restore_model_from_jax_checkpoint(model, weights)
        else:
            model.load_state_dict(_without_prefix(state_dict(weights, device)))
        self._model = model.to(device).eval()
        self._facts = {"weights": weights, "size": size}
        super().__init__(
            self._tracks, "tapnext", images_for(device, (size, size), 8), window, batch
        )

    def describe(self) -> Mapping[str, Any]:
        """Return the facts for the submission's footer."""
        return {**super().describe(), **self._facts}

    def _tracks(self, frames: Any, points: npt.NDArray[np.float32]) -> tuple[Any, Any]:
        import torch

        queries = np.concatenate([np.zeros_like(points[:, :1]), points[:, ::-1]], axis=1)
        asked = frames.new_tensor(queries)[None]  # (1, N, 3): t, y, x
        video = 2 * frames.permute(0, 2, 3, 1)[None] - 1  # (1, T, H, W, 3)
        tracks, seen, state = [], [], None
        with torch.inference_mode():
            for step in range(video.shape[1]):
                given = {"query_points": asked} if state is None else {"state": state}
                at, _, odds, state = self._model(video=video[:, step : step + 1], **given)
                tracks.append(at[0, 0].flip(-1))  # (N, 2), from (y, x)
                seen.append(odds[0, 0, :, 0].sigmoid())
        return torch.stack(tracks), torch.stack(seen)


def _without_prefix(values: Mapping[str, Any]) -> dict[str, Any]:
    """Return weights by the network's own names: Lightning puts `tapnext.` before them."""
    values = values.get("state_dict", values)
    return {name.removeprefix("tapnext."): value for name, value in values.items()}
