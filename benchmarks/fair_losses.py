"""Which loss is better: contrastive as printed or as coded, distributional, canonical head or not.

    python benchmarks/fair_losses.py --out DIR [--config FILE] [--report]

Makes the sets, trains, chooses, and writes `DIR/report.md` and `DIR/report.json`. What is
compared is data: `fair_losses.yaml`. Call it again to continue: it skips what is finished and
resumes what was interrupted, and several calls at the same time share the work. With --report it
only reports on what there is. The whole takes hours; `--quick` takes a few steps of a small
network, which shows that the parts fit.

Every arm has the same number of trials. A trial is the beginning of a training with the random
seed 0; at each rung of steps the best trials, by their RMSE on the validation split, go on. The
last one is trained to the end and repeated with the other seeds. The test split is used once, for
the finished trainings.
"""

from __future__ import annotations

import os

os.environ.setdefault("OMP_WAIT_POLICY", "PASSIVE")

import argparse
import fcntl
import json
import math
import statistics
import time
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Final

import numpy as np
from record import machine

from pliant.baselines.predict import predict
from pliant.evaluator import evaluate
from pliant.generator.config import GenerateConfig
from pliant.generator.runner.run import generate
from pliant.models import load_matcher
from pliant.models.don.settings import DonSettings
from pliant.models.don.trainer import train_don
from pliant.models.training.checkpoint import latest_checkpoint, read_history
from pliant.models.training.run_folder import RUN_FACTS, read_run_json
from pliant.spec.answers import Answers
from pliant.spec.configuration import Settings, merged, read_mapping, settings_from
from pliant.spec.dataset import Dataset
from pliant.spec.frame import Pair
from pliant.spec.io.jsonfiles import write_json

CONFIG: Final = Path(__file__).with_suffix(".yaml")
CHOICE: Final = "val/rmse_px"
"""The figure that chooses among trials."""

SMALL: Final = {
    "common": {"width": 160, "height": 120},
    "settings": {
        "batch": 1,
        "network": {"widths": [16, 32, 64], "global_blocks": 1},
        "validation": {"every": 4, "pairs": 4, "queries": 16, "calibration_pairs": 4},
    },
    "rungs": [{"steps": 4, "kept": 1}],
    "steps": 8,
    "seeds": 1,
}


class Arm(Settings):
    """A loss.

    Attributes:
        settings: What makes it this arm.
        trials: What is tried; settings each.
    """

    settings: Mapping[str, Any]
    trials: tuple[Mapping[str, Any], ...]


class Rung(Settings):
    """Where trials are compared.

    Attributes:
        steps: After how many steps.
        kept: How many go on.
    """

    steps: int
    kept: int


class Stage(Settings):
    """A part of the work.

    Attributes:
        tier: The tier.
        arms: Names of arms.
    """

    tier: str
    arms: tuple[str, ...]


class Study(Settings):
    """The whole comparison.

    Attributes:
        name: Its name.
        sets: Name -> config of a dataset; a tier's are TIER and TIER-test.
        settings: What all trainings have.
        tiers: Tier -> what its trainings have in addition.
        arms: Name -> arm.
        rungs: Where trials are compared, by rising steps.
        steps: Steps of a whole training.
        seeds: Trainings with the chosen settings.
        queue: The work, what informs most first.
    """

    name: str
    sets: Mapping[str, GenerateConfig]
    settings: Mapping[str, Any]
    tiers: Mapping[str, Mapping[str, Any]]
    arms: Mapping[str, Arm]
    rungs: tuple[Rung, ...]
    steps: int
    seeds: int
    queue: tuple[Stage, ...]


@dataclass(frozen=True)
class SetToMake:
    """A dataset of the comparison."""

    name: str

    @property
    def folder(self) -> Path:
        """Where it is, below the folder of all."""
        return Path("sets") / self.name

    def made(self, out: Path) -> bool:
        """Return whether it is finished."""
        return (out / self.folder).with_suffix(".made").is_file()

    def run(self, study: Study, out: Path) -> None:
        """Generate it."""
        generate(study.sets[self.name], out / self.folder, workers=1)
        (out / self.folder).with_suffix(".made").touch()


@dataclass(frozen=True)
class Training:
    """A training of an arm on a tier, up to a number of steps."""

    tier: str
    arm: str
    trial: int
    seed: int
    steps: int

    @property
    def folder(self) -> Path:
        """Where it is, below the folder of all."""
        return Path("runs") / self.tier / self.arm / f"trial-{self.trial}-seed-{self.seed}"

    def run(self, study: Study, out: Path) -> None:
        """Train up to its steps."""
        arm = study.arms[self.arm]
        values: Mapping[str, Any] = study.settings
        for more in (study.tiers[self.tier], arm.settings, arm.trials[self.trial]):
            values = merged(values, more)
        own = {"tier": self.tier, "seed": self.seed, "steps": study.steps}
        own["cache_dir"] = str(out / "cache" / self.tier)
        settings = settings_from(DonSettings, {**values, **own})
        data, folder = Dataset.open(out / "sets" / self.tier), out / self.folder
        begun = latest_checkpoint(folder) is not None
        train_don(data, folder, settings, resume=begun, stop_at=self.steps)


def read_study(path: Path, quick: bool) -> Study:
    """Read the YAML file; every set takes `common` and then its own values."""
    values = merged(read_mapping(path), SMALL if quick else {})
    common = values.pop("common")
    for name, own in values["sets"].items():
        labels = {"id": f"{values['name']}-{name}", "title": f"{values['name']}: {name}"}
        few = {"splits": dict.fromkeys(own["splits"], 4)} if quick else {}
        values["sets"][name] = merged(merged({**labels, **common}, own), few)
        values["sets"][name]["splits"] = few.get("splits", own["splits"])
    return settings_from(Study, values, path=path)


def work(study: Study, out: Path) -> None:
    """Do whatever is left to do."""
    while todo := list(open_jobs(study, out)):
        for job in todo:
            with claimed(out / job.folder) as mine:
                if mine:
                    print(f"{time.strftime('%H:%M:%S')} {job}", flush=True)
                    job.run(study, out)
                    break
        else:
            time.sleep(30)  # other calls are at it, and what follows needs their results


def open_jobs(study: Study, out: Path) -> Iterator[Training | SetToMake]:
    """Give out what can be done now, in the order of the queue."""
    for stage in study.queue:
        sets = [SetToMake(stage.tier), SetToMake(f"{stage.tier}-test")]
        yield from (each for each in sets if not each.made(out))
        if sets[0].made(out):
            for arm in stage.arms:
                yield from _open_trainings(study, out, stage.tier, arm)


def _open_trainings(study: Study, out: Path, tier: str, arm: str) -> Iterator[Training]:
    left = list(range(len(study.arms[arm].trials)))
    for rung in study.rungs:
        tried = {trial: Training(tier, arm, trial, 0, rung.steps) for trial in left}
        errors = {trial: error(out, each) for trial, each in tried.items()}
        missing = [tried[trial] for trial, found in errors.items() if found == math.inf]
        if missing:
            yield from missing
            return
        left = sorted(left, key=errors.__getitem__)[: rung.kept]
    for seed in range(study.seeds):
        training = Training(tier, arm, left[0], seed, study.steps)
        if not read_run_json(out / training.folder / RUN_FACTS):
            yield training


def error(out: Path, training: Training) -> float:
    """Return the validation error of a training after its steps, infinite before."""
    return dict(curve(out / training.folder)).get(training.steps, math.inf)


def curve(run: Path) -> list[tuple[int, float]]:
    """Return the validation error of a training by its steps."""
    return [(int(each["step"]), each[CHOICE]) for each in read_history(run) if CHOICE in each]


@contextmanager
def claimed(run: Path) -> Iterator[bool]:
    """Say whether a training is this process's to do; no other has it until the end."""
    run.parent.mkdir(parents=True, exist_ok=True)
    with run.with_suffix(".lock").open("w") as lock:
        try:
            fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            yield False
        else:
            yield True


def scored(out: Path, tier: str, run: Path) -> dict[str, float] | None:
    """Return the figures of a finished training on the test split, px; None before it is finished.

    `rmse_px` and `symmetric_rmse_px` as it answers; `argmax_rmse_px` of its most probable pixels;
    `blank_rmse_px` where it sees the same masks and no picture.
    """
    found: dict[str, float] = read_run_json(run / "test.json")
    if found or not read_run_json(run / RUN_FACTS):
        return found or None
    data = Dataset.open(out / "sets" / f"{tier}-test")
    matcher = load_matcher(run)
    for label, method, decode in (
        ("", matcher, "median"),
        ("argmax_", matcher, "argmax"),
        ("blank_", Blank(matcher), "median"),
    ):
        matcher.settings = matcher.settings.replace(decode=decode)
        answers = run / f"{label}test.parquet"
        predict(data, "test", method, answers)
        figures = evaluate(answers, data).overall
        found[f"{label}rmse_px"] = figures["rmse_px"]
        found[f"{label}median_px"] = figures["median_px"]
        if not label:
            found["symmetric_rmse_px"] = figures.get("symmetric_rmse_px", figures["rmse_px"])
    write_json(run / "test.json", found)
    return found


@dataclass(frozen=True)
class Blank:
    """A method that is given the masks, and one grey for every picture."""

    method: Any
    name = "blank"

    def describe(self) -> Mapping[str, Any]:
        """Return what the method says of itself."""
        return {**self.method.describe(), "pictures": "blank"}

    def answer(self, pair: Pair) -> Answers:
        """Answer as the method does without pictures."""
        source, target = (
            view.replace(rgb=np.full_like(view.rgb, 128), key=f"{view.key} blank")
            for view in (pair.source, pair.target)
        )
        answers: Answers = self.method.answer(replace(pair, source=source, target=target))
        return answers


def report(study: Study, out: Path) -> None:
    """Write what was tried, chosen and reached."""
    shown = ("rmse_px", "median_px", "symmetric_rmse_px", "argmax_rmse_px", "blank_rmse_px")
    lines = [f"# {study.name}", "", f"{study.steps} steps; px; {machine()['machine']}.", ""]
    lines += ["| tier | arm | RMSE by seed | " + " | ".join(shown) + " |", "|---" * 8 + "|"]
    trials = ["", "| tier | arm | training | validation RMSE by steps |", "|---|---|---|---|"]
    document: dict[str, Any] = {**machine(), "steps": study.steps, "arms": {}}
    for tier, name in ((stage.tier, arm) for stage in study.queue for arm in stage.arms):
        runs = sorted((out / "runs" / tier / name).glob("trial-*-seed-*/"))
        scores = {run.name: score for run in runs if (score := scored(out, tier, run))}
        curves = {run.name: curve(run) for run in runs}
        for run, points in curves.items():
            steps = ", ".join(f"{step}: {error:.1f}" for step, error in points)
            tried = json.dumps(study.arms[name].trials[int(run.split("-")[1])])
            trials.append(f"| {tier} | {name} | {run} `{tried}` | {steps} |")
        document["arms"][f"{tier}/{name}"] = {"test": scores, "validation": curves}
        if scores:
            each = ", ".join(f"{score['rmse_px']:.1f}" for score in scores.values())
            means = (statistics.mean(score[key] for score in scores.values()) for key in shown)
            cells = [tier, name, each, *(f"{mean:.1f}" for mean in means)]
            lines.append(f"| {' | '.join(cells)} |")
    (out / "report.md").write_text("\n".join(lines + trials) + "\n")
    write_json(out / "report.json", document)


def main() -> None:
    """Read the command line and do the work."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--out", type=Path, required=True, help="folder of sets and trainings")
    parser.add_argument("--config", type=Path, default=CONFIG, help="the comparison")
    parser.add_argument("--report", action="store_true", help="report on what there is, and end")
    parser.add_argument("--quick", action="store_true", help="a few steps of a small network")
    arguments = parser.parse_args()
    study, out = read_study(arguments.config, arguments.quick), arguments.out.absolute()
    if not arguments.report:
        work(study, out)
    report(study, out)


if __name__ == "__main__":
    main()
