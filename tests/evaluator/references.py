"""Metrics written from their definitions, one query at a time, to compare the evaluator with.

They share no code with the evaluator and loop where it is vectorised.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pyarrow as pa
import pytest

from pliant.evaluator import read_protocol
from pliant.spec.tables import ANSWERS_OPTIONAL

DIAGONAL = 200.0  # of 160x120
STANDARD = read_protocol("standard").metrics


def mean(values: Any) -> float | None:
    values = list(values)
    return math.fsum(values) / len(values) if values else None


def rms(values: Any) -> float | None:
    values = list(values)
    return math.sqrt(math.fsum(v * v for v in values) / len(values)) if values else None


class Rows:
    """The rows of a split as dictionaries with query, ground truth and answer."""

    def __init__(self, scene: Any, answers: pa.Table) -> None:
        given = {(r["pair_id"], r["query_id"]): r for r in answers.to_pylist()}
        self.rows = []
        for query, true in zip(scene.queries.to_pylist(), scene.truth.to_pylist(), strict=True):
            row = {**query, **true, "answer": given.get((query["pair_id"], query["query_id"]))}
            row["seen"] = row["visibility_b"] == "visible"
            row["error"] = DIAGONAL if row["answer"] is None else self.distance(row)
            row["reach"] = math.inf if row["answer"] is None else row["error"]
            self.rows.append(row)

    @staticmethod
    def distance(row: dict[str, Any]) -> float:
        return math.hypot(row["answer"]["u"] - row["u_b"], row["answer"]["v"] - row["v_b"])

    def of(self, tier: str | None) -> list[dict[str, Any]]:
        return [row for row in self.rows if tier in (None, row["tier"])]


def pairs_of(rows: list[dict[str, Any]]) -> list[list[dict[str, Any]]]:
    found: dict[int, list[dict[str, Any]]] = {}
    for row in rows:
        found.setdefault(row["pair_id"], []).append(row)
    return list(found.values())


def reference_localisation(rows: list[dict[str, Any]]) -> dict[str, float | None]:
    seen = [row for row in rows if row["seen"]]
    errors = [row["error"] for row in seen]
    result = {
        "rmse_px": rms(errors),
        "mean_px": mean(errors),
        "rmse_px_mean_over_pairs": mean(
            rms(row["error"] for row in pair if row["seen"])
            for pair in pairs_of(rows)
            if any(row["seen"] for row in pair)
        ),
        "outside_image_rate": mean(
            not (0 <= row["answer"]["u"] <= 160 and 0 <= row["answer"]["v"] <= 120)
            for row in rows
            if row["answer"]
        ),
    }
    names = {0.05: "p5_px", 0.25: "p25_px", 0.5: "median_px", 0.75: "p75_px", 0.95: "p95_px"}
    ordered = sorted(errors)
    for level, name in names.items():
        if not ordered:
            result[name] = None
            continue
        place = level * (len(ordered) - 1)
        low = math.floor(place)
        high = min(low + 1, len(ordered) - 1)
        result[name] = ordered[low] + (ordered[high] - ordered[low]) * (place - low)
    for threshold in (1, 2, 4, 8, 16, 32):
        result |= reference_pck(rows, f"pck_{threshold}px", lambda row, t=threshold: t)
    for share in (0.05, 0.1):
        result |= reference_pck(rows, f"pck_{share}box", lambda row, s=share: s * row["box_px"])
    return result


def reference_pck(rows: list[dict[str, Any]], name: str, limit: Any) -> dict[str, float | None]:
    def hit(row: dict[str, Any]) -> bool:
        return bool(row["reach"] <= limit(row))

    return {
        name: mean(hit(row) for row in rows if row["seen"]),
        f"{name}_mean_over_pairs": mean(
            mean(hit(row) for row in pair if row["seen"])
            for pair in pairs_of(rows)
            if any(row["seen"] for row in pair)
        ),
    }


def reference_tapvid(rows: list[dict[str, Any]]) -> dict[str, float | None]:
    """After the published definition, a pair for a video."""
    thresholds = (1, 2, 4, 8, 16)
    oa: list[float | None] = []
    within: dict[int, list[float]] = {t: [] for t in thresholds}
    jaccard: dict[int, list[float]] = {t: [] for t in thresholds}
    for pair in pairs_of(rows):
        right = []
        for row in pair:
            answer = row["answer"]
            row["said"] = answer is None or answer.get("visible", 1.0) >= 0.5
            right.append(answer is not None and row["said"] == row["seen"])
            if answer is not None:
                du = (answer["u"] - row["u_b"]) * 256 / 160
                dv = (answer["v"] - row["v_b"]) * 256 / 120
                row["scaled"] = math.hypot(du, dv)
            else:
                row["scaled"] = math.inf
        oa.append(mean(right))
        for t in thresholds:
            visible = sum(row["seen"] for row in pair)
            hits = sum(row["seen"] and row["scaled"] < t for row in pair)
            if visible:
                within[t].append(hits / visible)
            true_positives = sum(row["seen"] and row["said"] and row["scaled"] < t for row in pair)
            false_positives = sum(
                row["said"] and (not row["seen"] or not row["scaled"] < t) for row in pair
            )
            if visible + false_positives:
                jaccard[t].append(true_positives / (visible + false_positives))
    result = {"oa": mean(oa)}
    result |= {f"delta_{t}": mean(within[t]) for t in thresholds}
    result |= {f"jaccard_{t}": mean(jaccard[t]) for t in thresholds}
    for name, values in (("delta_avg", within), ("aj", jaccard)):
        defined = all(values[t] for t in thresholds)
        result[name] = mean(mean(values[t]) or 0.0 for t in thresholds) if defined else None
    return result


def reference_symmetry(rows: list[dict[str, Any]]) -> dict[str, float | None]:
    squares, point_squares, flips, point_flips, per_pair = [], [], [], [], []
    for pair in pairs_of(rows):
        seen = [row for row in pair if row["seen"]]
        if not seen:
            continue
        # A point on the axis of a symmetry is its own partner: equal by the same arithmetic.
        candidates = [[own_squared(row) for row in seen]]
        complete = all(row["answer"] is not None for row in seen)
        count = len(seen[0]["alternatives"])
        for index in range(count if complete else 0):
            candidates.append([partner_squared(row, index) for row in seen])
        sums = [math.fsum(values) for values in candidates]
        best = min(sums)
        squares.append(best)
        per_pair.append(math.sqrt(best / len(seen)))
        if count:
            flips.append(not complete or best < sums[0])
        for row in seen:
            own = own_squared(row)
            others = [
                partner_squared(row, index)
                for index in range(count if row["answer"] is not None else 0)
                if row["alternatives"][index]["visibility"] == "visible"
            ]
            nearest = min([own, *others])
            point_squares.append(nearest)
            if count:
                point_flips.append(row["answer"] is None or nearest < own)
    counted = sum(row["seen"] for row in rows)
    return {
        "symmetric_rmse_px": math.sqrt(math.fsum(squares) / counted) if counted else None,
        "symmetric_rmse_px_mean_over_pairs": mean(per_pair),
        "point_symmetric_rmse_px": math.sqrt(math.fsum(point_squares) / counted)
        if counted
        else None,
        "flip_rate": mean(flips),
        "point_flip_rate": mean(point_flips),
    }


def own_squared(row: dict[str, Any]) -> float:
    return row["error"] ** 2 if row["answer"] is None else squared(row, row["u_b"], row["v_b"])


def partner_squared(row: dict[str, Any], index: int) -> float:
    partner = row["alternatives"][index]
    return squared(row, partner["u"], partner["v"])


def squared(row: dict[str, Any], u: float, v: float) -> float:
    return (row["answer"]["u"] - u) ** 2 + (row["answer"]["v"] - v) ** 2


def reference_continuity(rows: list[dict[str, Any]]) -> dict[str, float | None]:
    s = STANDARD["continuity"]
    jumps, stretches = [], []
    for pair in pairs_of(rows):
        usable = [row for row in pair[: s["queries_per_pair"]] if row["seen"]]
        for row in usable:
            others = [other for other in usable if other is not row]
            if not others:
                continue

            def near(other: dict[str, Any], row: dict[str, Any] = row) -> np.float32:
                du = np.float32(other["u_a"]) - np.float32(row["u_a"])
                dv = np.float32(other["v_a"]) - np.float32(row["v_a"])
                return np.float32(du * du + dv * dv)  # min() keeps the first of equals

            nearest = min(others, key=near)
            a = math.hypot(nearest["u_a"] - row["u_a"], nearest["v_a"] - row["v_a"])
            true = math.hypot(nearest["u_b"] - row["u_b"], nearest["v_b"] - row["v_b"])
            if not s["min_distance_a_px"] <= a <= s["max_distance_a_px"]:
                continue
            if true > s["max_true_stretch"] * a:
                continue
            p, q = nearest["answer"], row["answer"]
            if p is None or q is None:
                jumps.append(True)
                stretches.append(DIAGONAL / a)
                continue
            b = math.hypot(p["u"] - q["u"], p["v"] - q["v"])
            jumps.append(b > max(s["jump_stretch"] * a, s["jump_min_px"]))
            stretches.append(b / a)
    stretch = float(np.quantile(stretches, 0.95)) if stretches else None
    return {"jump_rate": mean(jumps), "stretch_p95": stretch}


def reference_redetected(rows: list[dict[str, Any]]) -> dict[str, float | None]:
    def since(row: dict[str, Any]) -> int:
        return int(row["frame_b"] - row["frame_a"])

    tracks: dict[tuple[Any, ...], list[int]] = {}
    for row in rows:
        if row["sequence_a"] == row["sequence_b"] and not row["seen"]:
            key = (row["sequence_a"], row["frame_a"], since(row) > 0, row["point"])
            tracks.setdefault(key, []).append(abs(since(row)))
    again = [
        row
        for row in rows
        if row["sequence_a"] == row["sequence_b"]
        and any(
            hidden < abs(since(row))
            for hidden in tracks.get(
                (row["sequence_a"], row["frame_a"], since(row) > 0, row["point"]), []
            )
        )
    ]
    return {"aj_redetected": reference_tapvid(again)["aj"] if again else None}


def reference_jitter(rows: list[dict[str, Any]]) -> dict[str, float | None]:
    errors: dict[tuple[Any, ...], Any] = {}
    for row in rows:
        if row["seen"]:
            key = (row["sequence_a"], row["frame_a"], row["sequence_b"], row["point"])
            answer = row["answer"]
            offset = answer and (answer["u"] - row["u_b"], answer["v"] - row["v_b"])
            errors[(*key, row["frame_b"])] = offset
    changes: list[float] = []
    for (*place, frame_b), error in errors.items():
        earlier = (*place, frame_b - 1)
        if earlier in errors:
            before = errors[earlier]
            if error is None or before is None:
                changes.append(2 * DIAGONAL)
            else:
                changes.append(math.hypot(error[0] - before[0], error[1] - before[1]))
    return {"jitter_px": mean(changes)}


def assert_agrees(found: dict[str, Any], expected: dict[str, Any], place: str) -> None:
    for name, value in expected.items():
        if value is None:
            assert found[name] is None, (place, name)
        else:
            assert found[name] == pytest.approx(value, rel=1e-9, abs=1e-9), (place, name)


def answers_of(scene: Any, seed: int, kind: str) -> pa.Table:
    """Return answers of mixed quality: near, far, mirrored and outside."""
    rng = np.random.default_rng(seed)
    uv = scene.true_px + rng.normal(0, 3, (scene.rows, 2))
    far = rng.random(scene.rows) < 0.2
    uv[far] = rng.uniform(-40, 200, (far.sum(), 2))
    for row, others in enumerate(scene.truth["alternatives"].to_pylist()):
        if others and (scene.pair[row] % 3 == 0 or rng.random() < 0.1):
            uv[row] = np.array([others[0]["u"], others[0]["v"]]) + rng.normal(0, 1, 2)
    if kind == "double":
        columns = {"u": uv[:, 0], "v": uv[:, 1]}
        table = scene.table(uv)
        for name, values in columns.items():
            table = table.set_column(table.column_names.index(name), name, pa.array(values))
        return table
    table = scene.table(uv, visible=rng.random(scene.rows).astype(np.float32))
    if kind == "sigma":
        sigma = np.exp(rng.normal(1, 1, scene.rows)).astype(np.float32) + np.float32(0.6)
        return table.append_column("sigma", pa.array(sigma))
    if kind == "modes":
        modes = []
        for u, v in uv:
            count = int(rng.integers(1, 4))
            weight = rng.dirichlet(np.ones(count))
            modes.append(
                [
                    {
                        "u": u + rng.normal(0, 5) * (k > 0),
                        "v": v + rng.normal(0, 20) * (k > 0),
                        "sigma": 0.6 + float(np.exp(rng.normal(1, 1))),
                        "weight": weight[k],
                    }
                    for k in range(count)
                ]
            )
        return table.append_column("modes", pa.array(modes, ANSWERS_OPTIONAL.field("modes").type))
    if kind == "holes":
        return table.take(pa.array(np.flatnonzero(rng.random(scene.rows) < 0.8)))
    return table
