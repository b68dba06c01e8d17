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
from tests.folders import files_of
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


def call(name: str, scored: dict[str, Path], out: str) -> list[str]:
    return [str(scored.get(word, word.replace("OUT", out))) for word in COMMANDS[name]]


@pytest.mark.parametrize("name", ["predict", "evaluate", "convert", "publish", "generate"])
def test_a_full_disk_is_one_line_and_loses_nothing(
    name: str, scored: dict[str, Path], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    arguments = call(name, scored, str(tmp_path / "out"))
    if name in ("predict", "evaluate"):  # the others refuse or skip what is finished
        assert run(arguments) == 0
    before = files_of(tmp_path)
    with full_disk(400):
        code = run(arguments)
    shown = "".join(capsys.readouterr())
    assert code in (1, 2), shown
    assert "Traceback" not in shown
    assert "File too large" in shown
    if name == "publish":
        assert not any(name.endswith(".json") for name in files_of(tmp_path))
    elif name != "generate":
        assert files_of(tmp_path) == before


@pytest.mark.parametrize("name", COMMANDS)
def test_a_place_that_cannot_be_written_is_one_line(
    name: str, scored: dict[str, Path], capfd: pytest.CaptureFixture[str]
) -> None:
    """No file can be made in /proc, not even by root."""
    assert run(call(name, scored, "/proc/pliant/out")) in (1, 2)
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
