"""Metrics of surfaces and regions against second ones; of all others: test_differential.py."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pytest

from tests.evaluator.references import Rows, answers_of, assert_agrees, mean, pairs_of, rms


def test_geodesic_errors_agree_with_a_reference(scene: Any, tmp_path: Path) -> None:
    table = answers_of(scene, seed=3, kind="plain")
    scores = scene.score(tmp_path, table)
    dataset = scene.dataset
    scale = {"cloth": (0.8, 0.5), "rope": (1.2, 0.012)}
    for tier in ("cloth", "rope"):
        metres, off, asked = [], 0, 0
        for row in Rows(scene, table).of(tier):
            if not row["seen"]:
                continue
            asked += 1
            sequence = dataset.sequence(row["sequence_b"])
            surface = sequence.surface(row["frame_b"])
            point = sequence.points().to_pylist()[row["point"]]
            u, v = row["answer"]["u"], row["answer"]["v"]
            home = (math.floor(v), math.floor(u))
            near = []
            for r in range(home[0] - 1, home[0] + 2):
                for c in range(home[1] - 1, home[1] + 2):
                    if 0 <= r < 120 and 0 <= c < 160 and surface.object_id[r, c] == 1:
                        own = -1.0 if (r, c) == home else (c + 0.5 - u) ** 2 + (r + 0.5 - v) ** 2
                        near.append((own, r, c))
            if not near or not (0 <= home[0] < 120 and 0 <= home[1] < 160):
                off += 1
                continue
            _, r, c = min(near)
            d0 = abs(float(surface.m0[r, c]) - point["m0"])
            d1 = abs(float(surface.m1[r, c]) - point["m1"])
            if tier == "rope":
                d1 = min(d1 % (2 * math.pi), 2 * math.pi - d1 % (2 * math.pi))
            metres.append(math.hypot(scale[tier][0] * d0, scale[tier][1] * d1))
        expected = {
            "geodesic_mean_m": mean(metres),
            "geodesic_rmse_m": rms(metres),
            "off_object_rate": off / asked,
        }
        assert_agrees(scores.tiers[tier], expected, tier)
        assert metres
        assert off


def test_curves_are_those_of_plain_numpy(scene: Any, tmp_path: Path) -> None:
    table = answers_of(scene, seed=3, kind="plain")
    far = table["u"].to_numpy() + np.where(scene.pair == 0, np.float32(500), 0)
    table = table.set_column(2, "u", pa.array(far))  # a pair that is beyond the diagonal
    document = scene.score(tmp_path, table).document
    edges = [0.5, 1, 2, 3, 4, 6, 8, 12, 16, 24, 32, 48, 64, 96, 128, 192]
    for tier in (None, "cloth", "rope"):
        seen = [row for row in Rows(scene, table).of(tier) if row["seen"]]
        error = np.array([row["error"] for row in seen])
        of_pairs = np.array([rms(row["error"] for row in pair) for pair in pairs_of(seen)])
        curves = document["curves"][tier or "overall"]
        assert curves["cdf"]["error_px"] == edges
        shares = [(error < edge).mean() for edge in edges]
        assert curves["cdf"]["share_below"] == pytest.approx(shares)
        steps = np.histogram(error, [*np.arange(0, 132, 4), np.inf])[0] / len(error)
        found = curves["error_px"]
        assert found["edges_px"] == np.arange(0, 132, 4).tolist()
        assert [*found["share"], found["share_beyond"]] == pytest.approx(steps.tolist())
        for name, values in (("normalised_error", error), ("normalised_pair_rmse", of_pairs)):
            bins = np.histogram(np.minimum(values / 200, 1), 50, (0, 1))[0] / len(values)
            assert curves[name]["edges"] == pytest.approx(np.linspace(0, 1, 51).tolist())
            assert curves[name]["share"] == pytest.approx(bins.tolist())
        box = {
            f"p{100 * each:g}": np.quantile(of_pairs, each)
            for each in (0.05, 0.25, 0.5, 0.75, 0.95)
        }
        assert curves["pair_rmse_box_px"] == pytest.approx(box)


def test_slices_are_those_of_single_rows(scene: Any, tmp_path: Path) -> None:
    table = answers_of(scene, seed=3, kind="plain")
    document = scene.score(tmp_path, table).document

    def between(value: float, edges: list[float], unit: str) -> str:
        low = max((edge for edge in edges if edge <= value), default=None)
        high = min((edge for edge in edges if edge > value), default=None)
        if low is None:
            return f"below {high} {unit}".strip()
        return (f"{low} {unit} and more" if high is None else f"{low} to {high} {unit}").strip()

    outside: dict[tuple[str, int], np.ndarray] = {}

    def to_silhouette(row: dict[str, Any]) -> float:
        place = row["sequence_b"], row["frame_b"]
        if place not in outside:
            on = np.pad(scene.dataset.sequence(place[0]).surface(place[1]).object_id == 1, 1)
            outside[place] = np.argwhere(~on)[:, ::-1] - 0.5
        return float(np.linalg.norm(outside[place] - [row["u_b"], row["v_b"]], axis=1).min())

    covered = {f"cloth-test-{k:06d}": 0.5 + 0.1 * k for k in range(3)}  # 0.5 is an edge
    label_of = {
        "visibility in the target": lambda row: row["visibility_b"],
        "displacement": lambda row: between(
            math.dist((row["u_a"], row["v_a"]), (row["u_b"], row["v_b"])), [32, 64, 128, 256], "px"
        ),
        "distance to the silhouette": lambda row: between(to_silhouette(row), [4, 8, 16], "px"),
        "shape": lambda row: "rope open" if row["tier"] == "rope" else "",
        "coverage of the cloth": lambda row: (
            between(covered[row["sequence_b"]], [0.25, 0.5, 0.75], "").replace("  ", " ")
            if row["tier"] == "cloth"
            else ""
        ),
    }
    assert set(document["slices"]) == set(label_of)
    for name, label in label_of.items():
        members: dict[str, list[dict[str, Any]]] = {}
        for row in Rows(scene, table).rows:
            if (row["seen"] or name == "visibility in the target") and label(row):
                members.setdefault(label(row), []).append(row)
        found = {row["slice"]: row for row in document["slices"][name]}
        assert set(found) == set(members), name
        for each, rows in members.items():
            error = [row["error"] for row in rows]
            expected = {
                "slice": each,
                "queries": len(rows),
                "rmse_px": pytest.approx(rms(error)),
                "mean_px": pytest.approx(mean(error)),
                "pck_8px": pytest.approx(mean(row["reach"] <= 8 for row in rows)),
            }
            assert found[each] == expected, (name, each)


@pytest.mark.parametrize("modes", [2, 64])
def test_the_regions_of_modes_agree_with_a_sample(modes: int) -> None:
    """1,024 answers: within 0.03 of probability, since regions are found from points."""
    from pliant.evaluator.metrics.mixtures import Mixtures, in_regions

    rng = np.random.default_rng(3)
    count, levels = 1024, (0.5, 0.9, 0.95)
    centre = 160 + rng.normal(0, 20, (count, modes, 2))
    sigma = np.exp(rng.uniform(np.log(0.5), np.log(8), (count, modes)))
    weight = rng.dirichlet(np.ones(modes), count)
    true = np.empty((count, 2))
    for row in range(count):
        mode = rng.choice(modes, p=weight[row])
        true[row] = centre[row, mode] + sigma[row, mode] * rng.normal(size=2)
    rows = np.repeat(np.arange(count), modes)
    mixtures = Mixtures(rows, centre.reshape(-1, 2), sigma.ravel(), weight.ravel(), count)
    found = in_regions(mixtures, true, levels)

    def density_of(row: int, at: np.ndarray) -> np.ndarray:
        squared = ((at[:, None] - centre[row]) ** 2).sum(axis=2)
        variance = sigma[row] ** 2
        return (weight[row] / (2 * np.pi * variance) * np.exp(-squared / 2 / variance)).sum(axis=1)

    wrong = 0
    for row in range(80):
        drawn_from = rng.choice(modes, 4000, p=weight[row])
        drawn = centre[row, drawn_from] + sigma[row, drawn_from, None] * rng.normal(size=(4000, 2))
        above = (density_of(row, drawn) > density_of(row, true[row : row + 1])).mean()
        for level, inside in zip(levels, found[:, row], strict=True):
            assert inside == (above <= level) or abs(above - level) < 0.03
            wrong += inside != (above <= level)
    assert wrong <= 8
