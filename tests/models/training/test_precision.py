"""`precision: auto`: bfloat16 where the processor has instructions for it."""

from __future__ import annotations

from pathlib import Path

import pytest
import torch

from pliant.models.training import precision
from pliant.models.training.muon import orthogonalised
from pliant.models.training.precision import bfloat16_is_native, halved

CPU_FLAGS = Path("/proc/cpuinfo")


@pytest.mark.skipif(not CPU_FLAGS.exists(), reason="Linux says what the processor has")
def test_the_processor_is_known() -> None:
    flags = CPU_FLAGS.read_text()
    assert bfloat16_is_native("cpu") == ("avx512_bf16" in flags or "amx_bf16" in flags)


@pytest.mark.parametrize("native", [True, False])
def test_auto_follows_the_processor(native: bool, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(precision, "bfloat16_is_native", lambda _: native)
    assert halved("auto", "cpu") is native
    assert halved("bfloat16", "cpu")
    assert not halved("float32", "cpu")


def test_muon_makes_singular_values_alike_in_either_precision(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    gradient = torch.randn(24, 60, generator=torch.Generator().manual_seed(1))
    for native in (True, False):
        monkeypatch.setattr(
            "pliant.models.training.muon.bfloat16_is_native", lambda _, native=native: native
        )
        values = torch.linalg.svdvals(orthogonalised(gradient))
        assert 0.6 < float(values.min()) <= float(values.max()) < 1.3
