"""The evaluator as a wheel, made from the code that is running: what a platform scores with.

Packing the installed modules needs no build tool and no network, and makes sure that the
competition is scored by the very code of the `pliant` that published it.
"""

from __future__ import annotations

import base64
import hashlib
import re
from collections.abc import Iterator, Mapping
from importlib import metadata, resources
from importlib.resources.abc import Traversable
from typing import Final

from pliant.publishing.competition.archive import archive_bytes

PACKAGES: Final = ("spec", "evaluator")
LEFT_OUT: Final = frozenset({"conformance", "examples", "files", "__pycache__"})
"""Subfolders that scoring does not need. What is left is the same whether Pliant was installed
from its wheel or runs from a checkout."""

SUFFIXES: Final = (".py", ".json", ".arrow", ".j2", ".html", ".css", ".js")

LIBRARIES: Final = {
    "numpy": "numpy",
    "pyarrow": "pyarrow",
    "jsonschema": "jsonschema",
    "OpenEXR": "OpenEXR",
    "pillow": "PIL",
    "matplotlib": "matplotlib",
    "jinja2": "jinja2",
    "pydantic": "pydantic",
    "pyyaml": "yaml",
    "scipy": "scipy",
}
"""What scoring imports: name of the distribution -> name of the module."""


def wheel_name() -> str:
    """Return the wheel's file name."""
    return f"pliant-{metadata.version('pliant')}-py3-none-any.whl"


def build_wheel() -> bytes:
    """Return a wheel of `pliant.spec` and `pliant.evaluator`; equal code gives equal bytes."""
    version = metadata.version("pliant")
    info = f"pliant-{version}.dist-info"
    files = dict(_sources())
    needs = "".join(f"Requires-Dist: {line}\n" for line in requirement_ranges())
    files[f"{info}/METADATA"] = (
        f"Metadata-Version: 2.1\nName: pliant\nVersion: {version}\n"
        f"Summary: The specification and the evaluator of Pliant\nLicense: Apache-2.0\n"
        f"Requires-Python: >=3.11\n{needs}"
    ).encode()
    files[f"{info}/WHEEL"] = (
        b"Wheel-Version: 1.0\nGenerator: pliant\nRoot-Is-Purelib: true\nTag: py3-none-any\n"
    )
    files[f"{info}/RECORD"] = _record(files, f"{info}/RECORD")
    return archive_bytes(files)


def requirement_pins() -> str:
    """Return the libraries at the versions that run here, as pip's requirements."""
    return "".join(f"{name}=={metadata.version(name)}\n" for name in LIBRARIES)


def requirement_ranges() -> list[str]:
    """Return the ranges of versions that Pliant declares for the libraries."""
    declared = {}
    for line in metadata.requires("pliant") or ():
        name = re.split(r"[^A-Za-z0-9._-]", line, maxsplit=1)[0]
        if ";" not in line:  # what follows a semicolon belongs to an extra
            declared[name.lower()] = line
    return [declared[name.lower()] for name in LIBRARIES]


def _sources() -> Iterator[tuple[str, bytes]]:
    yield "pliant/__init__.py", resources.files("pliant").joinpath("__init__.py").read_bytes()
    for package in PACKAGES:
        yield from _walk(resources.files(f"pliant.{package}"), f"pliant/{package}")


def _walk(folder: Traversable, name: str) -> Iterator[tuple[str, bytes]]:
    for item in folder.iterdir():
        path = f"{name}/{item.name}"
        if item.is_dir():
            if item.name not in LEFT_OUT:
                yield from _walk(item, path)
        elif item.name.endswith(SUFFIXES):
            yield path, item.read_bytes()


def _record(files: Mapping[str, bytes], own_name: str) -> bytes:
    lines = []
    for name in sorted(files):
        digest = base64.urlsafe_b64encode(hashlib.sha256(files[name]).digest())
        lines.append(f"{name},sha256={digest.decode().rstrip('=')},{len(files[name])}")
    return "\n".join([*lines, f"{own_name},,", ""]).encode()
