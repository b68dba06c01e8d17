"""The command line as a whole: names, help, and what the code of a plug-in cannot do to it."""

from __future__ import annotations

import gc
import re
import subprocess
import sys
from collections.abc import Callable
from functools import partial
from pathlib import Path

import pytest

from pliant.benchmarks.suite.config_file import read_config
from pliant.cli.main import COMMANDS, SECTIONS, main, run
from pliant.generator.config import GenerateConfig
from pliant.models.don.settings import DonSettings
from pliant.models.recipe_file import RECIPES, read_recipe
from pliant.models.timecycle.settings import TimeCycleSettings
from pliant.spec.configuration import read_settings
from pliant.spec.io.parquet import read_footer
from tests.conftest import Refused
from tests.known import known

PLUG_INS = {
    "at import": "import sys\nsys.exit(0)\n",
    "by the builtin": "exit()\n",
    "in the constructor": """
class Method:
    def __init__(self):
        raise SystemExit
""",
    "in answer": """
import sys
class Method:
    def answer(self, pair):
        sys.exit(0)
""",
}


@pytest.mark.parametrize("when", PLUG_INS)
@pytest.mark.parametrize("workers", ["1", pytest.param("2", marks=pytest.mark.long)])
def test_a_plug_in_that_exits_is_an_error(
    when: str, workers: str, tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    """Its exit code must not become the command's, above all not 0 beside an older submission."""
    if workers == "2" and when != "in answer":
        pytest.skip("it ends before there are workers")
    method = tmp_path / f"exits_{tmp_path.name}.py"
    method.write_text(PLUG_INS[when])
    out = tmp_path / "out.parquet"
    call = ["--data", "sample", "--out", str(out)]
    assert run(["predict", "identity", *call]) == 0
    capfd.readouterr()
    assert run(["predict", f"{method}:Method", *call, "--workers", workers]) == 2
    error = capfd.readouterr().err.splitlines()[-1]  # on a slow machine after lines of progress
    line = 1 + [*map(str.strip, PLUG_INS[when].splitlines())].index(
        next(x.strip() for x in PLUG_INS[when].splitlines() if "xit" in x)
    )
    assert error.startswith(f"Error: {method}, line {line}: this code ended the program")
    assert read_footer(out)["method"]["name"] == "identity"


@pytest.mark.parametrize(
    ("call", "accept"),
    [
        ("generate", lambda given: read_settings(GenerateConfig, None, ["tiers=[rope]", *given])),
        ("train don", partial(read_settings, DonSettings, None)),
        ("train timecycle", partial(read_settings, TimeCycleSettings, None)),
        ("train model", partial(read_recipe, RECIPES / "don-rope.yaml")),
        ("benchmark", partial(read_config, Path("benchmarks/pliant-v3-mini.yaml"))),
    ],
)
def test_the_example_of_set_is_accepted(
    call: str, accept: Callable[[list[str]], object], capsys: pytest.CaptureFixture[str]
) -> None:
    assert run([*call.split(), "--help"]) == 0
    said = " ".join(capsys.readouterr().out.split())
    example = re.search(r"in YAML, such as (\S+)\. Overrides", said)
    accept([known(example)[1]])


@pytest.mark.parametrize(
    ("call", "suggestion"),
    [(["evalute"], "evaluate"), (["train", "dn"], "don"), (["valdate", "x"], "validate")],
)
def test_a_misspelt_command_suggests_the_right_one(
    call: list[str], suggestion: str, refused: Refused
) -> None:
    shown = refused(2, *call)
    assert "Did you mean" in shown
    assert f"'{suggestion}'" in shown


def test_help_lists_every_command_in_its_section(capsys: pytest.CaptureFixture[str]) -> None:
    assert run(["--help"]) == 0
    shown = capsys.readouterr().out
    parts = [shown.index(f"\n{section}:\n") for section in SECTIONS]
    assert parts == sorted(parts)
    assert all(f"\n  {name} " in shown for name in COMMANDS)
    assert all(about.endswith(".") for about in COMMANDS.values())


@pytest.mark.parametrize("group", ["challenge", "train"])
def test_help_of_a_group_cuts_no_summary(group: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert run([group, "--help"]) == 0
    assert "..." not in capsys.readouterr().out.split("Commands:")[1]


@pytest.mark.parametrize("call", [["methods"], ["info", "sample"]])  # by click, and by rich
def test_a_reader_that_goes_away_ends_the_command_silently(call: list[str]) -> None:
    """`pliant … | head -0`."""
    script = f"import sys\nfrom pliant.cli.main import run\nsys.exit(run({call}))"
    command = [sys.executable, "-c", script]
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE) as done:
        known(done.stdout).close()
        assert b"ended the program" not in known(done.stderr).read()
    assert done.returncode == 1


def test_the_end_of_a_process_searches_no_objects_for_cycles(
    capsys: pytest.CaptureFixture[str],
) -> None:
    try:
        with pytest.raises(SystemExit) as ended:
            main(["--help"])
        assert gc.get_freeze_count() > 0
    finally:
        gc.unfreeze()
    assert ended.value.code == 0
    assert "Usage: pliant" in capsys.readouterr().out


def test_python_runs_the_command_line() -> None:
    program = [sys.executable, "-m", "pliant", "validate", "no-such-folder"]
    done = subprocess.run(program, capture_output=True, text=True)
    assert done.returncode == 2
    assert "folder not found" in done.stderr
