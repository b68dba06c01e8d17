"""`pliant demo`: the main job, small: generate, validate, answer, evaluate, report."""

from __future__ import annotations

import json
import os
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import click

from pliant.cli.terminal import echo

if TYPE_CHECKING:
    from rich.console import Console

    from pliant.generator.config import GenerateConfig
    from pliant.spec.dataset import Dataset

TIERS: Final = ("rope", "cloth-1", "cloth-3")
METHODS: Final = ("sift", "surf", "orb", "identity", "random", "centroid", "oracle")
SPARSE_METHODS: Final = ("sift", "surf", "orb")
SPLIT: Final = "test"


@click.command("demo")
@click.option("--out", required=True, type=click.Path(path_type=Path), help="Folder to fill.")
@click.option("--sequences", default=4, show_default=True, help="Sequences per tier.")
@click.option("--frames", default=3, show_default=True, help="Configurations per sequence.")
@click.option("--size", default="640x480", show_default=True, metavar="WxH", help="Image size.")
@click.option("--seed", default=0, show_default=True, help="Seed of everything.")
@click.option("--workers", type=int, help="Worker processes.  [default: one a core]")
@click.option("--json", "as_json", is_flag=True, help="Report as one JSON document on stdout.")
def command(
    out: Path,
    sequences: int,
    frames: int,
    size: str,
    seed: int,
    workers: int | None,
    as_json: bool,
) -> int:
    """Make, validate, answer, score and report a small benchmark.

    Blender renders rope, cloth-1 and cloth-3; SIFT, SURF, ORB and the controls answer the
    frozen queries; OUT/report/index.html shows the paper's table and pictures.
    The same command again goes on where it was interrupted.
    """
    from rich.console import Console

    from pliant.cli.generate import build_config

    config = build_config(
        TIERS,
        None,
        (
            "queries.pairs_per_sequence=3",
            "queries.queries_per_pair=100",
            "id=pliant-demo",
            "title=The Pliant demo",
        ),
        {"splits": f"{SPLIT}={sequences}", "frames": frames, "size": size, "seed": seed},
    )
    console = Console(stderr=True, highlight=False, soft_wrap=True)
    count = workers or len(os.sched_getaffinity(0))
    started = time.monotonic()
    result = run_demo(config, out, count, console)
    seconds = time.monotonic() - started
    if as_json:
        echo(json.dumps({**result, "seconds": round(seconds, 1)}, indent=1))
    else:
        echo(f"{seconds:.0f} s in all. Open {result['page']}")
    return 0


def run_demo(config: GenerateConfig, out: Path, workers: int, console: Console) -> dict[str, Any]:
    """Run the whole chain into a folder.

    Args:
        config: What to render.
        out: Gets `dataset/`, `submissions/`, `reports/` and `report/index.html`.
        workers: Processes.
        console: Where the steps are told.

    Returns:
        The page's path, and the RMSE of every tier and method.

    Raises:
        SpecError: The rendered dataset breaks the specification.
        PliantError: Whatever a step refuses.
    """
    from pliant.spec.dataset import Dataset

    check_folder(out)
    root = out / "dataset"
    with step(console, "generate"):
        generate(config, root, workers)
    with step(console, "validate"):
        validate(root, workers)
    dataset = Dataset.open(root)
    scores: dict[str, Any] = {}
    matches: dict[str, Any] = {}
    for method in METHODS:
        with step(console, f"{method}: answer and score"):
            scores[method] = answer_and_score(dataset, method, out, workers)
            if method in SPARSE_METHODS:
                matches[method] = match_and_score(dataset, method, out, workers)
    with step(console, "report"):
        from pliant.cli.demo_page import write_page

        page = write_page(dataset, config, scores, matches, SPLIT, out)
    tiers = list(config.tiers)
    print_table(console, scores, tiers)
    return {
        "page": str(page),
        "rmse_px": {
            tier: {name: each["tiers"][tier]["rmse_px"] for name, each in scores.items()}
            for tier in tiers
        },
    }


def check_folder(out: Path) -> None:
    """Refuse a folder that holds something else than an earlier demo.

    Raises:
        CallError: It is a file, or a folder with other things in it.
    """
    from pliant.spec.errors import CallError

    if out.exists() and not out.is_dir():
        raise CallError("the demo's folder is a file", path=out, fix="Name another --out")
    known = {"dataset", "submissions", "reports", "report"}
    strangers = sorted(p.name for p in out.iterdir() if p.name not in known) if out.exists() else []
    if strangers:
        raise CallError(
            "the folder holds something else than a demo",
            path=out,
            found=", ".join(strangers[:3]),
            required="an empty folder, a new one, or an earlier demo's",
        )


@contextmanager
def step(console: Console, name: str) -> Iterator[None]:
    """Tell a step and how long it took."""
    started = time.monotonic()
    with console.status(name):
        yield
    console.print(f"{name:28} {time.monotonic() - started:6.1f} s")


def generate(config: GenerateConfig, root: Path, workers: int) -> None:
    """Render the dataset, or go on with it.

    Raises:
        GenerationError: A sequence failed three times.
    """
    from pliant.generator.runner.run import generate
    from pliant.spec.errors import GenerationError

    summary = generate(config, root, workers=workers)
    if summary.failed:
        first = summary.failed[0]
        raise GenerationError(
            f"{len(summary.failed)} sequences could not be made",
            path=root,
            where=first.id,
            found=first.error.splitlines()[-1],
            fix="The same command tries them again",
        )


def validate(root: Path, workers: int) -> None:
    """Check the rendered dataset in full.

    Raises:
        SpecError: It breaks the specification.
    """
    from pliant.spec.errors import SpecError
    from pliant.spec.validation.validate import validate

    report = validate(root, workers=workers)
    if report.errors:
        raise SpecError(
            f"the rendered dataset breaks the specification {report.errors} times",
            path=root,
            found=str(report.issues[0]),
            fix=f"See all of it with: pliant validate {root}",
        )


def answer_and_score(dataset: Dataset, method: str, out: Path, workers: int) -> dict[str, Any]:
    """Answer the frozen queries with one method and score it by the `standard` protocol.

    Returns:
        The method's scores, as in its `scores.json`.
    """
    from pliant.baselines import METHODS as AVAILABLE
    from pliant.baselines.predict import predict

    submission = out / "submissions" / f"{method}.parquet"
    submission.parent.mkdir(parents=True, exist_ok=True)
    predict(dataset, SPLIT, AVAILABLE[method](), submission, workers=workers)
    return score(dataset, submission, out / "reports" / method, "standard")


def match_and_score(dataset: Dataset, method: str, out: Path, workers: int) -> dict[str, Any]:
    """Write a sparse method's own keypoint matches and score them by the `matches` protocol.

    Returns:
        The scores, as in its `scores.json`.
    """
    from pliant.baselines import METHODS as AVAILABLE
    from pliant.baselines.predict import predict

    submission = out / "submissions" / f"{method}-matches.parquet"
    predict(dataset, SPLIT, AVAILABLE[method](), submission, "matches", workers=workers)
    return score(dataset, submission, out / "reports" / f"{method}-matches", "matches")


def score(dataset: Dataset, submission: Path, report: Path, protocol: str) -> dict[str, Any]:
    """Evaluate one submission, write its report, and return its `scores.json`."""
    from pliant.evaluator import evaluate, write_report

    write_report(evaluate(submission, dataset.root, protocol=protocol), report, data=dataset)
    scores: dict[str, Any] = json.loads((report / "scores.json").read_text())
    return scores


def print_table(console: Console, scores: dict[str, Any], tiers: list[str]) -> None:
    """Print RMSE in pixels, a row a tier and a column a method."""
    from rich.table import Table

    from pliant.evaluator.report.overview import format_px

    table = Table(title="RMSE, px", title_justify="left")
    table.add_column("tier")
    for method in scores:
        table.add_column(method, justify="right")
    for tier in tiers:
        table.add_row(
            tier, *(format_px(each["tiers"][tier]["rmse_px"]) for each in scores.values())
        )
    console.print(table)
