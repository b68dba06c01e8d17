"""Metrics on one block that is made by hand."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from pliant.evaluator.metrics.base import PairTable
from pliant.evaluator.metrics.blocks import VISIBLE, Block, Partners
from pliant.evaluator.metrics.causes import (
    CAUSES,
    NO_CAUSE,
    Causes,
    CausesSettings,
)
from pliant.evaluator.metrics.distribution import answered_mixtures
from pliant.evaluator.metrics.surfaces import SurfaceFacts
from pliant.evaluator.submission.answers import PlacedAnswers
from pliant.spec.model import Tier
from tests.evaluator.conftest import CLOTH, ROPE

BEFORE = 2  # rows of the split before the block


def block(true_px: Any, answer_px: Any, **more: Any) -> Block:
    """Return a block of one pair, all of whose points are visible if not said otherwise."""
    count = len(true_px)
    usual: dict[str, Any] = {
        "first_row": BEFORE, "first_pair": 0, "starts": np.array([0, count]),
        "true_px": np.asarray(true_px, float), "state": np.full(count, VISIBLE, np.uint8),
        "answer_px": np.asarray(answer_px, float), "missing": None, "missing_px": 800.0,
    }  # fmt: skip
    return Block(**usual | more)


def context(rows: int, **more: Any) -> Any:
    table = PairTable(1, [])
    per_row = np.full(BEFORE + rows, np.nan)
    return SimpleNamespace(table=table, per_row=per_row.copy, **more)


NOWHERE = (np.nan, np.nan)
# Of a 640x480 image: precise to 4 px, near a partner to 16 px, near the truth to 32 px; a pixel
# spans 1 mm. Each row: error in px, steps on the material in m, the cause.
CASES: list[tuple[float, tuple[float, float], str, dict[str, Any]]] = [
    (4.0, (0.5, 0), "imprecision", {}),
    (4.1, (0.01, 0), "along", {}),
    (5.0, (0.016, 0), "layer", {}),  # 16 px on the material, more than 3 times 5 px
    (5.0, (-0.016, 0), "layer", {}),
    (5.0, (0.015, 0), "along", {}),
    (32.0, (0.097, 0), "layer", {}),
    (32.1, (0.2, 0), "along", {}),
    (5.0, (0.001, 0.002), "across", {}),
    (5.0, (0.001, -0.002), "across", {}),
    (5.0, (0.002, 0.002), "along", {}),
    (5.0, (0.01, 0.012), "layer", {}),
    (50.0, NOWHERE, "off_object", {}),
    (50.0, NOWHERE, "flip", {"partner": 16.0}),
    (50.0, NOWHERE, "off_object", {"partner": 16.1}),
    (32.0, (0.2, 0), "flip", {"partner": 16.0}),
    (31.9, (0, 0), "along", {"partner": 16.0}),  # not twice as near as the truth
    (3.0, (0, 0), "imprecision", {"partner": 1.0}),
    (5.0, (0.5, 0), "along", {"pixel_m": 0.0}),
    (5.0, (0.5, 0), "", {"known": False}),
    (50.0, NOWHERE, "", {"known": False, "partner": 1.0}),
    (5.0, (0.5, 0), "hidden", {"known": False, "visible": False}),
    (np.nan, NOWHERE, "", {"known": False, "visible": False}),
    (0.0, (0, 0), "missing", {"missing": True}),
]


@pytest.mark.parametrize(("described", "across"), [(ROPE, "across"), (CLOTH, "along")])
def test_causes_of_errors(described: dict[str, Any], across: str) -> None:
    count = len(CASES)
    true_px = np.stack([np.full(count, 100.0), 10.0 * np.arange(count)], axis=1)
    error = np.array([each[0] for each in CASES])
    answer_px = true_px + np.stack([error, np.zeros(count)], axis=1)
    usual = {"partner": None, "pixel_m": 0.001, "known": True, "visible": True, "missing": False}
    more = [usual | each[3] for each in CASES]
    values = {name: np.array([each[name] for each in more]) for name in usual}
    answer_px[values["missing"]] = np.nan
    places = [
        (*answer_px[k] + [0, each["partner"]],)
        for k, each in enumerate(more)
        if each["partner"] is not None
    ]
    begin = np.cumsum([0, *(each["partner"] is not None for each in more)])
    given = block(
        true_px, answer_px, missing=values["missing"],
        state=np.where(values["visible"], VISIBLE, VISIBLE + 1).astype(np.uint8),
        partners=Partners(begin, np.array(places), np.ones(len(places), bool)),
    )  # fmt: skip
    empty = np.full(count, np.nan)
    facts = SurfaceFacts(
        values["known"], values["known"], empty, empty, np.array([each[1] for each in CASES]),
        values["pixel_m"].astype(float),
    )  # fmt: skip
    tier = Tier.from_document(described)
    given_context = context(
        count,
        queries=SimpleNamespace(size=(640, 480), tier=np.zeros(1, np.int64), tiers=["t"]),
        dataset=SimpleNamespace(tiers={"t": tier}),
        answers=SimpleNamespace(uv_px=np.zeros((BEFORE + count, 2))),
        surfaces=SimpleNamespace(facts=lambda *_: facts),
    )
    causes = Causes(CausesSettings(), given_context)
    causes.update(given)
    assert causes.codes[:BEFORE].tolist() == [NO_CAUSE] * BEFORE
    names = [CAUSES[code].name if code != NO_CAUSE else "" for code in causes.codes[BEFORE:]]
    expected = [across if each[2] == "across" else each[2] for each in CASES]
    assert names == expected
    columns = given_context.table.columns
    squared = np.where(values["missing"], 800.0, error) ** 2
    for cause in CAUSES:
        mine = np.array([name == cause.name for name in expected])
        assert columns[f"cause_{cause.name}_answers"][0] == mine.sum()
        assert columns[f"cause_{cause.name}_px2"][0] == pytest.approx(squared[mine].sum())
    assert columns["causes_known"][0] == values["known"].sum()


def test_distributions_of_some_answers() -> None:
    uv_px = np.arange(10.0).reshape(5, 2)
    given = block(uv_px[BEFORE:], uv_px[BEFORE:])
    chosen = np.array([0, 2])
    sigma = PlacedAnswers(uv_px, sigma_px=np.array([9.0, 9, 0.2, 9, 3]))
    found = answered_mixtures(sigma, given, chosen, 0.5)
    np.testing.assert_array_equal(found.uv_px, [[4, 5], [8, 9]])
    np.testing.assert_array_equal(found.sigma_px, [0.5, 3])
    np.testing.assert_array_equal(found.weight, [1, 1])
    modes = np.array([[1, 2, 0.1, 3], [3, 4, 2, 1], [5, 6, 7, 0.5], [8, 9, 4, 2]], float)
    several = PlacedAnswers(
        uv_px, modes=modes, mode_begin=np.array([3, 3, 0, 2, 3]),
        mode_count=np.array([1, 1, 2, 1, 1]),
    )  # fmt: skip
    found = answered_mixtures(several, given, chosen, 0.5)
    np.testing.assert_array_equal(found.row, [0, 0, 1])
    np.testing.assert_array_equal(found.uv_px, [[1, 2], [3, 4], [8, 9]])
    np.testing.assert_array_equal(found.sigma_px, [0.5, 2, 4])
    np.testing.assert_array_equal(found.weight, [0.75, 0.25, 1])
    assert found.rows == 2
