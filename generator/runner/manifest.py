"""The run's own records in `DATASET/.pliant`: lock, config, failures, logs, unfinished work.

Nothing here is part of the dataset; deleting the folder of a finished set loses nothing.
"""

from __future__ import annotations

import json
import shutil
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import asdict, dataclass
from importlib.metadata import version
from pathlib import Path
from typing import Any, Final

from pliant.generator.config import GROWING_FIELDS, LABEL_FIELDS, GenerateConfig
from pliant.spec.errors import CallError
from pliant.spec.io.reading import sha256_file
from pliant.spec.io.writing import replacing
from pliant.spec.secrets import (
    SECRET_SEED_FILE,
    draw_secret_seed,
    read_secret_seed,
    write_secret_seed,
)
from pliant.spec.storage.layout import (
    DATASET_JSON,
    INDEX_TABLE,
    PRIVATE_DIR,
    QUERIES_DIR,
    TRUTH_DIR,
    sequence_name,
)
from pliant.spec.text import shortened

RUN_DIR: Final = ".pliant"


@dataclass(frozen=True)
class Failure:
    """A sequence that could not be made.

    Attributes:
        id: The sequence.
        attempts: How often it was tried in this run.
        error: Traceback or cause of the last attempt.
    """

    id: str
    attempts: int
    error: str


class RunFolder:
    """`DATASET/.pliant`: what a run must remember next to the dataset itself."""

    def __init__(self, root: Path) -> None:
        self.root = root
        self.path = root / RUN_DIR
        self.logs = self.path / "logs"
        self._config = self.path / "config.json"
        self._failures = self.path / "failures.json"

    def check(self) -> None:
        """Refuse a folder that contains anything but a dataset of ours; write nothing.

        Raises:
            CallError: The folder contains something else or a packed dataset, or is not a folder.
        """
        if self.root.exists() and not self.root.is_dir():
            raise CallError("the output is a file, not a folder", path=self.root)
        if (self.root / INDEX_TABLE).exists():
            raise CallError(
                "the output folder contains a packed dataset, which cannot grow",
                path=self.root,
                found=INDEX_TABLE,
                fix="Name the folder it was packed from, or a new one",
            )
        if self.root.is_dir() and self.stored_config() is None:
            ours = (RUN_DIR, PRIVATE_DIR)
            others = sorted(p.name for p in self.root.iterdir() if p.name not in ours)
            if others:
                raise CallError(
                    "the output folder contains something else",
                    path=self.root,
                    found=", ".join(others[:3]) + (" …" if len(others) > 3 else ""),
                    fix="Name a new or empty folder",
                )

    def open(self) -> None:
        """Make the folder, after `check`.

        Raises:
            CallError: As `check`, or the folder cannot be written.
        """
        try:
            self.check()
            self.logs.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise CallError(
                "the output folder cannot be written", path=self.root, found=error.strerror
            ) from error

    @contextmanager
    def locked(self) -> Iterator[None]:
        """Hold the folder for one process; the lock ends with the process, however it ends.

        Raises:
            CallError: Another process is generating into this folder.
        """
        from filelock import FileLock, Timeout

        try:
            with FileLock(self.path / "lock", timeout=0):
                yield
        except Timeout as error:
            raise CallError(
                "another process is generating into this folder",
                path=self.root,
                fix="Wait for it to end, or stop it",
            ) from error

    def secret_seed(self, *, begun: bool) -> int:
        """Return the dataset's secret seed, drawn and stored in its private file if it has none.

        Args:
            begun: Whether the folder contains a dataset made with a secret seed.

        Raises:
            CallError: Such a dataset has lost its file, or the file cannot be read or written.
        """
        seed = read_secret_seed(self.root)
        if seed is None:
            if begun:
                raise CallError(
                    "the secret seed of this dataset is missing",
                    path=self.root / SECRET_SEED_FILE,
                    fix="Put a copy of the file back; without it the dataset cannot be continued",
                )
            seed = draw_secret_seed()
            write_secret_seed(self.root, seed)
        return seed

    def is_finished(self, config: GenerateConfig) -> bool:
        """Return whether a run with just this config, and this Pliant, came to its end.

        Its tables must be as it wrote them.
        """
        stored = _read_object(self._config)
        if stored is None or stored.get("finished") is not True:
            return False
        return stored.get("given") == _given(config) and stored.get("tables") == self._tables()

    def stored_config(self) -> dict[str, Any] | None:
        """Return the resolved config the folder was started with, None where there is none.

        A finished set that was copied without `.pliant` still tells it in `dataset.json`.
        """
        stored = _read_object(self._config)
        if stored is None:
            stored = (_read_object(self.root / DATASET_JSON) or {}).get("provenance")
            stored = {"resolved": stored.get("config")} if isinstance(stored, dict) else None
        resolved = None if stored is None else stored.get("resolved")
        if not isinstance(resolved, dict) or not isinstance(resolved.get("splits"), dict):
            return None  # a dataset that was not generated
        return resolved

    def store_config(self, config: GenerateConfig, *, finished: bool) -> None:
        """Remember a config, and whether its run came to its end."""
        document = {"given": _given(config), "resolved": config.resolved(), "finished": finished}
        _write(self._config, {**document, "tables": self._tables()} if finished else document)

    def _tables(self) -> dict[str, str]:
        """Return the sha256 of each table of the dataset as a whole, by its name."""
        folders = (self.root, self.root / QUERIES_DIR, self.root / TRUTH_DIR)
        tables = [path for folder in folders for path in folder.glob("*.parquet")]
        return {path.relative_to(self.root).as_posix(): sha256_file(path) for path in tables}

    def store_failures(self, failures: list[Failure]) -> None:
        """Remember the sequences that failed, with their tracebacks; none removes the file."""
        if failures:
            _write(self._failures, [asdict(failure) for failure in failures])
        else:
            self._failures.unlink(missing_ok=True)

    def clear_partial(self) -> None:
        """Remove what killed workers left unfinished."""
        for path in self.root.glob(f"{sequence_name('*', '.*.partial')}"):
            shutil.rmtree(path, ignore_errors=True)


def refuse_changes(stored: Mapping[str, Any], wanted: Mapping[str, Any], root: Path) -> None:
    """Refuse a config that would not continue the set in a folder.

    Tiers and sequences may be added, and the labels may change; every other field decides
    the bytes of the sequences that are there.

    Args:
        stored: Resolved config of the folder.
        wanted: Resolved config of this call.
        root: The folder, for the message.

    Raises:
        CallError: Fields differ; the message names each with both values.
    """
    free = {*GROWING_FIELDS, *LABEL_FIELDS}
    free |= {kind for kind in ("rope", "cloth") if kind not in stored or kind not in wanted}
    differences = _differences(
        {key: value for key, value in stored.items() if key not in free},
        {key: value for key, value in wanted.items() if key not in free},
    )
    for split, count in stored.get("splits", {}).items():
        asked = wanted["splits"].get(split, 0)
        if asked < count:
            differences.append(f"splits.{split} ({count} there, {asked} in this call)")
    missing = [tier for tier in stored.get("tiers", []) if tier not in wanted["tiers"]]
    if missing:
        differences.append(f"tiers ({', '.join(missing)} there, not in this call)")
    if differences:
        raise CallError(
            "the folder contains a dataset generated with other settings",
            path=root,
            found="; ".join(differences),
            fix="Use the same settings (sequences and tiers may be added, not taken "
            "away), or name another folder",
        )


def _write(path: Path, document: Any) -> None:
    """Write a JSON file so that its name never stands for half of it, even after a power cut."""
    with replacing(path, durable=True) as partial:
        partial.write_text(json.dumps(document, indent=1, sort_keys=True) + "\n", encoding="utf-8")


def _given(config: GenerateConfig) -> dict[str, Any]:
    return {"pliant": version("pliant"), "config": json.loads(json.dumps(config.to_dict()))}


def _read_object(path: Path) -> dict[str, Any] | None:
    """Return a JSON file's object; None if there is no file, or no object in it."""
    try:
        values = json.loads(path.read_text(encoding="utf-8"))
    except FileNotFoundError:
        return None
    except (OSError, ValueError) as error:
        raise CallError("the file cannot be read", path=path, found=error) from error
    return values if isinstance(values, dict) else None


def _differences(stored: Mapping[str, Any], wanted: Mapping[str, Any], at: str = "") -> list[str]:
    lines: list[str] = []
    for key in sorted({*stored, *wanted}):
        old, new = stored.get(key), wanted.get(key)
        if isinstance(old, Mapping) and isinstance(new, Mapping):
            lines += _differences(old, new, f"{at}{key}.")
        elif old != new:
            there, here = (shortened(json.dumps(each), 60) for each in (old, new))
            lines.append(f"{at}{key} ({there} there, {here} in this call)")
    return lines
