"""Training Dense Object Nets: from a dataset and a config to a run that can answer."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from contextlib import nullcontext
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

import torch

from pliant.loaders import MixedPairs, PairDataset
from pliant.loaders.frame_store import FrameStore, named_tier
from pliant.models.don.calibration import calibrate, fit_sharpness
from pliant.models.don.loss import don_loss
from pliant.models.don.matcher import CALIBRATION, RUN_FACTS, DonMatcher
from pliant.models.don.validation import draw_validation_pairs, validate
from pliant.models.networks.canonical import CanonicalHead
from pliant.models.networks.descriptor_network import DescriptorNetwork, build_network
from pliant.models.settings import DonSettings
from pliant.models.training.checkpoint import BEST, load_best
from pliant.models.training.loop import Batch, LoopSettings, Progress, step_batches, train
from pliant.models.training.processes import Processes, joined_processes
from pliant.models.training.run_folder import open_run, run_facts, with_tier, write_json
from pliant.spec.dataset import Dataset

RESUMABLE = ("threads", "workers", "cache", "checkpoint_every", "answer")
"""Settings that may differ when a run goes on: they change no step."""


def shipped_recipe(dataset: Dataset, tier: str) -> Path:
    """Return the shipped CPU recipe for a tier: one for ropes, one for cloths.

    Args:
        dataset: The dataset.
        tier: Name of a tier; empty where the dataset has only one.

    Raises:
        CallError: No tier is named and the dataset has several, or there is none of that name.
    """
    kind = named_tier(dataset, with_tier(tier, dataset)).kind
    name = "don-cloth.yaml" if kind == "cloth" else "don-rope.yaml"
    return Path(__file__).parents[1] / "configs" / name


def training_data(dataset: Dataset, settings: DonSettings) -> list[tuple[Dataset, str]]:
    """Return the datasets and tiers that a run trains on, its own first.

    Args:
        dataset: The run's dataset.
        settings: The config, its tier named.
    """
    found = [(dataset, settings.tier)]
    for entry in settings.also:
        path, _, tier = entry.partition("#")
        found.append((Dataset.open(path) if path else dataset, tier or settings.tier))
    return found


class DonTask:
    """What `pliant.models.training.loop.train` needs to know of Dense Object Nets.

    Args:
        dataset: The dataset.
        settings: The config, its tier named.
        run: The run's folder.
        processes: Which process this is.
    """

    network: DescriptorNetwork

    def __init__(
        self, dataset: Dataset, settings: DonSettings, run: Path, processes: Processes
    ) -> None:
        self.settings, self.processes = settings, processes
        self.full_size = dataset.size
        self._size = (settings.width, settings.height)
        cache = run / "cache" if settings.cache else None
        parts = [
            PairDataset(
                of,
                tier,
                settings.split,
                settings.pairs,
                size=self._size,
                seed=settings.seed,
                augmentation=settings.augment,
                cache=cache,
                limit=settings.limit or None,
                orientation=settings.loss.orientation_weight > 0,
            )
            for of, tier in training_data(dataset, settings)
        ]
        self.pairs = parts[0] if len(parts) == 1 else MixedPairs(parts, settings.seed)
        held_out = settings.validation
        self._held_out = FrameStore(dataset, settings.tier, held_out.split, self._size, cache=cache)
        self.validation_pairs = draw_validation_pairs(
            self._held_out, held_out.pairs, held_out.queries, settings.seed
        )
        torch.manual_seed(settings.seed)  # the same first weights in every process
        canonical = None
        if settings.loss.canonical_weight > 0:
            store = parts[0].store
            dim = settings.network.descriptor_dim
            canonical = CanonicalHead.of_object(dim, store.tier.queried, store.material)
        network = build_network(
            settings.network,
            settings.pairs.network_input,
            initial_scale=settings.loss.initial_scale,
            learn_scale=settings.loss.learn_scale,
            orientation=settings.loss.orientation_weight > 0,
            foreground=settings.loss.foreground_weight > 0,
            canonical=canonical,
        )
        self.network = network.to(  # type: ignore[call-overload]
            processes.device,
            memory_format=torch.channels_last,  # which torch's type stub lacks
        )

    def batches(self, start: int, stop: int) -> Iterable[Batch]:
        """Return the batches of steps start to stop - 1 for this process."""
        return step_batches(self.pairs, self.settings, self.processes, start, stop)

    def loss(
        self, batch: Batch, progress: float, generator: torch.Generator
    ) -> tuple[torch.Tensor, Mapping[str, torch.Tensor]]:
        """Return the loss of a batch and its named parts."""
        device = self.processes.device
        batch = {name: tensor.to(device, non_blocking=True) for name, tensor in batch.items()}
        images = batch["image"].flatten(0, 1).contiguous(memory_format=torch.channels_last)
        half = self.settings.precision == "bfloat16"
        with torch.autocast(device.type, torch.bfloat16) if half else nullcontext():
            out = self.network.described(images)
        loss, figures = don_loss(
            out,
            self.network.scale,
            batch,
            self.settings.loss,
            canonical=self.network.canonical,
            progress=progress,
            generator=generator,
        )
        return loss, {**figures, "scale": self.network.scale.detach()}

    def validate(self) -> Mapping[str, float]:
        """Return the errors on the validation pairs, px of the dataset."""
        return validate(self.matcher(), self.validation_pairs, self.full_size)

    def _sharpened(self, matcher: DonMatcher) -> DonMatcher:
        """Return the matcher with a fitted softmax scale, where its loss teaches it none."""
        if self.settings.loss.kind == "contrastive":
            matcher.sharpness = fit_sharpness(matcher, self.validation_pairs)
        return matcher

    def matcher(self, facts: Mapping[str, Any] | None = None) -> DonMatcher:
        """Return a matcher around the network as it is."""
        # One upright look while training: turned copies are for the final answers.
        matcher = DonMatcher(
            self.network,
            self._size,
            self.settings.pairs.network_input,
            replace(self.settings.answer, rotations=1),
            facts=facts,
        )
        return self._sharpened(matcher)

    def calibrated(self, facts: Mapping[str, Any]) -> DonMatcher:
        """Return the final matcher, calibrated on pairs of the validation split."""
        held_out = self.settings.validation
        pairs = draw_validation_pairs(
            self._held_out, held_out.calibration_pairs, held_out.queries, self.settings.seed + 1
        )
        matcher = DonMatcher(
            self.network,
            self._size,
            self.settings.pairs.network_input,
            self.settings.answer,
            facts=facts,
        )
        matcher.calibration = calibrate(matcher, pairs, self.full_size)
        return matcher


def train_don(
    dataset: Dataset,
    run: Path,
    settings: DonSettings,
    *,
    resume: bool = False,
    progress: Progress | None = None,
    stop_at: int | None = None,
) -> dict[str, Any]:
    """Train Dense Object Nets; afterwards `load_matcher(run)` answers.

    Under `torchrun` every process calls this with the same arguments; process 0 writes.

    Args:
        dataset: The dataset.
        run: The run's folder: new or empty, or with `resume` one that was begun.
        settings: The config.
        resume: Go on from the newest checkpoint.
        progress: Told after each step.
        stop_at: Stop after this many steps with a checkpoint, as an interruption would.

    Returns:
        The run's facts, as in `run.json`, with the final validation and calibration figures.

    Raises:
        CallError: The config does not fit the dataset, or the folder is in use.
        TrainingError: Nothing to resume, another config than it began with, or divergence.
    """
    settings = replace(settings, tier=with_tier(settings.tier, dataset))
    if settings.threads:
        torch.set_num_threads(settings.threads)
    with joined_processes() as processes:
        if processes.first:
            open_run(run, settings, resume, RESUMABLE)
        task = DonTask(dataset, settings, run, processes)
        watched = settings.validation
        keep_last = watched.keep == "last"
        loop = LoopSettings.of(settings, watched.every, watched.patience, keep_last=keep_last)
        state = train(
            task,
            run,
            settings.optimiser,
            loop,
            processes,
            resume=resume,
            progress=progress,
            stop_at=stop_at,
        )
        facts = run_facts(dataset, settings, state.step, processes.world) | {
            "loss": settings.loss.kind,
            "network": settings.network.name,
            "descriptor_dim": settings.network.descriptor_dim,
        }
        if processes.first and (run / BEST).is_file():
            load_best(task.network, run)
            matcher = task.calibrated(facts)
            figures = validate(matcher, task.validation_pairs, dataset.size)
            facts["validation"] = figures
            calibration = matcher.calibration
            if calibration is not None:
                write_json(run / CALIBRATION, asdict(calibration))
                facts["calibration"] = dict(calibration.figures or {})
            write_json(run / RUN_FACTS, {k: v for k, v in facts.items() if k != "calibration"})
            from pliant.models.don.report import write_run_report

            write_run_report(run, matcher, task.validation_pairs, state.history, facts)
    return facts
