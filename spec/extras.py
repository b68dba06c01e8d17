"""Optional packages: whether they are installed, and the error that names what is missing."""

from __future__ import annotations

from collections.abc import Iterable
from importlib.util import find_spec
from typing import Final

from pliant.spec.errors import MissingExtraError

EXTRAS: Final[dict[str, tuple[str, ...]]] = {
    "generate": ("bpy", "numba", "psutil", "platformdirs"),
    "classical": ("cv2", "mahotas"),
    "train": ("torch", "safetensors", "tensorboard"),
    "explore": ("starlette", "uvicorn", "matplotlib"),
    "service": (
        *("fastapi", "python_multipart", "sqlalchemy", "alembic", "psycopg", "cryptography"),
    ),
    "cluster": ("ray",),
    "convert": ("rerun",),
    "publish": ("mlcroissant", "datasets", "huggingface_hub", "fsspec"),
}
"""Extra of Pliant -> the modules that it installs."""


def extra_of(module: str) -> str | None:
    """Return the extra that installs a module, or None for one of no extra.

    Args:
        module: Its name, such as `numba.core`.
    """
    top = module.partition(".")[0]
    return next((extra for extra, modules in EXTRAS.items() if top in modules), None)


def is_installed(package: str) -> bool:
    """Return whether a top-level package can be imported; it is not imported."""
    try:
        return find_spec(package) is not None
    except (ImportError, ValueError):
        return False


def require_packages(packages: Iterable[str], feature: str, extra: str) -> None:
    """Refuse a call early, before it writes anything, if an optional package is missing.

    Args:
        packages: Import names of top-level packages.
        feature: What needs them.
        extra: Extra of Pliant that installs them.

    Raises:
        MissingExtraError: One is missing; names the command that installs them.
    """
    if not all(map(is_installed, packages)):
        raise MissingExtraError(feature, extra)
