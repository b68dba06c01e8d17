"""Causes of errors: constructed on rendered images, recovered, and adding up to the error."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image, ImageFilter

from pliant.evaluator import evaluate_answers, write_report
from pliant.evaluator.scores import Scores, read_scores
from pliant.spec.dataset import Dataset
from pliant.spec.sequence import SequenceRecord

NAMES = ("imprecision", "flip", "off_object", "layer", "across", "along", "missing", "hidden")
WIDTH = 640


@pytest.fixture(scope="module")
def bare(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Bare ropes and scrunched cloths at 640x480, drawn by our own rasteriser."""
    for name in ("numba", "scipy", "psutil"):
        pytest.importorskip(name)
    from pliant.generator.config import GenerateConfig, QuerySettings
    from pliant.generator.runner.run import generate
    from pliant.generator.settings.cloth import ClothSettings
    from pliant.generator.settings.rope import RopeSettings
    from tests.generator.runner.standin import InProcess

    config = GenerateConfig(
        tiers=("rope", "cloth-3"),
        splits={"test": 3},
        frames=2,
        width=WIDTH,
        height=480,
        style="raster",
        rope=RopeSettings(ball=False, shapes={"overlap": 0.5, "knot": 0.5}),
        cloth=ClothSettings(points_a_side=33, tracked_a_side=17),
        queries=QuerySettings(pairs_per_sequence=4, queries_per_pair=128),
        id="causes",
    )
    out = tmp_path_factory.mktemp("causes") / "data"
    assert not generate(config, out, engine=InProcess()).failed
    return out


@dataclass(frozen=True)
class Target:
    """What a target frame shows: its points, from the tables, and where its object is.

    Attributes:
        all_material: (N, 2), material of every point of the sequence.
        points_px, material: (P, 2), the visible points whose own pixel shows them. At an edge the
            pixel of a point may show another layer.
        near_object: bool (H, W), the object and 5 px around it.
    """

    all_material: np.ndarray
    points_px: np.ndarray
    material: np.ndarray
    near_object: np.ndarray


@dataclass(frozen=True)
class Asked:
    """One visible query with what its target frame shows, from the tables of points alone.

    Attributes:
        row: Its row.
        tier: Its tier.
        true_px: (2,), the truth.
        partners_px: (S, 2), where its symmetric partners are.
        target: Its target frame.
        steps_m: (P, 2), from its material to that of the frame's points along both coordinates.
    """

    row: int
    tier: str
    true_px: np.ndarray
    partners_px: np.ndarray
    target: Target
    steps_m: np.ndarray

    @property
    def apart_px(self) -> np.ndarray:
        return np.linalg.norm(self.target.points_px - self.true_px, axis=1)

    def point(self, rng: np.random.Generator, wanted: np.ndarray) -> np.ndarray | None:
        """Draw one of the wanted points that are not near a partner."""
        places = self.target.points_px
        return some(rng, places, wanted & self.away_from_partners(places))

    def away_from_partners(self, places: np.ndarray) -> np.ndarray:
        gap = np.linalg.norm(places[:, None] - self.partners_px[None], axis=-1)
        return gap.min(axis=1, initial=np.inf) > 17


def target_of(sequence: SequenceRecord, frame: int) -> Target:
    described = sequence.described
    points = sequence.points().to_pylist()
    every = np.array([[each["m0"], each["m1"]] for each in points])
    surface = sequence.surface(frame)
    seen, places = [], []
    for each in sequence.correspondences().to_pylist():
        point = points[each["point"]]
        if (
            each["frame"] == frame
            and each["visibility"] == "visible"
            and point["kind"] == "surface"
            and point["object"] == described.queried_object
        ):
            at = int(each["v_px"]), int(each["u_px"])
            under = np.array([surface.m0[at], surface.m1[at]], float)
            mine = every[each["point"]]
            if described.queried.distance_m(under, mine) < 0.02:
                seen.append(mine)
                places.append((each["u_px"], each["v_px"]))
    on = Image.fromarray(surface.object_id == described.queried_object).convert("L")
    near = np.array(on.filter(ImageFilter.MaxFilter(11))) > 0
    return Target(every, np.array(places), np.array(seen), near)


def asked_of(root: Path) -> list[Asked]:
    dataset = Dataset.open(root)
    truth, queries = dataset.truth("test").to_pylist(), dataset.queries("test").to_pylist()
    targets: dict[tuple[str, int], Target] = {}
    found = []
    for row, (true, query) in enumerate(zip(truth, queries, strict=True)):
        if true["visibility_b"] != "visible":
            continue
        sequence = dataset.sequence(query["sequence_b"])
        key = sequence.id, query["frame_b"]
        if key not in targets:
            targets[key] = target_of(sequence, query["frame_b"])
        target = targets[key]
        steps = target.material - target.all_material[true["point"]]
        for axis, each in enumerate(sequence.described.queried.material):
            if each.period is not None:
                steps[:, axis] -= each.period * np.round(steps[:, axis] / each.period)
            steps[:, axis] *= each.metres_per_unit
        partners = [(a["u"], a["v"]) for a in true["alternatives"] or []]
        at, partners_px = np.array([true["u_b"], true["v_b"]]), np.array(partners).reshape(-1, 2)
        found.append(Asked(row, query["tier"], at, partners_px, target, np.abs(steps)))
    return found


def some(rng: np.random.Generator, places: np.ndarray, wanted: np.ndarray) -> np.ndarray | None:
    chosen = np.flatnonzero(wanted)
    return places[rng.choice(chosen)] if len(chosen) else None


def imprecise(asked: Asked, rng: np.random.Generator) -> np.ndarray | None:
    angle, radius = rng.uniform(0, 2 * np.pi), rng.uniform(0, 3.9)
    return asked.true_px + radius * np.array([np.cos(angle), np.sin(angle)])


def flipped(asked: Asked, rng: np.random.Generator) -> np.ndarray | None:
    far = np.linalg.norm(asked.partners_px - asked.true_px, axis=1) > 12
    place = some(rng, asked.partners_px, far)
    return None if place is None else place + rng.normal(0, 1, 2)


def off_object(asked: Asked, rng: np.random.Generator) -> np.ndarray | None:
    """A place of the background, up to 60 px from the truth, 5 px from the object."""
    places = asked.true_px + rng.uniform(-60, 60, (200, 2))
    near_object = asked.target.near_object
    places = places[((places >= 0) & (places < near_object.shape[::-1])).all(axis=1)]
    column, row = places.astype(int).T
    background = ~near_object[row, column]
    return some(rng, places, background & asked.away_from_partners(places))


def layered(asked: Asked, rng: np.random.Generator) -> np.ndarray | None:
    """A point at most 30 px away that is at least 0.2 m away on the material."""
    near = (asked.apart_px > 5) & (asked.apart_px < 30)
    far = np.hypot(*asked.steps_m.T) > 0.2
    return asked.point(rng, near & far)


def across(asked: Asked, rng: np.random.Generator) -> np.ndarray | None:
    """A point of the same cross-section."""
    if asked.tier != "rope":
        return None
    same = (asked.steps_m[:, 0] < 0.002) & (asked.apart_px > 5)
    return asked.point(rng, same)


def along(asked: Asked, rng: np.random.Generator) -> np.ndarray | None:
    """A point farther away than any neighbouring strand."""
    far = (asked.apart_px > 40) & (asked.steps_m[:, 0] > 0.05)
    return asked.point(rng, far)


CONSTRUCTED: dict[str, Callable[[Asked, np.random.Generator], np.ndarray | None]] = {
    "imprecision": imprecise,
    "flip": flipped,
    "off_object": off_object,
    "layer": layered,
    "across": across,
    "along": along,
}
LEAST = {"layer": 60}
"""Constructed answers that there must be at least, else 250."""


@pytest.fixture(scope="module")
def asked(bare: Path) -> list[Asked]:
    """The visible queries of `bare`."""
    return asked_of(bare)


def causes(scores: Scores, group: str = "overall") -> dict[str, Any]:
    document = scores.document["causes"]
    found: dict[str, Any] = document["overall"] if group == "overall" else document["tiers"][group]
    return found


def oracle_px(root: Path) -> np.ndarray:
    """Return the truth, float64 (R, 2), zeros where a hidden point has no position."""
    truth = Dataset.open(root).truth("test")
    uv = np.stack([truth[name].to_numpy() for name in ("u_b", "v_b")], axis=1)
    return np.nan_to_num(uv.astype(float))


@pytest.mark.slow
@pytest.mark.parametrize("cause", CONSTRUCTED)
def test_constructed_errors_get_their_cause(bare: Path, asked: list[Asked], cause: str) -> None:
    """The truth with one kind of error: at least 99 % of the errors are recognised."""
    rng = np.random.default_rng(7)
    uv = oracle_px(bare)
    made = []
    for each in asked:
        place = CONSTRUCTED[cause](each, rng)
        if place is not None:
            uv[each.row] = place
            made.append(float(((place - each.true_px) ** 2).sum()))
    assert len(made) >= LEAST.get(cause, 250)
    scores = evaluate_answers(bare, "test", uv)
    found, counted = causes(scores), scores.document["counts"]["counted"]
    right = counted - len(made) if cause == "imprecision" else 0  # answers without an error
    assert 0.99 * len(made) <= found[cause]["answers"] - right <= len(made), found
    assert found[cause]["squared_error_share"] > 0.98
    assert scores.overall["rmse_px"] == pytest.approx(np.sqrt(sum(made) / counted), rel=1e-5)


@pytest.mark.slow
def test_hidden_points_and_missing_answers_are_causes_too(bare: Path) -> None:
    """A hidden point counts outside the RMSE; a missing answer as an error of the diagonal."""
    states = Dataset.open(bare).truth("test")["visibility_b"].to_pylist()
    queries = Dataset.open(bare).queries("test")
    rows = np.arange(len(states))
    kept = rows % 10 != 0
    columns = {name: queries[name].to_numpy()[kept] for name in ("pair_id", "query_id")}
    uv = oracle_px(bare)[kept]
    columns |= {"u": uv[:, 0].astype(np.float32), "v": uv[:, 1].astype(np.float32)}
    found = causes(evaluate_answers(bare, "test", columns, allow_missing=True))
    hidden = np.array([state != "visible" for state in states])
    assert found["hidden"]["answers"] == hidden.sum() > 50
    assert found["hidden"]["squared_error_share"] is None
    assert found["missing"]["answers"] == (~hidden & ~kept).sum() > 50
    assert found["missing"]["squared_error_share"] == pytest.approx(1, abs=1e-6)
    assert found["missing"]["rmse_px"] == pytest.approx(800)


@pytest.mark.slow
def test_the_shares_add_up_to_the_squared_error(bare: Path, tmp_path: Path) -> None:
    """Random answers: every visible point has one cause, in every tier and in the pair table."""
    rng = np.random.default_rng(3)
    uv = rng.uniform(0, (640, 480), (len(oracle_px(bare)), 2))
    near = rng.random(len(uv)) < 0.6
    uv[near] = (oracle_px(bare) + rng.normal(0, 10, uv.shape))[near]
    scores = evaluate_answers(bare, "test", uv)
    for group in ("overall", *scores.tiers):
        found = causes(scores, group)
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
    assert read_scores(tmp_path / "report").document["causes"] == scores.document["causes"]


def test_without_surface_images_there_are_no_causes(
    scene_maker: Callable[..., Any], tmp_path: Path
) -> None:
    scene = scene_maker(tmp_path / "data", images=False)
    assert "causes" not in scene.score(tmp_path).document


def test_scores_for_participants_have_no_causes(scene: Any, tmp_path: Path) -> None:
    """Causes are found with the truth, so they would tell single answers."""
    assert "causes" in scene.score(tmp_path).document
    assert "causes" not in scene.score(tmp_path, hide_truth=True).document
