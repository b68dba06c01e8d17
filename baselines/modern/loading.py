"""Imports of optional libraries and weights from files, with clear errors."""

from __future__ import annotations

import importlib
from collections.abc import Sequence
from pathlib import Path
from typing import Any, Final

from pliant.baselines.adapters.images import Coordinates, Images
from pliant.spec.errors import CallError

_MEAN: Final = (0.485, 0.456, 0.406)
_STD: Final = (0.229, 0.224, 0.225)


def library(name: str, feature: str, install: str) -> Any:
    """Import an optional library.

    Args:
        name: The module.
        feature: Who needs it, for the message.
        install: The command that installs it.

    Raises:
        CallError: It cannot be imported.
    """
    try:
        return importlib.import_module(name)
    except (ImportError, RuntimeError) as error:  # torchvision of another torch: RuntimeError
        raise CallError(
            f"{feature} needs the library {name!r}",
            found=" ".join(str(error).split())[:200],
            fix=f"Install it with: {install}",
        ) from error


def state_dict(path: str | Path, device: str) -> dict[str, Any]:
    """Read a network's weights; nothing in the file is executed.

    Raises:
        CallError: The file is missing, or holds something else.
    """
    import torch

    if not Path(path).is_file():
        raise CallError("weights file not found", path=path)
    try:
        values = torch.load(path, map_location=device, weights_only=True)
    except Exception as error:  # pickle's and zipfile's errors share no base
        raise CallError(
            "the weights cannot be read", path=path, found=type(error).__name__
        ) from error
    values = values.get("model", values) if isinstance(values, dict) else values
    if not isinstance(values, dict):
        raise CallError("the file has no weights", path=path, found=type(values).__name__)
    return values


def pretrained(auto_class: Any, weights: str, **options: Any) -> Any:
    """Load a model, processor or a part of a pipeline from a folder or a hub id.

    Raises:
        CallError: The model is not found, or is of another kind.
    """
    try:
        return auto_class.from_pretrained(weights, **options)
    except (OSError, ValueError) as error:
        raise CallError(
            f"{auto_class.__name__} cannot load this",
            where=f"weights={weights}",
            found=" ".join(str(error).split())[:200],
            required="a folder, or an id on the Hugging Face Hub",
        ) from error


def normalised(image: Any) -> Any:
    """Return an image (1, 3, H, W), 0 to 1, as networks trained on ImageNet expect it.

    The channels' mean and standard deviation over ImageNet become 0 and 1.
    """
    mean, std = (image.new_tensor(each)[:, None, None] for each in (_MEAN, _STD))
    return (image - mean) / std


def images_for(
    device: str, size: Sequence[int] | None, multiple: int, coordinates: Coordinates = "pixel"
) -> Images:
    """Return how a network receives images.

    Args:
        device: A torch device.
        size: Width and height, px; None keeps those of the images.
        multiple: What the sides are rounded up to.
        coordinates: How the network counts positions; see `Images`.

    Raises:
        CallError: The size is not two positive numbers.
    """
    if size is not None and (len(size) != 2 or min(size) < 1):
        raise CallError("this is not a size", where="size", found=size, required="[width, height]")
    pair = None if size is None else (int(size[0]), int(size[1]))
    return Images(pair, multiple, device, coordinates)
