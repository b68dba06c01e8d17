"""Causes of errors in the scores: of each tier, in the pair table, and adding up to the error."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Callable
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from pliant.evaluator import write_report
from pliant.evaluator.metrics.causes import CAUSES, NO_CAUSE, Causes, CausesSettings, cause_rows
from pliant.evaluator.metrics.surfaces import SurfaceFacts
from pliant.evaluator.scores import read_scores
from pliant.spec.model import Tier
from tests.evaluator.conftest import CLOTH, ROPE
from tests.evaluator.hand_made import Split, episodes, off_by, split

NAMES = ("imprecision", "flip", "off_object", "layer", "across", "along", "missing", "hidden")


def test_an_error_gets_its_cause(scene: Any, tmp_path: Path) -> None:
    """One kind of error at a time, on pictures 160 px wide: 1 px is precise, 8 px is near."""
    true_px, visible = scene.true_px, scene.visible
    cloth = np.array(scene.queries["tier"].to_pylist()) == "cloth"
    alternatives = scene.truth["alternatives"].to_pylist()
    partner_px = np.array(
        [(each[0]["u"], each[0]["v"]) if each else (0, 0) for each in alternatives]
    )
    other_px = np.roll(true_px.reshape(-1, 20, 2), 1, axis=1).reshape(-1, 2)
    for cause, answer_px, of in (
        ("imprecision", true_px + 0.7, visible),
        ("flip", partner_px, cloth),
        ("off_object", np.ones_like(true_px), visible),
        ("along", other_px, ~cloth & (np.linalg.norm(other_px - true_px, axis=1) > 8)),
    ):
        wrong = visible & of & (np.linalg.norm(answer_px - true_px, axis=1) > 0.9)
        table = scene.table(np.where(wrong[:, None], answer_px, true_px))
        found = scene.score(tmp_path, table).document["causes"]["overall"]
        expected = Counter(imprecision=sum(visible & ~wrong), hidden=sum(~visible))
        expected[cause] += sum(wrong)
        assert min(sum(wrong), expected["hidden"]) > 20
        assert +Counter({name: found[name]["answers"] for name in NAMES}) == +expected


def test_the_shares_add_up_to_the_squared_error(scene: Any, tmp_path: Path) -> None:
    """Random answers: every visible point has one cause, in every tier and in the pair table."""
    rng = np.random.default_rng(3)
    uv = rng.uniform(0, (160, 120), (scene.rows, 2))
    near = rng.random(scene.rows) < 0.6
    uv[near] = (scene.true_px + rng.normal(0, 4, uv.shape))[near]
    scores = scene.score(tmp_path, scene.table(uv))
    document = scores.document["causes"]
    for group, found in (("overall", document["overall"]), *document["tiers"].items()):
        assert list(found) == list(NAMES)
        counted = [found[name] for name in NAMES if name != "hidden"]
        assert sum(each["squared_error_share"] for each in counted) == pytest.approx(1)
        assert sum(each["answers_share"] for each in counted) == pytest.approx(1)
        values = scores.overall if group == "overall" else scores.tiers[group]
        total = sum(each["answers"] * (each["rmse_px"] or 0) ** 2 for each in counted)
        answers = sum(each["answers"] for each in counted)
        assert np.sqrt(total / answers) == pytest.approx(values["rmse_px"])
    sums = [scores.per_pair[f"cause_{name}_px2"].to_numpy() for name in NAMES if name != "hidden"]
    whole = scores.per_pair["sum_squared_px2"].to_numpy()
    np.testing.assert_allclose(np.sum(sums, axis=0), whole, rtol=1e-9)
    write_report(scores, tmp_path / "report")
    assert read_scores(tmp_path / "report").document["causes"] == document


def test_without_surface_images_and_for_participants_there_are_no_causes(
    scene: Any, scene_maker: Callable[..., Any], tmp_path: Path
) -> None:
    """Causes are found with the truth, so they would tell single answers."""
    bare = scene_maker(tmp_path / "data", images=False)
    assert "causes" not in bare.score(tmp_path).document
    assert "causes" not in scene.score(tmp_path, hide_truth=True).document


NAN = math.nan
NOWHERE = (NAN, NAN)
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
    (NAN, NOWHERE, "", {"known": False, "visible": False}),  # a hidden point without a position
    (0.0, (0, 0), "missing", {"missing": True}),
]
BEFORE = 2  # rows of the split before the block


@pytest.mark.parametrize(("described", "across"), [(ROPE, "across"), (CLOTH, "along")])
def test_causes_of_errors(described: dict[str, Any], across: str) -> None:
    usual = {"partner": None, "pixel_m": 0.001, "known": True, "visible": True, "missing": False}
    cases = [usual | each[3] for each in CASES]
    error = np.array([each[0] for each in CASES])
    answer_px = np.stack([100 + np.nan_to_num(error), 10.0 * np.arange(len(CASES))], axis=1)
    true_px = answer_px - np.stack([error, 0 * error], axis=1)
    partners = [
        [] if each["partner"] is None else [(u, v + each["partner"], True)]
        for each, (u, v) in zip(cases, answer_px, strict=True)
    ]
    answer_px[[each["missing"] for each in cases]] = NAN
    before = np.zeros((BEFORE, 2))
    known = np.array([each["known"] for each in cases])
    empty = np.full(len(cases), NAN)
    facts = SurfaceFacts(
        known, known, empty, empty, np.array([each[1] for each in CASES], float),
        np.array([each["pixel_m"] for each in cases]),
    )  # fmt: skip
    made = Split(
        split([BEFORE, len(cases)], size=(640, 480)),
        np.concatenate([before, answer_px]), np.concatenate([before, true_px]),
        [BEFORE + row for row, each in enumerate(cases) if not each["visible"]],
        dataset=episodes(t=Tier.from_document(described)), partners=[[], [], *partners],
        surfaces=SimpleNamespace(facts=lambda *_: facts),
    )  # fmt: skip
    causes = Causes(CausesSettings(), made.context)
    causes.update(made.block(1, 2))
    assert causes.codes[:BEFORE].tolist() == [NO_CAUSE] * BEFORE
    names = [CAUSES[code].name if code != NO_CAUSE else "" for code in causes.codes[BEFORE:]]
    expected = [across if each[2] == "across" else each[2] for each in CASES]
    assert names == expected
    squared = np.where([name == "missing" for name in expected], 800.0, error) ** 2
    for cause in CAUSES:
        mine = np.array([name == cause.name for name in expected])
        assert made.column(f"cause_{cause.name}_answers") == [0, mine.sum()]
        found = made.column(f"cause_{cause.name}_px2")
        assert found == pytest.approx([0, squared[mine].sum()])
    assert made.column("causes_known") == [0, known.sum()]


def test_shares_of_causes() -> None:
    sums = {f"cause_{cause.name}_{key}": 0.0 for cause in CAUSES for key in ("answers", "px2")}
    sums |= {"cause_flip_answers": 3, "cause_flip_px2": 48, "cause_along_answers": 1}
    sums |= {"cause_along_px2": 16, "cause_hidden_answers": 4, "cause_hidden_px2": 400}
    keys = ("answers", "answers_share", "squared_error_share", "rmse_px")

    def figures(name: str, **changes: float) -> list[Any]:
        rows = cause_rows(sums | changes)
        assert tuple(rows[name]) == keys
        return list(rows[name].values())

    assert figures("flip") == [3, 0.75, 0.75, 4]
    assert figures("along") == [1, 0.25, 0.25, 4]
    assert figures("layer") == [0, 0, 0, None]
    assert figures("hidden") == [4, None, None, 10]
    assert figures("flip", cause_flip_px2=0, cause_along_px2=0) == [3, 0.75, None, 0]
    assert figures("flip", cause_flip_answers=0, cause_along_answers=0)[1] is None


@pytest.mark.parametrize(
    ("hidden", "known", "left_out"),
    [
        ([2], [True, True, False], ""),
        ([], [True, False, False], "2 of 3 pairs"),
        ([1, 2], [False, False, False], None),
    ],
)
def test_pairs_without_causes_are_said(
    hidden: list[int], known: list[bool], left_out: str | None
) -> None:
    queries = split([1, 1, 1], tiers=["x", "y"], tier=[0, 0, 1])
    tier = Tier.from_document(CLOTH)

    def facts(block: Any, _: Any) -> SurfaceFacts:
        here, empty = np.array(known)[block.rows], np.full(len(block.state), NAN)
        return SurfaceFacts(here, here, empty, empty, np.stack([empty, empty], axis=1), empty)

    made = Split(
        queries, off_by(0, 0, 0), hidden=hidden, dataset=episodes(x=tier, y=tier),
        surfaces=SimpleNamespace(facts=facts),
    )  # fmt: skip
    found = made.found(Causes(CausesSettings(), made.context))
    if left_out is None:
        assert not found.causes
        assert not found.notes
        return
    imprecise = {name: rows["imprecision"]["answers"] for name, rows in found.causes.items()}
    assert imprecise == {"overall": sum(known), "x": sum(known[:2]), "y": 0}
    assert found.notes.get("causes", "").startswith(left_out)
    assert bool(left_out) == ("causes" in found.notes)
