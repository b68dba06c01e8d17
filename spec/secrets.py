"""The secret seed of a generated dataset: 128 bits in a private file that is never published.

With the seed of a dataset, anybody can generate its answers again. A seed in a public file, or one
that can be guessed, therefore reveals the answers of a held-out split.
"""

from __future__ import annotations

import json
import os
import secrets
from collections.abc import Mapping
from pathlib import Path
from typing import Any, Final

from pliant.spec.errors import CallError
from pliant.spec.io.writing import cannot_write, replacing
from pliant.spec.storage.layout import DATASET_JSON, PRIVATE_DIR

SECRET_SEED_FILE: Final = f"{PRIVATE_DIR}/seed.json"
"""Where a dataset keeps its secret seed; its public files then say null, or 0."""

SECRET_BITS: Final = 128
"""Size of a secret seed."""

GUESSABLE_BELOW: Final = 2**64
"""A smaller seed can be found by trying: one CPU core tries 18,000 a second."""


def draw_secret_seed() -> int:
    """Return a seed of 128 bits from the operating system's random source.

    It is never below `GUESSABLE_BELOW`.
    """
    return GUESSABLE_BELOW + secrets.randbelow(2**SECRET_BITS - GUESSABLE_BELOW)


def read_secret_seed(root: Path) -> int | None:
    """Return the secret seed of a dataset, None where it has none.

    Args:
        root: The dataset's folder.

    Raises:
        CallError: The file cannot be read.
    """
    path = root / SECRET_SEED_FILE
    try:
        seed = int(json.loads(path.read_text(encoding="utf-8"))["seed"], 16)
    except FileNotFoundError:
        return None
    except (OSError, ValueError, KeyError, TypeError) as error:
        raise CallError(
            "the secret seed cannot be read",
            path=path,
            found=type(error).__name__,  # its text would quote the file
            required='{"seed": "HEX"}',
        ) from None
    if not 0 <= seed < 2**SECRET_BITS:
        raise CallError(
            "the secret seed has the wrong size",
            path=path,
            found=f"{seed.bit_length()} bits",
            required=f"at most {SECRET_BITS} bits, >= 0",
        )
    return seed


def write_secret_seed(root: Path, seed: int) -> None:
    """Write the secret seed of a dataset, readable by its owner alone.

    Args:
        root: The dataset's folder.
        seed: The seed, 0 to 2^128 - 1.

    Raises:
        CallError: The file cannot be written.
    """
    path = root / SECRET_SEED_FILE
    try:
        path.parent.mkdir(mode=0o700, parents=True, exist_ok=True)
    except OSError as error:
        raise cannot_write(path, error) from error
    with replacing(path, durable=True) as partial:
        descriptor = os.open(partial, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o600)
        with os.fdopen(descriptor, "w", encoding="utf-8") as stream:
            json.dump({"seed": f"{seed:032x}"}, stream)


def seed_weakness(info: Mapping[str, Any], root: Path) -> str | None:
    """Return why others can find the seed that a dataset was generated from, None if they cannot.

    Args:
        info: The content of `dataset.json`.
        root: The dataset's folder.

    Returns:
        A clause without the seed itself. None for a secret seed of 64 bits or more, and for a
        dataset that names no seed, such as an imported one.

    Raises:
        CallError: The file of the secret seed cannot be read.
    """
    if info["provenance"]["seed"] is not None:
        return f"the seed is stored in {DATASET_JSON}, which everybody who has the dataset can read"
    seed = read_secret_seed(root)
    if seed is not None and seed < GUESSABLE_BELOW:
        return f"the secret seed has {seed.bit_length()} bits; fewer than 64 can be found by trying"
    return None
