"""Settings that every training run has: optimiser, validation, size, steps, processes."""

from __future__ import annotations

from typing import Annotated, Literal, TypeVar

from pliant.spec.configuration import Settings
from pliant.spec.constraints import Bounds, Count, Natural, NonNegative, Positive

BelowOne = Annotated[float, Bounds(0, 1, below=True)]
BatchSize = Annotated[int, Bounds(1, 4096)]
Channels = Annotated[int, Bounds(1, 1024)]
"""Channels of a layer or descriptor. The bounds refuse a mistyped or hostile config before its
network takes the memory of the machine."""

Precision = Literal["auto", "float32", "bfloat16"]


class OptimiserSettings(Settings):
    """The optimiser and its learning rate schedule.

    Attributes:
        kind: `adamw`, or `muon` for the layers' weights (`models/training/optimiser.py`) and AdamW
            for the rest.
        learning_rate: AdamW's highest value.
        matrix_rate: Muon's highest value; it follows the same schedule.
        weight_decay: Decoupled weight decay.
        beta1: Share kept, each step, of the running mean of the gradient.
        schedule: `cosine` to zero, `step` (times `step_factor` every `step_every`), `constant`.
        warmup: Steps of linear rise at the start.
        step_every: Steps.
        step_factor: 0 to 1.
        clip_norm: Largest norm of the gradient, 0 for no clipping.
        average: Share kept, each step, of the running average of the weights that validates and
            answers; 0 uses the weights themselves.
    """

    kind: Literal["adamw", "muon"] = "adamw"
    learning_rate: Positive = 2e-3
    matrix_rate: Positive = 0.02
    weight_decay: NonNegative = 1e-4
    beta1: BelowOne = 0.9
    schedule: Literal["cosine", "step", "constant"] = "cosine"
    warmup: Natural = 100
    step_every: Count = 250
    step_factor: Annotated[float, Bounds(0, 1, above=True)] = 0.9
    clip_norm: NonNegative = 1.0
    average: BelowOne = 0.99


class ValidationSettings(Settings):
    """How a run is watched.

    Attributes:
        split: Split to validate on.
        every: Steps between validations.
        keep: Which weights answer: the `best` validated ones, or the `last`, which a learning rate
            that ends at 0 has brought to rest, where few pairs cannot tell the better ones.
    """

    split: str = "val"
    every: Count = 250
    keep: Literal["best", "last"] = "best"


class RunSettings(Settings):
    """Settings of every training run, whatever it trains.

    Attributes:
        tier: Tier to train on; empty where the dataset has only one.
        split: Split to train on.
        limit: Train on the first so many sequences only; 0 for all.
        width: Width that frames are brought to, px: the network's input.
        height: Its height.
        seed: Seed of weights, samples and draws.
        steps: Optimiser steps.
        batch: Samples a step and process.
        precision: `float32` or `bfloat16` (forward and backward of the network); `auto` takes
            bfloat16 where the processor has instructions for it.
        threads: CPU threads of torch; 0 leaves torch's own choice.
        workers: Loader processes; 0 loads in the training process.
        cache: Keep decoded frames in a folder.
        cache_dir: That folder; several runs may share one. Empty for RUN/cache.
        checkpoint_every: Steps between checkpoints.
        optimiser: The optimiser.
        validation: How the run is watched.
    """

    tier: str = ""
    split: str = "train"
    limit: Natural = 0
    width: Annotated[int, Bounds(8, 8192, "px")] = 160
    height: Annotated[int, Bounds(8, 8192, "px")] = 120
    seed: Annotated[int, Bounds(0, 2**32 - 1)] = 0
    steps: Count = 3000
    batch: BatchSize = 8
    precision: Precision = "float32"
    threads: Annotated[int, Bounds(0, 1024)] = 0
    workers: Annotated[int, Bounds(0, 256)] = 0
    cache: bool = True
    cache_dir: str = ""
    checkpoint_every: Count = 250
    optimiser: OptimiserSettings = OptimiserSettings()
    validation: ValidationSettings = ValidationSettings()


Chosen = TypeVar("Chosen", bound=RunSettings)
