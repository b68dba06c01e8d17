"""Dense Object Nets on ropes: what a step costs beyond the network, and how well it does.

Makes a set of ropes (unseen configurations in a material seen in training, a camera from above),
trains with the shipped CPU recipe, answers the
test split with the run and with SIFT, SURF and ORB, and scores all four by the `standard`
protocol. `--quick` trains far too little to be good: its errors show that the pieces fit, not what
the method can do.

overhead_ratio           CPU time of loader, network and loss, forward and backward, over that of
                         the network alone with a loss of one sum
rmse_px                  pooled over points visible in both frames
rmse_px_mean_over_pairs  mean over pairs of each pair's RMSE
median_px                median error
best_classical_rmse_px   lowest of SIFT, SURF and ORB
ece                      expected calibration error of P(error <= 8 px)
"""

from __future__ import annotations

import os

# Waiting threads sleep: CPU time is then work, also where other programs run as well.
os.environ.setdefault("OMP_WAIT_POLICY", "PASSIVE")

import tempfile
import time
from collections.abc import Callable
from pathlib import Path

import torch
from overhead import overhead_ratio
from record import Value, main

from pliant.baselines import METHODS
from pliant.baselines.predict import predict
from pliant.evaluator import Scores, evaluate
from pliant.generator.config import GenerateConfig, QuerySettings
from pliant.generator.runner.run import generate
from pliant.generator.settings import AppearanceSettings, CameraSettings
from pliant.models import load_matcher
from pliant.models.don.settings import DonSettings
from pliant.models.don.trainer import DonTask, train_don
from pliant.models.training.processes import Processes
from pliant.spec.configuration import read_settings
from pliant.spec.dataset import Dataset

RECIPE = Path(__file__).parents[1] / "models" / "configs" / "don-rope.yaml"
CLASSICAL = ("sift", "surf", "orb")
SMALL = {"train": 12, "val": 4, "test": 4}
QUICK = [
    "steps=40",
    "batch=2",
    "network.widths=[16, 32, 64]",
    "optimiser.warmup=10",
    "validation={every: 40, pairs: 6, queries: 32, calibration_pairs: 8}",
]


ONE_MATERIAL = GenerateConfig(
    tiers=("rope",),
    splits={"train": 3000, "val": 60, "test": 60},
    seed=2026,
    style="raster",
    look=AppearanceSettings(materials=1),
    camera=CameraSettings(top=1, oblique=0, fov_deg=(48, 50), distance_m=(1.38, 1.45)),
)


def overhead(dataset: Dataset, settings: DonSettings, run: Path, rounds: int) -> float:
    """Return CPU time of a whole step over that of the network alone."""
    task = DonTask(dataset, settings, run, Processes(0, 1, torch.device("cpu")))
    for _ in task.batches(0, len(task.samples) // settings.batch + 1):
        pass  # every frame is in the store, as after the first minutes of a run

    def bare(batch: dict[str, torch.Tensor]) -> Callable[[], torch.Tensor]:
        images = batch["image"].flatten(0, 1).contiguous(memory_format=torch.channels_last)

        def alone() -> torch.Tensor:
            with task.precision():
                return task.network(images).sum()

        return alone

    return overhead_ratio(task, rounds, bare)


def scored(dataset: Dataset, method: str, matcher: object, folder: Path) -> Scores:
    """Answer the test split and score it."""
    path = folder / f"{method}.parquet"
    predict(dataset, "test", matcher, path)  # type: ignore[arg-type]
    return evaluate(path, dataset)


def measure(quick: bool) -> dict[str, Value]:
    """Make, train, answer, score."""
    with tempfile.TemporaryDirectory() as folder:
        scratch = Path(folder)
        config = ONE_MATERIAL
        if quick:
            config = config.replace(splits=SMALL, queries=QuerySettings(pairs_per_sequence=1))
        generate(config, scratch / "set", workers=1 if quick else 2)
        dataset = Dataset.open(scratch / "set")
        settings = read_settings(DonSettings, RECIPE, ["tier=rope", *(QUICK if quick else [])])
        timed = read_settings(DonSettings, RECIPE, ["tier=rope", "limit=12"])
        ratio = overhead(dataset, timed, scratch / "timing", 3 if quick else 15)
        run = scratch / "run"
        started = time.process_time()
        train_don(dataset, run, settings)
        trained_s = time.process_time() - started
        learned = scored(dataset, "don", load_matcher(run), scratch).overall
        classical = {
            name: scored(dataset, name, METHODS[name](), scratch).overall["rmse_px"]
            for name in CLASSICAL
        }
        record: dict[str, Value] = {"overhead_ratio": ratio, "train_cpu_s": trained_s}
        for name in ("rmse_px", "rmse_px_mean_over_pairs", "median_px", "pck_8px", "ece"):
            record[name] = learned.get(name)
        record |= {f"{name}_rmse_px": value for name, value in classical.items()}
        record["best_classical_rmse_px"] = min(classical.values())
        record["train_sequences"] = sum(s.split == "train" for s in dataset.sequences)
    return record


if __name__ == "__main__":
    main("don", measure, __doc__)
