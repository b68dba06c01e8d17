"""The optimiser of a network and its learning rate schedule."""

from __future__ import annotations

import math
from typing import Any, Final

import torch
from torch import nn

from pliant.models.training.processes import bfloat16_is_native
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


_COEFFICIENTS: Final = (3.4445, -4.7750, 2.0315)
_ITERATIONS: Final = 5
_EPSILON: Final = 1e-7
_LEAST_ROWS: Final = 16
_MOMENTUM: Final = 0.95  # Nesterov's


def is_matrix(parameter: torch.Tensor) -> bool:
    """Return whether Muon is for this parameter: a layer's weights, no vector and no thin head."""
    return parameter.dim() > 1 and parameter.shape[0] >= _LEAST_ROWS


def orthogonalised(gradient: torch.Tensor) -> torch.Tensor:
    """Return about U Vᵀ of a matrix: singular values of 0.7 to 1.2, the same singular vectors.

    Args:
        gradient: float (m, n).

    Returns:
        float (m, n), worked out in bfloat16 where the processor has it.
    """
    a, b, c = _COEFFICIENTS
    wide = gradient.shape[0] <= gradient.shape[1]
    x = gradient if wide else gradient.T
    if bfloat16_is_native(x.device.type):
        x = x.bfloat16()
    x = x / (x.norm() + _EPSILON)  # the largest singular value is then at most 1
    for _ in range(_ITERATIONS):
        gram = x @ x.T
        x = torch.addmm(x, torch.addmm(gram, gram, gram, beta=b, alpha=c), x, beta=a)
    return (x if wide else x.T).to(gradient.dtype)


class Muon(torch.optim.AdamW):
    """Muon for the groups that say `muon`, AdamW for the others.

    The mean gradient G of a weight matrix is replaced by the nearest matrix with orthonormal rows
    or columns, U Vᵀ of its singular value decomposition, so that weak directions of the gradient
    move as far as the strong one. Small descriptor networks train in about two thirds of AdamW's
    steps. The orthogonal factor comes from five Newton-Schulz iterations X ← aX + (bA + cA²)X with
    A = XXᵀ, which send singular values of (0, 1] to about 1 (K. Jordan et al., "Muon: an optimizer
    for hidden layers in neural networks", 2024, whose coefficients these are).

    A convolution's weights (C_out, C_in, k, k) are the matrix (C_out, C_in k k); its step is
    scaled by sqrt(max(1, rows / columns)), so that outputs change alike whatever the shape.

    Its arguments are AdamW's; groups may have `muon` (bool) and say their own `weight_decay`.
    """

    @torch.no_grad()
    def step(self, closure: Any = None) -> Any:
        """Move every parameter that has a gradient."""
        groups = self.param_groups
        for group in groups:
            for parameter in group["params"] if group.get("muon") else ():
                if parameter.grad is not None:
                    self._muon(parameter, group)
        self.param_groups = [group for group in groups if not group.get("muon")]
        try:
            return super().step(closure)
        finally:
            self.param_groups = groups

    def _muon(self, parameter: torch.Tensor, group: dict[str, Any]) -> None:
        state, gradient = self.state[parameter], parameter.grad
        assert gradient is not None
        if not state:
            state["mean"] = torch.zeros_like(parameter)
            state["step"] = torch.zeros(())  # AdamW looks for it in a state that is loaded
        mean = state["mean"]
        mean.lerp_(gradient, 1 - _MOMENTUM)
        ahead = gradient.lerp(mean, _MOMENTUM).flatten(1)
        rows, columns = ahead.shape
        parameter.mul_(1 - group["lr"] * group["weight_decay"])
        size = group["lr"] * max(1.0, rows / columns) ** 0.5
        parameter.add_(orthogonalised(ahead).view_as(parameter), alpha=-size)
