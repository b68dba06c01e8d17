"""Exports a finished run: its weights at half the size, and its model card."""

from __future__ import annotations

import re
import shutil
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, Final

from pliant.evaluator.scores import Scores
from pliant.models import CARD, load_matcher
from pliant.models.don.crossings import CROSSINGS
from pliant.models.don.familiarity import FAMILIARITY
from pliant.models.don.settings import FurtherSet
from pliant.models.model_card import model_card
from pliant.models.networks.mask_network import MASKS
from pliant.models.networks.print_network import PRINTS
from pliant.models.training.checkpoint import (
    BEST,
    FINISH,
    Weights,
    read_progress,
    read_weights_file,
    save_weights,
)
from pliant.models.training.run_folder import (
    BALL,
    CALIBRATION,
    CONFIG,
    RUN_FACTS,
    TENSORBOARD,
    data_digest,
)
from pliant.spec.dataset import Dataset
from pliant.spec.errors import CallError
from pliant.spec.io.jsonfiles import read_json
from pliant.spec.io.staging import staged
from pliant.spec.io.yamlfiles import read_yaml, yaml_text
from pliant.spec.storage.layout import SEQUENCES_TABLE
from pliant.spec.text import shortened

DATA_CONFIG: Final = "data.yaml"
"""The config that the training set was generated from; `pliant generate` takes it."""
RECIPE: Final = "recipe.yaml"
"""The recipe whose last stage a run is; `pliant train model` takes it."""

_NAME: Final = re.compile(r"[a-z0-9]+(-[a-z0-9]+)*")
_LARGEST_HALF: Final = 65504.0


def export_run(
    run: Path,
    name: str,
    out: Path,
    dataset: Dataset,
    reports: Sequence[Scores] = (),
    *,
    replace: bool = False,
) -> Path:
    """Write the small form of a finished run.

    Args:
        run: The run's folder.
        name: What the model is called: lower-case letters, digits and dashes.
        out: The folder of models; `out/name` is made.
        dataset: What the run was trained on.
        reports: Evaluations of the run (or of its shipped form) for the card.
        replace: Replace `out/name` if it is there.

    Returns:
        The model's folder: `config.yaml`, `best.safetensors` (float16), `run.json`, where the
        run has them `calibration.json`, `familiarity.json`, `crossings.safetensors`,
        `masks.safetensors`, `ball.safetensors`, `prints.safetensors`, `data.yaml` and
        `recipe.yaml`, and `CARD.md`.

    Raises:
        CallError: The name cannot be used, the run is not a run, not finished or was trained on
            other data, a report is of another run, or the model exists.
        TrainingError: The run has no validated weights, or is damaged.
    """
    if not _NAME.fullmatch(name):
        raise CallError(
            "the model's name cannot be used",
            found=repr(name),
            required="lower-case letters, digits and dashes, such as don-rope",
        )
    matcher = load_matcher(run)  # it answers: config, weights and calibration fit
    if not (run / RUN_FACTS).is_file():
        raise CallError("the run is not finished", path=run, required=RUN_FACTS, fix=FINISH)
    folder = out / name
    if folder.exists() and not replace:
        raise CallError(
            "the model exists already",
            path=folder,
            fix="Choose another --name or --out, or delete it.",
        )
    settings = read_yaml(run / CONFIG)
    also = [FurtherSet.parse(entry) for entry in settings.get("also", ())]
    named = [Dataset.open(each.data) if each.data else dataset for each in also]
    further = [each for each in named if each is not dataset]
    facts = _checked_facts(run, [dataset, *named], reports)
    settings = portable(settings, [each.id for each in further])
    card = model_card(
        name=name,
        settings=settings,
        facts=facts,
        dataset=dataset.info,
        further=[each.info for each in further],
        parameters=sum(p.numel() for p in matcher.network.parameters()),
        training_s=training_seconds(run),
        reports=[report.document for report in reports],
        stage=run.name if (run / RECIPE).is_file() else "",
    )
    with staged(folder) as place:
        _write_files(run, place, settings, [dataset, *further])
        (place / CARD).write_text(card, encoding="utf-8")
    return folder


def _checked_facts(
    run: Path, datasets: Sequence[Dataset], reports: Sequence[Scores]
) -> dict[str, Any]:
    """Return a finished run's facts; refuse other datasets, and reports of other runs."""
    facts: dict[str, Any] = read_json(run / RUN_FACTS)
    trained_on = {"id": datasets[0].id, "version": datasets[0].version}
    if facts["dataset"] != trained_on:
        raise CallError(
            "the run was trained on another dataset",
            path=run / RUN_FACTS,
            where="dataset",
            found=facts["dataset"],
            required=trained_on,
        )
    progress = read_progress(run)  # empty for a mean and for an exported model
    # as they were made: with no files held out, and not simulated
    whole = all(each.has(SEQUENCES_TABLE) and not each.held_out for each in datasets)
    if whole and progress and progress["data"] != data_digest(datasets):
        raise CallError(
            "the dataset has other sequences than the run was trained on",
            path=run,
            found=", ".join(each.address for each in datasets),
            fix="Pass the dataset of the training, unchanged, as --data.",
        )
    for report in reports:
        _check_report(report, facts)
    return facts


def _write_files(
    run: Path, folder: Path, settings: Mapping[str, Any], datasets: Sequence[Dataset]
) -> None:
    """Write what answering needs, and the configs that the datasets were generated from.

    Args:
        run: The run's folder.
        folder: The model's folder.
        settings: The config of the model.
        datasets: The run's own dataset, then the further ones.
    """
    for kept in (RUN_FACTS, CALIBRATION, FAMILIARITY, RECIPE):
        if (run / kept).is_file():
            shutil.copyfile(run / kept, folder / kept)
    (folder / CONFIG).write_text(yaml_text(settings), encoding="utf-8")
    for name in (BEST, CROSSINGS, MASKS, BALL, PRINTS):
        if name == BEST or (run / name).is_file():
            save_weights(folder / name, halved(read_weights_file(run / name)))
            (folder / name).chmod(0o644)  # safetensors makes it the owner's alone
    texts: dict[str, str] = {}
    for number, used in enumerate(datasets):
        config = used.info["provenance"].get("config")
        if config is None:
            continue
        text, file, count = yaml_text(config), f"data-{used.id}.yaml" if number else DATA_CONFIG, 1
        while texts.setdefault(file, text) != text:  # another set of this id
            count += 1
            file = f"data-{used.id}-{count}.yaml"
        (folder / file).write_text(text, encoding="utf-8")


def portable(settings: Mapping[str, Any], further: Sequence[str]) -> dict[str, Any]:
    """Return a run's config without the paths of the machine that it ran on.

    Args:
        settings: The config.
        further: Ids of the datasets that it names in addition to its own, in its order.

    Returns:
        The config with the datasets' ids and the name of the weights that it started from.
    """
    given = {**settings, "cache_dir": "", "network": {**settings.get("network", {})}}
    if source := given["network"].get("pretrained", ""):
        given["network"]["pretrained"] = source if ":" in source else Path(source).name
    ids = iter(further)
    also = [FurtherSet.parse(entry) for entry in given.get("also", ())]
    if also:
        given["also"] = [str(each._replace(data=next(ids)) if each.data else each) for each in also]
    return given


def halved(weights: Weights) -> Weights:
    """Return weights with the large tensors as float16.

    Vectors and scalars (norms, biases, the softmax's scale) weigh little and stay as they are,
    and so does a tensor with a value that float16 cannot hold.

    Args:
        weights: Name -> tensor.
    """
    return {
        name: tensor.half()
        if tensor.is_floating_point()
        and tensor.dim() > 1
        and float(tensor.abs().max()) <= _LARGEST_HALF
        else tensor
        for name, tensor in weights.items()
    }


def training_seconds(run: Path) -> float | None:
    """Return the wall time of a run's training by its TensorBoard log, pauses left out.

    Args:
        run: The run's folder.

    Returns:
        Seconds from the first logged step to the last, summed over the log's files (a resumed
        run has several); None where there is no log.
    """
    from tensorboard.backend.event_processing.event_accumulator import EventAccumulator

    total = 0.0
    for path in (run / TENSORBOARD).glob("events.out.tfevents.*"):
        events: Any = EventAccumulator(str(path))
        events.Reload()
        if "loss" in events.Tags()["scalars"]:
            times = [event.wall_time for event in events.Scalars("loss")]
            total += times[-1] - times[0]
    return total or None


def _check_report(report: Scores, facts: dict[str, Any]) -> None:
    method = report.document["submission"]["method"]
    for key in ("dataset", "tier", "steps", "seed", "validation"):
        if method.get(key) != facts.get(key):
            raise CallError(
                "the report is of another run",
                path=report.document["submission"]["file"],
                where=f"method.{key}",
                found=f"{shortened(repr(method.get(key)), 80)} of the method {method['name']!r}",
                required=shortened(repr(facts.get(key)), 80),
            )
