from __future__ import annotations

import json
import logging
import shutil
import time
from pathlib import Path

import pytest

from pliant.generator.runner.manifest import RunFolder
from pliant.generator.runner.plan import first_damage
from pliant.generator.runner.run import generate
from pliant.spec.errors import CallError, GenerationError
from tests.generator.runner.standin import digests, make, small_config
from tests.known import known


def test_a_finished_set_is_left_alone(tmp_path):
    out = tmp_path / "set"
    summary = make(out)
    assert (summary.sequences, summary.made, summary.frames) == (6, 6, 24)
    before = {path: path.stat().st_mtime_ns for path in out.rglob("*.*") if path.is_file()}
    summary = make(out)
    assert summary.unchanged
    assert summary.made == 0
    assert {path: path.stat().st_mtime_ns for path in before} == before


@pytest.mark.parametrize("name", ["sequences.parquet", "truth/test.parquet"])
def test_damaged_tables_of_a_finished_set_are_written_again(name, uninterrupted, tmp_path):
    out = tmp_path / "set"
    make(out)
    (out / name).write_bytes(b"half")
    assert make(out).made == 0
    (out / name).unlink()
    assert make(out).made == 0
    assert digests(out) == uninterrupted


def test_the_description_counts_one_in_the_singular(tmp_path):
    make(tmp_path / "set", splits={"train": 1}, frames=1, episodes=False)
    described = json.loads((tmp_path / "set" / "dataset.json").read_bytes())["description"]
    assert described.startswith("1 sequence of 1 frame (configurations) of rope,")


def test_growth_that_was_interrupted_before_the_tables_is_finished(
    uninterrupted, tmp_path, monkeypatch
):
    out = tmp_path / "set"
    make(out, splits={"test": 2})
    with monkeypatch.context() as patch:
        tables = "pliant.generator.runner.dataset_files.write_dataset_files"
        patch.setattr(tables, lambda *_: 1 / 0)
        with pytest.raises(ZeroDivisionError):
            make(out)
    assert make(out).made == 0
    assert digests(out) == uninterrupted
    assert {"dataset.json", "truth/test.parquet"} <= uninterrupted.keys()
    with pytest.raises(CallError, match=r"splits.test \(3 there, 1 in this call\)"):
        make(out, splits={"train": 3, "test": 1})


def test_other_settings_are_refused_and_named(tmp_path):
    out = tmp_path / "set"
    make(out)
    before = digests(out)
    with pytest.raises(CallError, match=r"seed \(0 there, 1 in this call\)"):
        make(out, seed=1)
    with pytest.raises(CallError, match=r"rope.length_m \(1.2 there, 1.1 in this call\)"):
        make(out, rope={"length_m": 1.1})
    assert digests(out) == before
    shutil.rmtree(out / ".pliant")  # a copy without the run's records still knows
    with pytest.raises(CallError, match="frames"):
        make(out, frames=5)
    assert make(out).made == 0


def test_labels_may_change(tmp_path):
    out = tmp_path / "set"
    make(out)
    make(out, title="Six ropes", version="1.1.0")
    info = json.loads((out / "dataset.json").read_text())
    assert (info["title"], info["version"]) == ("Six ropes", "1.1.0")


def test_foreign_folders_and_files_are_refused(tmp_path):
    (tmp_path / "photos").mkdir()
    (tmp_path / "photos" / "cat.png").touch()
    (tmp_path / "file").touch()
    with pytest.raises(CallError, match=r"photos: the output folder contains something else.*cat"):
        make(tmp_path / "photos")
    with pytest.raises(CallError, match="not a folder"):
        make(tmp_path / "file")
    with pytest.raises(CallError, match="cannot be written"):
        make(tmp_path / "file" / "below")
    assert sorted(p.name for p in (tmp_path / "photos").iterdir()) == ["cat.png"]


@pytest.mark.parametrize("config", [{}, {"splits": ["test"], "tiers": 1}])
def test_a_dataset_that_was_not_generated_is_refused(config, tmp_path):
    out = tmp_path / "set"
    out.mkdir()
    document = json.dumps({"provenance": {"config": config}})
    (out / "dataset.json").write_text(document)
    with pytest.raises(CallError, match=r"contains something else; found dataset\.json"):
        make(out)
    assert [path.name for path in out.iterdir()] == ["dataset.json"]


def test_a_packed_dataset_does_not_grow(tmp_path):
    """Its sequences are in shards, where the plan does not find them."""
    out = tmp_path / "set"
    make(out)
    shutil.rmtree(out / ".pliant")
    shutil.rmtree(out / "sequences")
    (out / "index.parquet").touch()
    before = digests(out)
    with pytest.raises(CallError, match="a packed dataset, which cannot grow"):
        make(out)
    assert digests(out) == before
    assert not (out / ".pliant").exists()


def test_one_run_at_a_time(tmp_path):
    run = RunFolder(tmp_path / "set")
    run.open()
    with run.locked(), pytest.raises(CallError, match="another process is generating"):
        make(tmp_path / "set")
    make(tmp_path / "set")


@pytest.mark.parametrize("jump_s", [-3600.0, 86400.0 * 400])
def test_a_clock_that_jumps_changes_no_byte(jump_s, uninterrupted, tmp_path, monkeypatch):
    clock = iter(range(10**9))
    began = time.time()
    monkeypatch.setattr(time, "time", lambda: began + next(clock) * jump_s)
    summary = make(tmp_path / "set")
    assert 0 < summary.seconds < 60
    assert digests(tmp_path / "set") == uninterrupted


def test_a_set_that_is_moved_meanwhile_goes_on_where_it_is(uninterrupted, tmp_path):
    out, moved = tmp_path / "set", tmp_path / "moved"

    def move(state):
        if state.sequences == 2 and not moved.exists():
            out.rename(moved)

    with pytest.raises(GenerationError, match="moved or removed"):
        make(out, progress=move)
    assert not (out / "dataset.json").exists()
    make(moved)
    assert digests(moved) == uninterrupted


@pytest.mark.parametrize("fault", ["raise", pytest.param("segfault", marks=pytest.mark.long)])
def test_failures_are_counted_named_and_made_up_later(fault, uninterrupted, tmp_path):
    out = tmp_path / "set"
    faults = {"rope-test-000001": fault}
    if fault == "segfault":  # and a worker that is killed once costs nothing
        faults["rope-train-000002"] = "once"
    summary = make(out, workers=2 if fault == "segfault" else 0, faults=faults)
    assert [(each.id, each.attempts) for each in summary.failed] == [("rope-test-000001", 3)]
    recorded = json.loads((out / ".pliant" / "failures.json").read_text())
    expected = {"raise": "ValueError: no such knot", "segfault": "SIGSEGV"}[fault]
    assert expected in recorded[0]["error"]
    assert summary.sequences == 5
    assert not (out / "sequences" / "rope" / "rope-test-000001").exists()
    assert (out / "dataset.json").is_file()

    assert make(out).made == 1
    names = {path.name for path in (out / ".pliant").glob("failed-*")}
    assert names == ({"failed-rope-train-000002"} if fault == "segfault" else set())
    assert digests(out) == uninterrupted
    assert not (out / ".pliant" / "failures.json").exists()


def test_what_the_settings_make_impossible_is_tried_once(tmp_path):
    faults = {"rope-test-000001": "impossible", "rope-train-000001": "raise"}
    frames = []
    summary = make(
        tmp_path / "set", faults=faults, progress=lambda state: frames.append(state.frames)
    )
    assert {each.id: each.attempts for each in summary.failed} == {
        "rope-test-000001": 1,
        "rope-train-000001": 3,
    }
    assert summary.frames == frames[-1] == 4 * 4
    assert max(frames) < 4 * 4 + 4  # those of failed attempts are not counted


def test_a_full_disk_stops_the_run_and_keeps_what_is_finished(uninterrupted, tmp_path):
    out = tmp_path / "set"
    with pytest.raises(GenerationError, match=r"No space left on device.* of 6 sequences"):
        make(out, faults={"rope-test-000001": "full"})
    assert not (out / "dataset.json").exists()
    assert not list((out / "sequences" / "rope").glob(".*"))
    make(out)
    assert digests(out) == uninterrupted


def test_no_sequence_at_all_is_an_error(tmp_path):
    faults = {f"rope-test-{k:06d}": "raise" for k in range(2)}
    with pytest.raises(GenerationError, match=r"no sequence could be made.*no such knot"):
        make(tmp_path / "set", splits={"test": 2}, faults=faults)


def test_each_run_has_a_log_and_leaves_the_logger_as_it_was(tmp_path):
    logger = logging.getLogger("pliant.generator")
    before = logger.level, list(logger.handlers)
    make(tmp_path / "set")
    (log,) = (tmp_path / "set" / ".pliant" / "logs").iterdir()
    assert "rope-test-000002: 4 frames" in log.read_text()
    assert (logger.level, logger.handlers) == before


@pytest.mark.parametrize(("workers", "engine"), [(0, "local"), (1, "slurm")])
def test_impossible_calls(workers, engine, tmp_path):
    with pytest.raises(CallError, match=r"workers|engine"):
        generate(small_config(), tmp_path / "set", workers=workers, engine=engine)


def truncate(path):
    path.write_bytes(path.read_bytes()[:-20])


def change_one_byte(path):
    data = bytearray(path.read_bytes())
    data[len(data) // 2] ^= 1
    path.write_bytes(data)


@pytest.mark.parametrize(
    ("damage", "says"), [(truncate, "has"), (change_one_byte, "has"), (Path.unlink, "is missing")]
)
def test_damaged_sequences_are_made_again(damage, says, uninterrupted, tmp_path):
    out = tmp_path / "set"
    make(out)
    names = ["rgb/000001.png", "depth/000002.exr", "correspondences.parquet", "points.parquet"]
    places = ["test-000000", "test-000001", "train-000000", "train-000002"]
    for name, place in zip(names, places, strict=True):
        damage(out / "sequences" / "rope" / f"rope-{place}" / name)
    truncate(out / "sequences" / "rope" / "rope-test-000002" / "sequence.json")
    assert make(out).made == 5
    assert digests(out) == uninterrupted
    logs = "".join(path.read_text() for path in (out / ".pliant" / "logs").iterdir())
    for name, place in zip(names, places, strict=True):
        assert f"rope-{place} is made again: {name} {says}" in logs
    assert "rope-test-000002 is made again: sequence.json cannot be read" in logs
    assert make(out).unchanged


def test_sizes_are_compared_before_any_file_is_read(monkeypatch, tmp_path):
    out = tmp_path / "set"
    make(out)
    folder = out / "sequences" / "rope" / "rope-test-000001"
    assert first_damage(folder) is None
    last = json.loads((folder / "sequence.json").read_text())["files"][-1]["path"]
    truncate(folder / last)
    monkeypatch.setattr("pliant.generator.runner.plan.sha256_file", lambda path: 1 / 0)
    damage = known(first_damage(folder))
    assert f"{last} has" in damage
