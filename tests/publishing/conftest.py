"""The tiny dataset, published once with its test split held out."""

from __future__ import annotations

import os
import subprocess
import sys
from dataclasses import dataclass, replace
from pathlib import Path

import pytest

from pliant.publishing import Published, PublishSettings, publish

# The tiny set has the seed 0.
HELD_OUT = PublishSettings(hold_out=("test",), answers_are_public=True)
SETTINGS = replace(HELD_OUT, shard_bytes=300_000, authors=("Ada", "Grace"))


@dataclass(frozen=True)
class Halves:
    """A dataset and the two halves that were published of it."""

    whole: Path
    public: Path
    private: Path
    facts: Published


def printed(script: str, *arguments: object, **environment: str) -> list[str]:
    """Run a script in a process of its own that does not ask the Hub; return what it prints."""
    offline = {"HF_HUB_OFFLINE": "1", "HF_DATASETS_OFFLINE": "1"}
    done = subprocess.run(
        [sys.executable, "-c", script, *map(str, arguments)],
        env={**os.environ, **offline, **environment},
        capture_output=True,
        text=True,
    )
    assert done.returncode == 0, done.stderr[-3000:]
    return done.stdout.splitlines()


@pytest.fixture(scope="session")
def halves(tiny_dataset: Path, tmp_path_factory: pytest.TempPathFactory) -> Halves:
    out = tmp_path_factory.mktemp("published") / "tiny"
    facts = publish(tiny_dataset, out, SETTINGS)
    assert facts.private is not None
    return Halves(tiny_dataset, out, facts.private, facts)
