"""Freezing a benchmark's test questions without making the whole of it.

Training splits are left out, and every image is drawn by the quickest style: tables, queries and
truth know neither of them. Sets that differ only in what the picture looks like (style, noise,
colours) share their tables, so only the first of them is made, and the others' questions are drawn
from its tables.
"""

from __future__ import annotations

import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

from pliant.benchmarks.suite.checksums import set_checksums
from pliant.benchmarks.suite.config import TEST_SPLIT, BenchmarkConfig
from pliant.generator.config import GenerateConfig
from pliant.generator.objects.tiers import describe_tier
from pliant.generator.runner.plan import plan_tasks
from pliant.generator.runner.run import generate
from pliant.generator.settings import AppearanceSettings
from pliant.generator.truth.queries import build_queries
from pliant.spec.errors import GenerationError
from pliant.spec.io.reading import sha256_file
from pliant.spec.storage.layout import QUERIES_DIR, TRUTH_DIR


def frozen_questions(
    config: BenchmarkConfig,
    out: Path,
    *,
    workers: int = 1,
    tell: Callable[[str], None] = lambda message: None,
) -> dict[str, Any]:
    """Make the test splits and return the document to be frozen.

    Args:
        config: The benchmark.
        out: Folder of the test splits: new, or one that was begun.
        workers: Sequences in work at a time.
        tell: Called with each progress message.

    Returns:
        `name`, `version` and `sets`: name -> `queries`, `truth` and `tables`, as `read_frozen`
        reads them.

    Raises:
        CallError: The folder contains something else.
        GenerationError: A sequence could not be made.
    """
    out.mkdir(parents=True, exist_ok=True)
    first: dict[str, str] = {}  # geometry -> the set that was made for it
    sets: dict[str, dict[str, Any]] = {}
    for name, whole in config.asked.items():
        wanted = _test_split(whole)
        source = first.setdefault(repr(_geometry(wanted)), name)
        if source == name:
            tell(f"Making {name}: {wanted.counts[TEST_SPLIT]} sequences of {wanted.frames} frames")
            summary = generate(wanted, out / name, workers=workers)
            if summary.failed:
                raise GenerationError(
                    "a sequence could not be made", path=out / name, where=summary.failed[0].id
                )
            sets[name] = set_checksums(out / name)
        else:
            tell(f"{name}: the tables of {source}")
            sets[name] = {**_drawn_from(wanted, out / source, out), "tables": source}
    return {"name": config.name, "version": config.version, "sets": sets}


def _test_split(config: GenerateConfig) -> GenerateConfig:
    """Return the config of a set's test split, drawn quickly; its questions are the set's own."""
    splits = {TEST_SPLIT: config.counts[TEST_SPLIT]}
    return config.replace(
        splits=splits, sequences=None, style="raster", depth_camera=None, shutter=0.0
    )


def _geometry(config: GenerateConfig) -> GenerateConfig:
    """Return what decides a set's tables: the config without labels and the picture's looks."""
    return config.replace(id="any", title="", description="", look=AppearanceSettings(), noise=None)


def _drawn_from(config: GenerateConfig, made: Path, folder: Path) -> dict[str, str]:
    """Return `queries` and `truth` of a set whose tables another set's folder contains."""
    with tempfile.TemporaryDirectory(dir=folder) as scratch:
        queries, truth = Path(scratch) / QUERIES_DIR, Path(scratch) / TRUTH_DIR
        build_queries(
            made,
            [describe_tier(config, tier) for tier in config.tiers],
            plan_tasks(config),
            config.queries,
            seed=config.seed,
            dataset={"id": config.id, "version": config.version},
            queries_dir=queries,
            truth_dir=truth,
        )
        name = f"{TEST_SPLIT}.parquet"
        return {"queries": sha256_file(queries / name), "truth": sha256_file(truth / name)}
