"""Which precision is fast: bfloat16 where the processor multiplies it itself, else float32."""

from __future__ import annotations

from functools import cache

import torch

from pliant.models.training.settings import Precision


@cache
def bfloat16_is_native(device: str) -> bool:
    """Return whether a kind of device (`cpu`, `cuda`) has instructions for bfloat16.

    A CPU without them (AVX-512 BF16, AMX) imitates them, at a third of the speed of float32. A
    torch that cannot tell (before `torch.cpu.get_capabilities`) counts as one without.
    """
    if device == "cuda":
        return bool(torch.cuda.is_bf16_supported(including_emulation=False))
    of_cpu: dict[str, bool] = getattr(torch.cpu, "get_capabilities", dict)()
    return any(of_cpu.get(name, False) for name in ("avx512_bf16", "amx_bf16"))


def halved(precision: Precision, device: str) -> bool:
    """Return whether networks run in bfloat16 at a run's setting on this kind of device."""
    return precision == "bfloat16" or (precision == "auto" and bfloat16_is_native(device))
