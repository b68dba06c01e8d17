"""Networks of optical flow: RAFT of torchvision, and SEA-RAFT and others of `ptlflow`."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Final

from pliant.baselines.adapters.dense import DenseMatcher
from pliant.baselines.modern.loading import images_for, library, state_dict
from pliant.spec.errors import CallError

_STRIDE: Final = 8


class Raft(DenseMatcher):
    """RAFT (Teed and Deng 2020) from the source straight to the target.

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
        facts = {"weights": weights, "small": small, "updates": updates}
        super().__init__(self._flow, "raft", images_for(device, size, _STRIDE), "flow", facts)

    def _flow(self, source: Any, target: Any) -> Any:
        import torch

        with torch.inference_mode():
            updates = self._model(2 * source - 1, 2 * target - 1, num_flow_updates=self._updates)
        return updates[-1]


class PtlFlow(DenseMatcher):
    """A network of `ptlflow`, such as SEA-RAFT (Wang, Lipson and Deng 2024), likewise.

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
        facts = {"model": model, "weights": weights, "version": package.__version__}
        super().__init__(self._flow, "flow", images_for(device, size, 1), "flow", facts)

    def _flow(self, source: Any, target: Any) -> Any:
        """Return the flow, (2, H, W); the package takes blue, green, red."""
        import torch

        images = torch.stack([source, target], dim=1).flip(2)  # (1, 2, 3, H, W)
        with torch.inference_mode():
            return self._model({"images": images})["flows"][0, 0]
