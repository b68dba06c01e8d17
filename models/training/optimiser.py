"""The optimiser of a network and its learning rate schedule."""

from __future__ import annotations

import math

import torch
from torch import nn

from pliant.models.training.muon import Muon, is_matrix
from pliant.models.training.settings import OptimiserSettings


def learning_rate(settings: OptimiserSettings, step: int, steps: int) -> float:
    """Return the learning rate of a step.

    Args:
        settings: The schedule.
        step: Number of the step, from 0.
        steps: Steps in all.
    """
    rate = settings.learning_rate
    if step < settings.warmup:
        return rate * (step + 1) / settings.warmup
    if settings.schedule == "cosine":
        share = (step - settings.warmup) / max(1, steps - settings.warmup)
        return rate * 0.5 * (1 + math.cos(math.pi * min(1.0, share)))
    if settings.schedule == "step":
        return float(rate * settings.step_factor ** (step // settings.step_every))
    return rate


def make_optimiser(network: nn.Module, settings: OptimiserSettings) -> torch.optim.Optimizer:
    """Return the optimiser of a network's trainable parameters.

    Weights decay, biases and norms do not. Each group contains `ratio`, its rate over
    `settings.learning_rate`.

    Args:
        network: What is trained.
        settings: Which optimiser.
    """
    parameters = [p for p in network.parameters() if p.requires_grad]
    muon = settings.kind == "muon"
    matrices = [p for p in parameters if muon and is_matrix(p)]
    weights = [p for p in parameters if p.dim() > 1 and not (muon and is_matrix(p))]
    vectors = [p for p in parameters if p.dim() <= 1]
    groups = [
        {"params": weights, "weight_decay": settings.weight_decay, "ratio": 1.0},
        {"params": vectors, "weight_decay": 0.0, "ratio": 1.0},
    ]
    betas = (settings.beta1, 0.999)
    if not muon:
        return torch.optim.AdamW(groups, lr=settings.learning_rate, betas=betas)
    ratio = settings.matrix_rate / settings.learning_rate
    groups.append({"params": matrices, "weight_decay": 0.0, "ratio": ratio, "muon": True})
    return Muon(groups, betas=betas)
