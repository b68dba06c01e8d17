"""TimeCycle on rope episodes: what a step costs beyond encoder and affinity, and how well it does.

Makes rope episodes of 320x240, trains with the shipped CPU recipe, and tracks points through
validation episodes next to staying put (identity), the middle of the mask (centroid) and the same
network untrained, all with the same propagation. `--quick` trains far too little to be good: its
errors show that the pieces fit, not what the method can do. Errors are in pixels of a picture
640 wide.

To use what exists: PLIANT_TIMECYCLE_DATA names a dataset of rope episodes, PLIANT_TIMECYCLE_RUN a
finished run on it (otherwise it is trained).

overhead_ratio       CPU time of loader, patches, encoder, affinities, localiser and losses, forward
                     and backward, over that of the encoder on the same pictures and the same
                     affinities, with a loss of one sum
rmse_px_10, _20      RMSE that many frames after the query, and of the rivals: identity_,
                     centroid_, untrained_
"""

from __future__ import annotations

import os

# Waiting threads sleep: CPU time is then work, also where other programs run as well.
os.environ.setdefault("OMP_WAIT_POLICY", "PASSIVE")

import statistics
import tempfile
import time
from pathlib import Path

import torch
from record import Value, main

from pliant.generator.config import GenerateConfig
from pliant.generator.runner.run import generate
from pliant.models import load_matcher
from pliant.models.timecycle.affinity import affinity
from pliant.models.timecycle.matcher import TimeCycleMatcher
from pliant.models.timecycle.settings import TimeCycleSettings
from pliant.models.timecycle.trainer import TimeCycleTask, train_timecycle
from pliant.models.training.processes import Processes
from pliant.spec.configuration import read_settings
from pliant.spec.dataset import Dataset

RECIPE = Path(__file__).parents[1] / "models" / "configs" / "timecycle.yaml"
SMALL = {"train": 2, "val": 2}
LARGE = {"train": 36, "val": 8}
QUICK = ["steps=16", "batch=2", "validation.clips=2", "validation.every=16", "optimiser.warmup=4"]


def overhead_ratio(task: TimeCycleTask, rounds: int) -> float:
    """Return CPU time of a whole step over that of its encoder and affinities, by the median."""
    settings, network = task.settings, task.network
    generator = torch.Generator().manual_seed(0)
    lookups = affinities_a_clip(settings.clips.length)
    for _ in task.batches(0, rounds + 1):
        pass  # these frames are in the store, as after the first minutes of a run
    ratios = []
    for step in range(rounds + 1):
        started = time.process_time()
        batch = next(iter(task.batches(step, step + 1)))
        loss, _ = task.loss(batch, 0.0, generator)
        loss.backward()
        whole = time.process_time() - started
        images = batch["image"].flatten(0, 1)
        side = 8 * network.cells
        patches = settings.batch * settings.clips.patches
        cut = torch.rand(patches, 3, side, side)
        started = time.process_time()
        frames = task.encode(images).unflatten(0, (settings.batch, -1))
        patch = task.encode(cut).flatten(2).transpose(1, 2)
        each = frames[:, 0].repeat_interleave(settings.clips.patches, dim=0)
        total = torch.stack(
            [affinity(patch, each, network.temperature).square().sum() for _ in range(lookups)]
        ).sum()
        total.backward()
        ratios.append(whole / (time.process_time() - started))
        network.zero_grad(set_to_none=True)
    return statistics.median(ratios[1:])  # the first one warms up


def affinities_a_clip(length: int) -> int:
    """Return how many affinities each patch of a clip takes: cycles back, forward, skips, self."""
    longest = length - 1
    return longest + longest * (longest + 1) // 2 + 2 * max(1, longest - 1) + 1


def measure(quick: bool) -> dict[str, Value]:
    """Make, train, track."""
    with tempfile.TemporaryDirectory() as folder:
        scratch = Path(folder)
        data = os.environ.get("PLIANT_TIMECYCLE_DATA")
        if data is None:
            config = GenerateConfig(
                tiers=("rope",),
                splits=SMALL if quick else LARGE,
                frames=48 if quick else 96,
                episodes=True,
                width=320,
                height=240,
                style="raster",
                seed=21,
            )
            generate(config, scratch / "set", workers=1 if quick else 2)
            data = str(scratch / "set")
        dataset = Dataset.open(data)
        settings = read_settings(TimeCycleSettings, RECIPE, ["threads=1", "tier=rope"])
        torch.set_num_threads(1)
        alone = Processes(0, 1, torch.device("cpu"))
        few = settings.replace(limit=2)
        ratio = overhead_ratio(
            TimeCycleTask(dataset, few, scratch / "timing", alone), 3 if quick else 15
        )
        run = Path(os.environ.get("PLIANT_TIMECYCLE_RUN", scratch / "run"))
        started = time.process_time()
        if not run.exists():
            if quick:
                settings = read_settings(TimeCycleSettings, RECIPE, ["tier=rope", *QUICK])
            train_timecycle(dataset, run, settings)
        trained_s = time.process_time() - started
        matcher = load_matcher(run)
        if not isinstance(matcher, TimeCycleMatcher):
            raise SystemExit(f"{run} is not a run of TimeCycle")
        task = TimeCycleTask(dataset, matcher.settings, scratch / "watch", alone)
        curves = task.guard(matcher).curves
        record: dict[str, Value] = {"overhead_ratio": ratio, "train_cpu_s": trained_s}
        for method, curve in curves.items():
            prefix = "" if method == "trained" else f"{method}_"
            record |= {f"{prefix}rmse_px_{k}": curve[k - 1] for k in (10, 20)}
        record["train_episodes"] = sum(s.split == "train" for s in dataset.sequences)
    return record


if __name__ == "__main__":
    main("timecycle", measure, __doc__)
