"""Starting from the weights of another run, or of a file."""

from __future__ import annotations

import logging
from collections.abc import Mapping
from pathlib import Path
from typing import Final

import torch
from torch import nn

from pliant.loaders.inputs import IMAGE_CHANNELS, NetworkInput
from pliant.models.training.checkpoint import BEST
from pliant.spec.errors import CallError
from pliant.spec.io.yamlfiles import read_yaml

logger = logging.getLogger(__name__)

_BACKBONE: Final = "backbone."
_FIRST_LAYERS: Final = ("encoder.0.conv1.weight", "encoder.0.skip.weight", "conv1.weight")
_HEAD: Final = "head.weight"


def load_pretrained(network: nn.Module, name: str, source: str, seen: NetworkInput) -> None:
    """Load what fits of some weights into a network.

    A tensor fits if its name (with or without `backbone.`) and shape agree. Two layers also fit
    networks of another kind: the first one takes the filters of each channel that both networks
    see, and the head those of the outputs that both have.

    Args:
        network: The network, changed in place.
        name: Its `NetworkSettings.name`, for messages.
        source: As `NetworkSettings.pretrained` describes.
        seen: The network's input.

    Raises:
        CallError: The weights are missing or unreadable, or none fits (the scale of the
            distributional loss does not count).
    """
    weights = read_weights(source)
    folder = Path(source) if Path(source).is_dir() else Path(source).parent
    given_input = _input_of_run(folder)
    own = network.state_dict()
    fitting = {}
    for key, tensor in own.items():
        short = key.removeprefix(_BACKBONE)
        given = next((weights[n] for n in (key, short, _BACKBONE + key) if n in weights), None)
        if given is None:
            continue
        if short in _FIRST_LAYERS:
            given = _first_layer(given.float(), tensor, given_input, seen)
        elif short == _HEAD and given.shape[1:] == tensor.shape[1:]:
            rows = min(len(given), len(tensor))
            given = torch.cat([given[:rows].to(tensor.dtype), tensor[rows:]])
        if given is not None and given.shape == tensor.shape:
            fitting[key] = given
    network.load_state_dict(fitting, strict=False)
    logger.info("%d of %d tensors from %s", len(fitting), len(own), source)
    if not fitting.keys() - {"log_scale"}:
        raise CallError(
            "none of the pretrained weights fits this network",
            where="network.pretrained",
            found=source,
            required=f"weights of {name} with the same settings of `network`",
            fix="Copy `network` of the config.yaml that the weights were trained with.",
        )


def _input_of_run(folder: Path) -> NetworkInput:
    """Return the input of the run in a folder, or colour where the folder has no run's config."""
    config = folder / "config.yaml"
    values = (read_yaml(config) if config.is_file() else None) or {}
    samples = values.get("pairs") or values.get("clips") or {}
    return NetworkInput(samples.get("input", "rgb"), samples.get("masks", False))


def _first_layer(
    given: torch.Tensor, own: torch.Tensor, given_input: NetworkInput, own_input: NetworkInput
) -> torch.Tensor | None:
    """Return a first layer's filters for another input, or None if they do not fit.

    A channel that both inputs have keeps its filters. Grey takes the sum of the colour filters,
    since it stands for three equal colours, and depth their mean where only colour is given; a
    colour takes a third of the grey filters. Any other channel starts at 0.
    """
    if given.dim() != 4 or given.shape[0] != own.shape[0] or given.shape[2:] != own.shape[2:]:
        return None
    copies = own.shape[1] // own_input.channels  # pixels of a patch, each with its own filter
    if given.shape[1] != given_input.channels * copies:
        return None
    filters = given.view(len(given), given_input.channels, copies, *given.shape[2:])
    by_name = dict(zip(given_input.names, filters.unbind(dim=1), strict=True))
    if "red" in by_name:
        colours = torch.stack([by_name[name] for name in IMAGE_CHANNELS["rgb"]])
        by_name.setdefault("grey", colours.sum(dim=0))
        by_name.setdefault("depth", colours.mean(dim=0))
    elif "grey" in by_name:
        by_name |= dict.fromkeys(IMAGE_CHANNELS["rgb"], by_name["grey"] / 3)
    empty = torch.zeros_like(filters[:, 0])
    return torch.stack([by_name.get(n, empty) for n in own_input.names], dim=1).view_as(own)


def read_weights(source: str) -> Mapping[str, torch.Tensor]:
    """Return the state dictionary of a run or a file.

    Args:
        source: As `NetworkSettings.pretrained` describes. Files are read without pickle:
            `.pt` and `.pth` through torch's weights-only reader.

    Raises:
        CallError: The source is missing or unreadable.
    """
    path = Path(source) / BEST if Path(source).is_dir() else Path(source)
    if not path.is_file():
        raise _unreadable(path, "no such file")
    try:
        if path.suffix == ".safetensors":
            from safetensors.torch import load_file

            return load_file(path)
        loaded = torch.load(path, map_location="cpu", weights_only=True)
    except Exception as error:  # each reader has errors of its own; none of them is ours
        raise _unreadable(path, "a file that contains no weights") from error
    state = loaded.get("state_dict", loaded) if isinstance(loaded, dict) else None
    if not isinstance(state, dict):
        raise _unreadable(path, type(state or loaded).__name__)
    return {name.removeprefix("module."): value for name, value in state.items()}


def _unreadable(path: Path, found: str) -> CallError:
    return CallError(
        "the pretrained weights cannot be read",
        path=path,
        where="network.pretrained",
        found=found,
        required="a run's folder, or a .safetensors, .pt or .pth file",
    )
