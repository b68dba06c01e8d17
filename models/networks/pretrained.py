"""Starting from somebody else's weights: a file, torch.hub or timm."""

from __future__ import annotations

import importlib
import logging
from collections.abc import Mapping
from pathlib import Path

import torch
from torch import nn

from pliant.spec.errors import CallError

logger = logging.getLogger(__name__)


def load_pretrained(backbone: nn.Module, source: str, log_scale: nn.Parameter | None = None) -> int:
    """Load what fits of some weights into a network.

    A tensor fits if name and shape agree. The first convolution of an RGB network also fits
    one with depth: the extra channel gets the mean of the colour filters.

    Args:
        backbone: The network, changed in place.
        source: As `NetworkSettings.pretrained` describes. Weights of a run of Dense Object Nets
            (`RUN/best.safetensors`) are such weights too.
        log_scale: The logarithm of the inverse temperature, changed in place where the weights
            hold one: a run goes on with the scale that another has learned.

    Returns:
        How many tensors of the backbone were loaded.

    Raises:
        CallError: The source is missing or unreadable.
    """
    weights = read_weights(source)
    own = backbone.state_dict()
    fitting = {}
    for name, tensor in own.items():
        given = weights.get(name, weights.get(f"backbone.{name}"))
        if given is None:
            continue
        if given.shape == tensor.shape:
            fitting[name] = given
        elif given.dim() == 4 and given.shape[1] == 3 and _same_but_inputs(given, tensor):
            grey = given.mean(dim=1, keepdim=True)
            fitting[name] = torch.cat([given, grey], dim=1) if tensor.shape[1] == 4 else grey
    backbone.load_state_dict(fitting, strict=False)
    learned = weights.get("log_scale")
    if log_scale is not None and learned is not None and learned.shape == log_scale.shape:
        with torch.no_grad():
            log_scale.copy_(learned)
    logger.info("%d of %d tensors from %s", len(fitting), len(own), source)
    return len(fitting)


def _same_but_inputs(given: torch.Tensor, own: torch.Tensor) -> bool:
    return (
        given.shape[0] == own.shape[0]
        and given.shape[2:] == own.shape[2:]
        and own.shape[1] in (1, 4)
    )


def read_weights(source: str) -> Mapping[str, torch.Tensor]:
    """Return a state dictionary from a file, torch.hub or timm.

    Args:
        source: As `NetworkSettings.pretrained` describes. Files are read without pickle:
            `.pt` and `.pth` through torch's weights-only reader.

    Raises:
        CallError: The source is missing or unreadable, or timm is not installed.
    """
    if source.startswith("timm:"):
        return _timm(source.removeprefix("timm:"))
    try:
        if source.startswith("hub:"):
            repository, _, name = source.removeprefix("hub:").rpartition(":")
            model: nn.Module = torch.hub.load(repository, name, pretrained=True)
            return model.state_dict()
        path = Path(source)
        if path.suffix == ".safetensors":
            from safetensors.torch import load_file

            return load_file(path)
        loaded = torch.load(path, map_location="cpu", weights_only=True)
    except Exception as error:  # each reader has errors of its own; none of them is ours
        raise _unreadable(source, f"{type(error).__name__}: {error}") from error
    if not isinstance(loaded, dict):
        raise _unreadable(source, type(loaded).__name__)
    state = loaded.get("state_dict", loaded)
    return {name.removeprefix("module."): value for name, value in state.items()}


def _timm(name: str) -> Mapping[str, torch.Tensor]:
    try:
        timm = importlib.import_module("timm")
    except ImportError as error:
        raise CallError(
            "timm is not installed", where=f"timm:{name}", fix="Install it with: pip install timm"
        ) from error
    model: nn.Module = timm.create_model(name, pretrained=True)
    return model.state_dict()


def _unreadable(source: str, found: str) -> CallError:
    return CallError(
        "the pretrained weights cannot be read",
        where=source,
        found=found.splitlines()[0][:200] if found else "nothing",
        required="a .safetensors, .pt or .pth file, hub:REPO:NAME or timm:NAME",
    )
