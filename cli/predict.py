"""`pliant predict`: answer a split's queries with a method."""

from __future__ import annotations

import sys
import time
from contextlib import redirect_stdout
from pathlib import Path
from typing import Any, Literal

import click

from pliant.cli.options import (
    data_option,
    json_option,
    kind_option,
    method_options,
    split_option,
    submission_out_option,
    workers_option,
)
from pliant.cli.terminal import echo_result, progress_bar


@click.command()
@click.argument("method")
@data_option("The dataset.")
@split_option
@submission_out_option
@kind_option("the method's")
@workers_option()
@click.option(
    "--no-masks",
    is_flag=True,
    help="Do not give the method the masks of the objects.",
)
@method_options
@json_option
def command(
    method: str,
    data: Path,
    split: str,
    out: Path,
    kind: Literal["answers", "matches"],
    workers: int,
    no_masks: bool,
    options: dict[str, Any],
    as_json: bool,
) -> None:
    """Answer the queries of a dataset and write a submission.

    METHOD is a name that `pliant methods` lists, the folder of a training run, or a matcher of
    your own: path/to/my.py:Matcher or package.module:Matcher.
    """
    from pliant.api import open_method
    from pliant.baselines.predict import predict
    from pliant.spec.dataset import Dataset

    dataset = Dataset.open(data)
    # What a method prints is not part of the JSON document.
    with redirect_stdout(sys.stderr if as_json else sys.stdout):
        matcher = open_method(method, **options)
        started = time.perf_counter()
        with progress_bar(matcher.name, "pairs") as bar:
            prediction = predict(
                dataset, split, matcher, out, kind,
                workers=workers, masks=not no_masks, progress=bar,
            )  # fmt: skip
        seconds = time.perf_counter() - started
    ran = f"{prediction.method.get('implementation', '')} {prediction.method.get('version', '')}"
    text = (
        f"{out}: {prediction.rows} {kind} for {prediction.pairs} pairs of {dataset.id}/{split} by "
        f"{matcher.name}{f' ({ran.strip()})' if ran.strip() else ''} in {seconds:.1f} s"
    )
    document = {**prediction.as_dict(), "seconds": round(seconds, 3)}
    echo_result(document, text, as_json=as_json)
