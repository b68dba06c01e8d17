"""Optical flow of SEA-RAFT (Wang, Lipson and Deng 2024) and others, by the package `ptlflow`."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, Final

from pliant.baselines.adapters.dense import DenseMatcher
from pliant.baselines.modern.loading import images_for, library
from pliant.spec.errors import CallError


class PtlFlow(DenseMatcher):
    """A flow network of `ptlflow`, from the source straight to the target.

    Args:
        weights: A checkpoint of the package, or the name of one that it downloads, such as
            `things`.
        model: The network, such as `sea_raft_s`, `sea_raft_m`, `raft`, `flowformer` or `gmflow`.
        device: A torch device.
        size: Width and height that images are resized to; None keeps them.
    """

    library: Final = "ptlflow"

    def __init__(
        self,
        weights: str,
        model: str = "sea_raft_m",
        device: str = "cpu",
        size: Sequence[int] | None = None,
    ) -> None:
        package = library(self.library, "flow", "pip install ptlflow")
        try:
            network = package.get_model(model, ckpt_path=weights)
        except (ValueError, OSError) as error:
            raise CallError(
                "ptlflow cannot load this",
                where=f"model={model}, weights={weights}",
                found=" ".join(str(error).split())[:200],
            ) from error
        self._model = network.to(device).eval()
        self._facts = {"model": model, "weights": weights, "version": package.__version__}
        super().__init__(self._flow, "flow", images_for(device, size, 1), "flow")

    def describe(self) -> Mapping[str, Any]:
        """Return the facts for the submission's footer."""
        return {**super().describe(), **self._facts}

    def _flow(self, source: Any, target: Any) -> Any:
        """Return the flow, (2, H, W); the package takes blue, green, red."""
        import torch

        images = torch.stack([source, target], dim=1).flip(2)  # (1, 2, 3, H, W)
        with torch.inference_mode():
            return self._model({"images": images})["flows"][0, 0]
