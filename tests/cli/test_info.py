from __future__ import annotations

import json

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


def test_info_in_words(tiny_dataset, capsys):
    assert run(["info", str(tiny_dataset)]) == 0
    text = capsys.readouterr().out
    assert "15 sequences, 30 frames" in text
    assert "cloth-3" in text


def test_no_dataset(tmp_path, capsys):
    assert run(["info", str(tmp_path)]) == 1
    assert "no Pliant dataset" in capsys.readouterr().err
