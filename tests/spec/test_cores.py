from __future__ import annotations

import os

import pytest

from pliant.spec.cores import cpu_cores


def test_cores_are_those_of_the_process_or_without_affinity_those_of_the_machine(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(os, "sched_getaffinity", lambda _: {3, 5, 6}, raising=False)
    assert cpu_cores() == 3
    monkeypatch.delattr(os, "sched_getaffinity")
    monkeypatch.setattr(os, "cpu_count", lambda: 7)
    assert cpu_cores() == 7
    monkeypatch.setattr(os, "cpu_count", lambda: None)
    assert cpu_cores() == 1
