from __future__ import annotations

import json

import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from pliant.cli.main import run
from pliant.spec.dataset import Dataset


def test_info_as_json(tiny_dataset, capsys):
    assert run(["info", str(tiny_dataset), "--json"]) == 0
    document = json.loads(capsys.readouterr().out)
    dataset = Dataset.open(tiny_dataset)
    assert document["sequences"] == len(dataset.sequences) == 15
    assert document["frames"] == 30
    assert [tier["name"] for tier in document["tiers"]] == ["rope", "cloth-1", "cloth-3"]
    rope, smooth, scrunched = document["tiers"]
    assert rope["sequences"] == {"train": 2, "val": 1, "test": 2}
    assert sum(rope["shapes"].values()) == 5
    assert rope["coverage"] is None
    assert smooth["coverage"]["min"] > scrunched["coverage"]["max"]
    asked = document["queries"]["test"]
    assert asked["queries"] == len(dataset.queries("test"))
    assert asked["pairs"] == 3 * 2 * 2
    assert asked["truth"] is True


def test_info_of_a_public_half(tiny_dataset, tmp_path, capsys):
    """A held-out sequence's zero is no occlusion, and an untold seed is not called None."""
    told = json.loads((tiny_dataset / "dataset.json").read_text())
    told["provenance"]["seed"] = None
    (tmp_path / "dataset.json").write_text(json.dumps(told | {"held_out": ["test"]}))
    table = pq.read_table(tiny_dataset / "sequences.parquet")
    rows = table.to_pylist()
    for row in rows:
        row["self_occluded"] *= row["split"] != "test"
    pq.write_table(pa.Table.from_pylist(rows, table.schema), tmp_path / "sequences.parquet")
    assert run(["info", str(tmp_path), "--json"]) == 0
    spread = json.loads(capsys.readouterr().out)["tiers"][0]["self_occluded"]
    shown = [r["self_occluded"] for r in rows if r["tier"] == "rope" and r["split"] != "test"]
    assert spread["min"] == pytest.approx(min(shown), abs=1e-4)
    assert spread["min"] > 0
    assert spread["mean"] == pytest.approx(sum(shown) / 3, abs=1e-4)
    assert run(["info", str(tmp_path)]) == 0
    text = capsys.readouterr().out
    assert "15 sequences, 30 frames" in text
    assert "cloth-3" in text
    assert "no seed given" in text
    assert "None" not in text
    assert all(word in text for word in ("occluded", "symmetries"))  # on 80 columns, whole
    assert max(len(line) for line in text.splitlines() if "━" in line) <= 80
