"""The contrastive random walk: by hand, against a loop, and as a run's only loss."""

from __future__ import annotations

import itertools
import math
from itertools import pairwise
from pathlib import Path

import pytest
import torch

from pliant.models import load_matcher
from pliant.models.timecycle import report
from pliant.models.timecycle.network import TimeCycleNetwork
from pliant.models.timecycle.settings import TimeCycleSettings, WalkSettings
from pliant.models.timecycle.trainer import train_timecycle
from pliant.models.timecycle.turned_copies import turned_copies
from pliant.models.timecycle.walk import WayHome, walk_loss
from pliant.spec.configuration import read_settings
from pliant.spec.dataset import Dataset
from pliant.spec.errors import CallError

pytestmark = pytest.mark.filterwarnings("ignore::DeprecationWarning")

NO_CYCLES = "losses={similarity: 0, skip: 0, long: 0, self_cycle: 0}"
TINY = [
    "steps=3", "batch=1", "width=96", "height=64",
    "network={descriptor_dim: 16, widths: [8, 16, 32], global_blocks: 1}",
    "clips={length: 3, step_max: 3}", "checkpoint_every=3", "optimiser.warmup=1",
    "validation={split: test, every: 3, clips: 1, frames: 3, queries: 8}", NO_CYCLES,
]  # fmt: skip


def distinct(frames: int) -> torch.Tensor:
    """Clips whose every cell has a direction of its own, (1, T, 96, 8, 12)."""
    return torch.eye(96).reshape(96, 8, 12).expand(1, frames, 96, 8, 12)


def alike(cells: int) -> torch.Tensor:
    return torch.full((1, cells), 1 / cells)


def test_walkers_between_distinct_nodes_come_home() -> None:
    settings = WalkSettings(nodes=2, temperature=0.02, dropout=0.0)
    moved = torch.stack([distinct(1)[0, 0].roll(2 * step, dims=2) for step in range(4)])[None]
    for frames in (distinct(4), moved):  # wherever content goes, it comes back
        found = walk_loss(frames, alike(96), settings)
        assert float(found["walk"]) < 1e-3
        assert float(found["walk_home"]) == 1


def test_walkers_between_equal_nodes_are_anywhere() -> None:
    frames = torch.ones(2, 3, 4, 8, 12) / 2
    found = walk_loss(frames, alike(96).expand(2, -1), WalkSettings(nodes=2, dropout=0.0))
    assert float(found["walk"]) == pytest.approx(math.log(24), abs=1e-5)


def test_loss_agrees_with_a_loop_over_walks() -> None:
    generator = torch.Generator().manual_seed(0)
    frames = torch.randn(2, 4, 6, 3, 4, generator=generator)
    frames = torch.nn.functional.normalize(frames, dim=2)
    counts = torch.rand(2, 12, generator=generator)
    counts = counts / counts.sum(dim=1, keepdim=True)
    total = 0.0
    for clip in range(2):
        nodes = [frame.flatten(1).T for frame in frames[clip]]
        for reach in (1, 2, 3):
            places = [3 - step for step in range(reach + 1)]
            places += places[-2::-1]  # 3 2 1 2 3: back, and the same way home
            walk = torch.eye(12)
            for here, there in pairwise(places):
                walk = walk @ (nodes[here] @ nodes[there].T / 0.3).softmax(dim=1)
            total -= float((walk.diagonal().log() * counts[clip]).sum()) / (2 * 3)
    settings = WalkSettings(nodes=1, temperature=0.3, dropout=0.0)
    assert float(walk_loss(frames, counts, settings)["walk"]) == pytest.approx(total, rel=1e-5)


def test_only_counted_nodes_count_and_dropped_edges_change_the_loss() -> None:
    torch.manual_seed(0)
    frames = torch.nn.functional.normalize(torch.randn(1, 3, 6, 4, 4), dim=2)
    one = torch.zeros(1, 16)
    one[0, 5] = 1
    settings = WalkSettings(nodes=1, dropout=0.4)
    whole = walk_loss(frames, alike(16), settings)["walk"]
    assert float(walk_loss(frames, one, settings)["walk"]) != float(whole)
    dropped = walk_loss(frames, alike(16), settings, torch.Generator().manual_seed(1))["walk"]
    assert torch.isfinite(dropped)
    assert float(dropped) > float(whole)  # paths home are cut


def test_walk_reaches_every_weight_of_the_encoder_and_learns() -> None:
    torch.manual_seed(1)
    settings = read_settings(TimeCycleSettings, None, [*TINY, "walk={weight: 1, dropout: 0}"])
    encoder = TimeCycleNetwork(settings)
    images = torch.rand(2, 3, 3, 64, 96)
    optimiser = torch.optim.Adam(encoder.encoder.parameters(), 3e-3)
    losses = []
    for _ in range(8):
        frames = encoder.encode(images.flatten(0, 1)).unflatten(0, (2, 3))
        loss = walk_loss(frames, alike(96).expand(2, -1), settings.walk)["walk"]
        optimiser.zero_grad()
        loss.backward()
        gradients = [each.grad for each in encoder.encoder.parameters() if each.requires_grad]
        assert all(g is not None and torch.isfinite(g).all() for g in gradients)
        optimiser.step()
        losses.append(float(loss.detach()))
    assert losses[-1] < 0.9 * losses[0]


@pytest.mark.slow
def test_run_of_the_walk_alone_answers(
    tiny_episode: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(report, "write_timecycle_report", lambda *_: None)
    settings = read_settings(TimeCycleSettings, None, [*TINY, "walk.weight=1", "walk.nodes=1"])
    train_timecycle(Dataset.open(tiny_episode), tmp_path / "run", settings)
    matcher = load_matcher(tmp_path / "run")
    assert matcher.settings.walk.weight == 1  # type: ignore[union-attr]


@pytest.mark.parametrize(
    ("override", "message"),
    [("walk.weight=0", "one weight above 0"), ("walk={weight: 1, nodes: 9}", "walk.nodes")],
)
def test_wrong_settings_are_one_sentence(override: str, message: str) -> None:
    with pytest.raises(CallError, match=message):
        read_settings(TimeCycleSettings, None, [*TINY, override])


def test_walkers_stay_on_the_object() -> None:
    """Equal nodes: chance among the object's nodes alone, whose number differs between frames."""
    frames = torch.ones(1, 2, 4, 8, 12) / 2
    mask = torch.zeros(1, 2, 64, 96, dtype=torch.bool)
    mask[0, 0, 8:16, 16:56] = True  # 5 cells of 8x8 px, from the second row and the third column
    mask[0, 1, 40:55, 8:24] = True  # 2 x 2 cells
    counts = torch.zeros(8, 12)
    counts[5:7, 1:3] = 1 / 4  # the last frame's
    settings = WalkSettings(nodes=1, dropout=0.0, on_object=True)
    found = walk_loss(frames, counts.reshape(1, -1), settings, None, mask)
    assert float(found["walk"]) == pytest.approx(math.log(4), abs=1e-4)
    # A cell of the table that looks like one of the object does not distract.
    generator = torch.Generator().manual_seed(0)
    noise = torch.randn(1, 2, 24, 8, 12, generator=generator)
    different = torch.nn.functional.normalize(noise, dim=2)
    different[0, 0, :, 1, 2:6] = different[0, 1, :, 5:7, 1:3].flatten(1)
    different[0, 1, :, 0, 0] = different[0, 1, :, 5, 1]
    for on_object, loss in ((True, 1e-3), (False, 0.1)):
        settings = WalkSettings(nodes=1, temperature=0.01, dropout=0.0, on_object=on_object)
        found = walk_loss(different, counts.reshape(1, -1), settings, None, mask)
        assert (float(found["walk"]) < loss) == on_object


def test_a_network_that_knows_only_the_place_does_not_come_home_through_copies() -> None:
    """Copies are shifted, each by its own number of columns; what is in a cell moves along."""
    settings = WalkSettings(nodes=1, temperature=0.02, dropout=0.0)
    shifts = (3, 5, 8)
    centres = torch.stack(torch.meshgrid(torch.arange(8.0), torch.arange(12.0), indexing="ij"), -1)
    place = torch.stack([centres.flip(-1).reshape(-1, 2) + 0.5] * 3)[None]
    for frame, shift in enumerate(shifts):
        place[0, frame, :, 0] = (place[0, frame, :, 0] + shift) % 12
    shown = torch.ones(1, 3, 64, 96, dtype=torch.bool)
    rolled = [distinct(1)[:, 0].roll(shift, dims=3) for shift in shifts]
    content = WayHome(torch.stack(rolled, dim=1), shown, place)
    followed = walk_loss(distinct(3), alike(96), settings, home=content)
    assert float(followed["walk"]) < 0.3  # a place is shared out among the nodes around it
    assert float(followed["walk_home"]) == 1
    fixed = WayHome(distinct(3), shown, place)
    lost = walk_loss(distinct(3), alike(96), settings, home=fixed)
    assert float(lost["walk"]) > 10 * float(followed["walk"])
    assert float(lost["walk_home"]) == 0


def test_turned_copies_show_cells_where_they_say() -> None:
    """A bright cell of 8x8 px, on the object, is found at its place in every copy."""
    images = torch.zeros(4, 2, 1, 64, 96)
    images[..., 24:32, 56:64] = 1.0  # row 3, column 7
    found = turned_copies(images, images[:, :, 0] > 0, torch.Generator().manual_seed(0), 8)
    assert not torch.allclose(found.images[:, 0], found.images[:, 1])
    v, u = torch.meshgrid(torch.arange(64) + 0.5, torch.arange(96) + 0.5, indexing="ij")
    at = torch.stack([u, v], dim=-1)
    for clip, frame in itertools.product(range(4), range(2)):
        for shown in (found.images[clip, frame, 0], found.mask[clip, frame].float()):
            centre = (at * shown[..., None]).sum(dim=(0, 1)) / shown.sum() / 8
            torch.testing.assert_close(centre, found.place[clip, frame, 43], atol=0.1, rtol=0)
