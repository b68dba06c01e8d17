"""A challenge with hidden answers on one's own machine: publish, create, invite, serve, submit."""

import re
import shlex
import socket
import subprocess
import sys
import time
import urllib.error
import urllib.request
from pathlib import Path

PLIANT = str(Path(sys.executable).with_name("pliant"))  # the command of this environment
out = Path(sys.argv[1] if len(sys.argv) > 1 else "out")


def pliant(*words: object) -> str:
    """Run a command as you would at a terminal, and return what it prints."""
    call = [PLIANT, *map(str, words)]
    print(shlex.join(["pliant", *call[1:]]))
    return subprocess.run(call, check=True, capture_output=True, text=True).stdout


public, private, challenge = out / "public", out / "public-private", out / "challenge"
ropes = out / "ropes"
splits = ["--splits", "train=2,test=2", "--frames", "2", "--size", "160x120", "--style", "raster"]
pliant("generate", "rope", "--out", ropes, *splits, "--secret-seed", "--workers", "1")
pliant("publish", ropes, "--out", public, "--hold-out", "test")  # the answers stay behind
pliant("challenge", "create", challenge, "--data", public, "--private", private, "--split", "test")
invitation = pliant("challenge", "invite", challenge, "Ada's team")
token = re.search(r"pliant_\S+", invitation)[0]

with socket.socket() as probe:
    probe.bind(("127.0.0.1", 0))
    address = f"http://127.0.0.1:{probe.getsockname()[1]}"
serve = ["serve", str(challenge), "--port", address.rpartition(":")[2], "--workers", "1"]
service = subprocess.Popen([PLIANT, *serve])
try:
    for _ in range(300):
        try:
            urllib.request.urlopen(f"{address}/healthz", timeout=5)
            break
        except (urllib.error.URLError, OSError):
            time.sleep(0.2)
    pliant("predict", "centroid", "--data", public, "--split", "test", "--out", out / "a.parquet")
    print(pliant("submit", out / "a.parquet", "--to", address, "--token", token))
    board = urllib.request.urlopen(f"{address}/api/v1/leaderboard.csv").read().decode()
    print(board)
finally:
    service.terminate()
    service.wait()
