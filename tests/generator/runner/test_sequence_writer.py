from __future__ import annotations

import errno
import shutil

import pyarrow as pa
import pytest

from pliant.generator.runner import sequence_writer
from pliant.generator.seeding import SequenceTask
from pliant.spec.errors import CallError
from pliant.spec.io.parquet import TableWriter, read_footer, read_table, write_table
from pliant.spec.io.reading import sha256_file
from tests.generator.runner.standin import maker, small_config

TASK = SequenceTask("rope", "train", 0)


@pytest.fixture
def make(tmp_path):
    """Make one stand-in sequence of some frames; returns its folder."""

    def run(frames=4, **faults):
        maker(small_config(frames=frames), tmp_path, faults)().make(TASK, lambda: None)
        return TASK.folder(tmp_path)

    return run


def test_an_encoder_that_fails_fails_the_sequence(make, tmp_path, monkeypatch):
    def full(*arguments, **options):
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr(sequence_writer, "write_surface", full)
    with pytest.raises(CallError, match="No space left"):
        make()
    assert not TASK.folder(tmp_path).exists()


def test_a_failed_exr_on_a_full_disk_is_a_full_disk(make, tmp_path, monkeypatch):
    def fail(*arguments, **options):
        raise RuntimeError("File output failed")  # what OpenEXR says, whatever the cause

    monkeypatch.setattr(sequence_writer, "write_surface", fail)
    with pytest.raises(RuntimeError, match="File output failed"):
        make()
    monkeypatch.setattr(sequence_writer, "_free_bytes", lambda folder: 100)
    with pytest.raises(CallError, match="No space left"):
        make()


def test_the_table_is_the_same_in_one_piece_or_many(make, monkeypatch):
    folder = make(6)
    whole = read_table(folder / "correspondences.parquet", "correspondences")
    shutil.rmtree(folder)
    monkeypatch.setattr(sequence_writer, "_ROWS_IN_MEMORY", 30)
    pieces = read_table(make(6) / "correspondences.parquet", "correspondences")
    assert len(whole) == 6 * 16
    assert pieces.equals(whole)


def test_a_sequence_that_is_there_is_replaced(make):
    folder = make()
    (folder / "rgb" / "000007.png").touch()
    before = sha256_file(folder / "sequence.json")
    assert make() == folder  # a lost worker that was not lost
    assert sha256_file(folder / "sequence.json") == before
    assert not (folder / "rgb" / "000007.png").exists()


def test_table_writer_equals_write_table(tmp_path):
    rows = [{"pair_id": k, "query_id": 0, "u": 1.0, "v": 2.0} for k in range(6)]
    table = pa.Table.from_pylist(rows)
    write_table(tmp_path / "whole", table, "answers", {"split": "test"})
    with TableWriter(tmp_path / "pieces", "answers", {"split": "test"}) as writer:
        writer.write(table.slice(0, 4))
        writer.write(table.slice(4))
    assert read_footer(tmp_path / "pieces") == read_footer(tmp_path / "whole")
    assert read_table(tmp_path / "pieces", "answers").equals(
        read_table(tmp_path / "whole", "answers")
    )
    with TableWriter(tmp_path / "none", "answers") as writer, pytest.raises(ValueError, match="u"):
        writer.write(table.drop(["u"]))
