"""The point trackers of the package `tapnet`: TAPIR, BootsTAPIR and TAPNext."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Final

import numpy as np
import numpy.typing as npt

from pliant.baselines.adapters.trackers import TrackerMatcher
from pliant.baselines.modern.loading import images_for, library, state_dict

_INSTALL: Final = "pip install git+https://github.com/google-deepmind/tapnet"


class Tapir(TrackerMatcher):
    """TAPIR and BootsTAPIR (Doersch et al. 2023, 2024) in PyTorch.

    A point's visibility is that it is neither hidden nor uncertain.

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
        package = library("tapnet.torch.tapir_model", "tapir", _INSTALL)
        model = package.TAPIR(pyramid_level=pyramid_level)
        model.load_state_dict(state_dict(weights, device))
        self._model = model.to(device).eval()
        facts = {"weights": weights, "pyramid_level": pyramid_level}
        images = images_for(device, (size, size), 8)
        super().__init__(self._tracks, "tapir", images, window, batch, facts)

    def _tracks(self, frames: Any, points: npt.NDArray[np.float32]) -> tuple[Any, Any]:
        import torch

        with torch.inference_mode():
            found = self._model(*_inputs(frames, points))
        hidden, far = found["occlusion"].sigmoid(), found["expected_dist"].sigmoid()
        visible = ((1 - hidden) * (1 - far))[0].T  # (T, N)
        return found["tracks"][0].transpose(0, 1), visible


class TapNext(TrackerMatcher):
    """TAPNext (Zholus et al. 2025) in PyTorch, one frame at a time.

    Its positions count from the image's corner.

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
        package = library("tapnet.tapnext.tapnext_torch", "tapnext", _INSTALL)
        model = package.TAPNext(image_size=(size, size))
        if weights.endswith(".npz"):
            utils = library("tapnet.tapnext.tapnext_torch_utils", "tapnext", _INSTALL)
            model = utils.restore_model_from_jax_checkpoint(model, weights)
        else:
            model.load_state_dict(_without_prefix(state_dict(weights, device)))
        self._model = model.to(device).eval()
        facts = {"weights": weights, "size": size}
        images = images_for(device, (size, size), 8)
        super().__init__(self._tracks, "tapnext", images, window, batch, facts)

    def _tracks(self, frames: Any, points: npt.NDArray[np.float32]) -> tuple[Any, Any]:
        import torch

        video, queries = _inputs(frames, points)
        tracks, seen, state = [], [], None
        with torch.inference_mode():
            for step in range(video.shape[1]):
                given = {"query_points": queries} if state is None else {"state": state}
                at, _, odds, state = self._model(video=video[:, step : step + 1], **given)
                tracks.append(at[0, 0].flip(-1))  # (N, 2), from (y, x)
                seen.append(odds[0, 0, :, 0].sigmoid())
        return torch.stack(tracks), torch.stack(seen)


def _inputs(frames: Any, points: npt.NDArray[np.float32]) -> tuple[Any, Any]:
    """Return a clip, (1, T, H, W, 3), -1 to 1, and its queries, (1, N, 3): t, y, x."""
    queries = np.concatenate([np.zeros_like(points[:, :1]), points[:, ::-1]], axis=1)
    return 2 * frames.permute(0, 2, 3, 1)[None] - 1, frames.new_tensor(queries)[None]


def _without_prefix(values: Mapping[str, Any]) -> dict[str, Any]:
    """Return weights by the network's own names: Lightning puts `tapnext.` before them."""
    values = values.get("state_dict", values)
    return {name.removeprefix("tapnext."): value for name, value in values.items()}
