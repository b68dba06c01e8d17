"""Propagation on frames whose motion is known."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import pytest
import torch

from pliant.baselines.matcher import TrackMatcher
from pliant.models.timecycle.matcher import TimeCycleMatcher
from pliant.models.timecycle.network import TimeCycleNetwork
from pliant.models.timecycle.propagation import Propagator
from pliant.models.timecycle.settings import PropagationSettings, TimeCycleSettings
from pliant.spec.configuration import read_settings
from pliant.spec.frame import Frame, Pair

H, W = 20, 28


def texture(seed: int = 0) -> torch.Tensor:
    """A smooth field of descriptors, larger than a frame: float (24, 3 H, 3 W)."""
    generator = torch.Generator().manual_seed(seed)
    noise = torch.randn(1, 24, 3 * H + 4, 3 * W + 4, generator=generator)
    return torch.nn.functional.avg_pool2d(noise, 5, stride=1)[0]


def frame(field: torch.Tensor, moved: tuple[float, float]) -> torch.Tensor:
    """What a frame sees when the texture has moved by (u, v) cells."""
    u = torch.arange(W) + W - moved[0] + 0.5
    v = torch.arange(H) + H - moved[1] + 0.5
    at = torch.stack(torch.meshgrid(u, v, indexing="xy"), dim=-1)
    size = torch.tensor([3.0 * W, 3.0 * H])
    seen = torch.nn.functional.grid_sample(
        field[None], (2 * at / size - 1)[None], align_corners=False
    )[0]
    return torch.nn.functional.normalize(seen, dim=0)


SHARP = PropagationSettings(temperature=0.05, top_k=5, radius=0, prior=0)
POINTS = torch.tensor([[6.2, 5.5], [10.0, 12.3], [14.8, 8.1]])


@pytest.mark.parametrize("refine", [1, 2])
@pytest.mark.parametrize("radius", [0.0, 0.15])
def test_a_translating_texture_is_followed(refine: int, radius: float) -> None:
    """20 frames of 0.3 and 0.15 cells each: within a quarter of a cell all the way, when read
    between cells; within half of one when not."""
    field = texture()
    settings = SHARP.replace(first_weight=0.5, refine=refine, radius=radius)
    carried = Propagator(frame(field, (0, 0)), POINTS, settings, 1.0)
    for step in range(1, 21):
        found = carried.step(frame(field, (0.3 * step, 0.15 * step)))
        gap = (found - POINTS - torch.tensor([0.3, 0.15]) * step).norm(dim=1)
        assert float(gap.max()) < (0.5 if refine == 1 else 0.25), step


@pytest.mark.parametrize("smooth", [0.0, 1.0])
def test_what_does_not_move_stays_exactly_where_it_is(smooth: float) -> None:
    still, on = frame(texture(), (0, 0)), np.zeros((H, W), bool)
    on[4:16, 4:18] = True
    carried = Propagator(still, POINTS, PropagationSettings(smooth=smooth), 0.1, on)
    for _ in range(5):
        torch.testing.assert_close(carried.step(still), POINTS, atol=1e-4, rtol=0)


def test_the_radius_keeps_points_near() -> None:
    """The texture jumps by 9 cells: without a radius it is found again, with one it is not."""
    field = texture()
    first, jumped = frame(field, (0, 0)), frame(field, (9, 0))
    free, bound = (
        Propagator(first, POINTS, SHARP.replace(top_k=10, radius=radius), 1.0)
        for radius in (0.0, 0.1)
    )
    assert float((free.step(jumped) - POINTS - torch.tensor([9.0, 0])).norm(dim=1).max()) < 0.3
    assert float((bound.step(jumped) - POINTS).norm(dim=1).max()) < 0.1 * W + 1


def test_the_prior_breaks_a_tie_for_the_nearer_place() -> None:
    """Two places look alike, 3 and 9 cells away: the mean of both, or nearly the nearer one."""
    flat = torch.zeros(2, H, W)
    flat[1] = 1.0  # nothing looks like the point …
    first, later = flat.clone(), flat.clone()
    first[:, 10, 8] = torch.tensor([1.0, 0.0])  # … but the cell it is in,
    for column in (11, 17):  # and later two others
        later[:, 10, column] = torch.tensor([1.0, 0.0])
    point = torch.tensor([[8.5, 10.5]])
    plain = PropagationSettings(temperature=0.02, radius=0, prior=0, refine=1, top_k=2)
    torch.testing.assert_close(
        Propagator(first, point, plain, 1.0).step(later), torch.tensor([[14.5, 10.5]])
    )
    near = plain.replace(prior=3.0)
    found = Propagator(first, point, near, 1.0).step(later)
    # exp(-9/18) against exp(-81/18): 0.982 of the weight for the nearer.
    assert float(found[0, 0]) == pytest.approx(8.5 + 3 + 6 * (1 - 1 / (1 + np.exp(-4.0))), abs=1e-3)


def test_the_first_frame_brings_a_point_back_after_it_was_hidden() -> None:
    field, other = texture(), texture(seed=9)
    settings = SHARP.replace(context=2, first_weight=0.6)
    carried = Propagator(frame(field, (0, 0)), POINTS, settings, 1.0)
    for _ in range(4):
        carried.step(frame(other, (0, 0)))
    lost = (carried.xy - POINTS).norm(dim=1)
    found = carried.step(frame(field, (2, 1)))
    assert float(lost.min()) > 2  # it looked elsewhere meanwhile
    assert float((found - POINTS - torch.tensor([2.0, 1.0])).norm(dim=1).max()) < 0.75


def test_only_cells_on_the_object_are_searched_where_asked() -> None:
    field = texture()
    carried = Propagator(frame(field, (0, 0)), POINTS, PropagationSettings(radius=0), 0.1)
    searched = np.zeros((H, W), dtype=np.bool_)
    searched[:, 20:] = True
    assert float(carried.step(frame(field, (0, 0)), searched)[:, 0].min()) > 19


SETTINGS = read_settings(
    TimeCycleSettings, None, ["width=96", "height=64", "network={widths: [8, 16, 32]}"]
)


def views(count: int) -> Iterator[Frame]:
    rng = np.random.default_rng(0)
    rgb = rng.integers(0, 256, (120, 200, 3), dtype=np.uint8)
    mask = np.zeros((120, 200), dtype=np.bool_)
    mask[40:80, 50:150] = True
    for _ in range(count):
        yield Frame(rgb=rgb, mask=mask)


def test_the_matcher_speaks_in_the_pictures_own_pixels() -> None:
    """200x120 pictures, 96x64 for the network: still points come back as they were given."""
    torch.manual_seed(0)
    matcher = TimeCycleMatcher(TimeCycleNetwork(SETTINGS), SETTINGS)
    assert isinstance(matcher, TrackMatcher)
    uv = np.array([[60.5, 50.5], [140.0, 70.0]], dtype=np.float32)
    tracked = list(matcher.track(views(4), uv))
    assert len(tracked) == 3
    for answers in tracked:
        np.testing.assert_allclose(answers.uv_px, uv, atol=0.01)
    a, b = views(2)
    np.testing.assert_allclose(matcher.answer(Pair(a, b, uv)).uv_px, uv, atol=0.5)
    assert matcher.answer(Pair(a, b, uv[:0])).uv_px.shape == (0, 2)
    heat = matcher.heat(a, b, uv[0])
    assert heat.values.shape == (120, 200)
    assert 0 < heat.confidence <= 1


def test_one_step_looks_everywhere() -> None:
    torch.manual_seed(0)
    settings = SETTINGS.replace(propagation=SETTINGS.propagation.replace(search="mask"))
    matcher = TimeCycleMatcher(TimeCycleNetwork(settings), settings)
    a, b = views(2)
    found = matcher.answer(Pair(a, b, np.array([[60.5, 50.5]], dtype=np.float32))).uv_px
    assert 40 < found[0, 0] < 160
    assert 30 < found[0, 1] < 90


def test_neighbours_carry_a_point_that_looks_like_nothing() -> None:
    """Noise covers the query's cell in the next frame: alone it strays, with its neighbours not."""
    field, moved = texture(), (1.2, -0.6)
    first, second = frame(field, (0, 0)), frame(field, moved)
    query = torch.tensor([[14.3, 9.6]])
    column, row = (query[0] + torch.tensor(moved)).long().tolist()
    noise = torch.randn(24, 2, 2, generator=torch.Generator().manual_seed(1))
    second[:, row : row + 2, column : column + 2] = torch.nn.functional.normalize(noise, dim=0)
    on = np.zeros((H, W), bool)
    on[5:14, 9:20] = True
    gaps = []
    for smooth in (0.0, 1.5):
        settings = SHARP.replace(radius=0.1, smooth=smooth)
        carried = Propagator(first, query, settings, 1.0, on)
        found = carried.step(second)
        assert found.shape == query.shape
        gaps.append(float((found - query - torch.tensor(moved)).norm()))
    assert gaps[1] < 0.25 < gaps[0]
