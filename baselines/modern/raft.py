"""Optical flow of RAFT (Teed and Deng 2020) in torchvision's implementation."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, Final

from pliant.baselines.adapters.dense import DenseMatcher
from pliant.baselines.modern.loading import images_for, library, state_dict

_STRIDE: Final = 8


class Raft(DenseMatcher):
    """RAFT from the source straight to the target.

    Args:
        weights: A file of torchvision's weights; `default` takes torchvision's own, from the web.
        device: A torch device.
        size: Width and height that images are resized to, at least 128 each; None keeps the
            images' size, rounded up to a multiple of 8.
        small: Whether it is the small network.
        updates: Iterations of the update.
    """

    library: Final = "torchvision"

    def __init__(
        self,
        weights: str,
        device: str = "cpu",
        size: Sequence[int] | None = None,
        small: bool = False,
        updates: int = 12,
    ) -> None:
        flow = library("torchvision.models.optical_flow", "raft", "pip install 'pliant[modern]'")
        make = flow.raft_small if small else flow.raft_large
        model = make(weights="DEFAULT" if weights == "default" else None)
        if weights != "default":
            model.load_state_dict(state_dict(weights, device))
        self._model, self._updates = model.to(device).eval(), updates
        self._facts = {"weights": weights, "small": small, "updates": updates}
        super().__init__(self._flow, "raft", images_for(device, size, _STRIDE), "flow")

    def describe(self) -> Mapping[str, Any]:
        """Return the facts for the submission's footer."""
        return {**super().describe(), **self._facts}

    def _flow(self, source: Any, target: Any) -> Any:
        import torch

        with torch.inference_mode():
            updates = self._model(2 * source - 1, 2 * target - 1, num_flow_updates=self._updates)
        return updates[-1]
