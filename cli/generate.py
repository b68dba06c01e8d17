"""`pliant generate`: generate a dataset, or resume the generation."""

from __future__ import annotations

from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

import click
from rich.filesize import decimal

from pliant.cli.options import (
    choice_option,
    image_size,
    json_option,
    out_option,
    path_option,
    set_option,
)
from pliant.cli.terminal import (
    Bar,
    echo,
    echo_json,
    echo_result,
    progress_bar,
    terminated_like_interrupted,
)
from pliant.spec.cores import cpu_cores
from pliant.spec.errors import CallError
from pliant.spec.text import duration, plural

if TYPE_CHECKING:
    from pliant.generator.config import GenerateConfig
    from pliant.generator.runner.plan import Plan
    from pliant.generator.runner.progress import RunState, Summary

_STOPPED = "Interrupted: finished sequences are kept, the same command continues."


@click.command("generate")
@click.argument("tiers", nargs=-1, metavar="[TIER]...")
@out_option("PATH", "Dataset folder.")
@click.option("--sequences", type=int, metavar="N", help="Sequences per tier.  [default: 20]")
@click.option(
    "--splits", metavar="S=N,...", help="Sequences per tier by split, such as train=80,test=20."
)
@click.option("--frames", type=int, metavar="F", help="Frames per sequence.  [default: 1]")
@click.option(
    "--episodes/--configurations",
    default=None,
    help="Frames in time, or independent configurations (the default).",
)
@click.option("--size", metavar="WxH", help="Image size in pixels.  [default: 640x480]")
@click.option("--seed", type=int, help="Random seed.  [default: 0]")
@click.option(
    "--secret-seed",
    is_flag=True,
    default=None,
    help="Draw a secret 128-bit seed, for data whose test labels are withheld; it is stored "
    "only in OUT/.private.",
)
@click.option(
    "--style", metavar="fast|photo|raster|real-depth", help="Render style.  [default: fast]"
)
@path_option(
    "--config", "FILE", "YAML or JSON file with these settings and more; options override it."
)
@set_option("cloth.points_a_side=49")
@click.option("--workers", type=int, metavar="N", help="Worker processes.  [default: one per core]")
@choice_option(
    "--engine", ["local", "ray"], "Processes of this machine, or a Ray cluster.", "local"
)
@click.option(
    "--dry-run",
    is_flag=True,
    help="Show the plan, and the time and disk space estimated by short trials; write nothing.",
)
@json_option
def command(
    tiers: tuple[str, ...],
    out: Path,
    overrides: tuple[str, ...],
    config: Path | None,
    workers: int | None,
    engine: Literal["local", "ray"],
    dry_run: bool,
    as_json: bool,
    **flags: Any,
) -> int:
    """Render datasets of the given TIERs (rope, cloth-1, cloth-2, cloth-3, towel) into a folder.

    Run the same command again to resume after an interruption. --sequences may be raised and TIERs
    added later; other settings are refused for an existing folder. Exit code 1 if a sequence
    could not be made; the other sequences are kept.
    """
    from pliant.generator.runner.run import generate

    settings = build_config(tiers, config, overrides, flags)
    count = cpu_cores() if workers is None else workers
    if dry_run:
        _dry_run(settings, out, count, as_json)
        return 0
    with terminated_like_interrupted(_STOPPED), progress_bar("generate", "images") as bar:
        show = GenerationDisplay(bar, out, count)
        summary = generate(settings, out, workers=count, engine=engine, progress=show)
    _report(summary, as_json)
    return 1 if summary.failed else 0


def build_config(
    tiers: tuple[str, ...],
    config_file: Path | None,
    overrides: tuple[str, ...],
    flags: dict[str, Any],
) -> GenerateConfig:
    """Merge config file, flags and `--set` into one config; later ones win.

    Args:
        tiers: Tier names, empty for the file's.
        config_file: YAML or JSON file, or None.
        overrides: `dotted.key=value` texts.
        flags: The other flags, None where not given.

    Raises:
        CallError: A value cannot be read or is refused.
    """
    from pliant.generator.config import GenerateConfig
    from pliant.spec.configuration import read_mapping, settings_from

    values = read_mapping(config_file) if config_file else {}
    for each in tiers:
        if Path(each).suffix in (".yaml", ".yml", ".json"):
            raise CallError(
                "a config file is not a tier", where=each, fix=f"Give it by `--config {each}`."
            )
    if tiers:
        values["tiers"] = list(tiers)
    given = {name: value for name, value in flags.items() if value is not None}
    if "sequences" in given and "splits" in given:
        raise CallError("give either --sequences or --splits, not both", where="--sequences")
    for name, other in (("sequences", "splits"), ("splits", "sequences")):
        if name in given:
            values.pop(other, None)
    if "size" in given:
        values["width"], values["height"] = image_size(given.pop("size"))
    if "splits" in given:
        given["splits"] = _parse_splits(given["splits"])
    values.update(given)
    return settings_from(GenerateConfig, values, path=config_file, overrides=overrides)


def _parse_splits(text: str) -> dict[str, int]:
    try:
        pairs = [part.split("=") for part in text.split(",")]
        counts = {name.strip(): count.strip() for name, count in pairs}
        if not all(count.isdecimal() for count in counts.values()):
            raise ValueError(text)
        return {name: int(count) for name, count in counts.items()}
    except ValueError as error:
        raise CallError(
            "the splits cannot be read",
            where="--splits",
            found=text,
            required="SPLIT=N,..., such as train=80,val=10,test=20",
        ) from error


def _dry_run(config: GenerateConfig, out: Path, workers: int, as_json: bool) -> None:
    from pliant.generator.runner.estimate import estimate_run
    from pliant.generator.runner.manifest import RunFolder, refuse_changes
    from pliant.generator.runner.plan import plan_run

    folder = RunFolder(out)
    folder.check()
    stored = folder.stored_config()
    if stored is not None:
        refuse_changes(stored, config.resolved(), out)
    plan = plan_run(config, out)
    if not as_json:
        echo(describe_plan(plan, config, out, workers))
    estimate = estimate_run(config, plan, workers)
    document = {
        "sequences": len(plan.tasks),
        "missing": len(plan.missing),
        "frames": plan.frames,
        "estimated_seconds": round(estimate.seconds, 1),
        "estimated_bytes": estimate.bytes,
        "files": estimate.files,
    }
    text = (
        f"Estimate from trials of each tier with {plural(workers, 'worker')}: about "
        f"{duration(estimate.seconds)}, {decimal(estimate.bytes)} in "
        f"{estimate.files:,} files. Nothing was written."
    )
    echo_result(document, text, as_json=as_json)


def describe_plan(plan: Plan, config: GenerateConfig, out: Path, workers: int) -> str:
    """Return the plan in one sentence or two."""
    splits = ", ".join(f"{split} {count}" for split, count in config.counts.items())
    kind = "episodes" if config.episodes else "configurations"
    text = (
        f"{out}: {plural(len(plan.tasks), 'sequence')} ({', '.join(config.tiers)}; per tier "
        f"{splits}) of {plural(config.frames, 'frame')} ({kind}): "
        f"{plural(plan.frames, 'image')} of {config.width}x{config.height}, style {config.style}."
    )
    if plan.finished:
        text += f" {len(plan.finished)} sequences are there already."
    return f"{text} {plural(workers, 'worker')}."


class GenerationDisplay:
    """Shows how far a run is: the plan, a forecast once every tier is measured, and a bar."""

    def __init__(self, bar: Bar, out: Path, workers: int) -> None:
        self._bar, self._out, self._workers = bar, out, workers
        self._begun = self._forecast = False

    def __call__(self, state: RunState) -> None:
        """Show a state; see `generate`."""
        if not self._begun:
            self._begun = True
            self._bar.print(
                f"{self._out}: {len(state.plan.missing)} of {len(state.plan.tasks)} sequences to "
                f"make, {plural(state.frames_wanted, 'image')}, {plural(self._workers, 'worker')}; "
                f"log {state.log}"
            )
        left = None if self._forecast else state.forecast.left()
        if left is not None and left.seconds:
            self._forecast = True
            costs = ", ".join(
                f"{tier} {seconds:.2f} s and {decimal(round(written))}"
                for tier, (seconds, written) in state.forecast.per_image().items()
            )
            self._bar.print(
                f"Measured per image: {costs}; left: about {duration(left.seconds)} and "
                f"{decimal(round(left.bytes))}"
            )
        facts = [f"{decimal(state.memory_bytes)} per worker"] if state.memory_bytes else []
        if state.failures:
            facts.append(f"{state.failures} failed attempts")
        self._bar(state.frames, state.frames_wanted, facts=", ".join(facts))


def _report(summary: Summary, as_json: bool) -> None:
    if as_json:
        document = {
            "out": str(summary.root),
            "sequences": summary.sequences,
            "made": summary.made,
            "frames": summary.frames,
            "bytes": summary.bytes,
            "seconds": round(summary.seconds, 3),
            "failed": [asdict(each) for each in summary.failed],
        }
        echo_json(document)
        return
    if summary.unchanged:
        echo(f"{summary.root} is finished: {plural(summary.sequences, 'sequence')}, none to make.")
        return
    echo(
        f"{summary.root}: {plural(summary.sequences, 'sequence')}, {summary.made} made now "
        f"({plural(summary.frames, 'image')}, {decimal(summary.bytes)}, "
        f"{duration(summary.seconds)})."
    )
    for each in summary.failed:
        last = each.error.splitlines()[-1]
        echo(f"FAILED {each.id} after {plural(each.attempts, 'attempt')}: {last}", err=True)
    if summary.failed:
        echo(
            f"{len(summary.failed)} sequences are missing; tracebacks in "
            f"{summary.root / '.pliant' / 'failures.json'}. The same command tries them again.",
            err=True,
        )
