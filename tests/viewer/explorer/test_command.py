"""`pliant explore` from the command line: one address, one sentence for what is wrong."""

from __future__ import annotations

import os
import signal
import socket
import subprocess
import sys
import urllib.request
from collections.abc import Callable
from pathlib import Path

import pytest

from pliant.cli.main import run

Submit = Callable[[Path, float], Path]


def test_it_serves_until_it_is_stopped(tiny_episode: Path, submit: Submit) -> None:
    submission = str(submit(tiny_episode, 4.0))
    call = [str(tiny_episode), submission, "identity", "--no-browser"]
    code = "from pliant.cli.main import main; main()"
    with subprocess.Popen(
        [sys.executable, "-c", code, "explore", *call],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        env={**os.environ, "PYTHONUNBUFFERED": "1"},
    ) as process:
        assert process.stdout is not None
        about, address = process.stdout.readline(), process.stdout.readline().split()[0]
        assert about == "tiny-episode: 2 sequences, moved 4 px, identity\n"
        assert address.startswith("http://127.0.0.1:")
        with urllib.request.urlopen(address) as answer:
            assert b"Explore" in answer.read()
        process.send_signal(signal.SIGINT)
        _, said = process.communicate(timeout=30)
        assert "Traceback" not in said
        assert process.returncode == 0


def test_what_is_wrong_is_one_sentence(
    tiny_dataset: Path,
    tiny_episode: Path,
    submit: Submit,
    tmp_path: Path,
    capfd: pytest.CaptureFixture[str],
) -> None:
    (tmp_path / "bad.parquet").write_bytes(b"PAR1")
    data, of_other_data = str(tiny_dataset), str(submit(tiny_episode, 1.0))
    other_truth = str(tiny_episode / "truth" / "test.parquet")
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))
        taken.listen()
        for call, code, message in (
            ([str(tmp_path)], 1, "dataset.json"),
            ([data, "sifd"], 2, "there is no method"),  # "sift", misspelled
            ([data, "oracle"], 2, "pliant predict oracle"),
            ([data, of_other_data], 1, "pliant check"),
            ([data, str(tmp_path / "bad.parquet")], 1, "pliant check"),
            ([data, "--truth", str(tmp_path / "bad.parquet")], 1, "bad.parquet"),
            ([data, "--truth", other_truth], 1, "does not belong to these queries"),
            ([data, "--truth", str(tmp_path)], 1, "or the file of a split's truth"),
            ([data, "identity", "--port", str(taken.getsockname()[1])], 2, "the port cannot"),
        ):
            assert run(["explore", *call, "--no-browser"]) == code
            (said,) = capfd.readouterr().err.strip().splitlines()
            assert message in said


def test_a_missing_extra_is_named(tiny_dataset: Path, tmp_path: Path) -> None:
    """As in a base install, for every command that serves a page."""
    (tmp_path / "index.html").write_text("a site")
    calls = {"explore": tiny_dataset, "annotate": tmp_path, "serve": tmp_path}
    named = [(name, str(path)) for name, path in calls.items()]
    code = (
        "import sys; sys.modules['uvicorn'] = sys.modules['starlette'] = None\n"
        "from pliant.cli.main import run\n"
        f"print([run([*call, '--no-browser']) for call in {named}])"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
    assert done.stdout == "[2, 2, 2]\n"
    said = done.stderr.strip().splitlines()
    assert len(said) == 3
    assert all("pip install 'pliant[explore]'" in line for line in said)
