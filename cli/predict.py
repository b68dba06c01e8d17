"""`pliant predict`: answer a split's queries with a method."""

from __future__ import annotations

import json
import time
from pathlib import Path
from typing import Literal

import click

from pliant.cli.terminal import echo


@click.command()
@click.argument("method")
@click.option(
    "--data",
    required=True,
    type=click.Path(path_type=Path),
    metavar="DIR",
    help="The dataset.",
)
@click.option("--split", default="test", show_default=True, help="Whose queries to answer.")
@click.option(
    "--out",
    required=True,
    type=click.Path(path_type=Path),
    metavar="SUB.parquet",
    help="The submission to write; an earlier submission there is replaced.",
)
@click.option(
    "--kind",
    type=click.Choice(["answers", "matches"]),
    default="answers",
    show_default=True,
    help="Answers to the queries, or the method's own keypoint matches.",
)
@click.option(
    "--workers", default=1, show_default=True, metavar="N", help="Processes; the file is the same."
)
@click.option("--json", "as_json", is_flag=True, help="Report as one JSON document.")
def command(
    method: str,
    data: Path,
    split: str,
    out: Path,
    kind: Literal["answers", "matches"],
    workers: int,
    as_json: bool,
) -> None:
    """Answer the queries of a dataset and write a submission.

    METHOD is sift, surf, orb (dense descriptors on the target's object; --kind matches for
    their own keypoints), a control (identity, random, centroid, oracle), a shipped model
    (don-rope, don-cloth), or the folder of a training run.
    """
    from rich.console import Console
    from rich.progress import (
        BarColumn,
        MofNCompleteColumn,
        Progress,
        TextColumn,
        TimeRemainingColumn,
    )

    from pliant.api import open_method
    from pliant.baselines.predict import predict
    from pliant.spec.dataset import Dataset

    dataset = Dataset.open(data)
    matcher = open_method(method)
    started = time.perf_counter()
    columns = (
        TextColumn("{task.description}"),
        BarColumn(),
        MofNCompleteColumn(),
        TextColumn("{task.fields[rate]}"),
        TimeRemainingColumn(),
    )
    console = Console(stderr=True)
    with Progress(
        *columns, console=console, transient=True, disable=not console.is_terminal
    ) as bar:
        task = bar.add_task(f"{matcher.name}, pairs", total=None, rate="")

        def show(done: int, total: int) -> None:
            rate = f"{done / (time.perf_counter() - started):.1f} pairs/s"
            bar.update(task, completed=done, total=total, rate=rate)

        prediction = predict(dataset, split, matcher, out, kind, workers=workers, progress=show)
    seconds = time.perf_counter() - started
    if as_json:
        echo(json.dumps({**prediction.as_dict(), "seconds": round(seconds, 3)}))
        return
    ran = f"{prediction.method.get('implementation', '')} {prediction.method.get('version', '')}"
    echo(
        f"{out}: {prediction.rows} {kind} for {prediction.pairs} pairs of {dataset.id}/{split} by "
        f"{matcher.name}{f' ({ran.strip()})' if ran.strip() else ''} in {seconds:.1f} s"
    )
