from __future__ import annotations

import hashlib
from collections.abc import Callable
from pathlib import Path
from types import ModuleType

import pytest


@pytest.fixture(scope="session")
def digests() -> Callable[[Path], dict[str, str]]:
    """A function: file -> sha256 of a dataset, the run's own records left out."""

    def of(root: Path) -> dict[str, str]:
        return {
            path.relative_to(root).as_posix(): hashlib.sha256(path.read_bytes()).hexdigest()
            for path in sorted(root.rglob("*"))
            if path.is_file() and ".pliant" not in path.parts
        }

    return of


@pytest.fixture(scope="session")
def uninterrupted(
    standin: ModuleType, digests: Callable[[Path], dict[str, str]], tmp_path_factory
) -> dict[str, str]:
    """Digests of the small stand-in set made at once by one worker."""
    from pliant.generator.runner.run import generate

    out = tmp_path_factory.mktemp("uninterrupted") / "set"
    config = standin.small_config()
    generate(config, out, engine=standin.InProcess(), open_maker=standin.maker(config, out))
    return digests(out)
