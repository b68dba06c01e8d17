"""Training Dense Object Nets: from a dataset and a config to a run that can answer."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any, Final, Unpack

import torch

from pliant.loaders import MixedPairs, PairDataset
from pliant.loaders.frame_store import FrameStore, named_tier
from pliant.models.don.calibration import calibrate, fit_sharpness
from pliant.models.don.crossing_training import fit_crossings
from pliant.models.don.crossings import CROSSINGS
from pliant.models.don.familiarity import FAMILIARITY
from pliant.models.don.loading import don_network
from pliant.models.don.loss import don_loss
from pliant.models.don.matcher import DonMatcher
from pliant.models.don.settings import DonSettings
from pliant.models.don.validation import draw_validation_pairs, validate
from pliant.models.networks.canonical import CanonicalHead
from pliant.models.networks.descriptor_network import DescriptorNetwork
from pliant.models.training.checkpoint import save_weights
from pliant.models.training.loop import RunOptions, train_task
from pliant.models.training.processes import Processes
from pliant.models.training.run_folder import CALIBRATION, RUN_FACTS, with_tier, write_json
from pliant.models.training.task import Batch, Task
from pliant.spec.dataset import Dataset

_CHARTED: Final = {
    "RMSE, pooled": "val/rmse_px",
    "RMSE, mean over pairs": "val/rmse_px_mean_over_pairs",
    "median": "val/median_px",
    "network alone, RMSE, pooled": "val/network_rmse_px",
}


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
    for data, tier in settings.further:
        found.append((Dataset.open(data) if data else dataset, tier or settings.tier))
    return found


class DonTask(Task[DonSettings]):
    """Dense Object Nets as `train_task` trains them; see `Task`."""

    network: DescriptorNetwork
    answering = "answer"

    def __init__(
        self, dataset: Dataset, settings: DonSettings, run: Path, processes: Processes
    ) -> None:
        super().__init__(dataset, settings, run, processes)
        data = training_data(dataset, settings)
        self.datasets = [of for of, _ in data]
        parts = [
            PairDataset(
                self.training_frames(of, tier),
                settings.pairs,
                seed=settings.seed,
                augmentation=settings.augment,
                orientation=settings.loss.orientation_weight > 0,
            )
            for of, tier in data
        ]
        self.samples = MixedPairs(parts, settings.seed, settings.batch)
        self.validation_pairs = draw_validation_pairs(
            self.held_out, settings.validation.pairs, settings.validation.queries, settings.seed
        )
        torch.manual_seed(settings.seed)  # the same first weights in every process
        canonical = None
        if settings.loss.canonical_weight > 0:
            store = parts[0].store
            dim = settings.network.descriptor_dim
            canonical = CanonicalHead.of_object(dim, store.tier.queried, store.material)
        network = don_network(settings, canonical)
        self.network = network.to(  # type: ignore[call-overload]
            processes.device,
            memory_format=torch.channels_last,  # which torch's type stub lacks
        )

    def loss(
        self, batch: Batch, progress: float, generator: torch.Generator
    ) -> tuple[torch.Tensor, Mapping[str, torch.Tensor]]:
        """Return the loss of a batch and its named parts; see `Task`."""
        images = batch["image"].flatten(0, 1).contiguous(memory_format=torch.channels_last)
        with self.precision():
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
        # Upright images only while training: other copies are for the final answers.
        upright = self.settings.answer.replace(rotations=1, mirrored=False)
        matcher = self.matcher(self.settings.replace(answer=upright))
        return validate(matcher, self.validation_pairs, self.dataset.size)

    def matcher(self, settings: DonSettings, facts: Mapping[str, Any] | None = None) -> DonMatcher:
        """Return a matcher around the network as it is, not calibrated.

        Args:
            settings: How it answers.
            facts: The run's facts.
        """
        matcher = DonMatcher(self.network, settings, facts=facts)
        if settings.loss.kind == "contrastive":  # this loss learns no scale
            matcher.sharpness = fit_sharpness(matcher, self.validation_pairs)
        return matcher

    def facts(self) -> dict[str, Any]:
        """Return what `run.json` records about the method."""
        network = self.settings.network
        return {
            "loss": self.settings.loss.kind,
            "network": network.name,
            "descriptor_dim": network.descriptor_dim,
        }

    def finish(
        self, run: Path, history: Sequence[Mapping[str, float]], facts: dict[str, Any]
    ) -> None:
        """Calibrate and measure the trained network; see `Task`."""
        watched, size = self.settings.validation, self.dataset.size
        split, whole = watched.split, self.settings.answer.decode == "trace"
        seed, stores = self.settings.seed, self._frames(split, whole=whole)
        final_pairs = draw_validation_pairs(stores[0], watched.pairs, watched.queries, seed)
        share = -(-watched.calibration_pairs // len(stores))
        pairs = [
            pair
            for store in stores
            for pair in draw_validation_pairs(store, share, watched.queries, seed + 1)
        ]
        matcher = self.matcher(self.settings, facts)
        if self.settings.answer.crossings:
            frames = self._frames(self.settings.split, whole=True)
            matcher.reader.crossings = fit_crossings(frames, seed=seed)
            if matcher.reader.crossings is not None:
                save_weights(run / CROSSINGS, matcher.reader.crossings.state_dict())
        matcher.calibration = calibration = calibrate(matcher, pairs, size)
        facts["validation"] = validate(matcher, final_pairs, size)
        write_json(run / CALIBRATION, asdict(calibration))
        bare = [pair.without_masks() for pair in pairs]
        familiarity = matcher.fitted_familiarity([*pairs, *bare])
        write_json(run / FAMILIARITY, familiarity.as_document())
        write_json(run / RUN_FACTS, facts)  # last: a run that has it is finished
        facts["calibration"] = dict(calibration.figures or {})
        from pliant.models.training.run_page import Section, history_chart, write_run_page

        charts = [
            history_chart(history, {"loss": "loss"}, "Training loss"),
            history_chart(history, _CHARTED, "Validation error", "px"),
        ]
        width, height = self.size
        text = (
            "Validation errors of these curves are of the network in training, not calibrated, in "
            f"pictures of {width}x{height}; those above are of the finished run, as it answers."
        )
        write_run_page(run, facts, [Section("Curves", text, charts=charts)])

    def _frames(self, split: str, *, whole: bool) -> list[FrameStore]:
        """Return the frames of a split, the run's own first, then those of `also` that have it.

        Args:
            split: The split.
            whole: At the pictures' own size, where traces read masks and crossings, as answers
                have them; otherwise the frames that the run has decoded already.
        """
        cache = None if whole else self._cache
        return [
            FrameStore(of, tier, split, of.size if whole else self.size, cache=cache)
            for number, (of, tier) in enumerate(training_data(self.dataset, self.settings))
            if number == 0 or any((e.split, e.tier) == (split, tier) for e in of.sequences)
        ]


def train_don(
    dataset: Dataset, run: Path, settings: DonSettings, **options: Unpack[RunOptions]
) -> dict[str, Any]:
    """Train Dense Object Nets; see `train_task`."""
    return train_task(DonTask, dataset, run, settings, options)
