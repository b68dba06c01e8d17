"""The house rules that no type checker holds: arrows, packages, light imports."""

from __future__ import annotations

import ast
import subprocess
import sys
import tomllib
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]
FOLDERS = (
    "spec", "generator", "loaders", "evaluator", "baselines", "models", "publishing", "converters",
    "viewer", "benchmarks", "cli",
)  # fmt: skip

# folder -> the folders it may import (DESIGN: arrows point one way).
ARROWS: dict[str, set[str]] = {
    "spec": set(),
    "generator": {"spec"},
    "loaders": {"spec"},
    "baselines": {"spec"},
    # The trainers validate with the evaluator's own metrics, so that a curve in a run and a
    # score in a report are one number; the evaluator knows nothing of them.
    "models": {"spec", "loaders", "baselines", "evaluator"},
    "evaluator": {"spec"},
    "converters": {"spec"},
    # A dataset card shows a contact sheet.
    "publishing": {"spec", "evaluator", "viewer"},
    "viewer": {"spec", "baselines", "converters", "evaluator", "models"},
    "benchmarks": set(FOLDERS) - {"cli"},
    "cli": {*FOLDERS, "api"},
}
FORBIDDEN = {
    "evaluator": {"torch", "bpy", "cv2", "pickle"},
    "spec": {"torch", "bpy", "cv2", "pickle"},
}


def modules(folder: str) -> list[Path]:
    # spec/examples are programs of their own: they import nothing of ours. So are the files that
    # lie in benchmarks/ itself.
    found = (ROOT / folder).rglob("*.py")
    own = {ROOT / "benchmarks"} if folder == "benchmarks" else set()
    return sorted(p for p in found if "examples" not in p.parts and p.parent not in own)


def imported(path: Path) -> set[str]:
    """Every dotted name a module imports, at its top or inside a function."""
    names: set[str] = set()
    for node in ast.walk(ast.parse(path.read_text())):
        if isinstance(node, ast.Import):
            names |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            if node.level:
                names.add("." * node.level)
            elif node.module == "pliant":
                names |= {f"pliant.{alias.name}" for alias in node.names}
            elif node.module:
                names.add(node.module)
    return names


@pytest.mark.parametrize("folder", FOLDERS)
def test_arrows_point_one_way(folder: str) -> None:
    assert modules(folder), f"{folder}/ holds no module"
    for path in modules(folder):
        for name in imported(path):
            assert not name.startswith("."), f"{path} imports relatively"
            if name.startswith("pliant."):
                target = name.split(".")[1]
                assert target == folder or target in ARROWS[folder], f"{path} imports {name}"


@pytest.mark.parametrize("folder", sorted(FORBIDDEN))
def test_light_folders_never_name_heavy_libraries(folder: str) -> None:
    for path in modules(folder):
        heavy = {name.split(".")[0] for name in imported(path)} & FORBIDDEN[folder]
        if path == ROOT / "spec" / "limits.py":
            heavy -= {"pickle"}  # between a process and its own child
        assert not heavy, f"{path} imports {heavy}"


def test_packages_list_is_complete() -> None:
    """A package that pyproject forgets works editable and is missing from the wheel."""
    settings = tomllib.loads((ROOT / "pyproject.toml").read_text())["tool"]["setuptools"]
    found = {"pliant"} | {
        "pliant." + ".".join(path.parent.relative_to(ROOT).parts)
        for folder in FOLDERS
        for path in (ROOT / folder).rglob("__init__.py")
    }
    assert found == set(settings["packages"])
    assert {
        name: "/".join(name.split(".")[1:]) or "pliant" for name in settings["packages"]
    } == settings["package-dir"]


def test_every_module_lies_in_a_package() -> None:
    for folder in FOLDERS:
        for path in modules(folder):
            if "conformance" not in path.parts:
                assert (path.parent / "__init__.py").exists(), path


def test_package_of_the_checkout_links_to_every_room() -> None:
    """`pliant/` is complete without an installation: this is what mypy and worktrees import."""
    for folder in FOLDERS:
        name = "benchmarks/suite" if folder == "benchmarks" else folder
        assert (ROOT / "pliant" / name).resolve() == ROOT / name


LIGHT = """
import sys
import {module}
heavy = {{"torch", "bpy", "cv2", "numba", "mahotas", "ray"}} & set(sys.modules)
sys.exit(f"importing {module} brought in {{heavy}}" if heavy else 0)
"""


@pytest.mark.parametrize(
    "module",
    ["pliant", "pliant.spec", "pliant.spec.dataset", "pliant.evaluator", "pliant.cli.main"],
)
def test_import_stays_light(module: str) -> None:
    done = subprocess.run(
        [sys.executable, "-c", LIGHT.format(module=module)], capture_output=True, text=True
    )
    assert done.returncode == 0, done.stderr


def test_help_imports_nothing_of_the_commands() -> None:
    """What keeps `pliant --help` well under half a second."""
    code = (
        "import sys; from pliant.cli.main import run; run(['--help']);"
        "bad = {'numpy', 'pyarrow', 'torch', 'matplotlib', 'rich'} & set(sys.modules);"
        "sys.exit(str(bad) if bad else 0)"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    assert "generate" in done.stdout


def test_every_command_exists_and_says_what_it_does() -> None:
    from pliant.cli.main import COMMANDS, cli

    for name in COMMANDS:
        command = cli.get_command(None, name)  # type: ignore[arg-type]
        assert command is not None
        assert command.help, f"pliant {name} has no help"
