"""The evaluator against independent implementations, on small datasets drawn at random.

Plain Python (`references.py`), the published figures of TAP-Vid (`published_tapvid.py`) and a
JavaScript program that reads the files (`spec/examples/score_answers.mjs`): 1,000 sets in all.
"""

from __future__ import annotations

import json
import shutil
import subprocess
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from pliant.evaluator import evaluate
from pliant.evaluator.metrics import blocks
from tests.evaluator.figures import figure
from tests.evaluator.published_tapvid import published, scored, video
from tests.evaluator.reference_distributions import reference_distribution
from tests.evaluator.references import (
    Rows,
    answers_of,
    assert_agrees,
    reference_continuity,
    reference_jitter,
    reference_localisation,
    reference_redetected,
    reference_symmetry,
    reference_tapvid,
)

EXAMPLES = Path(__file__).resolve().parents[2] / "spec" / "examples"
pytestmark = pytest.mark.timeout(1800)  # 50 sets at once, on a busy machine
KINDS = ("plain", "double", "sigma", "modes", "holes")


def seeds(few: int, all_: int) -> Any:
    """Parametrise a test by the first seeds, and in `make test-all` by the others."""
    rest = [range(begin, min(begin + 50, all_)) for begin in range(few, all_, 50)]
    return pytest.mark.parametrize(
        "seeds",
        [range(few), *(pytest.param(each, marks=pytest.mark.long) for each in rest)],
        ids=str,
    )


def drawn(scene_maker: Any, root: Path, seed: int) -> tuple[Any, str, pa.Table]:
    """Return a dataset, a kind of answers, and answers of this kind."""
    rng = np.random.default_rng(seed)
    frames = int(rng.integers(2, 5))
    scene = scene_maker(
        root,
        tiers=[("cloth",), ("rope",), ("cloth", "rope")][rng.integers(3)],
        sequences=int(rng.integers(1, 4)),
        frames=frames,
        temporal=bool(rng.integers(2)),
        queries=int(rng.choice([1, 2, 5, 20])),
        seed=seed,
        images=False,
        sources=int(rng.integers(1, frames)),
        hidden=float(rng.choice([0, 0.3, 0.8])),
    )
    kind = KINDS[seed % len(KINDS)]
    return scene, kind, answers_of(scene, seed, kind)


@seeds(8, 400)
def test_plain_python_gives_the_same_figures(
    seeds: range, scene_maker: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    for seed in seeds:
        monkeypatch.setattr(blocks, "BLOCK_ROWS", (7, 1 << 18)[seed % 2])  # many blocks, or one
        scene, kind, table = drawn(scene_maker, tmp_path / "data", seed)
        if table.num_rows:
            order = pa.array(np.random.default_rng(seed).permutation(table.num_rows))
            path = scene.submit(tmp_path / "submission.parquet", table.take(order))
            scores = evaluate(path, scene.root, allow_missing=kind == "holes")
            coverage = table.num_rows / scene.rows
            assert scores.document["coverage"] == pytest.approx(coverage, abs=1e-12)
            rows = Rows(scene, table)
            for tier, found in [(None, scores.overall), *scores.tiers.items()]:
                part, place = rows.of(tier), f"seed {seed}, {kind}, {tier}"
                for reference in (
                    reference_localisation,
                    reference_tapvid,
                    reference_symmetry,
                    reference_continuity,
                    *([reference_jitter] if scene.dataset.sequences[0].temporal else []),
                    *([reference_distribution] if kind in ("sigma", "modes") else []),
                ):
                    assert_agrees(found, reference(part), place)
            for name in ("paper", "tapvid"):
                small = evaluate(path, scene.root, protocol=name, allow_missing=kind == "holes")
                for metric, value in small.overall.items():
                    if not metric.endswith("_moving"):  # of tapvid alone: test_protocols.py
                        assert value == scores.overall[metric], (name, metric)
            if scene.dataset.sequences[0].temporal:
                tracks = evaluate(path, scene.root, protocol="track", allow_missing=kind == "holes")
                assert_agrees(tracks.overall, reference_redetected(rows.of(None)), f"seed {seed}")
        shutil.rmtree(scene.root)


@seeds(6, 300)
def test_videos_have_the_published_figures(seeds: range, tmp_path: Path) -> None:
    for seed in seeds:
        rng = np.random.default_rng(seed)
        videos = [video(rng, int(points)) for points in rng.integers(4, 12, rng.integers(1, 3))]
        for mode in ("first", "strided"):
            root = tmp_path / f"{seed}-{mode}"
            scores = scored(videos, mode, root)
            for name, value in published(videos, mode).items():
                assert abs(figure(scores, name) - value) <= 1e-9, (seed, mode, name)
            for written in tmp_path.glob(f"{root.name}*"):
                shutil.rmtree(written)


@seeds(6, 300)
def test_javascript_gives_the_same_figures_and_files(
    seeds: range, scene_maker: Any, tmp_path: Path
) -> None:
    node = shutil.which("node")
    if node is None or not (EXAMPLES / "node_modules").is_dir():
        pytest.skip("needs node, and npm ci in spec/examples (make venv runs it)")
    expected = {}
    for seed in seeds:
        scene, kind, table = drawn(scene_maker, tmp_path / f"{seed}" / "data", seed)
        if kind == "modes" or not table.num_rows:  # the program knows no lists in answers
            continue
        folder = tmp_path / f"{seed}"
        path = scene.submit(folder / "answers.parquet", table)
        for name, each in (("queries", scene.queries), ("truth", scene.truth)):
            pq.write_table(each, folder / f"{name}.parquet", compression="snappy")
        (folder / "size.json").write_text("[160, 120]")
        expected[folder] = evaluate(path, scene.root, allow_missing=kind == "holes").document
    command = [node, str(EXAMPLES / "score_answers.mjs"), *map(str, expected)]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    for (folder, document), line in zip(expected.items(), done.stdout.splitlines(), strict=True):
        assert_agrees(document["overall"], json.loads(line), folder.name)
        copied = evaluate(folder / "copied.parquet", folder / "data", allow_missing=True).document
        for name in ("overall", "tiers", "intervals", "coverage"):
            assert copied[name] == document[name], (folder.name, name)
