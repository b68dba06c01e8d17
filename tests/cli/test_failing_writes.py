"""A disk that takes no more data: one line, exit code 2, and what was there before stays."""

from __future__ import annotations

import errno
import os
from pathlib import Path

import pytest

from pliant.cli.main import run
from pliant.spec.errors import CallError
from pliant.spec.io.jsonfiles import write_json
from pliant.spec.io.writing import replacing
from tests.full_disk import full_disk

COMMANDS = {
    "submission": ["submission", "--data", "DATA", "--out", "OUT.parquet"],
    "predict": ["predict", "identity", "--data", "DATA", "--out", "OUT.parquet"],
    "evaluate": ["evaluate", "SUB", "--data", "DATA", "--out", "OUT"],
    "leaderboard": ["leaderboard", "REPORT", "--out", "OUT.html"],
    "site": ["leaderboard", "REPORT", "--out", "OUT"],
    "view": ["view", "DATA", "--out", "OUT.png", "--count", "2"],
    "publish": ["publish", "DATA", "--out", "OUT"],
    "convert": ["convert", "sample", "--to", "tapvid", "--out", "OUT"],
    "generate": ["generate", "rope", "--sequences", "1", "--style", "raster",
                 "--size", "64x64", "--out", "OUT", "--workers", "1"],
}  # fmt: skip


@pytest.fixture(scope="module")
def places(tiny_dataset: Path, tmp_path_factory: pytest.TempPathFactory) -> dict[str, str]:
    folder = tmp_path_factory.mktemp("inputs")
    found = {
        "DATA": str(tiny_dataset),
        "SUB": str(folder / "s.parquet"),
        "REPORT": str(folder / "r"),
    }
    answered = ["predict", "identity", "--data", found["DATA"]]
    assert run([*answered, "--out", found["SUB"]]) == 0
    assert run(["evaluate", found["SUB"], "--data", found["DATA"], "--out", found["REPORT"]]) == 0
    return found


def _files(folder: Path) -> dict[str, bytes]:
    return {
        str(path.relative_to(folder)): path.read_bytes()
        for path in sorted(folder.rglob("*"))
        if path.is_file() and ".pliant" not in path.parts
    }


@pytest.mark.parametrize("name", ["predict", "evaluate", "convert", "publish", "generate"])
def test_a_full_disk_is_one_line_and_loses_nothing(
    name: str, places: dict[str, str], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    arguments = [places.get(a, a.replace("OUT", str(tmp_path / "out"))) for a in COMMANDS[name]]
    if name in ("predict", "evaluate"):  # the others refuse or skip what is finished
        assert run(arguments) == 0
    before = _files(tmp_path)
    with full_disk(400):
        code = run(arguments)
    shown = "".join(capsys.readouterr())
    assert code in (1, 2), shown
    assert "Traceback" not in shown
    assert "File too large" in shown
    if name == "publish":
        assert not any(name.endswith(".json") for name in _files(tmp_path))
    elif name != "generate":
        assert _files(tmp_path) == before


@pytest.mark.parametrize("name", COMMANDS)
def test_a_place_that_cannot_be_written_is_one_line(
    name: str, places: dict[str, str], capfd: pytest.CaptureFixture[str]
) -> None:
    """No file can be made in /proc, not even by root."""
    arguments = [places.get(a, a.replace("OUT", "/proc/pliant/out")) for a in COMMANDS[name]]
    assert run(arguments) in (1, 2)
    lines = [line for line in capfd.readouterr().err.splitlines() if line.startswith("Error")]
    assert len(lines) == 1
    assert "/proc" in lines[0]


@pytest.mark.parametrize("code", [errno.ENOSPC, errno.EROFS, errno.EDQUOT, errno.EIO])
def test_a_file_is_replaced_whole_or_not_at_all(
    code: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / "a.json"
    write_json(path, {"a": 1})
    earlier = path.read_bytes()

    def fail(self: Path, data: bytes) -> int:
        with open(self, "wb") as stream:
            stream.write(data[: len(data) // 2])
        raise OSError(code, os.strerror(code), str(self))

    monkeypatch.setattr(Path, "write_bytes", fail)
    with pytest.raises(CallError) as caught:
        write_json(path, {"a": list(range(100))})
    assert str(path) in str(caught.value)
    assert os.strerror(code) in str(caught.value)
    assert "partial" not in str(caught.value)
    assert path.read_bytes() == earlier
    assert [p.name for p in tmp_path.iterdir()] == ["a.json"]


def test_an_error_of_the_writer_itself_leaves_the_file(tmp_path: Path) -> None:
    path = tmp_path / "a.txt"
    path.write_text("earlier")
    with pytest.raises(ZeroDivisionError), replacing(path) as partial:
        partial.write_text(f"{1 / 0}")
    assert path.read_text() == "earlier"
    assert list(tmp_path.iterdir()) == [path]
    with replacing(path, durable=True) as partial:
        assert partial.suffix == ".txt"
        partial.write_text("new")
    assert path.read_text() == "new"
