"""`precision: auto`: bfloat16 where the processor has instructions for it."""

from __future__ import annotations

from pathlib import Path

import pytest

from pliant.models.training import precision
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
