"""Familiarity: uniform on queries like those of the validation split, 0 on strange ones."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from pliant.baselines.matcher import UNFAMILIAR
from pliant.baselines.tracing import MaskShape, Nadir, Trace
from pliant.loaders.frame_store import FrameStore
from pliant.models.don.described import DescribedView
from pliant.models.don.familiarity import (
    TRACED,
    DescriptorStatistics,
    Familiarity,
    QueryDescriptors,
    fit_familiarity,
    traced_statistics,
)
from pliant.models.don.matcher import DonMatcher
from pliant.models.don.tracing import TracedPlaces, TracedView
from pliant.models.don.validation import draw_validation_pairs
from pliant.models.shipped import load_shipped
from pliant.spec.dataset import Dataset
from pliant.spec.errors import TrainingError
from pliant.spec.frame import Frame
from tests.known import known

torch = pytest.importorskip("torch")

DIM, SIDE = 4, 20
RNG = np.random.default_rng(5)
BEGINNING = RNG.bit_generator.state
SPREAD = np.array([1.0, 3.0, 0.5, 2.0])


def picture(share: float = 0.25, shift: float = 0.0, scale: float = 1.0) -> DescribedView:
    """Descriptors on the object are Gaussian; off it they are far away."""
    mask = np.zeros((SIDE, SIDE), np.bool_)
    mask.reshape(-1)[: int(share * SIDE**2)] = True
    values = RNG.normal(size=(SIDE, SIDE, DIM)) * SPREAD * scale + shift
    values[~mask] += 40
    described = torch.from_numpy(values.transpose(2, 0, 1).astype(np.float32))
    return DescribedView([described], None, mask, None)


def asked(
    source: DescribedView, target: DescribedView, distance: float = 1.0, shift: float = 0
) -> QueryDescriptors:
    query = (RNG.normal(size=(20, DIM)) * SPREAD + shift).astype(np.float32)
    return QueryDescriptors(source, target, query, RNG.gamma(3.0, distance / 3, 20))


@pytest.fixture(autouse=True)
def draws_of_its_own() -> None:
    """What a test draws does not depend on which tests ran before it in the process."""
    RNG.bit_generator.state = BEGINNING
    RNG.random(1000)  # not the draws that `fitted` has seen


@pytest.fixture(scope="module")
def fitted() -> Familiarity:
    RNG.bit_generator.state = BEGINNING
    validation = [asked(picture(), picture()) for _ in range(100)]
    usual = DescriptorStatistics.of(validation)
    return fit_familiarity(np.concatenate(list(map(usual.statistics, validation))), usual)


def scores(fitted: Familiarity, *queries: QueryDescriptors) -> np.ndarray:
    return fitted.score(np.concatenate(list(map(known(fitted.descriptors).statistics, queries))))


def test_the_score_is_the_share_of_queries_as_unusual(fitted: Familiarity) -> None:
    found = scores(fitted, *(asked(picture(), picture()) for _ in range(100)))
    for level in (0.1, 0.3, 0.5, 0.7, 0.9):
        assert np.mean(found <= level) == pytest.approx(level, abs=0.06)


STRANGE = {
    "query": lambda: asked(picture(), picture(), shift=60),
    "no similar candidate": lambda: asked(picture(), picture(), distance=1e4),
    "source": lambda: asked(picture(shift=30), picture()),
    "target": lambda: asked(picture(), picture(scale=9)),
    "size of the object": lambda: asked(picture(), picture(share=0.9)),
}


@pytest.mark.parametrize("case", STRANGE)
def test_strange_queries_score_nothing(case: str, fitted: Familiarity) -> None:
    assert scores(fitted, STRANGE[case]()).max() < 0.01


def test_an_object_of_twice_the_size_is_not_strange(fitted: Familiarity) -> None:
    assert np.median(scores(fitted, asked(picture(), picture(share=0.5)))) > 0.2


def test_without_masks_the_query_alone_counts(fitted: Familiarity) -> None:
    bare = [replace(each, mask=None) for each in (picture(), picture())]
    assert np.median(scores(fitted, asked(bare[0], bare[1]))) > 0.2
    assert scores(fitted, asked(bare[0], bare[1], shift=60)).max() < 0.01


LINE = np.stack([np.linspace(10, 310, 300), np.full(300, 120.0)], axis=1)


def traced(
    shape: MaskShape, *, coverage: float = 0.98, retraced: float = 0.0, length_px: float = 300.0
) -> TracedView:
    trace = Trace(LINE, length_px, 4.0, coverage, retraced, Nadir.of_image((240, 320)))
    frame = Frame(np.zeros((240, 320, 3), np.uint8))
    return TracedView(frame, torch.zeros(2, 24, 32), [trace], shape)


ONE_ROPE = MaskShape(parts=1, ends=2, has_ball=False)


def statistics(view: TracedView, agreeing: float = 0.97) -> np.ndarray:
    """Three queries that readings of this weight carry to the answers."""
    answers = LINE[[50, 100, 200]]
    places = np.stack([answers, answers + np.array([60, 0])])
    weighed = TracedPlaces(places, np.array([agreeing, 1 - agreeing]), 1.5)
    return traced_statistics(traced(ONE_ROPE), view, weighed, answers)


@pytest.fixture(scope="module")
def of_ropes() -> Familiarity:
    rng = np.random.default_rng(1)
    views = [
        traced(
            MaskShape(1, int(rng.integers(0, 3)), has_ball=False),
            coverage=1 - 0.05 * rng.random(),
            retraced=0.02 * rng.random(),
            length_px=300 + 60 * rng.random(),
        )
        for _ in range(300)
    ]
    return fit_familiarity(
        np.concatenate([statistics(each, 1 - 0.1 * rng.random()) for each in views])
    )


@pytest.mark.parametrize(
    "case",
    [
        lambda: statistics(traced(MaskShape(2, 2, has_ball=False))),
        lambda: statistics(traced(MaskShape(1, 4, has_ball=False))),
        lambda: statistics(traced(MaskShape(1, 1, has_ball=True))),
        lambda: statistics(traced(ONE_ROPE, coverage=0.6)),
        lambda: statistics(traced(ONE_ROPE, retraced=0.5)),
        lambda: statistics(traced(ONE_ROPE, length_px=30.0)),
        lambda: statistics(traced(ONE_ROPE), agreeing=0.5),
        lambda: traced_statistics(traced(ONE_ROPE), traced(ONE_ROPE), None, LINE[:3]),
    ],
    ids=["parts", "ends", "ball", "uncovered", "retraced", "stout", "elsewhere", "no trace"],
)
def test_what_is_not_one_rope_is_strange(case: object, of_ropes: Familiarity) -> None:
    assert of_ropes.score(case()).max() < 0.01  # type: ignore[operator]
    assert of_ropes.score(statistics(traced(ONE_ROPE))).min() > 0.1


def ball_in_mask(own: Frame, other: Frame) -> Frame:
    """Return the frame with a mask that takes the ball for rope."""
    del other
    return own.replace(mask=own.objects, key=f"{own.key} ball in mask")


def two_ropes(own: Frame, other: Frame) -> Frame:
    """Return the frame with a mask that has the other frame's rope too, mirrored."""
    further = known(other.objects)[:, ::-1]
    mask, objects = known(own.mask) | further, known(own.objects) | further
    return own.replace(mask=mask, objects=objects, key=f"{own.key} and {other.key}")


@pytest.mark.long
def test_the_shipped_model_warns_of_masks_that_mislead_and_of_no_others() -> None:
    dataset = Dataset.open("sample")
    store = FrameStore(dataset, "rope", "test", dataset.size)
    matcher = load_shipped("don-rope")
    drawn = draw_validation_pairs(store, 6, 24, 0)
    pairs = drawn[1], drawn[5]  # a ball in the mask makes the answers wrong in these
    gaps_px, unusual = {}, {}
    for change in (None, ball_in_mask, two_ropes):
        errors, flagged = [], []
        for pair in pairs:
            a, b = pair.source, pair.target
            asked = (
                pair if change is None else replace(pair, source=change(a, b), target=change(b, a))
            )
            answers = matcher.answer(asked)
            errors.append(np.linalg.norm(answers.uv_px - pair.uv_b_px[:, 0], axis=1))
            flagged.append(known(answers.familiarity) < UNFAMILIAR)
        gaps_px[change], unusual[change] = np.concatenate(errors), np.concatenate(flagged)
    assert (gaps_px[None] < 15).all()
    assert unusual[None].mean() <= 0.05
    assert unusual[ball_in_mask][gaps_px[ball_in_mask] > 60].mean() >= 0.8
    assert (gaps_px[two_ropes] < 15).mean() >= 0.9  # the picture tells which of the two it is


@pytest.mark.parametrize("decode", ["trace", "median"])
def test_answers_that_are_not_of_traces_do_not_have_the_familiarity_of_traces(decode: str) -> None:
    """Without traces every query was called stranger than all of the training split."""
    matcher = load_shipped("don-rope", decode=decode, crossings=decode == "trace")
    assert isinstance(matcher, DonMatcher)
    assert (matcher.familiarity is None) == (decode == "median")


@pytest.mark.parametrize("kind", ["fitted", "of_ropes"])
def test_it_is_stored_whole(kind: str, request: pytest.FixtureRequest) -> None:
    stored = request.getfixturevalue(kind)
    again = Familiarity.from_document(stored.as_document(), "familiarity.json")
    values = RNG.normal(size=(20, len(stored.thresholds)))
    np.testing.assert_array_equal(again.score(values), stored.score(values))
    assert (again.descriptors is None) == (stored.descriptors is None)
    assert len(stored.thresholds) == len(
        TRACED if again.descriptors is None else DescriptorStatistics.STATISTICS
    )
    damaged = {**stored.as_document(), "thresholds": [[0.0]]}
    with pytest.raises(TrainingError, match="the familiarity is damaged"):
        Familiarity.from_document(damaged, "familiarity.json")
