"""Makes Pliant importable from the wheel next to this file.

It is copied into the programs that platforms run, where nothing of ours is installed: it uses
the standard library alone, and says in one line what is missing. A pure wheel is a zip archive
of its modules, so unpacking it is installing it; no pip takes part.
"""

from __future__ import annotations

import atexit
import importlib.util
import shutil
import subprocess
import sys
import tempfile
import zipfile
from pathlib import Path

MODULES = (
    "numpy", "pyarrow", "jsonschema", "OpenEXR", "PIL", "matplotlib", "jinja2", "pydantic", "yaml",
    "scipy",
)  # fmt: skip


def load_pliant(folder: Path) -> None:
    """Put the wheel of a folder in front of everything that is installed.

    Args:
        folder: Holds one `pliant-*.whl` and `requirements.txt`.

    Raises:
        SystemExit: This Python is too old, there is no wheel, or a library is missing and
            cannot be installed; the message is one line.
    """
    if sys.version_info < (3, 11):  # noqa: UP036 - a platform's Python may be any
        version = ".".join(str(part) for part in sys.version_info[:2])
        raise SystemExit(f"Scoring needs Python 3.11 or newer; found {version}.")
    wheels = sorted(folder.glob("pliant-*.whl"))
    if len(wheels) != 1:
        raise SystemExit(f"The program needs one pliant wheel next to it; found {len(wheels)}.")
    missing = [name for name in MODULES if importlib.util.find_spec(name) is None]
    if missing:
        _install(folder / "requirements.txt", missing)
    target = tempfile.mkdtemp(prefix="pliant-")
    atexit.register(shutil.rmtree, target, ignore_errors=True)
    with zipfile.ZipFile(wheels[0]) as archive:
        archive.extractall(target)
    sys.path.insert(0, target)


def _install(requirements: Path, missing: list[str]) -> None:
    """Install the libraries that the image lacks, at their pinned versions."""
    command = [sys.executable, "-m", "pip", "install", "--quiet", "--disable-pip-version-check"]
    done = subprocess.run(
        [*command, "--requirement", str(requirements)], capture_output=True, text=True, check=False
    )
    if done.returncode:
        lines = done.stderr.strip().splitlines() or ["pip is not there"]
        raise SystemExit(
            f"The image lacks {', '.join(missing)} and pip could not install them: {lines[-1]}"
        )
    importlib.invalidate_caches()
