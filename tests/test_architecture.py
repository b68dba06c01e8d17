"""The house rules that no type checker holds: arrows, packages, light imports."""

from __future__ import annotations

import graphlib
import re
import runpy
import subprocess
import sys
from pathlib import Path

import pytest

from pliant.cli.main import COMMANDS, module_of

ROOT = Path(__file__).resolve().parents[1]
FOLDERS = (
    "spec", "generator", "loaders", "evaluator", "baselines", "models", "publishing", "converters",
    "service", "viewer", "benchmarks", "cli",
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
    "publishing": {"spec", "evaluator"},
    "service": {"spec", "evaluator", "publishing"},
    "viewer": {"spec", "baselines", "evaluator", "models"},
    "benchmarks": set(FOLDERS) - {"cli"},
    "cli": {*FOLDERS, "api"},
}
FORBIDDEN = {
    "evaluator": {"torch", "bpy", "cv2", "pickle"},
    "spec": {"torch", "bpy", "cv2", "pickle"},
}


picture_of_rooms = runpy.run_path(str(ROOT / "docs" / "architecture_picture.py"))
modules, imported = picture_of_rooms["modules"], picture_of_rooms["imported"]


@pytest.mark.parametrize("folder", FOLDERS)
def test_arrows_point_one_way(folder: str) -> None:
    assert modules(folder), f"{folder}/ holds no module"
    for path in modules(folder):
        for name in imported(path):
            assert not name.startswith("."), f"{path} imports relatively"
            if name.startswith("pliant."):
                target = name.split(".")[1]
                assert target == folder or target in ARROWS[folder], f"{path} imports {name}"


# Inside the evaluator a module imports from its own layer and from those before it.
LAYERS = (
    {"statistics", "submission"}, {"metrics"}, {"protocols"},
    {"controls", "truth_hints", "examples", "scores"}, {"scoring"}, {"evaluate"},
    {"comparison"}, {"report"},
)  # fmt: skip


def test_no_import_in_the_evaluator_points_up() -> None:
    layer = {name: number for number, names in enumerate(LAYERS) for name in names}
    paths = {path: path.relative_to(ROOT / "evaluator").parts[0] for path in modules("evaluator")}
    own = {path: part.removesuffix(".py") for path, part in paths.items()}
    assert set(own.values()) == {*layer, "__init__"}
    for path, part in own.items():
        for name in imported(path) if part != "__init__" else ():
            if name.startswith("pliant.evaluator."):
                assert layer[name.split(".")[2]] <= layer[part], f"{path} imports {name}"


@pytest.mark.parametrize("folder", sorted(FORBIDDEN))
def test_light_folders_never_name_heavy_libraries(folder: str) -> None:
    for path in modules(folder):
        heavy = {name.split(".")[0] for name in imported(path)} & FORBIDDEN[folder]
        if path == ROOT / "spec" / "limits.py":
            heavy -= {"pickle"}  # between a process and its own child
        assert not heavy, f"{path} imports {heavy}"


def test_every_module_is_in_a_package() -> None:
    """A folder without `__init__.py` works in a checkout and is missing from the wheel."""
    for folder in FOLDERS:
        for path in modules(folder):
            if "conformance" not in path.parts:
                assert (path.parent / "__init__.py").exists(), path


def test_picture_of_the_rooms_is_current() -> None:
    current = picture_of_rooms["PICTURE"].read_text()
    assert current == picture_of_rooms["picture"](), "run docs/architecture_picture.py"


def test_no_module_imports_itself_through_others() -> None:
    """No import cycle, counting imports inside functions and those for type checking too."""
    names = {
        "pliant." + ".".join(path.relative_to(ROOT).with_suffix("").parts): path
        for folder in FOLDERS
        for path in modules(folder)
    }
    names = {name.removesuffix(".__init__"): path for name, path in names.items()}
    graph: dict[str, set[str]] = {name: set() for name in names}
    for name, path in names.items():
        for target in imported(path, members=True):
            while target and target not in names:
                target = target.rpartition(".")[0]
            graph[name] |= {target} - {name, ""}
    try:
        graphlib.TopologicalSorter(graph).prepare()
    except graphlib.CycleError as error:
        pytest.fail(" -> ".join(error.args[1]))


def test_architecture_page_names_files_that_exist() -> None:
    text = (ROOT / "docs" / "architecture.md").read_text()
    named = re.findall(r"`([\w/]+/(?:[\w.]+\.py)?)`", text)
    assert len(named) > 40
    assert [name for name in named if not (ROOT / name).exists()] == []


_HEAVY = {"torch", "bpy", "cv2", "numba", "mahotas", "ray"}
_OF_COMMANDS = set(map(module_of, COMMANDS))
LIGHT: dict[str, set[str]] = {
    "import pliant; dir(pliant)": {"numpy", "pyarrow", "pydantic", "yaml", *_HEAVY},
    # Every call starts with this module.
    "from pliant.cli.main import run; run(['--help'])": {
        *("numpy", "pyarrow", "rich", "matplotlib"), *_HEAVY, *_OF_COMMANDS,
    },
    "import pliant.spec.dataset": _HEAVY,
    "import pliant.baselines.predict": {"scipy.linalg", "scipy.ndimage", "scipy.special", *_HEAVY},
    "import pliant.evaluator.report.leaderboard, pliant.evaluator.report.report": _HEAVY,
}  # fmt: skip


@pytest.mark.parametrize("code", LIGHT)
def test_import_stays_light(code: str) -> None:
    program = f"import sys; {code}; print(*sys.modules, file=sys.stderr)"
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    assert not set(done.stderr.split()) & LIGHT[code]
