"""Contrastive against distributional, side by side: the same data, network, steps and seeds.

Both train with the shipped CPU recipe but for the loss (`--quick`: a few steps of a small network,
one seed) and answer the test split, on the set of a tier that `don.py` makes. The tier is rope, or
PLIANT_DON_TIER. PLIANT_DON_DATA names a dataset with
that tier to use instead of making one (such as DIR/sets/cloth-1 of `pliant benchmark`),
PLIANT_DON_STEPS the steps of every run, PLIANT_DON_RUNS a folder to keep the runs in, as LOSS-SEED:
what is finished there is not trained again, what was interrupted goes on from its checkpoint (with
other settings it is refused).

rmse_px_{LOSS}_seed_{S}   pooled RMSE on the test split, of the best validated weights
rmse_px_{LOSS}            mean over the seeds
spread_px_{LOSS}          largest less smallest
cpu_s_{LOSS}              CPU seconds of a run, mean over those this call trained from the start
"""

from __future__ import annotations

import os

os.environ.setdefault("OMP_WAIT_POLICY", "PASSIVE")

import tempfile
import time
from pathlib import Path

from don import one_material
from record import Value, main

from pliant.baselines.predict import predict
from pliant.evaluator import evaluate
from pliant.generator.runner.run import generate
from pliant.models import load_matcher
from pliant.models.don.settings import DonSettings
from pliant.models.don.trainer import train_don
from pliant.models.training.checkpoint import latest_checkpoint
from pliant.spec.configuration import read_settings
from pliant.spec.dataset import Dataset

CONFIGS = Path(__file__).parents[1] / "models" / "configs"
SMALL_SPLITS = {"train": 12, "val": 6, "test": 4}
LOSSES = {
    "distributional": ["loss.kind=distributional"],
    "contrastive": ["loss.kind=contrastive", "loss.margin=0.5"],
}
SMALL = ["batch=1", "network={widths: [16, 32, 64], global_blocks: 1, patch: 2}"]
FEW = "validation={every: 10, pairs: 6, queries: 32, calibration_pairs: 2}"


def measure(quick: bool) -> dict[str, Value]:
    """Train every loss with every seed."""
    steps = int(os.environ.get("PLIANT_DON_STEPS", "20" if quick else "400"))
    seeds = (0,) if quick else (0, 1, 2)
    tier = os.environ.get("PLIANT_DON_TIER", "rope")
    recipe = CONFIGS / ("don.yaml" if tier == "rope" else "don-cloth.yaml")
    record: dict[str, Value] = {"steps": steps, "seeds": len(seeds)}
    with tempfile.TemporaryDirectory() as folder:
        scratch = Path(folder)
        data = os.environ.get("PLIANT_DON_DATA")
        if data is None:
            config = one_material(tier)
            if quick:
                config = config.replace(splits=SMALL_SPLITS)
            generate(config, scratch / "set", workers=1 if quick else 2)
            data = str(scratch / "set")
        dataset = Dataset.open(data)
        runs = Path(os.environ.get("PLIANT_DON_RUNS", scratch / "runs"))
        watch = FEW if quick else f"validation.every={max(1, steps // 4)}"
        for loss, choice in LOSSES.items():
            errors, spent = [], []
            for seed in seeds:
                overrides = [f"tier={tier}", f"seed={seed}", f"steps={steps}", watch, *choice]
                settings = read_settings(
                    DonSettings, recipe, [*overrides, *(SMALL if quick else [])]
                )
                run = runs / f"{loss}-{seed}"
                begun = latest_checkpoint(run) is not None
                started = time.process_time()
                # A finished run takes no step more: it is only calibrated again.
                train_don(dataset, run, settings, resume=begun)
                if not begun:
                    spent.append(time.process_time() - started)
                answers = scratch / f"{run.name}.parquet"
                predict(dataset, "test", load_matcher(run), answers)
                errors.append(evaluate(answers, dataset).overall["rmse_px"])
                record[f"rmse_px_{loss}_seed_{seed}"] = errors[-1]
            record[f"rmse_px_{loss}"] = sum(errors) / len(errors)
            record[f"spread_px_{loss}"] = max(errors) - min(errors)
            if spent:
                record[f"cpu_s_{loss}"] = sum(spent) / len(spent)
    return record


if __name__ == "__main__":
    main("don_losses", measure, __doc__)
