"""The base install: every command that needs more names the extra, and the others work."""

from __future__ import annotations

import ast
import json
import re
import subprocess
import sys
import tomllib
from pathlib import Path

import pytest

from pliant.cli.main import COMMANDS
from pliant.spec.extras import EXTRAS

ROOT = Path(__file__).resolve().parents[2]

CALLS = {
    "generate rope --style raster --workers 1 --out OUT/a": "generate",
    "demo --out OUT/b": "all",
    "predict don-rope --data sample --out OUT/c.parquet": "train",
    "predict sift --data sample --out OUT/d.parquet": "classical",
    "predict vismatch:roma --data sample --out OUT/d.parquet": "vismatch",
    "predict identity --data sample --out OUT/e.parquet": "",
    "train don --data sample --out OUT/f": "train",
    "train timecycle --data sample --out OUT/f": "train",
    "train model don-rope --out OUT/r": "train",
    "train export OUT --name a --data sample --out OUT/g": "train",
    "benchmark benchmarks/suite/demo.yaml --out OUT/h": "all",
    "explore sample --no-browser": "explore",
    "match sift --source A.png --target B.png --at 1,1 --out OUT/i.png": "classical",
    "view sample --out OUT/j.png": "",
    "info sample": "",
    "validate sample": "",
    "publish OUT --out OUT/k": "",
    "check OUT/e.parquet --data sample": "",
    "evaluate OUT/e.parquet --data sample --out OUT/report": "",
    "compare OUT/report OUT/report": "",
    "leaderboard OUT/report --out OUT/l.html": "",
    "leaderboard OUT/report --out OUT/m": "",
    "hub-results OUT/report --dataset a/b --out OUT/q": "",
    "serve OUT/none": "",
    "challenge create OUT/p --data OUT --private OUT": "service",
    "submit OUT/e.parquet --to http://127.0.0.1:9 --token a": "",
    "verify OUT/report/scores.json --key OUT/report/scores.json": "service",
    "submission --data sample --out OUT/n.parquet": "",
    "annotate OUT/none": "explore",
    "convert sample --to rerun --out OUT/recordings": "convert",
    "import OUT/none --out OUT/o": "",
}
"""Call -> the extra that it needs, empty for none. A call without may fail for its input."""

PROGRAM = """
import contextlib, importlib.machinery, io, json, shlex, sys

hidden, calls = json.loads(sys.argv[1]), json.loads(sys.argv[2])
find = importlib.machinery.PathFinder.find_spec
importlib.machinery.PathFinder.find_spec = lambda name, *others: (
    None if name.partition(".")[0] in hidden else find(name, *others)
)
from pliant.cli.main import run

found = {}
for call in calls:
    out, err = io.StringIO(), io.StringIO()
    with contextlib.redirect_stdout(out), contextlib.redirect_stderr(err):
        code = run(shlex.split(call))
    found[call] = code, out.getvalue(), err.getvalue()
print(json.dumps(found))
"""

HIDDEN = [module for modules in EXTRAS.values() for module in modules] + ["vismatch"]


@pytest.fixture(scope="module")
def outcomes(tmp_path_factory: pytest.TempPathFactory) -> dict[str, tuple[int, str, str]]:
    out = str(tmp_path_factory.mktemp("base"))
    calls = [call.replace("OUT", out) for call in (*CALLS, "methods --json")]
    program = [sys.executable, "-c", PROGRAM, json.dumps(HIDDEN), json.dumps(calls)]
    done = subprocess.run(program, capture_output=True, text=True, cwd=ROOT)
    assert done.returncode == 0, done.stderr
    return {call.replace(out, "OUT"): said for call, said in json.loads(done.stdout).items()}


def test_every_command_is_called() -> None:
    assert {call.split()[0] for call in CALLS} == set(COMMANDS) - {"methods"}


@pytest.mark.parametrize("call", CALLS)
def test_a_missing_extra_is_named(call: str, outcomes: dict[str, tuple[int, str, str]]) -> None:
    code, out, err = outcomes[call]
    extra = CALLS[call]
    if extra:
        command = (
            "pip install vismatch" if extra == "vismatch" else f"pip install 'pliant[{extra}]'"
        )
        assert code == 2, out + err
        error = err.splitlines()[-1]
        assert error.startswith("Error: ")
        assert error.endswith(f"optional dependencies '{extra}'. Install them with: {command}")
        assert "Traceback" not in err
    else:
        assert "optional dependencies" not in err
        assert "Traceback" not in err


def test_methods_marks_what_is_missing(outcomes: dict[str, tuple[int, str, str]]) -> None:
    code, out, _ = outcomes["methods --json"]
    missing = {row["name"]: row["missing"] for row in json.loads(out)["methods"]}
    assert code == 0
    assert missing["identity"] is missing["rope-tracer"] is None
    assert missing["sift"] == missing["lk-chain"] == "pip install 'pliant[classical]'"
    assert missing["don-rope"] == "pip install 'pliant[train]'"
    assert missing["vismatch:NAME"] == "pip install vismatch"
    assert missing["fused:METHOD"] == "pip install 'pliant[classical]'"


@pytest.mark.parametrize("room", ["models", "loaders"])
def test_extra_train_brings_what_training_imports(room: str) -> None:
    """As in an environment with this extra alone: `pip install 'pliant[train]'`."""
    declared = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    brought = [*declared["dependencies"], *declared["optional-dependencies"]["train"]]
    names = {re.split(r"[=<>;\[ ]", each)[0].lower() for each in brought}
    imported = {
        name.partition(".")[0]
        for path in (ROOT / room).rglob("*.py")
        for node in ast.walk(ast.parse(path.read_text()))
        if isinstance(node, ast.Import | ast.ImportFrom)
        for name in [getattr(node, "module", None) or node.names[0].name]
    }
    distributions = {"cv2": "opencv-python-headless", "PIL": "pillow", "yaml": "pyyaml"}
    foreign = imported - sys.stdlib_module_names - {"pliant"}
    assert {distributions.get(each, each).lower() for each in foreign} <= names


def test_the_extras_are_those_of_the_package() -> None:
    declared = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    extras = declared["optional-dependencies"]
    assert set(EXTRAS) == set(extras) - {"docs", "dev", "all"}
    names = {"cv2": "opencv-python-headless", "rerun": "rerun-sdk"}
    for extra, modules in EXTRAS.items():
        required = {re.split(r"[=<>;\[ ]", each)[0] for each in extras[extra]}
        assert {names.get(each, each.replace("_", "-")) for each in modules} <= required
