"""Files by which the Hugging Face Hub shows a benchmark and the results of models on it.

The formats are those of https://huggingface.co/docs/hub/eval-results: `eval.yaml` in the
repository of the dataset, `.eval_results/NAME.yaml` in that of a model.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any, Final

from pliant.spec.dataset import Dataset
from pliant.spec.errors import SpecError
from pliant.spec.io.writing import write_file
from pliant.spec.io.yamlfiles import yaml_text

EVAL_YAML: Final = "eval.yaml"
FRAMEWORK: Final = "pliant"
METRIC: Final = "pck_8px"
"""The value of a result: a leaderboard of the Hub ranks by one number, the higher the better."""


def write_benchmark(dataset: Dataset, root: Path) -> None:
    """Write `eval.yaml`: a task for each split with queries, and for each of its tiers.

    Args:
        dataset: The public half.
        root: Its folder.
    """
    tasks = [
        {"id": task_id(split, tier), "config": "queries", "split": split}
        for split in dataset.splits_with_queries()
        for tier in ("", *dataset.tiers)
        if not tier or len(dataset.tiers) > 1
    ]
    if not tasks:
        return
    document = {
        "name": dataset.info["title"],
        "description": "Dense correspondence on deformable objects. The value of a result is the "
        "percentage of answers within 8 pixels of the ground truth (pck_8px of the protocol "
        "`standard`).",
        "evaluation_framework": FRAMEWORK,
        "tasks": tasks,
    }
    write_file(root / EVAL_YAML, yaml_text(document))


def task_id(split: str, tier: str = "") -> str:
    """Return the id of a task in `eval.yaml`: `test`, or `test-rope` for one tier."""
    return f"{split}-{tier}" if tier else split


def results(
    document: Mapping[str, Any], dataset: str, *, split: str = "test", url: str | None = None
) -> list[Any]:
    """Return the entries of `.eval_results/NAME.yaml`.

    Args:
        document: `scores.json` of a report, or a receipt of an evaluation service.
        dataset: Id of the dataset on the Hub, `USER/NAME`.
        split: The split of a receipt, which does not name it.
        url: Page that shows where the scores come from: a report or the service.

    Raises:
        SpecError: It is neither, or has no share of answers within 8 pixels.
    """
    try:
        groups = document.get("figures") or {"overall": document["overall"], **document["tiers"]}
        measured = {tier: group[METRIC] for tier, group in groups.items()}
    except (KeyError, TypeError) as error:
        raise SpecError(
            "this is neither a report nor a receipt with the metric of the Hub",
            found=f"no field {error}",
            required=f"scores.json or a receipt of a protocol with {METRIC}, such as standard",
        ) from error
    if len(measured) == 2:  # the whole and its only tier
        measured = {"overall": measured["overall"]}
    values = {tier: value for tier, value in measured.items() if value is not None}
    if not values:
        raise SpecError(
            "the scores have no value of the Hub's metric",
            found=f"{METRIC} is undefined: no scored query has an answer",
            required="a report in which at least one query is scored",
        )
    entries = []
    for tier, value in values.items():
        entry: dict[str, Any] = {
            "dataset": {
                "id": dataset,
                "task_id": task_id(document.get("split", split), "" if tier == "overall" else tier),
            },
            "value": round(100 * value, 4),
            "evaluation_framework": FRAMEWORK,
        }
        if "signature" in document:
            entry["notes"] = f"Receipt of submission {document['submission']}"
        if url is not None:
            entry["source"] = {"url": url, "name": "Pliant"}
        entries.append(entry)
    return entries


def write_results(entries: list[Any], out: Path) -> Path:
    """Write the entries into a model's repository.

    Args:
        entries: What `results` returns.
        out: Folder of the model's repository.

    Returns:
        The file.
    """
    name = entries[0]["dataset"]["id"].replace("/", "--")
    path = out / ".eval_results" / f"{name}.yaml"
    path.parent.mkdir(parents=True, exist_ok=True)
    write_file(path, yaml_text(entries))
    return path
