"""A run's folder: create it, check it before a run resumes, read and write its facts."""

from __future__ import annotations

import hashlib
import json
import platform
import shutil
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any, Final

from filelock import FileLock, Timeout

from pliant.models.training.checkpoint import (
    BEST,
    checkpoint_settings,
    checkpoint_to_resume,
    latest_checkpoint,
)
from pliant.models.training.processes import Processes
from pliant.models.training.settings import Chosen, RunSettings
from pliant.spec.configuration import (
    SettingsError,
    read_settings,
    settings_from,
    settings_to_dict,
)
from pliant.spec.dataset import Dataset
from pliant.spec.errors import CallError, TrainingError
from pliant.spec.io.writing import write_file
from pliant.spec.io.yamlfiles import yaml_text

CONFIG: Final = "config.yaml"
RUN_FACTS: Final = "run.json"
CALIBRATION: Final = "calibration.json"
BALL: Final = "ball.safetensors"
TENSORBOARD: Final = "tensorboard"
LOCK: Final = ".lock"

RESUMABLE: Final = ("threads", "workers", "cache", "cache_dir", "checkpoint_every")
"""Settings that may differ when a run resumes, because they change no training step."""


def with_tier(tier: str, dataset: Dataset) -> str:
    """Return the tier to train on.

    Args:
        tier: As the settings name it; may be empty.
        dataset: The dataset.

    Raises:
        CallError: No tier is named and the dataset has several.
    """
    names = list(dataset.tiers)
    if tier or len(names) == 1:
        return tier or names[0]
    raise CallError(
        "name the tier to train on",
        where="tier",
        required="one of " + ", ".join(names),
        fix=f"Add --set tier={names[0]}",
    )


@contextmanager
def open_run(run: Path, settings: RunSettings, resume: bool, answering: str) -> Iterator[None]:
    """Keep a run's folder for this process: a new one, or one that was begun.

    A run that was interrupted before its first checkpoint begins again.

    Args:
        run: The folder.
        settings: The run's settings.
        resume: Whether the run goes on.
        answering: The setting that says how the result answers; it may differ then.

    Raises:
        CallError: A new run's folder is not empty, or another process trains in it.
        TrainingError: There is nothing to resume, or a setting differs.
    """
    if resume:
        _check_resumable(run, settings, answering)
    elif run.exists() and (not run.is_dir() or any(run.iterdir())) and not _is_only_begun(run):
        raise CallError(
            "the folder of a new run must be empty",
            path=run,
            fix="Use another folder, or continue the run with --resume.",
        )
    run.mkdir(parents=True, exist_ok=True)
    try:
        with FileLock(run / LOCK, timeout=0):
            if not resume:
                (run / BEST).unlink(missing_ok=True)
                shutil.rmtree(run / TENSORBOARD, ignore_errors=True)
            write_settings(run, settings)
            yield
    except Timeout as error:
        raise CallError(
            "another process is training in this folder",
            path=run,
            fix="Wait for it to end, or stop it.",
        ) from error


def begun_settings(run: Path, method: type[Chosen]) -> Chosen:
    """Return the settings that a run which is to be resumed began with.

    Those of its checkpoint, because its config may have been edited since.

    Args:
        run: The run's folder.
        method: The class of its settings.

    Raises:
        TrainingError: It has no checkpoint or a damaged one, or its config is of another method.
    """
    folder = checkpoint_to_resume(run)
    try:
        begun = read_settings(method, run / CONFIG)
        values = checkpoint_settings(folder)
        return settings_from(method, values, path=folder) if values else begun
    except SettingsError as error:
        raise TrainingError(
            "the run is of another method, or its config was edited",
            path=run,
            found=str(error).splitlines()[0],
            fix="Resume it with the `pliant train` command that started it.",
        ) from error


def _check_resumable(run: Path, settings: RunSettings, answering: str) -> None:
    check_same_settings(
        run,
        settings_to_dict(begun_settings(run, type(settings))),
        settings_to_dict(settings),
        ignored=(*RESUMABLE, answering),
        fix=f"Leave --config and --set out and {CONFIG} as it was, or start another run.",
    )


def check_same_settings(
    run: Path,
    begun: Mapping[str, Any],
    now: Mapping[str, Any],
    *,
    ignored: Sequence[str] = RESUMABLE,
    fix: str,
) -> None:
    """Refuse other settings than a run began with.

    Args:
        run: The run's folder.
        begun: Its settings, as plain values.
        now: Those that it is to have.
        ignored: Settings that may differ, with all inside them.
        fix: What to do about a difference.

    Raises:
        TrainingError: A setting differs.
    """
    for name, value in now.items():
        if name in ignored or begun[name] == value:
            continue
        inner = isinstance(value, Mapping) and next(k for k in value if value[k] != begun[name][k])
        raise TrainingError(
            "a run resumes only with the settings that it was started with",
            path=run / CONFIG,
            where=f"{name}.{inner}" if inner else name,
            found=value[inner] if inner else value,
            required=begun[name][inner] if inner else begun[name],
            fix=fix,
        )


def data_digest(datasets: Sequence[Dataset]) -> str:
    """Return a checksum that differs between datasets with other sequences."""
    return hashlib.sha256(b"".join(each.fingerprint() for each in datasets)).hexdigest()


def _is_only_begun(run: Path) -> bool:
    """Return whether a folder is a run's that was interrupted before its first checkpoint.

    Of a finished run the checkpoint may have been removed.
    """
    is_run = (run / LOCK).is_file() and not (run / RUN_FACTS).is_file()
    return is_run and latest_checkpoint(run) is None


def write_settings(run: Path, settings: RunSettings) -> None:
    """Write a run's config."""
    write_file(run / CONFIG, yaml_text(settings_to_dict(settings)))


def run_facts(
    dataset: Dataset, settings: RunSettings, steps: int, processes: Processes
) -> dict[str, Any]:
    """Return what `run.json` says of every run.

    Args:
        dataset: What it was trained on.
        settings: Its settings.
        steps: Steps done.
        processes: The processes that trained together.
    """
    return {
        "dataset": {"id": dataset.id, "version": dataset.version},
        "tier": settings.tier,
        "split": settings.split,
        "steps": steps,
        "seed": settings.seed,
        "processes": processes.world,
        "device": processes.device_name,
        "python": platform.python_version(),
    }


def write_json(path: Path, document: Mapping[str, Any]) -> None:
    """Write one of a run's JSON files."""
    write_file(path, json.dumps(document, indent=1, sort_keys=True) + "\n")


def read_run_json(path: Path) -> dict[str, Any]:
    """Read one of a run's JSON files; one that is not there is empty.

    Raises:
        TrainingError: The file is damaged.
    """
    if not path.is_file():
        return {}
    try:
        document = json.loads(path.read_text())
    except (OSError, ValueError) as error:
        raise TrainingError("the file cannot be read", path=path, found=str(error)) from error
    if not isinstance(document, dict):
        raise TrainingError("the file contains no JSON object", path=path)
    return document
