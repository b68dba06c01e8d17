"""`pliant demo`: a small benchmark from rendering to an overview page."""

from __future__ import annotations

import shutil
import time
from pathlib import Path

import click

from pliant.cli.options import image_size, json_option, out_option
from pliant.cli.terminal import echo, echo_json, to_call
from pliant.spec.cores import cpu_cores
from pliant.spec.extras import require_packages

_SETS = ("rope", "cloth")
_COUNT = click.IntRange(min=1)
_PACKAGES = ("cv2", "mahotas", "torch", "safetensors", "alembic", "cryptography", "fastapi")


@click.command("demo")
@out_option("DIR", "Output folder.")
@click.option("--sequences", type=_COUNT, default=4, show_default=True, help="Sequences per tier.")
@click.option(
    "--frames", type=_COUNT, default=3, show_default=True, help="Configurations per sequence."
)
@click.option("--size", default="640x480", show_default=True, metavar="WxH", help="Image size.")
@click.option("--seed", default=0, show_default=True, help="Random seed.")
@click.option("--workers", type=int, help="Worker processes.  [default: one per core]")
@json_option
def command(
    out: Path,
    sequences: int,
    frames: int,
    size: str,
    seed: int,
    workers: int | None,
    as_json: bool,
) -> None:
    """Generate, validate, predict, score and report on a small benchmark.

    Blender renders rope, cloth-1 and cloth-3; SIFT, SURF, ORB, the networks that come with
    Pliant, and the controls answer the same queries. DIR/report/index.html shows an example
    match, the scores and the causes of the errors. The last line of the output is the command that
    serves the ropes as a challenge.
    Run the same command again to resume an interrupted demo.
    """
    from pliant.generator.runner.run import required_packages

    require_packages([*required_packages("fast"), *_PACKAGES], "pliant demo", "all")
    from importlib.resources import files

    from rich.console import Console
    from rich.table import Table

    from pliant.benchmarks.suite.config_file import read_config
    from pliant.benchmarks.suite.page import rmse_by_tier, write_results
    from pliant.benchmarks.suite.table import finished_rows
    from pliant.benchmarks.suite.work import Workspace
    from pliant.cli.benchmark import run_with_progress

    if sequences * frames < 2:
        raise click.UsageError("a pair takes two pictures: --sequences or --frames of 2 or more")
    started = time.monotonic()
    width, height = image_size(size)
    settings = {
        "splits.test": sequences, "frames": frames, "width": width, "height": height, "seed": seed,
    }  # fmt: skip
    config = read_config(
        Path(str(files("pliant.benchmarks.suite") / "demo.yaml")),
        [f"sets.{name}.{key}={value}" for name in _SETS for key, value in settings.items()],
    )
    differing = run_with_progress(config, out, True, workers or cpu_cores())
    write_results(config, out, differing, "pliant demo --out DIR")
    page = out / "report" / "index.html"
    rmse = rmse_by_tier(config, finished_rows(config, Workspace(out)))
    table = Table("method", title="RMSE, px", title_justify="left")
    for tier in rmse:
        table.add_column(tier, justify="right")
    for method in dict.fromkeys(method for values in rmse.values() for method in values):
        found = (values.get(method) for values in rmse.values())
        table.add_row(method, *("–" if px is None else f"{px:.3g}" for px in found))
    Console(stderr=True).print(table)
    serve, token = _make_challenge(out, Workspace(out).set_path("rope"))
    seconds = time.monotonic() - started
    if as_json:
        document = {"page": str(page), "rmse_px": rmse, "seconds": round(seconds, 1)}
        echo_json({**document, "serve": serve, "host_token": token})
    else:
        echo(f"{seconds:.0f} s in all. Open {page}")
        echo(f"Serve the ropes as a challenge with: {serve}")
        if token is not None:
            echo(f"The host's token, shown this once: {token}")


def _make_challenge(out: Path, data: Path) -> tuple[str, str | None]:
    """Publish a set and make a challenge of it, once.

    Returns:
        The command that serves it, and the host's token the first time.
    """
    from pliant.publishing import PublishSettings, publish
    from pliant.service.challenge import is_challenge
    from pliant.service.creation import create_challenge

    root, public = out / "challenge", out / "published"
    token = None
    if not is_challenge(root):
        private = public.with_name("published-private")
        for half in (public, private):
            shutil.rmtree(half, ignore_errors=True)  # of a demo that was interrupted
        # The demo's seed is known, so its answers are no secret.
        publish(data, public, PublishSettings(hold_out=("test",), answers_are_public=True))
        token = create_challenge(root, public, private, ["test"])
    return to_call("pliant", "serve", root), token
