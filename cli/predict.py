"""`pliant predict`: answer a split's queries with a method."""

from __future__ import annotations

import sys
import time
from pathlib import Path
from typing import Literal

import click

from pliant.cli.options import data_option, json_option, kind_option, out_option, split_option
from pliant.cli.terminal import echo_result, progress_bar


@click.command()
@click.argument("method")
@data_option("The dataset.")
@split_option
@out_option("SUB.parquet", "The submission to write; an earlier submission there is replaced.")
@kind_option("the method's")
@click.option(
    "--workers",
    default=1,
    show_default=True,
    metavar="N",
    help="Number of worker processes; does not change the output.",
)
@json_option
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
    from pliant.api import open_method
    from pliant.baselines.predict import predict
    from pliant.spec.dataset import Dataset

    dataset = Dataset.open(data)
    matcher = open_method(method)
    started = time.perf_counter()
    with progress_bar(matcher.name, "pairs", hidden=not sys.stderr.isatty()) as bar:

        def show(done: int, total: int) -> None:
            bar(done, total, facts=f"{done / (time.perf_counter() - started):.1f} pairs/s")

        prediction = predict(dataset, split, matcher, out, kind, workers=workers, progress=show)
    seconds = time.perf_counter() - started
    ran = f"{prediction.method.get('implementation', '')} {prediction.method.get('version', '')}"
    text = (
        f"{out}: {prediction.rows} {kind} for {prediction.pairs} pairs of {dataset.id}/{split} by "
        f"{matcher.name}{f' ({ran.strip()})' if ran.strip() else ''} in {seconds:.1f} s"
    )
    document = {**prediction.as_dict(), "seconds": round(seconds, 3)}
    echo_result(document, text, as_json=as_json)
