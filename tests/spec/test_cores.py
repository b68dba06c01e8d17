from __future__ import annotations

import ast
import os
from pathlib import Path

import pytest

from pliant.spec.cores import cpu_cores

ROOT = Path(__file__).parents[2]
GUARDED = {"spec/cores.py", "generator/runner/engine_local.py", "benchmarks/generation.py"}


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


def test_nobody_else_asks_for_the_affinity_that_macos_does_not_know() -> None:
    rooms = ("benchmarks", "cli", "generator", "models", "spec", "viewer", "loaders", "evaluator")
    users = {
        path.relative_to(ROOT).as_posix()
        for room in rooms
        for path in (ROOT / room).rglob("*.py")
        for node in ast.walk(ast.parse(path.read_text()))
        if isinstance(node, ast.Attribute) and node.attr == "sched_getaffinity"
    }
    assert users <= GUARDED
