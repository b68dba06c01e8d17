"""Checkpoints: weights as safetensors, the optimiser's state next to them, swapped in whole.

`RUN/checkpoints/000500/` holds `weights.safetensors`, `average.safetensors` (the running
average that answers), `optimiser.safetensors` and `state.json`. Nothing is pickled. The
folder is written under another name and renamed, so a checkpoint is there or it is not.
"""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Final

import torch
from safetensors import SafetensorError
from safetensors.torch import load_file, save

from pliant.spec.errors import TrainingError
from pliant.spec.io.jsonfiles import read_json
from pliant.spec.io.staging import discard, staged
from pliant.spec.io.writing import write_file

CHECKPOINTS: Final = "checkpoints"
BEST: Final = "best.safetensors"
FINISH: Final = "Finish it: add --resume to the `pliant train` command that started it."
_STATE: Final = "state.json"

Weights = dict[str, torch.Tensor]


@dataclass
class TrainingState:
    """Where a run stands.

    Attributes:
        step: Steps done.
        weights: The network's state dictionary.
        average: The running average of it (buffers as they are).
        optimiser: The optimiser's state dictionary.
        data: `data_digest` of what it is trained on.
        best: Lowest validation criterion so far, px.
        history: Figures of every logged step, {"step": …, name: value}.
        settings: The settings it runs with, as plain values.
        processes: How many processes train together.
    """

    step: int
    weights: Weights
    average: Weights
    optimiser: dict[str, Any]
    data: str
    best: float = float("inf")
    history: list[dict[str, float]] = field(default_factory=list)
    settings: Mapping[str, Any] = field(default_factory=dict)
    processes: int = 1


def save_weights(path: Path, weights: Mapping[str, torch.Tensor]) -> None:
    """Write weights so that the file is there whole or not at all.

    Args:
        path: The `.safetensors` file.
        weights: Name -> tensor.
    """
    write_file(path, save({k: v.detach().cpu().contiguous() for k, v in weights.items()}))


def read_weights_file(path: Path) -> Weights:
    """Read a `.safetensors` file.

    Raises:
        TrainingError: Missing or damaged.
    """
    try:
        return load_file(path)
    except (OSError, SafetensorError) as error:
        raise TrainingError(
            "the weights cannot be read", path=path, found=str(error).splitlines()[0]
        ) from error


def load_weights(network: torch.nn.Module, path: Path) -> None:
    """Load a network's weights and make it answer.

    Args:
        network: The network.
        path: Its weights.

    Raises:
        TrainingError: The weights are missing, damaged or of another network.
    """
    put_weights(network, read_weights_file(path), path)


def put_weights(network: torch.nn.Module, weights: Weights, path: Path) -> None:
    """Give a network weights that were read from a file, and make it answer.

    Raises:
        TrainingError: They are of another network.
    """
    try:
        network.load_state_dict(weights)
    except RuntimeError as error:
        raise TrainingError(
            "the weights do not fit the network of the run",
            path=path,
            found=str(error).splitlines()[-1].strip()[:200],  # the first only names the class
        ) from error
    network.eval()


def best_weights(run: Path) -> Path:
    """Return the file of the weights that answer for a run.

    Raises:
        TrainingError: The run has no validated weights yet.
    """
    if not (run / BEST).is_file():
        raise TrainingError(
            "the run has no validated weights yet", path=run, required=BEST, fix=FINISH
        )
    return run / BEST


def load_best(network: torch.nn.Module, run: Path) -> None:
    """Give a network the weights that answer for a run.

    Args:
        network: Built by the run's config.
        run: The run's folder.

    Raises:
        TrainingError: The run has no validated weights yet, or they are damaged or do not fit.
    """
    load_weights(network, best_weights(run))


def save_checkpoint(run: Path, state: TrainingState) -> None:
    """Write a checkpoint and remove the ones before it.

    Args:
        run: The run's folder.
        state: Where it stands.
    """
    folder = run / CHECKPOINTS / f"{state.step:07d}"
    tensors, plain = _split(state.optimiser)
    document = {
        "step": state.step,
        "best": None if state.best == float("inf") else state.best,
        "history": state.history,
        "data": state.data,
        "settings": state.settings,
        "processes": state.processes,
        "optimiser": plain,
    }
    with staged(folder) as place:
        save_weights(place / "weights.safetensors", state.weights)
        save_weights(place / "average.safetensors", state.average)
        save_weights(place / "optimiser.safetensors", tensors)
        (place / _STATE).write_text(json.dumps(document, indent=1, sort_keys=True) + "\n")
    remove_others(folder)


def remove_others(folder: Path) -> None:
    """Remove the other checkpoints of a run, which a killed process left."""
    for other in folder.parent.iterdir():
        if other != folder:
            discard(other)


def latest_checkpoint(run: Path) -> Path | None:
    """Return the newest whole checkpoint of a run, or None."""
    folder = run / CHECKPOINTS
    whole = [p for p in folder.glob("*") if p.name.isdigit()] if folder.is_dir() else []
    return max(whole, default=None)


def checkpoint_to_resume(run: Path) -> Path:
    """Return the newest whole checkpoint of a run.

    Raises:
        TrainingError: There is none.
    """
    folder = latest_checkpoint(run)
    if folder is None:
        raise TrainingError(
            "the run has no checkpoint to resume", path=run, fix="Start it without --resume."
        )
    return folder


def read_checkpoint(folder: Path) -> TrainingState:
    """Read a checkpoint.

    Args:
        folder: From `latest_checkpoint`.

    Raises:
        TrainingError: A file of it is missing or damaged.
    """
    with _undamaged(folder):
        document = _document(folder)
        return TrainingState(
            step=document["step"],
            weights=read_weights_file(folder / "weights.safetensors"),
            average=read_weights_file(folder / "average.safetensors"),
            optimiser=_join(
                read_weights_file(folder / "optimiser.safetensors"), document["optimiser"]
            ),
            best=float("inf") if document["best"] is None else document["best"],
            history=document["history"],
            data=document["data"],
            settings=document.get("settings", {}),
            processes=document.get("processes", 1),
        )


def checkpoint_settings(folder: Path) -> dict[str, Any]:
    """Return the settings of a checkpoint without reading its tensors; empty if it has none.

    Args:
        folder: From `latest_checkpoint`.

    Raises:
        TrainingError: It is damaged.
    """
    with _undamaged(folder):
        return dict(_document(folder).get("settings", {}))


def _document(folder: Path) -> dict[str, Any]:
    document: dict[str, Any] = json.loads((folder / _STATE).read_text())
    return document


@contextmanager
def _undamaged(folder: Path) -> Iterator[None]:
    try:
        yield
    except (OSError, ValueError, KeyError, TypeError, AttributeError) as error:
        path = folder / _STATE
        raise TrainingError(
            "the checkpoint is damaged", path=path, found=repr(error), fix="Remove its folder."
        ) from error


def read_progress(run: Path) -> dict[str, Any]:
    """Return the newest checkpoint of a run without its tensors; empty before the first.

    Raises:
        SpecError: It is damaged.
    """
    folder = latest_checkpoint(run)
    return read_json(folder / _STATE) if folder else {}


def _split(optimiser: dict[str, Any]) -> tuple[Weights, dict[str, Any]]:
    """Part an optimiser's state dictionary into tensors and plain values."""
    tensors = {
        f"{number}.{name}": value
        for number, values in optimiser["state"].items()
        for name, value in values.items()
    }
    return tensors, {"param_groups": optimiser["param_groups"]}


def _join(tensors: Weights, plain: dict[str, Any]) -> dict[str, Any]:
    state: dict[int, Weights] = {}
    for key, tensor in tensors.items():
        number, _, name = key.partition(".")
        state.setdefault(int(number), {})[name] = tensor
    groups = [
        {
            name: tuple(value) if isinstance(value, list) and name == "betas" else value
            for name, value in group.items()
        }
        for group in plain["param_groups"]
    ]
    return {"state": state, "param_groups": groups}
