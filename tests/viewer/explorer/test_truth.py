"""Live truth, against the truth of the dataset's own queries and by hand."""

from __future__ import annotations

import shutil
from pathlib import Path

import numpy as np
import pytest

from pliant.spec.arrays import FloatArray
from pliant.spec.dataset import Dataset
from pliant.spec.queries import RecordedPair
from pliant.spec.sequence import RecordedFrame
from pliant.viewer.explorer.app import Explorer
from pliant.viewer.explorer.frames import FrameCache
from pliant.viewer.explorer.recorded import RecordedQueries
from pliant.viewer.explorer.truth import Truth, TruthFinder
from tests.known import known


def pair_of(source: RecordedFrame, target: RecordedFrame) -> RecordedPair:
    return RecordedPair(source, target, np.zeros((0, 2), np.float32))


def truth_at(truth: TruthFinder, pair: RecordedPair) -> tuple[Truth, FloatArray]:
    """Return what is known of a pixel, and the place in the target."""
    found = known(truth.find(pair))
    return found, known(found.uv_b_px)


@pytest.mark.parametrize("tier", ["rope", "cloth-3"])
def test_a_frame_is_its_own_truth(explorer: Explorer, tier: str) -> None:
    frame = explorer.dataset.frames("test", tier)[0]
    mask = known(frame.mask)
    rows, columns = np.nonzero(mask)
    exact = 0
    for k in np.linspace(0, len(rows) - 1, 25).astype(int):
        asked = pair_of(frame, frame).at([columns[k] + 0.2, rows[k] + 0.2])
        found, place = truth_at(explorer.truth, asked)
        np.testing.assert_array_equal(found.uv_a_px, [columns[k] + 0.5, rows[k] + 0.5])
        # By the mesh where a pixel has no neighbours on its piece of surface.
        atol = 1e-3 if found.origin == "surface" else 1.0
        np.testing.assert_allclose(place, found.uv_a_px, atol=atol)
        assert found.visibility == "visible"
        np.testing.assert_allclose(known(found.xyz_b_m), known(found.xyz_a_m))
        exact += found.origin == "surface"
    assert exact >= 22


def test_it_agrees_with_the_queries(explorer: Explorer) -> None:
    """A query is within its pixel, so the truth of the pixel's centre is near the query's truth."""
    errors, agreed, hidden = [], [], 0
    queries = explorer.queries.splits["test"]
    for number, pair in enumerate(queries.pairs):
        for row in range(queries.starts[number], queries.starts[number + 1]):
            found = explorer.truth.find(pair.at(queries.uv_a_px[row]))
            if found is None:  # the centre of the query's pixel is beyond the silhouette
                continue
            seen = known(queries.visibility)[row] == "visible"
            agreed.append((found.visibility == "visible") == seen)
            hidden += not seen
            if found.uv_b_px is not None:
                errors.append(np.linalg.norm(found.uv_b_px - known(queries.uv_b_px)[row]))
    assert len(errors) > 100
    assert hidden > 10
    assert np.median(errors) < 1.0
    assert np.quantile(errors, 0.95) < 6.0
    assert np.mean(agreed) > 0.85


def test_the_background_has_no_truth(explorer: Explorer) -> None:
    frame = explorer.dataset.frames("test", "rope")[0]
    pair = pair_of(frame, frame)
    row, column = np.argwhere(~known(frame.mask))[0]
    for place in ((column + 0.5, row + 0.5), (-5.0, 3.0), (3.0, 1e6)):
        assert explorer.truth.find(pair.at(place)) is None


def test_without_surfaces_the_nearest_query_counts(tiny_dataset: Path, tmp_path: Path) -> None:
    root = tmp_path / "data"
    shutil.copytree(tiny_dataset, root)
    for depth in root.glob("sequences/*/*/depth"):
        shutil.rmtree(depth)
    dataset = Dataset.open(root)
    truth = TruthFinder(FrameCache(dataset), RecordedQueries(dataset))
    pair = dataset.pairs("test")[0]
    known = dataset.truth("test").slice(0, len(pair))
    u, v = (known[name].to_numpy() for name in ("u_b", "v_b"))
    for k in (0, 5):
        found, place = truth_at(truth, pair.at(pair.uv_a_px[k] + 0.01))
        assert found.origin == "query"
        np.testing.assert_allclose(found.uv_a_px, pair.uv_a_px[k], atol=1e-5)
        np.testing.assert_allclose(place, [u[k], v[k]], atol=1e-5)
    assert truth.find(pair.at([-100.0, -100.0])) is None
    assert truth.find(pair_of(pair.target, pair.source).at(pair.uv_a_px[0])) is None


def test_the_places_that_look_the_same(explorer: Explorer) -> None:
    """Of a tracked point of a blank cloth: where its seven partners of the table are seen."""
    frame = explorer.dataset.frames("test", "cloth-1")[0]
    points, table = frame.sequence.points(), frame.correspondences
    uv = np.stack([table["u_px"].to_numpy(), table["v_px"].to_numpy()], axis=1)
    seen = np.array([state == "visible" for state in table["visibility"].to_pylist()])
    checked = 0
    for row in np.flatnonzero(seen)[::7]:
        found = explorer.truth.find(pair_of(frame, frame).at(uv[row]))
        if found is None or found.partners_px is None:
            continue
        partners = [each for each in points["partners"][int(row)].as_py() if seen[each]]
        for place in uv[partners]:  # the truth is that of the pixel's centre, up to 0.7 px away
            checked += np.linalg.norm(found.partners_px - place, axis=1).min(initial=np.inf) < 1.5
    assert checked > 100
