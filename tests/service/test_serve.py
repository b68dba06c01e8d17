"""The whole service as processes: a newcomer's path, graceful stop, what leaks."""

from __future__ import annotations

import hashlib
import json
import os
import re
import sqlite3
import struct
import time
import urllib.error
import urllib.request
from pathlib import Path

import numpy as np
import pytest

from pliant.cli.main import run
from pliant.evaluator import read_protocol
from pliant.spec.io.parquet import read_table
from tests.service.conftest import Halves, MakeTrial
from tests.service.server import Server, serving

PAGES = (
    "/", "/?show=last", "/rules", "/data", "/submit", "/login", "/teams/2", "/submissions",
    "/submissions/1", "/submissions/2", "/admin", "/admin/audit", "/healthz",
    "/api/v1/challenge", "/api/v1/leaderboard", "/api/v1/leaderboard.csv", "/api/v1/submissions",
    "/api/v1/submissions.csv", "/api/v1/submissions/1", "/api/v1/submissions/1/receipt",
    "/api/v1/submissions/2", "/api/v1/key", f"/api/v1/protocols/{read_protocol('standard').sha256}",
    "/api/v1/openapi.json", "/no/such/page", "/api/v1/leaderboard?version=99",
    "/data/truth/test.parquet", "/data/../private/1/truth/test.parquet",
)  # fmt: skip


def fetch(address: str, token: str | None = None) -> bytes:
    headers = {} if token is None else {"Authorization": f"Bearer {token}"}
    try:
        with urllib.request.urlopen(urllib.request.Request(address, headers=headers)) as answer:
            return str(answer.headers).encode() + answer.read()
    except urllib.error.HTTPError as error:
        with error:
            return str(error.headers).encode() + error.read()


def test_port_0_is_any_free_port_and_a_taken_one_is_refused(
    make_trial: MakeTrial, tmp_path: Path
) -> None:
    challenge, log = make_trial().challenge, tmp_path / "log"
    challenge.database.engine.dispose()
    root = challenge.root
    server = Server(root, log, "--workers", "0", "--port", "0")
    try:
        end = time.monotonic() + 120
        while not (named := re.search(r"Serving .* on (http://\S+);", log.read_text())):
            assert server.process.poll() is None, log.read_text()
            assert time.monotonic() < end
            time.sleep(0.1)
        assert not named[1].endswith(":8000")
        assert b"ok" in fetch(f"{named[1]}/healthz")
        port = named[1].rpartition(":")[2]
        assert Server(root, log, "--workers", "0", "--port", port).process.wait(120) == 2
        assert f"127.0.0.1:{port}: the server cannot start. Choose another" in log.read_text()
        assert server.stop() == 0
        assert not list(root.glob("*-wal")), "the database is one file once nothing runs"
    finally:
        server.kill()


def secrets_of(private: Path) -> dict[str, bytes]:
    """Return what must appear nowhere: positions in every form, bytes and hashes of the files."""
    found: dict[str, bytes] = {}
    table = read_table(private / "truth" / "test.parquet", "truth")
    uv = np.stack([table["u_b"].to_numpy(), table["v_b"].to_numpy()], axis=1)
    for row, (u, v) in enumerate(uv):
        for order in "<>":
            found[f"row {row} float32 {order}"] = struct.pack(f"{order}2f", u, v)
            found[f"row {row} float64 {order}"] = struct.pack(f"{order}2d", u, v)
        for value in (u, v):
            if abs(value * 1000 - round(value * 1000)) > 0.01:
                for text in (repr(float(value)), str(np.float32(value)), f"{value:.5f}"):
                    found[f"row {row} {text}"] = text.encode()
    for name in ("u_b", "v_b"):
        values = table[name].to_numpy().astype("<f4")
        for row in range(len(values) - 1):
            found[f"column {name} {row}"] = values[row : row + 2].tobytes()
    for path in private.rglob("*"):
        if path.is_file() and path.name not in ("README.md", "dataset.json", "manifest.json"):
            data = path.read_bytes()
            sha256 = hashlib.sha256(data)
            found[f"{path.name} sha256"] = sha256.digest()
            if path.name != "test.parquet":  # pages name the truth by its sha256
                found[f"{path.name} sha256 text"] = sha256.hexdigest().encode()
            found[f"{path.name} md5"] = hashlib.md5(data).hexdigest().encode()
            found[f"{path.name} bytes"] = data[len(data) // 2 : len(data) // 2 + 24]
    return found


def test_the_search_for_answers_finds_them(service_halves: Halves) -> None:
    found = secrets_of(service_halves.private)
    truth = (service_halves.private / "truth" / "test.parquet").read_bytes()
    assert any(data in truth for data in found.values())
    table = read_table(service_halves.private / "truth" / "test.parquet", "truth")
    text = json.dumps(table.slice(0, 3).to_pylist()).encode()
    assert sum(data in text for data in found.values()) >= 4


def test_a_newcomers_path(
    service_halves: Halves, tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    """Create, invite, serve, submit, stop; everything that the service said is searched."""
    halves, root, log = service_halves, tmp_path / "challenge", tmp_path / "log"
    data = ["--data", str(halves.public), "--private", str(halves.private)]
    assert run(["challenge", "create", str(root), *data, "--json"]) == 0
    host = json.loads(capfd.readouterr().out)["host_token"]
    assert run(["challenge", "invite", str(root), "Ada", "--json"]) == 0
    token = json.loads(capfd.readouterr().out)["token"]
    with serving(root, log, "--workers", "1") as server:
        to = ["--to", server.address, "--token", token]
        assert run(["submit", str(halves.submissions[0]), *to]) == 0
        shown = capfd.readouterr()
        assert "rmse_px" in shown.out
        assert "Submission 1: scored" in shown.out
        assert "in the queue" in shown.err
        bad = str(halves.bad)
        assert run(["submit", bad, *to, "--json"]) == 1
        assert json.loads(capfd.readouterr().out)["counts"] == {"FILE_UNREADABLE": 1}
        assert run(["submit", bad, "--to", server.address, "--token", "wrong"]) == 2
        assert "TOKEN_INVALID" in capfd.readouterr().err
        said = {path: fetch(server.address + path) for path in PAGES}
        said |= {f"{path} host": fetch(server.address + path, host) for path in PAGES}
        for file in halves.submissions:
            assert run(["submit", str(file), *to, "--no-wait"]) == 0
        assert server.stop() == 0
    with sqlite3.connect(root / "challenge.sqlite") as connection:
        found = connection.execute("SELECT state, count(*) FROM job GROUP BY state").fetchall()
    connection.close()
    assert set(dict(found)) <= {"queued", "done"}  # a stop finishes jobs or gives them back
    said["log"] = log.read_bytes()
    for secret in (token, host):
        assert secret.split("_", 2)[2].encode() not in b"".join(said.values())
    everything = b"\n".join(said.values())
    leaked = [name for name, data in secrets_of(halves.private).items() if data in everything]
    assert leaked == []
    assert run(["challenge", "audit", str(root)]) == 0


def test_the_next_command_names_the_database(
    service_halves: Halves, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    root, database = tmp_path / "challenge", ["--database", f"sqlite:///{tmp_path}/own.sqlite"]
    halves = ["--data", str(service_halves.public), "--private", str(service_halves.private)]
    assert run(["challenge", "create", str(root), *halves, *database]) == 0
    assert capsys.readouterr().out.endswith(f"pliant serve {root} {' '.join(database)}\n")


def test_the_web_process_never_opens_the_answers(
    service_halves: Halves, make_trial: MakeTrial, tmp_path: Path
) -> None:
    """With the private folder out of its reach the web process serves every page."""
    trial = make_trial()
    root, host = trial.challenge.root, trial.host
    os.rename(root / "private", tmp_path / "elsewhere")
    os.rename(root / "keys" / "receipts.private.pem", tmp_path / "key")
    with serving(root, tmp_path / "log", "--workers", "0") as server:
        for path in PAGES:
            assert b"INTERNAL" not in fetch(server.address + path, host), path
        to = ["--to", server.address, "--token", host, "--no-wait"]
        assert run(["submit", str(service_halves.submissions[0]), *to]) == 0
