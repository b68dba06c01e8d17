"""The wheel that bundles carry, and the few lines that unpack it."""

from __future__ import annotations

import ast
import base64
import hashlib
import io
import subprocess
import sys
import zipfile
from pathlib import Path

import pytest

from pliant.publishing.competition import bootstrap
from pliant.publishing.competition.bundle import write_bundle
from pliant.publishing.competition.wheel import (
    LEFT_OUT,
    LIBRARIES,
    build_wheel,
    requirement_pins,
    requirement_ranges,
    wheel_name,
)
from pliant.spec.errors import SpecError

ROOT = Path(__file__).resolve().parents[3]


def test_wheel_holds_the_code_that_runs_here() -> None:
    with zipfile.ZipFile(io.BytesIO(build_wheel())) as archive:
        files = {name: archive.read(name) for name in archive.namelist()}
    for folder in ("spec", "evaluator"):
        for path in (ROOT / folder).rglob("*"):
            relative = path.relative_to(ROOT).as_posix()
            wanted = path.suffix in (".py", ".json", ".arrow", ".j2", ".css")
            if path.is_file() and wanted and not LEFT_OUT & set(path.parts):
                assert files[f"pliant/{relative}"] == path.read_bytes(), relative
    (record,) = [name for name in files if name.endswith("RECORD")]
    listed = dict(line.split(",")[:2] for line in files[record].decode().splitlines())
    assert set(listed) == set(files)
    for name, digest in listed.items():
        if name != record:
            sha256 = base64.urlsafe_b64encode(hashlib.sha256(files[name]).digest()).decode()
            assert digest == f"sha256={sha256.rstrip('=')}"


def test_pip_takes_the_wheel(tmp_path: Path) -> None:
    path = tmp_path / wheel_name()
    path.write_bytes(build_wheel())
    options = [
        "--no-index",
        "--no-deps",
        "--no-compile",
        "--quiet",
        "--target",
        str(tmp_path / "in"),
    ]
    command = [sys.executable, "-m", "pip", "install", "--disable-pip-version-check", *options]
    subprocess.run([*command, str(path)], check=True, capture_output=True)
    assert (tmp_path / "in" / "pliant" / "evaluator" / "protocols" / "standard.json").is_file()


def test_equal_halves_give_equal_bytes(halves: tuple[Path, Path], tmp_path: Path) -> None:
    first = write_bundle(*halves, tmp_path / "a")
    second = write_bundle(*halves, tmp_path / "b")
    assert [path.name for path in first] == [
        "codabench-test.zip",
        "evalai-test.zip",
        "README.md",
        "Dockerfile",
    ]
    for one, other in zip(first, second, strict=True):
        assert one.read_bytes() == other.read_bytes(), one.name
    assert sorted(p.name for p in (tmp_path / "a").iterdir()) == sorted(p.name for p in first)


def test_private_half_without_truth_is_refused(halves: tuple[Path, Path], tmp_path: Path) -> None:
    with pytest.raises(SpecError, match="the private half has no truth"):
        write_bundle(halves[0], halves[0], tmp_path / "out")


def test_requirements_name_what_scoring_imports() -> None:
    assert [line.split("==")[0] for line in requirement_pins().splitlines()] == list(LIBRARIES)
    assert all(">=" in line for line in requirement_ranges())
    assert tuple(LIBRARIES.values()) == bootstrap.MODULES


def test_bootstrap_can_be_read_by_an_old_python() -> None:
    """So that it can say that the Python is too old: Codabench's own image has 3.7."""
    source = (ROOT / "publishing" / "competition" / "bootstrap.py").read_text()
    ast.parse(source, feature_version=(3, 7))


def test_bootstrap_says_what_is_missing(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    with pytest.raises(SystemExit, match="needs one pliant wheel next to it; found 0"):
        bootstrap.load_pliant(tmp_path)
    (tmp_path / "pliant-1.whl").touch()
    (tmp_path / "requirements.txt").write_text("no-such-library @ file:///nowhere/at.whl\n")
    monkeypatch.setattr(bootstrap, "MODULES", ("numpy", "no_such_library"))
    with pytest.raises(SystemExit, match="The image lacks no_such_library and pip could not"):
        bootstrap.load_pliant(tmp_path)
    monkeypatch.setattr(sys, "version_info", (3, 9, 1))
    with pytest.raises(SystemExit, match=r"needs Python 3\.11 or newer; found 3\.9"):
        bootstrap.load_pliant(tmp_path)
