"""`generate` over a finished set notices damaged files and makes their sequences again."""

from __future__ import annotations

import json

import pytest

from pliant.generator.runner.plan import first_damage
from pliant.generator.runner.run import generate


@pytest.fixture
def finished(standin, tmp_path):
    """A function that runs the small set again; the set is there already."""
    config, out = standin.small_config(), tmp_path / "set"

    def run():
        return generate(
            config, out, engine=standin.InProcess(), open_maker=standin.maker(config, out)
        )

    assert run().made == 6
    return run, out


def truncate(path):
    path.write_bytes(path.read_bytes()[:-20])


def change_one_byte(path):
    data = bytearray(path.read_bytes())
    data[len(data) // 2] ^= 1
    path.write_bytes(data)


@pytest.mark.parametrize("damage", [truncate, change_one_byte])
def test_damaged_sequences_are_made_again(damage, finished, digests, uninterrupted):
    run, out = finished
    names = ["rgb/000001.png", "depth/000002.exr", "correspondences.parquet", "points.parquet"]
    places = ["test-000000", "test-000001", "train-000000", "train-000002"]
    for name, place in zip(names, places, strict=True):
        damage(out / "sequences" / "rope" / f"rope-{place}" / name)
    assert run().made == 4
    assert digests(out) == uninterrupted
    logs = "".join(path.read_text() for path in (out / ".pliant" / "logs").iterdir())
    for name, place in zip(names, places, strict=True):
        assert f"rope-{place} is made again: {name} has" in logs
    assert run().unchanged


def test_a_lost_file_and_a_broken_list_of_files_are_damage(finished, digests, uninterrupted):
    run, out = finished
    folder = out / "sequences" / "rope" / "rope-train-000000"
    (folder / "rgb" / "000000.png").unlink()
    truncate(out / "sequences" / "rope" / "rope-train-000001" / "sequence.json")
    assert first_damage(folder) == "rgb/000000.png is missing"
    assert run().made == 2
    assert digests(out) == uninterrupted


def test_sizes_are_compared_before_any_file_is_read(finished, monkeypatch):
    _, out = finished
    folder = out / "sequences" / "rope" / "rope-test-000001"
    assert first_damage(folder) is None
    last = json.loads((folder / "sequence.json").read_text())["files"][-1]["path"]
    truncate(folder / last)
    monkeypatch.setattr("pliant.generator.runner.plan.sha256_file", lambda path: 1 / 0)
    damage = first_damage(folder)
    assert damage is not None
    assert f"{last} has" in damage
