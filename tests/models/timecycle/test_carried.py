"""Points that the descriptors of a shipped network carry through a rendered episode."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import pliant
from pliant.baselines import Pair, TrackMatcher
from pliant.baselines.matcher import SplitMatcher
from pliant.models.don.trainer import train_don
from pliant.spec.dataset import Dataset
from pliant.spec.errors import CallError
from pliant.spec.point_mesh import surface_points
from tests.models.tiny_runs import don

FRAMES = 20


@pytest.mark.parametrize("flow", [True, False])
def test_descriptors_carry_points_of_a_rope(tiny_episode: Path, flow: bool) -> None:
    dataset = Dataset.open(tiny_episode)
    sequence = next(each for each in dataset.sequences if each.split == "test")
    points = surface_points(sequence.points(), dataset.tiers["rope"].queried_object)
    tables = [sequence.correspondences(number) for number in range(FRAMES)]
    places = np.stack(
        [np.column_stack([table["u_px"], table["v_px"]])[points] for table in tables]
    )  # (T, P, 2)
    seen = np.all([np.array(t["visibility"])[points] == "visible" for t in tables], axis=0)
    seen &= np.linalg.norm(places[-1] - places[0], axis=1) > 4
    asked = np.flatnonzero(seen)[::5]
    assert len(asked) > 10

    tracker = pliant.open_method("carried:don-rope", flow=flow)
    assert isinstance(tracker, TrackMatcher)
    start = places[0, asked].astype(np.float32)
    *_, last = tracker.track((sequence[number] for number in range(FRAMES)), start)
    error = np.linalg.norm(last.uv_px - places[-1, asked], axis=1)
    still = np.linalg.norm(start - places[-1, asked], axis=1)
    assert np.sqrt((error**2).mean()) < 0.6 * np.sqrt((still**2).mean())


def test_pairs_are_answered_as_by_the_network(tiny_episode: Path) -> None:
    sequence = Dataset.open(tiny_episode).sequences[0]
    pair = Pair(sequence[0], sequence[3], np.array([[80.0, 60.0], [70.0, 50.0]], np.float32))
    found = []
    for name in ("carried:don-rope", "don-rope"):
        matcher = pliant.open_method(name)
        assert not isinstance(matcher, SplitMatcher)
        found.append(matcher.answer(pair).uv_px)
    np.testing.assert_array_equal(found[0], found[1])


def test_a_network_of_another_size_than_whole_cells(tiny_episode: Path, tmp_path: Path) -> None:
    dataset = Dataset.open(tiny_episode)
    train_don(dataset, tmp_path / "run", don("validation.split=test", "split=test"))  # 40x30
    tracker = pliant.open_method(f"carried:{tmp_path / 'run'}")
    assert isinstance(tracker, TrackMatcher)
    start = np.array([[80.0, 60.0]], np.float32)
    sequence = dataset.sequences[0]
    (still,) = tracker.track((sequence[0], sequence[0]), start)
    np.testing.assert_allclose(still.uv_px, start, atol=1)


def test_only_networks_with_descriptors_carry_points() -> None:
    with pytest.raises(CallError, match="no descriptors and cannot carry points"):
        pliant.open_method("carried:centroid")
    with pytest.raises(CallError, match="priors"):
        pliant.open_method("carried:don-rope", priors=2)
    with pytest.raises(CallError, match=r"flow: .*found 'no' \(str\); required: true or false"):
        pliant.open_method("carried:don-rope", flow="no")  # `--set flow=no`
