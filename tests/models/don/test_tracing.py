from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import torch

from pliant.baselines.tracing import MaskShape, Nadir, Trace
from pliant.models.don.tracing import TracedPlaces, TracedView, traced_places
from pliant.spec.frame import Frame
from tests.known import known

GRID = np.stack(np.meshgrid(np.arange(40) + 0.5, np.arange(30) + 0.5), axis=-1).reshape(-1, 2)


def places(*uv: tuple[float, float], weight: tuple[float, ...] = ()) -> TracedPlaces:
    """One query, a place from each pair of traces."""
    given = np.array(weight or [1.0] * len(uv))
    return TracedPlaces(np.array(uv)[:, None], given / given.sum(), 2.0)


def log_p_at(*uv: tuple[float, float]) -> torch.Tensor:
    """A network that is equally sure of several places."""
    gap = np.min([((GRID - at) ** 2).sum(axis=1) for at in uv], axis=0)
    return torch.from_numpy(np.exp(-gap / 8) + 1e-9)[None].float().log().log_softmax(dim=1)


def test_of_two_places_the_one_on_the_trace_wins() -> None:
    """A traced place between candidates of a network that cannot tell two strands apart."""
    both = log_p_at((10.5, 10.5), (30.5, 20.5))
    weighed = places((30.0, 20.0)).weighted_log_p(both, GRID)
    assert float(weighed.exp().sum()) == pytest.approx(1, abs=1e-5)
    assert np.linalg.norm(GRID[int(weighed.argmax())] - (30.5, 20.5)) < 1.5
    assert np.linalg.norm(GRID[int(both.argmax())] - (10.5, 10.5)) < 1.5


def test_a_trace_far_from_a_sure_network_is_outvoted() -> None:
    sure = 40 * log_p_at((10.5, 10.5)).log_softmax(dim=1)
    weighed = places((30.0, 20.0)).weighted_log_p(sure.log_softmax(dim=1), GRID)
    assert np.linalg.norm(GRID[int(weighed.argmax())] - (10.5, 10.5)) < 1.5


def test_refining_averages_the_places_near_by() -> None:
    found = places((10.0, 10.0), (11.0, 10.0), (30.0, 20.0), weight=(0.3, 0.1, 0.6))
    np.testing.assert_allclose(found.refined(np.array([[10.6, 10.4]])), [[10.25, 10.0]])
    np.testing.assert_allclose(found.refined(np.array([[20.0, 5.0]])), [[20.0, 5.0]])


def line_view(ends_alike: bool, known: bool = True) -> TracedView:
    """Return a straight rope in an 80x20 image, read from either end, with even descriptors."""
    mask = np.zeros((20, 80), dtype=np.bool_)
    mask[9:11, 10:70] = True
    objects = mask.copy()
    objects[7:13, 4:10] = not ends_alike
    u = np.linspace(10, 70, 300)
    path = np.stack([u, np.full(300, 10.0)], axis=1)
    traces = [
        Trace(way, 60.0, 1.0, 1.0, 0.0, Nadir.of_image(mask.shape)) for way in (path, path[::-1])
    ]
    rgb = np.zeros((20, 80, 3), dtype=np.uint8)
    view = Frame(rgb, mask, objects=objects if known else None)
    return TracedView(view, torch.zeros(4, 20, 80), traces, MaskShape.of(mask, objects))


def carried(source: TracedView, target: TracedView) -> TracedPlaces:
    """Return where traces carry a point 12 px from the left end of the source's rope."""
    query = np.array([[22.0, 10.0]], dtype=np.float32)
    return known(traced_places(source, target, torch.tensor(1.0), query))


def test_a_rope_with_ends_alike_has_two_answers() -> None:
    bare = line_view(ends_alike=True)
    found = carried(bare, bare)
    # All readings that run one way are together, whichever end they start at.
    np.testing.assert_allclose(found.uv_px[:, 0, 0], found.uv_px[0, 0, 0], atol=0.5)
    np.testing.assert_allclose(found.uv_px[0] + known(found.reversed_px)[0], [[80, 20]], atol=0.5)
    candidates = np.array([[22.0, 10.0], [58.0, 10.0], [40.0, 10.0]])
    sure = torch.tensor([[0.998, 0.001, 0.001]]).log()  # the network knows of one way only
    one_way = found.weighted_log_p(sure, candidates)
    p = found.either_way(one_way, sure, candidates).exp().numpy()
    np.testing.assert_allclose(p, [[0.5, 0.5, 0]], atol=0.01)
    # All answers of a pair run the same way, however sure the network is of the other one.
    way = one_way.exp().numpy()
    first = int(abs(found.uv_px[0, 0, 0] - 58) < 1)
    assert way[0, first] > 0.98
    near = found.uv_px[0] + 0.3
    np.testing.assert_allclose(found.refined(near), found.uv_px[0], atol=0.2)


def test_a_ball_in_either_view_leaves_one_answer() -> None:
    ball, unknown = line_view(ends_alike=False), line_view(ends_alike=True, known=False)
    for source, target in ((ball, ball), (ball, unknown), (unknown, ball)):
        found = carried(source, target)
        assert found.reversed_px is None


def test_where_no_ball_is_known_the_descriptors_answer_and_the_other_way_is_as_likely() -> None:
    view = line_view(ends_alike=True, known=False)
    ramp = torch.linspace(0, 30, 80).expand(4, 20, 80)
    source, target = replace(view, descriptors=ramp), replace(view, descriptors=ramp.flip(2))
    found = carried(source, target)
    assert found.reversed_px is not None
    way = found.weight @ found.uv_px[:, 0, 0]
    np.testing.assert_allclose([way, 80 - way], [58, 22], atol=0.5)  # the target runs the other way
    candidates = np.array([[22.0, 10.0], [58.0, 10.0], [40.0, 10.0]])
    even = torch.full((1, 3), 1 / 3).log()
    p = found.either_way(found.weighted_log_p(even, candidates), even, candidates).exp().numpy()
    np.testing.assert_allclose(p, [[0.5, 0.5, 0]], atol=0.01)


def test_plausible_traces_that_agree_have_the_weight() -> None:
    """Of three readings of the target one leaves out a part of the mask, one runs the other way."""
    view = line_view(ends_alike=False)
    right, reverse = view.traces
    short = replace(right, coverage=0.9)
    ramp = torch.linspace(0, 30, 80).expand(4, 20, 80)  # the descriptors tell the two ends apart
    source = replace(view, descriptors=ramp, traces=[right])
    target = replace(view, descriptors=ramp, traces=[short, reverse, right])
    found = carried(source, target)
    np.testing.assert_allclose(found.weight.sum(), 1)
    np.testing.assert_allclose(found.uv_px[:, 0, 0], [22, 22, 58], atol=0.3)
    odds = found.weight[0] / found.weight[1:]
    np.testing.assert_allclose(odds[0], np.exp(30 * 0.1))
    assert odds[1] > 50
