"""Optional packages: whether they are installed, and the error that names what is missing."""

from __future__ import annotations

from collections.abc import Iterable
from importlib.util import find_spec

from pliant.spec.errors import MissingExtraError


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
