"""What the faults' commands read: a small dataset, reports, a publication, challenges."""

from __future__ import annotations

import io
import os
import shutil
from collections.abc import Callable
from contextlib import redirect_stderr, redirect_stdout
from pathlib import Path


def pliant(*arguments: object) -> int:
    """Run the command line."""
    from pliant.cli.main import run

    return run([str(each) for each in arguments])


def make_inputs(inputs: Path) -> None:
    """Make everything that the commands read, in an empty folder."""
    quiet = io.StringIO()
    made = inputs / "data"
    with redirect_stdout(quiet), redirect_stderr(quiet):
        size = ("--size", "64x64", "--style", "raster", "--workers", 1)
        codes = [pliant("generate", "rope", "--sequences", 3, "--frames", 2, *size, "--out", made)]
        for name in ("identity", "centroid"):
            file = inputs / f"{name}.parquet"
            codes += [
                pliant("predict", name, "--data", made, "--out", file),
                pliant("evaluate", file, "--data", made, "--out", inputs / name),
            ]
        codes += [
            publish(inputs, inputs),
            create(inputs, inputs),
            pliant("convert", made, "--to", "coco", "--out", inputs / "coco"),
            pliant("challenge", "backup", inputs / "challenge", "--out", inputs / "backup"),
            pliant("challenge", "invite", inputs / "challenge", "Later"),
            pliant("challenge", "archive", inputs / "challenge", "--out", inputs / "archive.tar"),
        ]
        from tests.faults.challenges import send

        shutil.copytree(inputs / "challenge", inputs / "waiting")
        send(inputs / "waiting", inputs / "identity.parquet")
    assert not any(codes), quiet.getvalue()


def publish(inputs: Path, work: Path) -> int:
    options = ("--hold-out", "test", "--answers-are-public")
    return pliant("publish", inputs / "data", "--out", work / "public", *options)


def create(inputs: Path, work: Path) -> int:
    halves = ("--data", inputs / "public", "--private", inputs / "public-private")
    return pliant("challenge", "create", work / "challenge", *halves)


def once(made: Path, make: Callable[[Path], int]) -> None:
    """Make something that does not exist yet, in a process of its own."""
    if not made.exists():
        child = os.fork()
        if child == 0:
            with redirect_stdout(io.StringIO()), redirect_stderr(io.StringIO()):
                os._exit(make(made))
        assert os.waitpid(child, 0)[1] == 0, made
