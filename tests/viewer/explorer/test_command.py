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

from tests.conftest import Refused

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
    tiny_dataset: Path, tiny_episode: Path, submit: Submit, tmp_path: Path, refused: Refused
) -> None:
    data, bad = tiny_dataset, tmp_path / "bad.parquet"
    bad.write_bytes(b"PAR1")
    other_truth = tiny_episode / "truth" / "test.parquet"
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))
        taken.listen()
        for code, message, *call in (
            (1, "dataset.json", tmp_path),
            (2, "there is no method", data, "sifd"),  # "sift", misspelled
            (2, "pliant predict oracle", data, "oracle"),
            (1, "pliant check", data, submit(tiny_episode, 1.0)),
            (1, "pliant check", data, bad),
            (1, "bad.parquet", data, "--truth", bad),
            (1, "does not belong to these queries", data, "--truth", other_truth),
            (1, "for --truth also SPLIT.parquet or its folder", data, "--truth", tmp_path),
            (2, "the port cannot", data, "identity", "--port", taken.getsockname()[1]),
        ):
            (said,) = refused(code, "explore", *call, "--no-browser").strip().splitlines()
            assert message in said
