"""What the Hugging Face Hub and Zenodo take: pairs with pictures, tasks, results, metadata."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from PIL import Image

from pliant import evaluate
from pliant.cli.main import run
from pliant.evaluator import write_report
from pliant.publishing.hub_results import results
from pliant.spec.dataset import Dataset
from pliant.spec.errors import SpecError
from tests.publishing.conftest import printed

DATASETS = """
import json, sys
from datasets import load_dataset
root, out = sys.argv[1:]
tables = {name: load_dataset(root, name) for name in ("frames", "pairs", "correspondences")}
frame, pair = tables["frames"]["test"][1], tables["pairs"]["val"][3]
pictures = {"frame": frame.pop("image"), **{side: pair.pop(f"image_{side}") for side in "ab"}}
for name, picture in pictures.items():
    picture.convert("RGB").save(f"{out}/{name}.png")
splits = {name: {split: len(rows) for split, rows in of.items()} for name, of in tables.items()}
queries = len(load_dataset(root)["test"])
pose = len(tables["frames"]["train"][0]["world_to_camera"])
print(json.dumps([splits, frame, pair, queries, pose], default=str))
"""


@pytest.mark.filterwarnings("ignore")
def test_hugging_face_datasets_shows_pictures(halves: Any, tmp_path: Path) -> None:
    pytest.importorskip("datasets")
    lines = printed(DATASETS, halves.public, tmp_path, HF_HOME=str(tmp_path / "hf"))
    splits, frame, row, queries, pose = json.loads(lines[-1])
    whole = Dataset.open(halves.whole)
    rows = {"train": 0, "val": 0, "test": 0}
    for sequence in whole.sequences:
        rows[sequence.split] += sequence.correspondences().num_rows
    pairs = whole.pairs("val")
    assert splits == {
        "frames": {"train": 12, "val": 6, "test": 12},
        "pairs": {"val": len(pairs)},  # the test split is held out
        "correspondences": {"train": rows["train"], "val": rows["val"]},
    }
    assert (queries, pose) == (288, 16)
    first, pair = next(s for s in whole.sequences if s.split == "test"), pairs[3]
    assert (frame["sequence"], frame["depth_exr"]) == (first.id, None)
    assert (row["pair_id"], row["frame_a"], row["frame_b"]) == (
        pair.pair_id, pair.source.key, pair.target.key,
    )  # fmt: skip
    for name, shown in (("frame", first[1]), ("a", pair.source), ("b", pair.target)):
        np.testing.assert_array_equal(np.asarray(Image.open(tmp_path / f"{name}.png")), shown.rgb)
    np.testing.assert_array_equal(np.stack([row["u_a"], row["v_a"]], 1), pair.queries)
    of_pair = whole.queries("val")["pair_id"].to_numpy() == pair.pair_id
    for name in ("u_b", "v_b", "visibility_b"):
        assert row[name] == whole.truth("val")[name].filter(of_pair).to_pylist()


def test_the_benchmark_names_a_task_per_split_and_tier(halves: Any) -> None:
    document = yaml.safe_load((halves.public / "eval.yaml").read_text())
    assert document["evaluation_framework"] == "pliant"
    assert [task["id"] for task in document["tasks"]] == [
        f"{split}{tier}"
        for split in ("val", "test")
        for tier in ("", "-rope", "-cloth-1", "-cloth-3")
    ]  # fmt: skip
    card = (halves.public / "README.md").read_text()
    configs = {each["config_name"] for each in yaml.safe_load(card.split("---")[1])["configs"]}
    assert {task["config"] for task in document["tasks"]} <= configs


def test_zenodo_metadata(halves: Any) -> None:
    document = json.loads((halves.public / ".zenodo.json").read_text())
    assert document["upload_type"] == "dataset"
    assert document["creators"] == [{"name": "Ada"}, {"name": "Grace"}]
    assert document["version"] == Dataset.open(halves.public).version


@pytest.mark.parametrize("kind", ["report", "receipt"])
def test_results_of_a_report_and_of_a_receipt(kind: str, halves: Any, tmp_path: Path) -> None:
    hub = pytest.importorskip("huggingface_hub")
    dataset = Dataset.open(halves.whole)
    answers = np.stack([dataset.truth("test")[name].to_numpy() for name in ("u_b", "v_b")], 1)
    answers[::2] += 20
    scores = evaluate(dataset, answers)
    scored = tmp_path / "report"
    if kind == "report":
        write_report(scores, scored, data=halves.whole)
    else:
        scored = tmp_path / "receipt.json"
        figures = {"overall": scores.overall, **scores.tiers}
        scored.write_text(json.dumps({"submission": "s1", "figures": figures, "signature": "x"}))
    given = ["hub-results", str(scored), "--dataset", "ada/ropes", "--out", str(tmp_path / "model")]
    assert run([*given, "--url", "https://example.org"]) == 0
    path = tmp_path / "model" / ".eval_results" / "ada--ropes.yaml"
    entries = hub.parse_eval_result_entries(yaml.safe_load(path.read_text()))
    tasks = yaml.safe_load((halves.public / "eval.yaml").read_text())["tasks"]
    assert {e.task_id for e in entries} == {t["id"] for t in tasks if t["split"] == "test"}
    assert entries[0].task_id == "test"
    value = scores.overall["pck_8px"]
    assert value is not None
    assert entries[0].value == pytest.approx(100 * value, abs=1e-3)
    assert 0 < entries[0].value < 100
    assert entries[0].dataset_id == "ada/ropes"


def test_other_files_are_refused(tmp_path: Path) -> None:
    (tmp_path / "x.json").write_text("{}")
    given = ["hub-results", str(tmp_path / "x.json"), "--out", str(tmp_path), "--dataset"]
    assert run([*given, "ada/ropes"]) == 1
    assert run([*given, "ropes"]) == 2


def test_a_tier_without_a_scored_query_has_no_result(tmp_path: Path) -> None:
    undefined: dict[str, Any] = {"pck_8px": None}
    figures = {"overall": {"pck_8px": 0.25}, "rope": {"pck_8px": 0.25}, "cloth-1": undefined}
    entries = results({"figures": figures}, "ada/ropes")
    tasks = {each["dataset"]["task_id"]: each["value"] for each in entries}
    assert tasks == {"test": 25.0, "test-rope": 25.0}
    with pytest.raises(SpecError, match="pck_8px is undefined"):
        results({"figures": {"overall": undefined, "rope": undefined}}, "ada/ropes")
