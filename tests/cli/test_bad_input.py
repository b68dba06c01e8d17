"""Every command on input that is missing, empty, damaged, of another kind or unreadable.

Each gives one sentence on standard error, or issues for `check` and `validate`, exit code 1 or 2,
and no traceback.
"""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import pytest
from _pytest.mark import ParameterSet
from PIL import Image

from pliant.cli.main import COMMANDS, run
from tests.privilege import without_privilege

INPUTS = [
    # The input that is replaced, and the call; OUT is a new path.
    ("SUB", "check SUB --data DATA"),
    ("DATA", "check SUB --data DATA"),
    ("SUB", "evaluate SUB --data DATA --out OUT"),
    ("DATA", "evaluate SUB --data DATA"),
    ("TRUTH", "evaluate SUB --data DATA --truth TRUTH"),
    ("DATA", "validate DATA --workers 1"),
    ("DATA", "info DATA"),
    ("DATA", "view DATA --out OUT.png"),
    ("DATA", "publish DATA --out OUT"),
    ("DATA", "convert DATA --to coco --out OUT"),
    ("DATA", "predict identity --data DATA --out OUT"),
    ("RUN", "predict RUN --data DATA --split val --out OUT"),
    ("DATA", "submission --data DATA --out OUT.parquet"),
    ("ANSWERS.csv", "submission ANSWERS.csv --data DATA --out OUT.parquet"),
    ("DATA", "train don --data DATA --out OUT"),
    ("CONFIG", "train don --data DATA --config CONFIG --out OUT"),
    ("DATA", "train timecycle --data DATA --out OUT"),
    ("REPORT", "compare REPORT REPORT"),
    ("REPORT", "leaderboard REPORT --out OUT.html"),
    ("REPORT", "leaderboard REPORT --out OUT"),
    ("SCORES.json", "hub-results SCORES.json --dataset a/b --out OUT"),
    ("KNOTS", "import KNOTS --out OUT"),
    ("TRACKS.pkl", "import TRACKS.pkl --out OUT"),
    ("TRACKS.npz", "import TRACKS.npz --out OUT"),
    ("PICTURE", "match orb --source PICTURE --target GOOD --at 5,5 --out OUT.png"),
    ("PICTURE", "match orb --source GOOD --target PICTURE --at 5,5 --out OUT.png"),
    (
        "PICTURE",
        "match orb --source GOOD --mask-source PICTURE --target GOOD --at 5,5 --out OUT.png",
    ),
    ("RUN", "match RUN --source GOOD --target GOOD --at 5,5 --out OUT.png"),
    ("RUN", "train export RUN --name a --data DATA --out OUT"),
    ("CONFIG", "benchmark CONFIG --out OUT"),
    ("CONFIG", "generate rope --config CONFIG --out OUT"),
]
FOLDERS: dict[str, tuple[str, ...]] = {
    "DATA": ("dataset.json", "sequences.parquet", "queries/test.parquet"),
    "REPORT": ("scores.json", "per_pair.parquet"),
    "RUN": ("config.yaml", "run.json", "best.safetensors", "data.yaml", "calibration.json"),
    "KNOTS": ("knots_info.json",),
}
"""Inputs that are folders, and the files in them that are damaged one by one."""


def test_every_command_that_reads_something_is_here() -> None:
    """Inputs of those that serve pages are in `tests/viewer`, of the service in `tests/service`."""
    assert {call.split()[0] for _, call in INPUTS} == set(COMMANDS) - {
        "demo",
        "methods",
        "annotate",
        "explore",
        "serve",
        "challenge",
        "submit",
        "verify",
    }


@pytest.fixture(scope="module")
def good(
    scored: dict[str, Path], quick_run: Path, tmp_path_factory: pytest.TempPathFactory
) -> dict[str, Path]:
    """One good input of each kind."""
    folder = tmp_path_factory.mktemp("good")
    names = ("CONFIG", "KNOTS", "TRACKS.pkl", "TRACKS.npz", "ANSWERS.csv", "PICTURE.png")
    found = {name: folder / name for name in names}
    found["CONFIG"].write_text("seed: 1\n")
    found["KNOTS"].mkdir()
    (found["KNOTS"] / "knots_info.json").write_text('{"0": [[[1, 2]], [[3, 4]]]}')
    np.savez(found["TRACKS.npz"], points=np.zeros((1, 2, 2)))
    found["TRACKS.pkl"].write_bytes(b"\x80\x04]\x94(K\x01K\x02K\x03e.")
    noise = np.random.default_rng(0).integers(0, 255, (40, 40, 3), np.uint8)
    Image.fromarray(noise).save(found["PICTURE.png"])
    found["ANSWERS.csv"].write_text("pair_id,query_id,u,v\n0,0,1,2\n")
    others = {
        "RUN": quick_run,
        "PICTURE": found["PICTURE.png"],
        "GOOD": found["PICTURE.png"],
        "TRUTH": scored["DATA"] / "truth" / "test.parquet",
        "SCORES.json": scored["REPORT"] / "scores.json",
    }
    return {**scored, **found, **others}


def _half(path: Path, good: Path) -> None:
    path.write_bytes(good.read_bytes()[: good.stat().st_size // 2])


DAMAGES: dict[str, Callable[[Path, Path], object]] = {
    "missing": lambda path, good: None,
    "empty": lambda path, good: path.write_bytes(b""),
    "a folder": lambda path, good: path.mkdir(),
    "binary": lambda path, good: path.write_bytes(bytes(range(256)) * 8),
    "text": lambda path, good: path.write_text("hello\n"),
    "truncated": _half,
}


def _call(kind: str, call: str, bad: Path, good: dict[str, Path], tmp_path: Path) -> list[str]:
    places = {key: str(path) for key, path in good.items()} | {kind: str(bad)}
    return [places.get(word, word.replace("OUT", str(tmp_path / "out"))) for word in call.split()]


def _fails_in_one_sentence(call: list[str], capfd: pytest.CaptureFixture[str]) -> int:
    capfd.readouterr()
    code = run(call)
    shown = capfd.readouterr()
    assert code in (1, 2), f"{call}: {code}\n{shown}"
    _is_one_sentence(call, shown.out, shown.err)
    return code


def _is_one_sentence(call: list[str], out: str, err: str) -> None:
    assert "Traceback" not in out + err
    errors = [line for line in err.splitlines() if line.startswith("Error: ")]
    if call[0] in ("check", "validate") and not errors:
        assert out.startswith("ERROR ")
    else:
        assert len(errors) == 1, err
        assert len(errors[0]) < 1500
        assert "Error(" not in errors[0]  # an exception's own words


@pytest.mark.parametrize("damage", DAMAGES)
@pytest.mark.parametrize(("kind", "call"), INPUTS)
def test_a_bad_path_is_one_sentence(
    kind: str,
    call: str,
    damage: str,
    good: dict[str, Path],
    tmp_path: Path,
    capfd: pytest.CaptureFixture[str],
) -> None:
    if good[kind].is_dir() and damage == "truncated":
        pytest.skip("only a file can be truncated")
    if kind == "CONFIG" and damage in ("empty", "truncated"):
        pytest.skip("valid settings")
    bad = tmp_path / f"bad{Path(kind).suffix}"
    DAMAGES[damage](bad, good[kind])
    code = _fails_in_one_sentence(_call(kind, call, bad, good, tmp_path), capfd)
    if kind == "DATA":  # a file in place of the dataset's folder is a wrong call
        assert code == (1 if damage == "a folder" else 2)


def test_a_url_is_no_path(capfd: pytest.CaptureFixture[str]) -> None:
    for call in (["validate", "https://a.b/c"], ["predict", "identity", "--data", "s3://a/b"]):
        assert run(call) == 2
        assert f"'{call[-1]}' is a URL; required: a path on this" in capfd.readouterr().err


def test_a_submission_is_not_written_by_the_name_of_another_format(
    tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "sub.CSV"
    assert run(["predict", "identity", "--data", str(tmp_path), "--out", str(out)]) == 2
    assert "would be a Parquet file" in capfd.readouterr().err
    assert not out.exists()


def _folder_cases() -> Iterator[ParameterSet]:
    """Yield every command with every file of its folder and every damage.

    `make test` has one damage of each file for each command, another one for the next command.
    """
    places = [(*each, file) for each in INPUTS for file in FOLDERS.get(each[0], ())]
    damages = ("missing", "empty", "a folder", "truncated")
    for number, place in enumerate(places):
        for turn, damage in enumerate(damages):
            marks = [pytest.mark.long] if (number + turn) % len(damages) else []
            yield pytest.param(*place, damage, marks=marks)


@pytest.mark.parametrize(("kind", "call", "file", "damage"), list(_folder_cases()))
def test_a_folder_with_a_bad_file_never_gives_a_traceback(
    kind: str,
    call: str,
    file: str,
    damage: str,
    good: dict[str, Path],
    tmp_path: Path,
    capfd: pytest.CaptureFixture[str],
) -> None:
    """A file that a command does not need may be bad."""
    if not (good[kind] / file).is_file():
        pytest.skip("this run has no such file")
    bad = tmp_path / "bad"
    shutil.copytree(good[kind], bad, copy_function=os.link)
    (bad / file).unlink()
    DAMAGES[damage](bad / file, good[kind] / file)
    words = _call(kind, call, bad, good, tmp_path)
    if words[0] == "train" and file == "queries/test.parquet":
        pytest.skip("training reads no test queries")
    capfd.readouterr()
    if run(words):
        shown = capfd.readouterr()
        _is_one_sentence(words, shown.out, shown.err)


def test_a_table_of_pairs_with_other_columns_is_one_sentence(
    good: dict[str, Path], tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    shutil.copytree(good["REPORT"], tmp_path / "bad")
    shutil.copy(good["DATA"] / "sequences.parquet", tmp_path / "bad" / "per_pair.parquet")
    site = _call("REPORT", "leaderboard REPORT --out OUT", tmp_path / "bad", good, tmp_path)
    _fails_in_one_sentence(site, capfd)


UNREADABLE = [
    ("SUB", "check SUB --data DATA"),
    ("DATA", "validate DATA --workers 1"),
    *(
        pytest.param(*each, marks=pytest.mark.long)
        for each in INPUTS
        if each[1].startswith(("info", "compare", "generate", "match orb --source PICTURE"))
    ),
]


@pytest.mark.parametrize(("kind", "call"), UNREADABLE)
def test_input_without_read_permission_is_one_sentence(
    kind: str, call: str, good: dict[str, Path], tmp_path: Path
) -> None:
    """Root reads everything: the command runs without that privilege."""
    bad = tmp_path / "bad"
    if good[kind].is_dir():
        shutil.copytree(good[kind], bad)
        (bad / FOLDERS[kind][0]).chmod(0)
    else:
        shutil.copy(good[kind], bad)
        bad.chmod(0)
    words = _call(kind, call, bad, good, tmp_path)
    done = subprocess.run(
        [sys.executable, "-c", "from pliant.cli.main import main; main()", *words],
        capture_output=True,
        text=True,
        preexec_fn=without_privilege,
        timeout=600,
    )
    assert done.returncode in (1, 2), done
    _is_one_sentence(words, done.stdout, done.stderr)
    shown = (done.stdout + done.stderr).lower()
    assert "permission denied" in shown or "not readable" in shown
