"""Figures of points with an equal partner, by distributions whose masses are known."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pytest

from pliant.spec.tables import ANSWERS_OPTIONAL
from tests.evaluator.figures import figure

NAMES = (
    "orbit_pck_8px", "flip_rate_8px", "mass_8px", "partner_mass_8px", "least_mass_8px",
)  # fmt: skip


def asked(scene: Any) -> dict[int, np.ndarray]:
    """Return, by row, where the visible partners of the points that count are, float (S, 2)."""
    found = {}
    rows = zip(scene.truth["alternatives"].to_pylist(), scene.true_px, scene.visible, strict=True)
    for number, (alternatives, own, visible) in enumerate(rows):
        seen = [(a["u"], a["v"]) for a in alternatives or [] if a["visibility"] == "visible"]
        places = np.array([own, *seen])
        gap = np.hypot(*(places[:, None] - places[None]).transpose(2, 0, 1))
        if visible and seen and gap[np.triu_indices(len(places), 1)].min() > 16:
            found[number] = np.array(seen)
    return found


def scores_of(
    scene: Any, folder: Path, weights: tuple[float, float], at_partner: dict[int, np.ndarray]
) -> dict[str, float]:
    """Score answers with one mode at the truth and one at the first partner.

    `at_partner` are the rows answered there, and where.
    """
    uv = scene.true_px.copy()
    modes = [[{"u": u, "v": v, "sigma": 0.5, "weight": 1.0}] for u, v in uv]
    for row, partners in asked(scene).items():
        (u, v), (x, y) = uv[row], partners[0]
        both = zip(((u, v), (x, y)), weights, strict=True)
        modes[row] = [
            {"u": at[0], "v": at[1], "sigma": 0.5, "weight": share} for at, share in both if share
        ]
    for row, place in at_partner.items():
        uv[row] = place
    column = pa.array(modes, ANSWERS_OPTIONAL.field("modes").type)
    table = scene.table(uv.astype(np.float32)).append_column("modes", column)
    scores = scene.score(folder, table)
    return {name: figure(scores, name) for name in NAMES}


def test_a_coin_between_two_places(scene: Any, tmp_path: Path) -> None:
    """Half of the mass at each of two places; every second answer is at the partner."""
    points = asked(scene)
    two = {row: at[0] for row, at in points.items() if len(at) == 1}
    flipped = dict(list(two.items())[::2])
    found = scores_of(scene, tmp_path, (0.5, 0.5), flipped)
    assert found["orbit_pck_8px"] == 1
    assert found["flip_rate_8px"] == pytest.approx(len(flipped) / len(points))
    assert found["mass_8px"] == pytest.approx(0.5, abs=1e-6)
    others = [1 / len(at) for at in points.values()]
    assert found["partner_mass_8px"] == pytest.approx(0.5 * np.mean(others), abs=1e-6)
    assert found["least_mass_8px"] == pytest.approx(0.5 * len(two) / len(points), abs=1e-6)
