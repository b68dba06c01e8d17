"""Cost of scoring: CPU time relative to reading both files, and memory.

A split of N queries (200 a pair, half of the pairs with a symmetry) and a shuffled submission are
written once; every figure is then taken in a process of its own, alternating with a process that
only reads the submission and the truth with pyarrow, and the median is kept. CPU time is that of
all threads, without imports.

`ratio_to_reading` and `peak_gib` are the `paper` protocol's.
Figures with `surfaces` are of a split whose target frames have surface images: 98 queries a pair,
20 pairs a target frame.
"""

from __future__ import annotations

import json
import statistics
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
from record import Value, cpu_s, main

from pliant.evaluator import evaluate
from pliant.spec import tables
from pliant.spec.conventions import CONVENTIONS, SPEC_VERSION, VISIBILITY_STATES
from pliant.spec.io.exr import Surface, write_surface
from pliant.spec.io.jsonfiles import write_json
from pliant.spec.io.parquet import write_table
from pliant.spec.io.reading import sha256_file
from pliant.spec.model import MaterialCoordinate, MaterialObject, Symmetry, Tier
from pliant.spec.storage import layout

QUERIES_PER_PAIR, QUERIES_WITH_SURFACES = 200, 98
FRAMES, POINTS = 21, 5000
WIDTH, HEIGHT = 640, 480
SIDES = (MaterialCoordinate("u", 0, 1, 0.5), MaterialCoordinate("v", 0, 1, 0.5))
HALF_TURN = Symmetry("half-turn", ((-1, 0), (0, -1)), (1, 1))
TIERS = tuple(
    Tier(name, "cloth", "two-sided", 1, (MaterialObject(1, "cloth", SIDES),), symmetries)
    for name, symmetries in (("plain", ()), ("turned", (HALF_TURN,)))
)
JOBS = ("read", "paper", "standard")
IDENTITY = {"dataset": {"id": "scale", "version": "1.0.0"}}


def write_surfaces(root: Path, names: list[str], tier_of: list[str]) -> None:
    """Write point tables and surface images: a bent square cloth, turned from frame to frame."""
    rng = np.random.default_rng(1)
    side = 0.5 * HEIGHT
    v, u = np.mgrid[:HEIGHT, :WIDTH] + 0.5
    images = []
    for frame in range(FRAMES):
        turn = np.exp(1j * frame) * ((u - WIDTH / 2) + 1j * (v - HEIGHT / 2)) / side
        m0, m1 = turn.real + 0.5 + 0.05 * np.sin(3 * turn.imag), turn.imag + 0.5
        on = (np.minimum(m0, m1) >= 0) & (np.maximum(m0, m1) <= 1)
        material = (np.where(on, each, 0).astype(np.float32) for each in (m0, m1))
        depth_m = np.where(on, 1, np.inf).astype(np.float32)
        images.append(root / f"surface-{frame}.exr")
        write_surface(images[-1], Surface(depth_m, *material, on.astype(np.uint32)))
    columns = {
        "point": np.arange(POINTS, dtype=np.int32),
        "object": np.ones(POINTS, np.int32),
        "kind": ["surface"] * POINTS,
        "m0": rng.random(POINTS, np.float32),
        "m1": rng.random(POINTS, np.float32),
        "partners": [list[int]()] * POINTS,
    }
    points = pa.table(columns, schema=tables.POINTS)
    for name, tier in zip(names, tier_of, strict=True):
        folder = root / layout.sequence_name(tier, name)
        for frame, image in enumerate(images):
            path = folder / layout.depth_name(frame)
            path.parent.mkdir(parents=True, exist_ok=True)
            path.hardlink_to(image)
        write_table(folder / layout.POINTS_TABLE, points, "points", IDENTITY)


def write_sequences(root: Path, sequence_count: int) -> tuple[list[str], list[str]]:
    """Write the dataset without its queries; return the names and tiers of its sequences."""
    info = {
        "spec_version": SPEC_VERSION,
        **IDENTITY["dataset"],
        "title": "Rows to score",
        "description": "Random rows for a benchmark of the evaluator.",
        "licence": "CC-BY-4.0",
        "conventions": CONVENTIONS,
        "image_size": {"width": WIDTH, "height": HEIGHT},
        "tiers": [tier.as_document() for tier in TIERS],
        "splits": ["test"],
        "provenance": {"generator": "benchmark", "seed": 0, "config": {}, "tools": {}},
    }
    root.mkdir(parents=True, exist_ok=True)
    write_json(root / layout.DATASET_JSON, info, "dataset")
    tier_of = [TIERS[2 * index // sequence_count].name for index in range(sequence_count)]
    names = [f"{tier}-test-{index:06d}" for index, tier in enumerate(tier_of)]
    same = {"split": "test", "frames": FRAMES, "temporal": False, "seed": 0, "style": "external"}
    same |= {"coverage": 0.5, "self_occluded": 0.2}
    rows = [{"id": name, "tier": tier, **same} for name, tier in zip(names, tier_of, strict=True)]
    table = pa.Table.from_pylist(rows, schema=tables.SEQUENCES)
    write_table(root / layout.SEQUENCES_TABLE, table, "sequences", IDENTITY)
    return names, tier_of


def text(codes: Any, words: list[str]) -> Any:
    """Return a string column; a dictionary keeps ten million strings small until then."""
    codes = pa.array(np.asarray(codes, np.int32))
    return pa.DictionaryArray.from_arrays(codes, words).cast(pa.string())


def write_rows(
    root: Path, pairs: int, per_pair: int, names: list[str], tier_of: list[str], middle: float = 1
) -> None:
    """Write queries, answers and a submission; half of the sequences have a symmetric partner.

    Args:
        root: Where the dataset is.
        pairs: Number of pairs.
        per_pair: Queries of each.
        names: Names of the sequences.
        tier_of: Tier of each.
        middle: Share of the image's height whose square in the middle has all queries; 1 takes
            the whole image.
    """
    rng = np.random.default_rng(0)
    sequence_count = len(names)
    pair = np.repeat(np.arange(pairs, dtype=np.int32), per_pair)
    query = np.tile(np.arange(per_pair, dtype=np.int32), pairs)
    sequence = np.minimum(np.arange(pairs) * sequence_count // pairs, sequence_count - 1)
    per_row = np.repeat(sequence, per_pair)
    tier_codes = np.array([tier == "turned" for tier in tier_of], np.int32)[per_row]
    low, high = np.zeros(2), np.array([WIDTH, HEIGHT])
    if middle < 1:
        low, high = ((high + sign * middle * HEIGHT) / 2 for sign in (-1, 1))
    uv_a = rng.uniform(low, high, (len(pair), 2)).astype(np.float32)
    uv_b = np.clip(uv_a + rng.normal(0, 20, uv_a.shape), 1, HEIGHT - 1).astype(np.float32)
    queries = {
        "pair_id": pair,
        "query_id": query,
        "tier": text(tier_codes, ["plain", "turned"]),
        "sequence_a": text(per_row, names),
        "frame_a": np.zeros(len(pair), np.int32),
        "sequence_b": text(per_row, names),
        "frame_b": (pair % (FRAMES - 1) + 1).astype(np.int32),
        "u_a": uv_a[:, 0],
        "v_a": uv_a[:, 1],
    }
    footer: dict[str, Any] = {**IDENTITY, "split": "test"}
    for folder in (layout.QUERIES_DIR, layout.TRUTH_DIR):
        (root / folder).mkdir(exist_ok=True)
    path = root / layout.queries_name("test")
    write_table(path, pa.table(queries, schema=tables.QUERIES), "queries", footer)
    footer["queries_sha256"] = sha256_file(path)
    state = rng.choice(4, len(pair), p=[0.75, 0.2, 0.03, 0.02])
    truth = {
        "pair_id": pair,
        "query_id": query,
        "tier": queries["tier"],
        "point": rng.integers(0, POINTS, len(pair), dtype=np.int32),
        "u_b": uv_b[:, 0],
        "v_b": uv_b[:, 1],
        "visibility_b": text(state, list(VISIBILITY_STATES)),
        "box_px": np.full(len(pair), 300, np.float32),
        "alternatives": _partners(uv_b, state, tier_codes),
    }
    truth_table = pa.table(truth, schema=tables.TRUTH)
    write_table(root / layout.truth_name("test"), truth_table, "truth", footer)
    order = rng.permutation(len(pair))
    answer = (uv_b + rng.normal(0, 6, uv_b.shape)).astype(np.float32)[order]
    columns = pair[order], query[order], *answer.T
    answers = pa.table(dict(zip(("pair_id", "query_id", "u", "v"), columns, strict=True)))
    footer["method"] = {"name": "noise"}
    write_table(root / "submission.parquet", answers, "answers", footer)


def _partners(uv_b: Any, state: Any, has_one: Any) -> pa.ListArray:
    """Return the partners of queries, (N, 2) and (N,): of those that have one, the axes swapped."""
    lists = tables.TRUTH.field("alternatives").type
    partner = uv_b[has_one > 0][:, ::-1]
    states = text(state[has_one > 0], list(VISIBILITY_STATES))
    items = pa.StructArray.from_arrays(
        [pa.array(np.ascontiguousarray(partner[:, axis])) for axis in (0, 1)] + [states],
        fields=list(lists.value_type),
    )
    offsets = np.concatenate([[0], np.cumsum(has_one)]).astype(np.int32)
    return pa.ListArray.from_arrays(pa.array(offsets), items, type=lists)


def job(what: str, root: Path) -> dict[str, float]:
    """Do one thing in this process; return its CPU seconds and the peak memory."""
    submission, truth = root / "submission.parquet", root / "truth" / "test.parquet"
    if what == "read":
        used = cpu_s(lambda: [pq.read_table(submission), pq.read_table(truth)])
    else:
        used = cpu_s(lambda: evaluate(submission, root, protocol=what))
    # Not ru_maxrss, which would count the parent's memory before the exec.
    status = dict(line.split(":") for line in Path("/proc/self/status").read_text().splitlines())
    return {"cpu_s": used, "peak_gib": int(status["VmHWM"].split()[0]) / 2**20}


def compare(root: Path, rounds: int) -> dict[str, dict[str, float]]:
    """Run jobs in turns, each in its own process; return median CPU time and largest peak."""
    runs: dict[str, list[dict[str, float]]] = {name: [] for name in JOBS}
    for name in JOBS * rounds:
        command = [sys.executable, __file__, "--job", name, str(root)]
        done = subprocess.run(command, check=True, capture_output=True, text=True)
        runs[name].append(json.loads(done.stdout.splitlines()[-1]))
    return {
        name: {
            "cpu_s": statistics.median(run["cpu_s"] for run in done),
            "peak_gib": max(run["peak_gib"] for run in done),
        }
        for name, done in runs.items()
    }


def measure(quick: bool) -> dict[str, Value]:
    """Measure 2 million rows (quick), or 10 million; 5,100 pairs with surfaces, or 51,000."""
    rows, pairs = (2_000_000, 5_100) if quick else (10_000_000, 51_000)
    with tempfile.TemporaryDirectory(prefix="pliant-bench-") as folder:
        root, plain_pairs = Path(folder), rows // QUERIES_PER_PAIR
        names, tier_of = write_sequences(root, max(2, plain_pairs // 20))
        write_rows(root, plain_pairs, QUERIES_PER_PAIR, names, tier_of)
        size = sum(path.stat().st_size for path in root.rglob("*.parquet"))
        plain = compare(root, 3)
    with tempfile.TemporaryDirectory(prefix="pliant-bench-") as folder:
        root = Path(folder)
        names, tier_of = write_sequences(root, max(2, pairs // (20 * (FRAMES - 1))))
        write_surfaces(root, names, tier_of)
        write_rows(root, pairs, QUERIES_WITH_SURFACES, names, tier_of, middle=0.5)
        surfaces = compare(root, 3 if quick else 1)
    result: dict[str, Value] = {
        "rows": rows,
        "bytes_per_row": size / rows,
        "reading_cpu_s": plain["read"]["cpu_s"],
        "pairs_surfaces": pairs,
    }
    for name, suffix in (("paper", ""), ("standard", "_standard")):
        found, slow = plain[name], surfaces[name]
        result |= {
            f"ratio_to_reading{suffix}": found["cpu_s"] / plain["read"]["cpu_s"],
            f"peak_gib{suffix}": found["peak_gib"],
            f"rows_per_s{suffix}": rows / found["cpu_s"],
            f"cpu_s_surfaces_{name}": slow["cpu_s"],
            f"ms_per_pair_surfaces_{name}": 1e3 * slow["cpu_s"] / pairs,
            f"ratio_to_reading_surfaces_{name}": slow["cpu_s"] / surfaces["read"]["cpu_s"],
            f"peak_gib_surfaces_{name}": slow["peak_gib"],
        }
    return result


if __name__ == "__main__":
    if sys.argv[1:2] == ["--job"]:
        print(json.dumps(job(sys.argv[2], Path(sys.argv[3]))))
    else:
        main("evaluation", measure, __doc__)
