from __future__ import annotations

import gc
import tracemalloc
from itertools import islice
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
from torch.utils.data import DataLoader, default_collate

from pliant.loaders import (
    AugmentSettings,
    ClipDataset,
    FrameStore,
    MixedPairs,
    PairDataset,
    PairSettings,
    StepOrder,
)
from pliant.loaders.pairs import Pairing
from pliant.spec.dataset import Dataset
from pliant.spec.errors import CallError
from pliant.spec.opening import SAMPLE
from tests.loaders.sheet_dataset import sheet_map, write_sheet_dataset

SIZE = (80, 60)


def pairs_of(
    dataset: Dataset,
    settings: PairSettings | None = None,
    size: tuple[int, int] = SIZE,
    augmentation: AugmentSettings | None = None,
    seed: int = 0,
) -> PairDataset:
    store = FrameStore(dataset, "sheet", "train", size)
    return PairDataset(store, settings, augmentation=augmentation, seed=seed)


def colours_at(image: torch.Tensor, uv: torch.Tensor) -> np.ndarray:
    """The RGB under each position (0 to 1), bilinear, by plain indexing."""
    rgb = (image.permute(1, 2, 0).numpy() + 2) / 4
    u, v = uv.numpy().T - 0.5
    column, row = np.floor(u).astype(int), np.floor(v).astype(int)
    right, down = (u - column)[:, None], (v - row)[:, None]
    top = rgb[row, column] * (1 - right) + rgb[row, column + 1] * right
    bottom = rgb[row + 1, column] * (1 - right) + rgb[row + 1, column + 1] * right
    return top * (1 - down) + bottom * down


def inside(mask: torch.Tensor, uv: torch.Tensor) -> torch.Tensor:
    """Whether the 5x5 pixels around each position all lie on the object."""
    shrunk = -torch.nn.functional.max_pool2d(-mask.float()[None], 5, 1, 2)[0]
    column, row = uv.floor().long().T
    height, width = mask.shape
    within = (column >= 0) & (column < width) & (row >= 0) & (row < height)
    return within & (shrunk[row.clamp(0, height - 1), column.clamp(0, width - 1)] > 0)


@pytest.mark.parametrize("turned", [False, True])
def test_matches_show_the_same_print(sheet_dataset: Dataset, turned: bool) -> None:
    """Whatever was done to the two views, a point has the sheet's own colour in both."""
    augmentation = AugmentSettings(rotate_deg=180, scale=0.1, colour=0, noise=0) if turned else None
    pairs = pairs_of(sheet_dataset, PairSettings(queries=60), (160, 120), augmentation)
    checked = 0
    for index in range(6):
        sample = pairs[index]
        both = sample["visible"][:, :, 0].all(dim=0)
        # On the sheet's rim the picture is mixed with the table.
        for view in (0, 1):
            both &= inside(sample["mask"][view], sample["uv_px"][view, :, 0])
        views = [
            colours_at(sample["image"][view], sample["uv_px"][view, both, 0]) for view in (0, 1)
        ]
        assert np.abs(views[0] - views[1]).max() < 0.03
        checked += int(both.sum())
    assert checked > 150


def test_partners_are_the_points_across_the_sheet(sheet_dataset: Dataset) -> None:
    """Slot 1 is the half-turned partner, (1 - u, 1 - v): in the image and as samples give it."""
    sample = pairs_of(sheet_dataset, size=sheet_dataset.size)[0]
    assert sample["material"].shape == (48, 2, 2)
    frame = int(sample["frames"][0])
    affine = sheet_map(frame, 0, sheet_dataset.size, 0.0)
    inverse = np.linalg.inv(affine[:, :2])
    material = (sample["uv_px"][0].double().numpy() - affine[:, 2]) @ inverse.T  # (Q, 2, 2)
    np.testing.assert_allclose(material[:, 1], 1 - material[:, 0], atol=1e-5)
    np.testing.assert_allclose(material, sample["material"], atol=1e-5)


def test_sample_depends_on_seed_and_number_alone(sheet_dataset: Dataset) -> None:
    first, second, other = (
        pairs_of(sheet_dataset, augmentation=AugmentSettings(), seed=seed) for seed in (0, 0, 1)
    )
    for _ in range(3):
        first[0]  # what was drawn before is no matter
    same = all(torch.equal(first[7][name], second[7][name]) for name in first[7])
    assert same
    assert not torch.equal(first[7]["image"], first[8]["image"])
    assert not torch.equal(first[7]["image"], other[7]["image"])


def test_workers_and_resuming_give_the_same_batches(sheet_dataset: Dataset) -> None:
    pairs = pairs_of(sheet_dataset)
    whole = list(DataLoader(pairs, batch_sampler=StepOrder(2, 0, 4)))
    workers: dict[str, Any] = {"num_workers": 1, "multiprocessing_context": "spawn"}
    resumed = list(DataLoader(pairs, batch_sampler=StepOrder(2, 2, 4), **workers))
    torch.testing.assert_close(whole[2:], resumed, rtol=0, atol=0)


def test_iteration_ends_after_an_epoch(sheet_dataset: Dataset, sheet_episode: Dataset) -> None:
    """Samples of larger numbers are drawn just as well, so numbers alone never end."""
    pairs = pairs_of(sheet_dataset)
    clips = ClipDataset(FrameStore(sheet_episode, "sheet", "train", (40, 30)), length=2)
    for samples in (pairs, MixedPairs([pairs]), clips):
        found = list(islice(samples, 100))
        assert len(found) == len(samples)
        assert torch.equal(found[-1]["image"], samples[len(samples) - 1]["image"])


def test_processes_share_the_samples_out() -> None:
    one = [number for batch in StepOrder(4, 0, 3) for number in batch]
    two = [list(StepOrder(2, 0, 3, rank=rank, world=2)) for rank in (0, 1)]
    interleaved = [number for a, b in zip(*two, strict=True) for number in (*a, *b)]
    assert interleaved == one == list(range(12))


def test_more_views_share_their_points(sheet_dataset: Dataset) -> None:
    sample = pairs_of(sheet_dataset, PairSettings(views=3))[0]
    assert sample["image"].shape == (3, 3, 60, 80)
    assert (sample["visible"][:, :, 0].sum(dim=0) >= 2).all()
    assert len(set(sample["frames"].tolist())) == 3


def test_depth_inputs(sheet_dataset: Dataset) -> None:
    sample = pairs_of(sheet_dataset, PairSettings(input="depth"))[0]
    assert sample["image"].shape[1] == 1
    depth = sample["image"][0, -1]
    assert (depth[~sample["mask"][0]] >= -0.2).all()
    assert float(depth.max()) == 3.0


def test_next_pairs_are_neighbours_and_tell_their_action(sheet_episode: Dataset) -> None:
    pairs = pairs_of(sheet_episode, PairSettings(pairing="next"), sheet_episode.size)
    sample = pairs[5]
    a, b = (pairs.store.frames[int(frame)] for frame in sample["frames"])
    assert a.sequence.id == b.sequence.id
    assert b.index == a.index + 1
    # The sheet turns by 0.05 rad a frame: a point moves by 2 sin(0.025) times its distance
    # from the centre, at most half the diagonal.
    index = int(a.sequence.id[-6:])
    affine = sheet_map(1000 * 0 + index, 0, sheet_episode.size, 0.05)
    side = np.linalg.norm(affine[:, 0])
    expected = 2 * np.sin(0.025) * side * np.sqrt(0.5)
    assert float(sample["action_px"][0, 1]) == pytest.approx(expected, rel=1e-4)
    assert float(sample["action_px"][0, 0]) == 0.0


def test_independent_frames_have_no_action(sheet_dataset: Dataset) -> None:
    sample = pairs_of(sheet_dataset)[0]
    assert torch.isinf(sample["action_px"]).all()


def test_clips_follow_points_through_an_episode(sheet_episode: Dataset) -> None:
    store = FrameStore(sheet_episode, "sheet", "train", sheet_episode.size)
    clips = ClipDataset(store, length=3, step=2, queries=20)
    assert len(clips) == 2 * 2
    sample = clips[3]
    assert sample["image"].shape == (3, 3, 120, 160)
    assert torch.equal(sample["frames"].diff(), torch.tensor([2, 2]))
    assert sample["visible"][0].all()
    moved = (sample["uv_px"][1] - sample["uv_px"][0]).norm(dim=1)
    centre_distance = (sample["uv_px"][0] - sample["uv_px"][0].mean(dim=0)).norm(dim=1)
    assert 0 < float(moved.max()) < 0.11 * float(centre_distance.max()) + 3


def test_clips_skip_frames_as_drawn(sheet_episode: Dataset) -> None:
    store = FrameStore(sheet_episode, "sheet", "train", sheet_episode.size)
    clips = ClipDataset(store, length=3, step=1, step_max=9)
    steps = []
    for number in range(24):
        gaps = clips[number]["frames"].diff()
        assert int(gaps[0]) == int(gaps[1])
        steps.append(int(gaps[0]))
    # Episodes of so many frames have no clip of larger steps: these are never drawn.
    longest = (min(s.frames for s in sheet_episode.sequences) - 1) // 2
    assert set(steps) == set(range(1, longest + 1))
    assert len(clips) == len(clips.starts[1])


def test_a_clip_is_augmented_as_a_whole(sheet_episode: Dataset) -> None:
    """One rotation for all frames: distances between tracks stay what they were."""
    store = FrameStore(sheet_episode, "sheet", "train", SIZE)
    a, b = (
        ClipDataset(store, length=3, augmentation=changes)[1]
        for changes in (None, AugmentSettings())
    )
    assert torch.equal(a["frames"], b["frames"])
    for t in range(3):
        torch.testing.assert_close(
            torch.pdist(a["uv_px"][t]), torch.pdist(b["uv_px"][t]), atol=1e-3, rtol=1e-4
        )


def test_clips_of_configurations_are_refused(sheet_dataset: Dataset) -> None:
    with pytest.raises(CallError, match="no episode of 4 frames"):
        ClipDataset(FrameStore(sheet_dataset, "sheet", "train"))
    with pytest.raises(CallError, match="too few frames for pairs of kind 'next'"):
        pairs_of(sheet_dataset, PairSettings(pairing="next"))


def test_memory_does_not_grow_with_what_was_read(tmp_path_factory: pytest.TempPathFactory) -> None:
    """After every frame has been seen, twice as many samples hold no more memory."""
    root = tmp_path_factory.mktemp("memory")
    dataset = Dataset.open(write_sheet_dataset(root / "set", {"train": 24}))
    pairs = PairDataset(FrameStore(dataset, "sheet", "train", SIZE, cache=root / "cache"))
    one_frame = pairs.store.view(0)
    frame_bytes = one_frame.rgb.nbytes + one_frame.depth_m.nbytes + one_frame.mask.nbytes

    def held_after(first: int, last: int) -> int:
        for index in range(first, last):
            pairs[index]
        gc.collect()
        return tracemalloc.get_traced_memory()[0]

    tracemalloc.start()
    try:
        before = held_after(0, 4)
        after = held_after(4, 60)
    finally:
        tracemalloc.stop()
    assert after - before < 4 * frame_bytes  # 24 frames kept would be six times that


def test_mixed_pairs_draw_from_each_part_by_its_frames(sheet_dataset: Dataset) -> None:
    """Of four training and two validation frames, two thirds of the samples are of training."""
    parts = [
        PairDataset(FrameStore(sheet_dataset, "sheet", split, (40, 30)))
        for split in ("train", "val")
    ]
    mixed = MixedPairs(parts, seed=1)
    assert len(mixed) == 6
    first = 0
    for index in range(60):
        sample = mixed[index]
        own = [torch.equal(sample["image"], part[index]["image"]) for part in parts]
        assert any(own)
        first += own[0]
    assert 30 <= first <= 50


def test_a_batch_is_of_one_part(sheet_dataset: Dataset) -> None:
    """Points of the sheet have a symmetry partner, those of a rope with a ball have none."""
    sheet = FrameStore(sheet_dataset, "sheet", "train", (40, 30))
    rope = FrameStore(Dataset.open(SAMPLE), "rope", "train", (40, 30))
    mixed = MixedPairs([PairDataset(sheet), PairDataset(rope)], batch=3)
    slots = set()
    for numbers in StepOrder(batch=3, start=0, stop=20):
        batch = default_collate([mixed[number] for number in numbers])
        slots.add(batch["uv_px"].shape[3])
    assert slots == {1, 2}


@pytest.mark.parametrize("pairing", ["sequence", "next"])
def test_the_truth_moves_by_no_more_than_the_action(
    sheet_episode: Dataset, pairing: Pairing
) -> None:
    """Views that are turned each on its own break the bound for most points."""
    settings = PairSettings(views=3, queries=40, pairing=pairing)
    turned = AugmentSettings(rotate_deg=180, scale=0.3)
    pairs = pairs_of(sheet_episode, settings, augmentation=turned)
    for index in range(6):
        sample = pairs[index]
        uv, visible = sample["uv_px"][:, :, 0], sample["visible"][:, :, 0]
        for a, b in ((0, 1), (1, 2), (0, 2)):
            both = visible[a] & visible[b]
            moved = (uv[a] - uv[b]).norm(dim=-1)[both]
            assert float(moved.max()) <= float(sample["action_px"][a, b]) * (1 + 1e-4) + 1e-3


def test_symmetric_copies_of_cloths_stay_upright(rendered_dataset: Path) -> None:
    """A cloth whose sides look alike gives other shapes, with u to the right and v up in each."""
    store = FrameStore(Dataset.open(rendered_dataset), "cloth-1", "train", (160, 120))
    still = AugmentSettings(rotate_deg=0, scale=0, colour=0, noise=0, symmetric=1)
    pairs = PairDataset(store, PairSettings(queries=200, masks=True), augmentation=still)
    shapes: dict[int, set[bytes]] = {}
    for index in range(20):
        sample = pairs[index]
        for view, frame in enumerate(sample["frames"].tolist()):
            visible = sample["visible"][view, :, 0]
            uv = sample["uv_px"][view, visible, 0]
            column, row = uv.floor().long().T
            assert sample["mask"][view][row, column].float().mean() > 0.8
            rows = torch.column_stack([sample["material"][visible, 0], torch.ones(len(uv))])
            slope = torch.linalg.lstsq(rows, uv).solution[:2]
            assert slope[0, 0] > abs(slope[0, 1])
            assert -slope[1, 1] > abs(slope[1, 0])
            shown = sample["mask"][view].numpy()
            shapes.setdefault(frame, set()).add(np.packbits(shown.any(axis=0)).tobytes())
    assert max(map(len, shapes.values())) >= 3
