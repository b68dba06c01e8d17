from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest
import torch

from pliant.models import load_matcher
from pliant.models.don.matcher import DonMatcher
from pliant.models.don.trainer import train_don
from pliant.models.networks.canonical import CanonicalHead, canonical_loss
from pliant.spec.dataset import Dataset
from pliant.spec.frame import Pair
from pliant.spec.model import MaterialCoordinate, MaterialObject
from tests.known import known
from tests.loaders.sheet_dataset import write_sheet_dataset
from tests.models.tiny_runs import don

ONE = torch.tensor(1.0)


def rope_head(anchors: int = 64, dim: int = 3) -> CanonicalHead:
    """Anchors on a rope of 2 m and radius 0.1 m: s from 0 to 1, theta from -pi to pi."""
    s, theta = (
        MaterialCoordinate("s", 0, 1, 2.0),
        MaterialCoordinate("theta", -math.pi, math.pi, 0.1, period=2 * math.pi),
    )
    rng = np.random.default_rng(0)
    material = np.column_stack([rng.uniform(0, 1, anchors), rng.uniform(-np.pi, np.pi, anchors)])
    return CanonicalHead.of_object(dim, MaterialObject(1, "rope", (s, theta)), material)


def test_distances_are_in_metres_and_angles_wrap() -> None:
    head = rope_head(2)
    head.anchors.copy_(torch.tensor([[0.5, 3.0], [0.25, 0.0]]))
    squared = head.squared_distance_m2(torch.tensor([[0.5, -3.0]]))
    wrapped = 0.1 * (2 * math.pi - 6.0)
    torch.testing.assert_close(squared, torch.tensor([[wrapped**2, 0.5**2 + 0.3**2]]))


def test_an_angle_and_the_same_angle_after_a_turn_have_one_embedding() -> None:
    head = rope_head(2)
    head.anchors.copy_(torch.tensor([[0.3, math.pi], [0.3, -math.pi]]))
    first, second = head.embeddings()
    torch.testing.assert_close(first, second, atol=1e-5, rtol=0)


def test_the_target_covers_the_symmetry_orbit() -> None:
    head = rope_head(200)
    material = torch.tensor([[[0.2, 0.5], [0.8, -0.5]]])
    q = head.target(material, 0.05)[0]
    assert float(q.sum()) == pytest.approx(1.0)
    near = head.anchors[:, 0] < 0.5
    assert float(q[near].sum()) == pytest.approx(0.5, abs=0.01)


def test_loss_is_the_entropy_where_the_embeddings_fit(monkeypatch: pytest.MonkeyPatch) -> None:
    """Cross-entropy against itself is the entropy; another point costs more."""
    head = rope_head()
    exact = head.anchors * head.scale_m * torch.tensor([1.0, 0.0])  # along the rope alone
    monkeypatch.setattr(head, "embeddings", lambda: exact)
    head.scale_m[1] = 0.0
    material = head.anchors[None, :, None]
    visible = torch.ones(1, len(exact), dtype=torch.bool)
    sigma = 0.1
    scale = torch.tensor(1 / (2 * sigma**2))
    q = head.target(material[0], sigma)
    entropy = float(-(q * q.clamp_min(1e-30).log()).sum(dim=1).mean())
    right = canonical_loss(head, exact[None], material, visible, scale=scale, sigma_m=sigma)
    assert float(right) == pytest.approx(entropy, rel=1e-4)
    wrong = canonical_loss(head, exact.flip(0)[None], material, visible, scale=scale, sigma_m=sigma)
    assert float(wrong) > entropy + 1


def test_hidden_points_do_not_count() -> None:
    head = rope_head()
    descriptors = torch.randn(1, 4, 3, requires_grad=True)
    visible = torch.tensor([[True, True, False, True]])
    material = head.anchors[None, :4, None]
    canonical_loss(head, descriptors, material, visible, scale=ONE, sigma_m=0.1).backward()
    assert (known(descriptors.grad)[0] != 0).any(dim=1).tolist() == [True, True, False, True]


def test_a_run_with_all_heads_answers_with_and_without_masks(
    sheet_dataset: Dataset, tmp_path: Path
) -> None:
    without_validation = write_sheet_dataset(tmp_path / "more", {"train": 3}, size=(80, 60))
    settings = don(
        "steps=3",
        "pairs={queries: 8, input: grey, masks: true}",
        "augment={recolour: 0.5, mask_faults: 0.5, mask_drop: 0.2}",
        "loss={canonical_weight: 0.5, foreground_weight: 0.5, orientation_weight: 0.2}",
        f"also=['#sheet', '{without_validation}#sheet']",
    )
    run = tmp_path / "run"
    train_don(sheet_dataset, run, settings)
    matcher = load_matcher(run)
    assert isinstance(matcher, DonMatcher)
    head = matcher.network.canonical
    assert isinstance(head, CanonicalHead)
    assert len(head.anchors) == 169
    assert float(head.scale_m[0]) == pytest.approx(0.5)
    a, b = (sequence.id for sequence in sheet_dataset.sequences[:2])
    source, target = sheet_dataset.frame(a, 0), sheet_dataset.frame(b, 0)
    assert known(source.objects).sum() > known(source.mask).sum()
    query = np.array([[40.0, 30.0]], np.float32)
    given = matcher.answer(Pair(source, target, query)).uv_px
    bare_source, bare_target = (
        view.replace(mask=None, objects=None, key=view.key + "x") for view in (source, target)
    )
    assert np.isfinite(matcher.answer(Pair(bare_source, bare_target, query)).uv_px).all()
    # The masks are seen: other masks, other descriptors.
    moved = source.replace(mask=~known(source.mask), key="other")
    assert not np.allclose(matcher.descriptor_map(source), matcher.descriptor_map(moved))
    assert np.isfinite(given).all()
