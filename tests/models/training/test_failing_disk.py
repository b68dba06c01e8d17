"""A disk that takes no more weights, or no log: one error, exit code 2, and no traceback."""

from __future__ import annotations

import errno
import os
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from tests.models.tiny_runs import options

pytest.importorskip("tensorboard", reason="training needs the extra 'train'")
from tensorboard.summary.writer.record_writer import RecordWriter

from pliant.cli.main import run
from pliant.models.training import checkpoint
from pliant.spec.dataset import Dataset
from tests.faults.trainings import DON, TIMECYCLE
from tests.full_disk import full_disk

Break = Callable[[pytest.MonkeyPatch], None]


def no_room(patch: pytest.MonkeyPatch) -> None:
    """Let no file of a checkpoint grow over 400 bytes."""
    save = checkpoint.save_checkpoint

    def limited(*arguments: Any) -> None:
        with full_disk(400):
            save(*arguments)

    patch.setattr("pliant.models.training.loop.save_checkpoint", limited)


def broken_log(patch: pytest.MonkeyPatch) -> None:
    """Let the log take its head, which is written before the first step, and no more."""
    write = RecordWriter.write
    sent: list[bytes] = []

    def fail(self: Any, data: bytes) -> None:
        if sent:
            raise OSError(errno.EIO, os.strerror(errno.EIO), "events.out.tfevents")
        sent.append(data)
        write(self, data)

    patch.setattr(RecordWriter, "write", fail)


@pytest.mark.parametrize("method", ["don", "timecycle"])
@pytest.mark.parametrize(
    ("damage", "message"), [(no_room, "File too large"), (broken_log, "Input/output error")]
)
def test_one_error_and_no_traceback(
    method: str,
    damage: Break,
    message: str,
    sheet_dataset: Dataset,
    tiny_episode: Path,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capfd: pytest.CaptureFixture[str],
) -> None:
    data = sheet_dataset.root if method == "don" else tiny_episode
    values = DON if method == "don" else TIMECYCLE
    call = ["train", method, "--data", str(data), "--out", str(tmp_path / "run")]
    capfd.readouterr()
    damage(monkeypatch)
    code = run([*call, *options(*values)])
    shown = capfd.readouterr()
    assert code == 2, shown
    assert "Traceback" not in shown.out + shown.err
    (error,) = [line for line in shown.err.splitlines() if line.startswith("Error: ")]
    assert message in error
