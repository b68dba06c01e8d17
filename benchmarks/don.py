"""Dense Object Nets on a tier: what a step costs beyond the network, and how well it does.

Makes a set of a tier (unseen configurations in a material seen in training, a camera from above),
trains with the shipped CPU recipe, answers the
test split with the run and with SIFT, SURF and ORB, and scores all four by the `standard`
protocol. `--quick` trains far too little to be good: its errors show that the pieces fit, not what
the method can do.

The tier is rope, or PLIANT_DON_TIER. To use what exists: PLIANT_DON_DATA names a dataset with
that tier (such as DIR/sets/rope of `pliant benchmark`), PLIANT_DON_RUN a finished run on it
(otherwise it is trained, with PLIANT_DON_STEPS steps).

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

import statistics
import tempfile
import time
from pathlib import Path

import torch
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

CONFIGS = Path(__file__).parents[1] / "models" / "configs"
CLASSICAL = ("sift", "surf", "orb")
SMALL = {"train": 12, "val": 4, "test": 4}
QUICK = [
    "steps=40",
    "batch=2",
    "network.widths=[16, 32, 64]",
    "optimiser.warmup=10",
    "validation={every: 40, pairs: 6, queries: 32, calibration_pairs: 8}",
]


def one_material(tier: str) -> GenerateConfig:
    """Return a set of configurations in one material, seen from above."""
    above, counts = CameraSettings(top=1, oblique=0), {"train": 300, "val": 30, "test": 30}
    if tier == "rope":
        above = above.replace(fov_deg=(48, 50), distance_m=(1.38, 1.45))
        counts = {"train": 3000, "val": 60, "test": 60}
    look = AppearanceSettings(materials=1)
    return GenerateConfig(
        tiers=(tier,), splits=counts, seed=2026, style="raster", look=look, camera=above
    )


def overhead_ratio(dataset: Dataset, settings: DonSettings, run: Path, rounds: int) -> float:
    """Return CPU time of a whole step over that of the network alone, the median of rounds."""
    task = DonTask(dataset, settings, run, Processes(0, 1, torch.device("cpu")))
    generator = torch.Generator().manual_seed(0)
    for _ in task.batches(0, len(task.samples) // settings.batch + 1):
        pass  # every frame is in the store, as after the first minutes of a run
    ratios = []
    for step in range(rounds + 1):
        started = time.process_time()
        batch = next(iter(task.batches(step, step + 1)))
        loss, _ = task.loss(batch, 0.0, generator)
        loss.backward()
        whole = time.process_time() - started
        images = batch["image"].flatten(0, 1).contiguous(memory_format=torch.channels_last)
        started = time.process_time()
        with task.precision():
            descriptors = task.network(images)
        descriptors.sum().backward()
        ratios.append(whole / (time.process_time() - started))
    return statistics.median(ratios[1:])  # the first one warms up


def scored(dataset: Dataset, method: str, matcher: object, folder: Path) -> Scores:
    """Answer the test split and score it."""
    path = folder / f"{method}.parquet"
    predict(dataset, "test", matcher, path)  # type: ignore[arg-type]
    return evaluate(path, dataset)


def measure(quick: bool) -> dict[str, Value]:
    """Make, train, answer, score."""
    tier = os.environ.get("PLIANT_DON_TIER", "rope")
    recipe_file = CONFIGS / ("don-rope.yaml" if tier == "rope" else "don-cloth.yaml")
    with tempfile.TemporaryDirectory() as folder:
        scratch = Path(folder)
        data = os.environ.get("PLIANT_DON_DATA")
        if data is None:
            config = one_material(tier)
            if quick:
                few = QuerySettings(pairs_per_sequence=1)
                config = config.replace(splits=SMALL, queries=few)
            generate(config, scratch / "set", workers=1 if quick else 2)
            data = str(scratch / "set")
        dataset = Dataset.open(data)
        steps = os.environ.get("PLIANT_DON_STEPS")
        overrides = [f"tier={tier}", *(QUICK if quick else [])] + (
            [f"steps={steps}"] if steps else []
        )
        settings = read_settings(DonSettings, recipe_file, overrides)
        timed = read_settings(DonSettings, recipe_file, [f"tier={tier}", "limit=12"])
        ratio = overhead_ratio(dataset, timed, scratch / "timing", 3 if quick else 15)
        run = Path(os.environ.get("PLIANT_DON_RUN", scratch / "run"))
        started = time.process_time()
        if not run.exists():
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
