"""Validation as a whole: reports, caps, workers, quick runs, the command."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow.parquet as pq
import pytest
from click.testing import CliRunner

from pliant.cli.main import run
from pliant.cli.validate import command
from pliant.spec.errors import CallError
from pliant.spec.validation.validate import validate
from tests.conformance.edits import (
    FOLDERS,
    ROPE_TEST,
    ROPE_TRAIN,
    change_json,
    change_rows,
    listed,
    remove,
    write,
)

Copy = Callable[[str], Path]

CLOTH = FOLDERS["CLOTH"]


def spoil(root: Path) -> None:
    """Break several things at once, in several files."""

    def move(rows: list[dict[str, Any]]) -> None:
        for row in rows:
            row["u_px"] += 1.0 + row["point"] % 3  # no one cause explains it

    listed(change_rows(f"{ROPE_TRAIN}/correspondences.parquet", move))(root)
    remove(f"{ROPE_TEST}/rgb/000001.png")(root)
    write("junk", b"")(root)
    change_json("dataset.json", lambda document: document["provenance"].update(seed=3))(root)


def test_all_problems_in_one_pass(copy_of: Copy) -> None:
    root = copy_of("full")
    spoil(root)
    report = validate(root)
    assert report.counts == {"FILE_EXTRA": 1, "FILE_MISSING": 1, "REPROJECTION_DISAGREES": 2 * 93}
    moved = [issue for issue in report.issues if issue.code == "REPROJECTION_DISAGREES"]
    assert "projects to" in moved[0].message
    assert validate(root, workers=3) == report  # workers do not change it


def test_quick_leaves_images_and_geometry_alone(copy_of: Copy) -> None:
    root = copy_of("full")
    listed(
        write(f"{ROPE_TRAIN}/depth/000000.exr", b"no image"),
        change_rows(f"{ROPE_TRAIN}/correspondences.parquet", lambda rows: rows[5].update(u_px=0.0)),
    )(root)
    assert validate(root, quick=True).counts == {}
    assert set(validate(root).counts) == {"FILE_UNREADABLE", "REPROJECTION_DISAGREES"}
    (root / f"{ROPE_TRAIN}/depth/000000.exr").write_bytes(b"no imagE")
    remove("truth/test.parquet")(root)
    change_rows("queries/test.parquet", lambda rows: rows[0].update(u_a=0.25))(root)
    quick = validate(root, quick=True)
    assert set(quick.counts) == {"CHECKSUM_DIFFERS", "QUERY_NOT_VISIBLE"}


@pytest.mark.parametrize("change", [("K", 0, 0, 1e-300), ("world_to_camera", 0, 3, 1e300)])
def test_absurd_cameras_give_issues_alone(
    copy_of: Copy, change: tuple[str, int, int, float]
) -> None:
    """No warning of NumPy, which would be an error here."""
    root, (name, row, column, value) = copy_of("minimal"), change

    def set_value(document: dict[str, Any]) -> None:
        document["frames"][0][name][row][column] = value

    listed(change_json(f"{CLOTH}/cameras.json", set_value))(root)
    assert validate(root).counts == {"REPROJECTION_DISAGREES": 81}


def test_wrong_calls(tmp_path: Path) -> None:
    with pytest.raises(CallError, match="folder not found"):
        validate(tmp_path / "nowhere")
    for workers, limit in ((0, 1), (1, 0), (-1, 1)):
        with pytest.raises(CallError, match="at least 1"):
            validate(tmp_path, workers=workers, limit=limit)
    assert run(["validate", str(tmp_path / "nowhere")]) == 2
    assert validate(tmp_path).counts == {"FILE_MISSING": 3}


def test_command_text_and_exit_codes(copy_of: Copy) -> None:
    root = copy_of("full")
    good = CliRunner().invoke(command, [str(root), "--workers", "1"], standalone_mode=False)
    assert good.return_value == 0
    assert "valid (5 sequences, 8 frames, full check)" in good.output
    spoil(root)
    bad = CliRunner().invoke(
        command, [str(root), "--workers", "1", "--limit", "3"], standalone_mode=False
    )
    assert bad.return_value == 1
    assert "3 of 188 problems listed" in bad.output
    assert "REPROJECTION_DISAGREES 186" in bad.output


def test_command_json_is_one_document(copy_of: Copy) -> None:
    root = copy_of("minimal")
    write("junk", b"")(root)
    code = f"from pliant.cli.main import main; main(['validate', {str(root)!r}, '--json'])"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert done.returncode == 1, done.stderr
    document = json.loads(done.stdout)
    assert document["counts"] == {"FILE_EXTRA": 1}
    assert document["issues"][0]["path"] == "junk"


@pytest.mark.skipif(sys.platform != "linux", reason="measures this process's own peak")
def test_hostile_claims_cost_no_memory(copy_of: Copy) -> None:
    """Bombs in every kind of file, checked in one process that may use 1 GiB."""
    root = copy_of("full")
    count = 1_500_000
    rows = pq.read_table(root / ROPE_TRAIN / "points.parquet").slice(0, 1)
    many = rows.take(np.zeros(count, np.int64))
    pq.write_table(many, root / ROPE_TRAIN / "points.parquet", row_group_size=count)
    (root / ROPE_TEST / "cameras.json").write_bytes(b"[" * 15_000_000)
    (root / "queries" / "test.parquet").write_bytes(b"PAR1" + os.urandom(1000) + b"PAR1")
    change_json(f"{ROPE_TEST}/sequence.json", lambda document: document.update(frames=10**5))(root)
    listed()(root)
    code = (
        "import resource, sys; resource.setrlimit(resource.RLIMIT_AS, (2**32, 2**32));"
        "from pliant.spec.validation.validate import validate;"
        f"report = validate({str(root)!r});"
        # VmHWM, not ru_maxrss: that one is handed down from the process that started this one.
        "status = open('/proc/self/status').read();"
        "print(status.split('VmHWM:')[1].split()[0], sorted(report.counts))"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    peak_kib, _, codes = done.stdout.partition(" ")
    assert "FILE_TOO_LARGE" in codes
    assert int(peak_kib) < 2**20
