from __future__ import annotations

import math
from typing import Any

import pytest
import torch
from torch.utils.data import default_collate

from pliant.loaders import FrameStore, PairDataset, PairSettings
from pliant.models.don.loss import _space_pixels, don_loss
from pliant.models.don.settings import LossSettings
from pliant.models.losses.regularisers import lipschitz_space_loss
from pliant.models.networks.descriptor_network import NetworkOutput
from pliant.spec.dataset import Dataset

Batch = dict[str, torch.Tensor]


@pytest.fixture(scope="module")
def batch(sheet_dataset: Dataset) -> Batch:
    settings = PairSettings(views=3, queries=12)
    pairs = PairDataset(
        FrameStore(sheet_dataset, "sheet", "train", (40, 30)), settings, orientation=True
    )
    made: Batch = default_collate([pairs[0], pairs[1]])
    return made


def material_map(batch: Batch, sharpness: float) -> torch.Tensor:
    """Descriptors that are the truth: the material coordinate itself, fitted to the matches.

    An affine map a view (the sheet's own) turns pixels into coordinates.
    """
    height, width = batch["mask"].shape[-2:]
    v, u = torch.meshgrid(torch.arange(height) + 0.5, torch.arange(width) + 0.5, indexing="ij")
    pixels = torch.stack([u, v, torch.ones_like(u)], dim=-1)  # (h, w, 3)
    maps = []
    for sample in range(len(batch["uv_px"])):
        first = batch["uv_px"][sample, 0, :, 0]
        for view in range(batch["uv_px"].shape[1]):
            here = batch["uv_px"][sample, view, :, 0]
            both = batch["visible"][sample, [0, view], :, 0].all(dim=0)
            known = torch.cat([here[both], torch.ones(int(both.sum()), 1)], dim=1)
            to_first = torch.linalg.lstsq(known, first[both]).solution  # (3, 2)
            maps.append((pixels @ to_first * sharpness).permute(2, 0, 1))
    return torch.stack(maps)


def parts_of(
    batch: Batch,
    descriptors: torch.Tensor,
    *,
    orientation: torch.Tensor | None = None,
    foreground: torch.Tensor | None = None,
    **options: Any,
) -> tuple[float, dict[str, float]]:
    """Return the loss of what a network puts out, and its named parts."""
    none = descriptors[:, :0]
    heads = (none if each is None else each for each in (orientation, foreground))
    settings = LossSettings(**options)
    loss, parts = don_loss(
        NetworkOutput(descriptors, *heads),
        torch.tensor(1.0),
        batch,
        settings,
        generator=torch.Generator().manual_seed(0),
    )
    return float(loss), {name: float(part) for name, part in parts.items()}


def run(batch: Batch, descriptors: torch.Tensor, **options: Any) -> float:
    return parts_of(batch, descriptors, **options)[0]


@pytest.mark.parametrize(
    "options",
    [
        {"kind": "distributional"},
        {"kind": "distributional", "direction": "reverse"},
        {"kind": "distributional", "background": -1},
        {"kind": "contrastive", "margin": 3.0},
    ],
)
def test_the_truth_costs_less_than_anything_else(batch: Batch, options: dict[str, object]) -> None:
    """Descriptors equal to the material coordinate; sources, targets and views all line up."""
    truth = material_map(batch, sharpness=0.7)
    best = run(batch, truth, **options)
    assert best < 0.5 * run(batch, truth.flip(0), **options)
    assert best < 0.5 * run(batch, truth.flip(-1), **options)
    assert best < 0.5 * run(batch, torch.zeros_like(truth), **options)


def test_gaussian_descriptors_reach_the_target_itself(batch: Batch) -> None:
    """With |f - g|^2 = |x - y|^2 / (2 sigma^2) in pixels, p is q and the divergence nearly 0.

    Only the views' scales differ a little from one to another.
    """
    truth = material_map(batch, sharpness=2**-0.5)
    assert run(batch, truth, background=0) < 0.1


def test_noise_does_not_tell_matches_from_non_matches(batch: Batch) -> None:
    # Of distances, and with a margin that none reaches: 100 + match - non-match, on average.
    noise = torch.randn(6, 64, 30, 40, generator=torch.Generator().manual_seed(1))
    hinge = {"margin": 100.0, "squared": False, "hard_scaling": False, "guard_px": 3.0}
    loss = run(batch, noise, kind="contrastive", non_matches=400, **hinge)
    assert loss == pytest.approx(100, abs=0.35)  # 102 if they are at the pixels' centres


def test_chunks_and_bins(batch: Batch) -> None:
    truth = material_map(batch, sharpness=0.7)
    assert run(batch, truth, chunk=5) == pytest.approx(run(batch, truth), rel=1e-5)
    assert run(batch, truth, bin_px=2) < 0.5 * run(batch, truth.flip(0), bin_px=2)


def test_lipschitz_terms_are_added_and_fall_silent_for_the_truth(batch: Batch) -> None:
    options: dict[str, Any] = {"space_weight": 1.0, "space_mu": (1.0, 1.0)}
    truth = material_map(batch, sharpness=2.0)
    wrong = torch.randn(truth.shape, generator=torch.Generator().manual_seed(1)) * 20

    def cost(descriptors: torch.Tensor, reach_m: float = 0.3) -> float:
        parts = parts_of(batch, descriptors, space_reach_m=reach_m, **options)[1]
        return parts["lipschitz_space"]

    assert cost(truth) < 0.01
    assert cost(wrong) > 0.1
    assert cost(wrong, 1e-6) == 0  # no two points are so near


def crossing_rope() -> Batch:
    """A rope of 1.2 m and 144 px: a figure of eight in the first view, an arc in the second.

    Both are the curves themselves, by arc length; 120 points, 1 cm apart.
    """
    t = torch.linspace(-3.1, 3.1, 4001, dtype=torch.float64)
    eight = torch.stack([t.cos(), t.sin() * t.cos()], dim=1) / (1 + t.sin() ** 2)[:, None]
    length = torch.cat([torch.zeros(1), eight.diff(dim=0).norm(dim=1).cumsum(0)])
    place = torch.linspace(0, 0.99, 120, dtype=torch.float64)  # share of the rope
    row = torch.searchsorted(length, place * length[-1])
    radius = 144 / 4.5
    arc = radius * torch.stack([(4.5 * place).cos(), (4.5 * place).sin()], dim=1)
    uv = torch.stack([eight[row] * 144 / length[-1], arc])[None, :, :, None] + 40
    apart = 1.2 * (place[:, None] - place[None]).abs()
    return {
        "uv_px": uv.float(),
        "visible": torch.ones(1, 2, 120, 1, dtype=torch.bool),
        "mask": torch.ones(1, 2, 80, 80, dtype=torch.bool),
        "distance_m": apart[None].float(),
    }


def test_the_truth_fulfils_the_condition_between_points_that_are_near_on_the_material() -> None:
    """Between points within 6 px in the figure of eight it does not, where the strands cross."""
    crossing = crossing_rope()
    settings = LossSettings()
    pixels = _space_pixels(crossing, settings.space_reach_m)
    true = pixels.uv_px.roll(-1, 0)  # the prediction is the truth
    apart = torch.cdist(pixels.uv_px, pixels.uv_px)[0].triu(1)
    violated = torch.cdist(true, true)[0] > settings.space_constant * apart
    near, disc = (apart > 0) & pixels.near[0], (apart > 0) & (apart < 6)
    assert int(near.sum()) in range(117 * 3, 117 * 4 + 3)  # 1 to 4 cm
    assert float((violated & near).sum() / near.sum()) < 0.01
    assert float((violated & disc).sum() / disc.sum()) > 0.05

    def cost(pairs: torch.Tensor) -> float:
        uv, seen = pixels.uv_px, pixels.valid
        return float(lipschitz_space_loss(true, uv, seen, pairs, lipschitz=2.0, mu=1.0))

    assert cost(pixels.near) < 0.001
    assert cost((torch.cdist(pixels.uv_px, pixels.uv_px) < 6)[:1].expand(2, -1, -1)) > 1


def test_points_hidden_in_the_next_view_are_left_out() -> None:
    crossing = crossing_rope()
    crossing["visible"][0, 1, 3] = False
    valid = _space_pixels(crossing, LossSettings().space_reach_m).valid
    assert valid[:, 3].tolist() == [False, False]
    assert int(valid.sum()) == 2 * 119


def test_time_term_knows_which_views_an_action_connects(batch: Batch) -> None:
    truth = material_map(batch, sharpness=2.0)
    moved = (batch["uv_px"][:, :, None, :, 0] - batch["uv_px"][:, None, :, :, 0]).norm(dim=-1)
    both = batch["visible"][:, :, None, :, 0] & batch["visible"][:, None, :, :, 0]
    action_px = (moved * both).amax(dim=-1)

    def cost(connected: Batch) -> float:
        options: dict[str, Any] = {"time_weight": 1.0, "space_mu": (1.0, 1.0), "time_constant": 1.0}
        return parts_of(connected, truth, **options)[1]["lipschitz_time"]

    assert cost({**batch, "action_px": action_px}) <= 0.3
    assert cost({**batch, "action_px": 0.01 * action_px}) > 1.0
    assert cost(batch) <= 0.0


def test_orientation_of_the_sheet(batch: Batch) -> None:
    """The flat sheet runs one way in each view: a map of that way costs nothing."""
    truth = material_map(batch, sharpness=0.7)
    ways = batch["orientation"].flatten(0, 1)[:, 0]  # (B V, 3); no sine
    assert ways[:, 2].isnan().all()
    maps = ways.nan_to_num(7.0)[:, :, None, None].expand(-1, -1, *truth.shape[-2:])

    def cost(orientation: torch.Tensor) -> tuple[float, float]:
        loss, parts = parts_of(batch, truth, orientation=orientation, orientation_weight=0.25)
        return loss, parts["orientation"]

    without = run(batch, truth)
    right, own = cost(maps)
    assert own == pytest.approx(0.0, abs=1e-4)
    assert right == pytest.approx(without, abs=1e-4)
    wrong, opposite = cost(-maps)
    assert opposite == pytest.approx(4.0, rel=1e-3)
    assert wrong == pytest.approx(without + 1.0, rel=1e-3)  # 0.25 of it
    assert cost(maps.roll(1, 0))[0] > right


def test_predicted_masks_are_held_to_both_masks(batch: Batch) -> None:
    truth = material_map(batch, sharpness=0.7)
    both = torch.stack([batch["mask"], batch["objects"]], dim=2).flatten(0, 1).float()
    for logits, expected in ((40 * (2 * both - 1), 0.0), (0 * both, math.log(2))):
        _, parts = parts_of(batch, truth, foreground=logits, foreground_weight=1.0)
        assert parts["foreground"] == pytest.approx(expected, abs=1e-6)
