"""The card of a shipped model: what it is, what it saw, how it was made, how well it does."""

from __future__ import annotations

import textwrap
from collections.abc import Mapping, Sequence
from typing import Any

from pliant.evaluator.report.cells import heading, score_cell

_WIDTH = 100

_METHODS = {
    "don": "a Dense Object Net: a network that gives every pixel a descriptor, the same for the "
    "same material point, and finds a point by p = softmax(-scale * squared distance) over the "
    "target: {decode}",
    "timecycle": "a TimeCycle network: descriptors learned from episodes without any "
    "correspondence, by following patches back and forth in time",
}
_DECODES = {
    "median": "the pixel with the least expected distance",
    "argmax": "the most probable pixel",
    "soft": "the mean",
}


def model_card(
    *,
    name: str,
    settings: Mapping[str, Any],
    facts: Mapping[str, Any],
    dataset: Mapping[str, Any],
    parameters: int,
    training_s: float | None,
    reports: Sequence[Mapping[str, Any]] = (),
) -> str:
    """Return the card as Markdown.

    Args:
        name: The model's name.
        settings: The run's config.
        facts: Its `run.json`.
        dataset: `dataset.json` of what it was trained on.
        parameters: Numbers in its weights.
        training_s: Wall time of the training, seconds, or None.
        reports: The documents of `scores.json` of its evaluations.
    """
    parts = [
        f"# {name}\n",
        _what(settings, facts, parameters),
        "## Use\n\n```\n"
        f"pliant predict {name} --data DATA --split test --out SUB.parquet\n"
        f"pliant match {name} --source A.png --target B.png --at U,V --out FIGURE.png\n```\n",
        "## Data\n\n" + _data(facts, dataset),
        "## Recipe and cost\n\n" + _recipe(settings, facts, training_s),
        "## Scores\n\n" + _scores(settings, facts, reports),
        "## Limits\n\n" + _limits(settings, facts, dataset),
        "## How it was made\n\n" + _commands(name, facts, dataset, bool(reports)),
    ]
    return "\n".join(parts)


def _what(settings: Mapping[str, Any], facts: Mapping[str, Any], parameters: int) -> str:
    kind = str(settings.get("kind", "don"))
    answer = settings.get("answer", {})
    words = _METHODS[kind].format(decode=_DECODES.get(answer.get("decode", ""), "answer"))
    network = facts.get("network")
    built = f" Network: {network}, {facts['descriptor_dim']} numbers a pixel." if network else ""
    return _filled(
        f"Trained on tier `{facts['tier']}`. It is {words}.{built} Input: pictures averaged to "
        f"{settings['width']} x {settings['height']}. {parameters:,} parameters; matrices are kept "
        "as float16 and computed with as float32."
    )


def _data(facts: Mapping[str, Any], dataset: Mapping[str, Any]) -> str:
    size = dataset["image_size"]
    provenance = dataset["provenance"]
    text = _filled(
        f"Dataset `{dataset['id']}` {dataset['version']} ({dataset['title']}), split "
        f"`{facts['split']}`, {size['width']} x {size['height']} pixels, made with "
        f"{provenance['generator']}."
    )
    config = provenance.get("config")
    if config is None:
        return text
    camera, look = config["camera"], config["look"]
    rows = [
        ("sequences of a tier", _counts(config["splits"])),
        ("frames of a sequence", f"{config['frames']:,}{', in time' * config['episodes']}"),
        ("render style", config["style"]),
        ("noise", "none" if config["noise"] is None else _inline(config["noise"])),
        ("camera", f"above : oblique = {camera['top']:g} : {camera['oblique']:g}, "
         f"field of view {_range(camera['fov_deg'])} degrees, " + _distance(camera)),
        ("seed", str(config["seed"])),
    ]  # fmt: skip
    if config["style"] != "real-depth":  # which shows neither
        rows += [
            (
                "materials",
                f"{look['materials']} for all sequences, from number {look['first_material']}"
                if look["materials"]
                else "another in every sequence",
            ),
            (
                "light",
                f"sun {_range(look['sun_elevation_deg'])} degrees high, "
                f"{_range(look['sun_share'])} of the light",
            ),
        ]
    table = "| | |\n|---|---|\n" + "".join(f"| {name} | {value} |\n" for name, value in rows)
    return f"{text}\n{table}\n`data.yaml` is the whole config.\n"


def _recipe(settings: Mapping[str, Any], facts: Mapping[str, Any], training_s: float | None) -> str:
    threads = settings.get("threads") or "all"
    time = "not recorded" if training_s is None else _duration(training_s)
    text = _filled(
        f"{facts['steps']:,} steps of {settings['batch']} samples, {facts['processes']} process "
        f"with threads: {threads}, {settings.get('precision', 'float32')}, seed {facts['seed']}. "
        f"Wall time from the first logged step to the last, validation included: {time}."
    )
    groups = [key for key, value in settings.items() if isinstance(value, Mapping)]
    shown = "\n".join(
        textwrap.fill(f"- {key}: {_inline(settings[key])}", _WIDTH, subsequent_indent="  ")
        for key in groups
        if key != "validation"
    )
    return f"{text}\n{shown}\n\n`config.yaml` is all of it.\n"


def _scores(
    settings: Mapping[str, Any], facts: Mapping[str, Any], reports: Sequence[Mapping[str, Any]]
) -> str:
    parts = []
    last = settings.get("validation", {}).get("keep") == "last"
    chosen = "; the weights are the last ones" if last else ", which chose the weights"
    figures = facts.get("validation", {})
    if "rmse_px" in figures:
        parts.append(
            _filled(
                f"On pairs of the validation split{chosen}: RMSE "
                f"{figures['rmse_px']:.2f} px pooled, {figures['rmse_px_mean_over_pairs']:.2f} px "
                f"mean over pairs, median error {figures['median_px']:.2f} px."
            )
        )
    parts += [_score_table(document) for document in reports]
    return "\n".join(parts) or "Not measured.\n"


def _score_table(document: Mapping[str, Any]) -> str:
    data, counts = document["dataset"], document["counts"]
    size = data["image_size"]
    head = _filled(
        f"Protocol `{document['protocol']}` {document['protocol_version']} on `{data['id']}` "
        f"{data['version']}, split `{document['split']}`: {counts['counted']:,} visible queries in "
        f"{counts['pairs']:,} pairs, {size[0]} x {size[1]} pixels; mask: "
        f"{document['submission']['method'].get('mask', 'none')}. In brackets "
        f"{document['intervals']['level'] * 100:g} % intervals over sequences."
    )
    metrics = document["headline"]
    heads = [heading(metric, document["protocol"]).text for metric in metrics]
    lines = [f"| tier | {' | '.join(heads)} |", "|---" * (1 + len(metrics)) + "|"]
    for tier in document["tiers"]:
        cells = [score_cell(document, tier, metric) for metric in metrics]
        shown = [
            f"{cell.value} ({cell.interval})" if cell.interval else cell.value for cell in cells
        ]
        lines.append(f"| {tier} | {' | '.join(shown)} |")
    return head + "\n" + "\n".join(lines) + "\n"


def _limits(
    settings: Mapping[str, Any], facts: Mapping[str, Any], dataset: Mapping[str, Any]
) -> str:
    limits = [
        f"It knows the object of tier `{facts['tier']}` and no other; pictures of other things get "
        "an answer all the same."
    ]
    config = dataset["provenance"].get("config") or {}
    if config.get("style") == "real-depth":
        limits.append(
            "It has seen drawings of what a depth camera shows, and no colour. Real depth pictures "
            "differ from them; the scores say nothing of those."
        )
    elif config.get("look", {}).get("materials"):
        limits.append(
            "It has seen the object in the materials named above alone. Other colours, and "
            "photographs, are outside of what was trained and of what the scores say."
        )
    else:
        limits.append("It has seen rendered pictures alone; the scores say nothing of photographs.")
    if settings.get("answer", {}).get("search") == "mask":
        limits.append(
            "It searches the object's mask where one is given. Without a mask it searches the "
            "whole picture, for which no score stands here."
        )
    limits.append(
        f"It sees {settings['width']} x {settings['height']} pixels: details below "
        f"{dataset['image_size']['width'] / settings['width']:g} pixels of the dataset's pictures "
        "are lost to it."
    )
    return (
        "\n".join(textwrap.fill(f"- {text}", _WIDTH, subsequent_indent="  ") for text in limits)
        + "\n"
    )


def _commands(name: str, facts: Mapping[str, Any], dataset: Mapping[str, Any], scored: bool) -> str:
    kind = "timecycle" if "guard" in facts else "don"
    lines = []
    if dataset["provenance"].get("config") is not None:
        lines.append("pliant generate --config data.yaml --out DATA")
    lines.append(f"pliant train {kind} --data DATA --config config.yaml --out RUN")
    scores = ""
    if scored:
        lines += [
            "pliant predict RUN --data DATA --split test --out SUB.parquet",
            "pliant evaluate SUB.parquet --data DATA --out REPORT",
        ]
        scores = " --scores REPORT"
    lines.append(f"pliant export RUN --name {name} --data DATA{scores} --out models/shipped")
    return "```\n" + "\n".join(lines) + "\n```\n"


def _filled(text: str) -> str:
    return textwrap.fill(text, _WIDTH) + "\n"


def _counts(splits: Mapping[str, int]) -> str:
    return ", ".join(f"{count:,} {split}" for split, count in splits.items())


def _range(values: Sequence[float]) -> str:
    return f"{values[0]:g} to {values[1]:g}"


def _distance(camera: Mapping[str, Any]) -> str:
    if camera.get("distance_m") is not None:
        return f"{_range(camera['distance_m'])} m away"
    return f"the object's box filling {_range(camera['fill'])} of the frame"


def _inline(values: Mapping[str, Any]) -> str:
    return ", ".join(f"{key} {_plain(value)}" for key, value in values.items() if value != "")


def _plain(value: Any) -> str:
    if isinstance(value, list):
        return f"[{', '.join(_plain(item) for item in value)}]"
    if isinstance(value, bool):
        return "yes" if value else "no"
    return f"{value:g}" if isinstance(value, float) else str(value)


def _duration(seconds: float) -> str:
    return f"{seconds / 60:.0f} min" if seconds < 5400 else f"{seconds / 3600:.1f} h"
