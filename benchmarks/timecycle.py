"""Following points through rope episodes without labels: what training brings, and what limits it.

Makes rope episodes of 320x240 and trains by the shipped recipe; `--quick` trains far too little to
be good: its errors show that the pieces fit, not what a method can do. Every encoder
is read in the way that suits it, chosen on the validation episodes that it is measured on; test
episodes are those of the benchmark. Errors are in pixels of a picture 640 wide.

`--data` and `--run` use what exists: a run that is finished is not trained again, an interrupted
one goes on. Without `--don` the row supervised is left out.

overhead_ratio        CPU time of loader, patches, encoder, affinities, localiser, losses, forward
                      and backward, over that of the encoder on the same pictures and the same
                      affinities, with a loss of one sum
rmse_px_10, _20       of TimeCycle, RMSE that many frames after the query; late_px is the mean over
                      the last half of the stretches. With a prefix, of other rows: identity_,
                      untrained_, and the ceilings supervised_ (the DON as it is) and oracle_
                      (descriptors computed from the true place along the rope)
"""

from __future__ import annotations

import os

# Waiting threads sleep: CPU time is then work, also where other programs run as well.
os.environ.setdefault("OMP_WAIT_POLICY", "PASSIVE")

import json
import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import Final

import numpy as np
import torch
from overhead import overhead_ratio
from record import Value, main

from pliant.generator.config import GenerateConfig
from pliant.generator.runner.run import generate
from pliant.loaders.frame_store import FrameStore
from pliant.models import load_matcher
from pliant.models.timecycle.matcher import TimeCycleMatcher
from pliant.models.timecycle.network import affinity
from pliant.models.timecycle.settings import TimeCycleSettings
from pliant.models.timecycle.trainer import TimeCycleTask, train_timecycle
from pliant.models.timecycle.validation import (
    Track,
    errors_over_time,
    figures,
    track_identity,
    track_with,
)
from pliant.models.training.checkpoint import latest_checkpoint
from pliant.models.training.processes import Processes
from pliant.models.training.run_folder import RUN_FACTS, read_run_json
from pliant.spec.configuration import read_mapping, read_settings
from pliant.spec.dataset import Dataset
from pliant.spec.frame import Frame

RECIPE: Final = Path(__file__).parents[1] / "models" / "configs" / "timecycle.yaml"
LOOK: Final = {
    "materials": 0,
    "object_hue": (-0.25, 0.5),
    "rope_colourings": {"solid": 0.4, "tracer": 0.6},
    "tables": {"plain": 0.35, "mottled": 0.65},
}
ROPE: Final = {
    "frame_rate_hz": 15,
    "substeps": 96,
    "hand_speed_m_s": (0.3, 0.6),
    "lift_m": (0.03, 0.1),
}
SMALL: Final = {"train": 2, "val": 2}
LARGE: Final = {"train": 150, "val": 24}
QUICK: Final = (
    "batch=1",
    "validation.clips=1",
    "validation.every=4",
    "optimiser.warmup=2",
    "propagation.chosen=false",
)
_CENTRES: Final = 64
_ORACLE_WIDTH: Final = 1.5
ALONE: Final = Processes(0, 1, torch.device("cpu"))


class Oracle(TimeCycleMatcher):
    """Propagation with descriptors of the true arc length: a bump over 64 places along the rope.

    Args:
        task: Whose settings and validation frames it has.
    """

    def __init__(self, task: TimeCycleTask) -> None:
        super().__init__(task.network, task.settings)
        self._store: FrameStore = task.held_out
        self._numbers = {frame.key: number for number, frame in enumerate(self._store.frames)}

    def read_by(self, propagation: object) -> Oracle:
        """Return the same descriptors, read in another way."""
        other = object.__new__(Oracle)
        other.__dict__ |= self.__dict__
        other.settings = self.settings.replace(propagation=propagation)
        return other

    def _encode(self, view: Frame) -> torch.Tensor:
        true = self._store.view(self._numbers[view.key])
        along = self._store.material[true.visible, 0]
        height, width = self.size[1] // self.stride, self.size[0] // self.stride
        cell = (true.uv_px[true.visible] / self.stride).astype(int).clip(0, (width - 1, height - 1))
        total = np.zeros((2, height, width))
        np.add.at(total, (0, cell[:, 1], cell[:, 0]), along)
        np.add.at(total, (1, cell[:, 1], cell[:, 0]), 1)
        place = _CENTRES * total[0] / total[1].clip(1)
        bump = np.exp(-((place - np.arange(_CENTRES)[:, None, None]) ** 2) / 2 / _ORACLE_WIDTH**2)
        bump[:, total[1] == 0] = 0
        described = torch.from_numpy(bump.astype(np.float32))
        return torch.nn.functional.normalize(described, dim=0)


def overhead(task: TimeCycleTask, rounds: int) -> float:
    """Return CPU time of a whole step over that of its encoder and affinities."""
    settings, network = task.settings, task.network
    patches, lookups = settings.clips.patches, affinities_a_clip(settings.clips.length)
    side = settings.stride * network.cells
    for _ in task.batches(0, rounds + 1):
        pass  # these frames are in the store, as after the first minutes of a run

    def bare(batch: dict[str, torch.Tensor]) -> Callable[[], torch.Tensor]:
        images = batch["image"].flatten(0, 1)
        cut = torch.rand(settings.batch * patches, images.shape[1], side, side)

        def alone() -> torch.Tensor:
            frames = task.encode(images).unflatten(0, (settings.batch, -1))
            patch = task.encode(cut).flatten(2).transpose(1, 2)
            each = frames[:, 0].repeat_interleave(patches, dim=0)
            found = [affinity(patch, each, network.temperature) for _ in range(lookups)]
            return torch.stack([each.square().sum() for each in found]).sum()

        return alone

    return overhead_ratio(task, rounds, bare)


def affinities_a_clip(length: int) -> int:
    """Return how many affinities each patch of a clip takes: cycles back, forward, skips, self."""
    longest = length - 1
    return longest + longest * (longest + 1) // 2 + 2 * max(1, longest - 1) + 1


def episodes(folder: Path, quick: bool) -> Path:
    """Make rope episodes in a folder and return it."""
    config = GenerateConfig(
        tiers=("rope",), splits=SMALL if quick else LARGE, frames=45, episodes=True,
        gripper=True, width=320, height=240, style="raster", seed=2027, look=LOOK, rope=ROPE,
    )  # fmt: skip
    generate(config, folder, workers=1 if quick else 2)
    return folder


def errors(task: TimeCycleTask, prefix: str, track: Track) -> dict[str, Value]:
    """Return the figures of a method on the validation stretches."""
    found = figures(errors_over_time(track, task.stretches))
    listed = {f"{prefix}rmse_px_{k}": found[f"rmse_px_{k}"] for k in (10, 20)}
    return {**listed, f"{prefix}late_px": found["criterion_px"]}


def measure(
    quick: bool, data: Path | None, run: Path | None, don: Path | None, steps: int | None
) -> dict[str, Value]:
    """Make, train, track."""
    torch.set_num_threads(1)
    steps = steps or (4 if quick else 700)
    changes = (f"steps={steps}", "threads=1", "tier=rope", *(QUICK if quick else ()))
    with tempfile.TemporaryDirectory() as folder:
        scratch = Path(folder)
        dataset = Dataset.open(data or episodes(scratch / "set", quick))
        run = run or scratch / "run"
        settings = read_settings(TimeCycleSettings, RECIPE, changes)
        if not read_run_json(run / RUN_FACTS):
            train_timecycle(dataset, run, settings, resume=latest_checkpoint(run) is not None)
        task = TimeCycleTask(dataset, settings, scratch / "watch", ALONE)
        untrained = TimeCycleMatcher(task.network, settings)
        trained = load_matcher(run)
        assert isinstance(trained, TimeCycleMatcher)
        record = errors(task, "", track_with(trained)) | errors(task, "identity_", track_identity)
        for name, matcher in (("untrained_", untrained), ("oracle_", Oracle(task))):
            record |= errors(task, name, track_with(task.read_out(matcher)))
        if don is not None:
            network = read_mapping(don / "config.yaml")["network"] | {"pretrained": str(don)}
            begun = (f"network={json.dumps(network)}", "lift=8")
            settings = read_settings(TimeCycleSettings, RECIPE, (*begun, *changes))
            supervised = TimeCycleTask(dataset, settings, scratch / "supervised", ALONE)
            matcher = TimeCycleMatcher(supervised.network, settings)
            track = track_with(supervised.read_out(matcher))
            record |= errors(supervised, "supervised_", track)
        record["overhead_ratio"] = overhead(task, 3 if quick else 15)
        record["train_episodes"] = sum(s.split == "train" for s in dataset.sequences)
    return record


if __name__ == "__main__":
    arguments = {
        "--data": {"type": Path, "help": "a dataset of rope episodes"},
        "--run": {"type": Path, "help": "the folder of the run"},
        "--don": {"type": Path, "help": "a trained network of ropes: models/shipped/don-rope"},
        "--steps": {"type": int, "help": "steps of the run"},
    }
    main("timecycle", measure, __doc__, arguments)
