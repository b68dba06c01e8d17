"""Frames: what a dataset's frame keeps, what a method is given, and frames made from arrays."""

from __future__ import annotations

import pickle
import shutil
from dataclasses import fields
from pathlib import Path

import numpy as np
import pytest

from pliant.spec import decoded
from pliant.spec.camera import Camera
from pliant.spec.dataset import Dataset
from pliant.spec.frame import Frame, Pair
from pliant.spec.lru_cache import LRUCache
from pliant.spec.sequence import RecordedFrame, SequenceRecord


@pytest.fixture
def dataset() -> Dataset:
    return Dataset.open("sample")


def count_reads(monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """Note every image that is decoded."""
    reads: list[str] = []
    for name in ("rgb", "surface"):
        real = getattr(SequenceRecord, name)

        def read(self: SequenceRecord, frame: int, real=real, name=name):
            reads.append(f"{name} {frame}")
            return real(self, frame)

        monkeypatch.setattr(SequenceRecord, name, read)
    return reads


def test_an_image_is_decoded_once(dataset: Dataset, monkeypatch: pytest.MonkeyPatch) -> None:
    reads = count_reads(monkeypatch)
    for _ in range(2):
        frame = dataset[0][1]
        assert frame.rgb is dataset.frame(dataset[0].id, 1).rgb
        assert frame.mask is not None
        assert frame.depth_m is not None
        assert frame.surface is not None
    assert reads == ["rgb 1", "surface 1"]


def test_what_is_kept_is_bounded(monkeypatch: pytest.MonkeyPatch) -> None:
    rgb = Dataset.open("sample")[0][0].rgb
    monkeypatch.setattr(decoded, "DECODED_BYTES", 2 * rgb.nbytes)
    dataset = Dataset.open("sample")
    reads = count_reads(monkeypatch)
    frames = [*dataset[0], *dataset[1]]
    for frame in (*frames[:3], frames[2], frames[0]):
        assert frame.rgb.nbytes == rgb.nbytes
    assert reads == ["rgb 0", "rgb 1", "rgb 0", "rgb 0"]


def test_shared_images_cannot_be_written_to(dataset: Dataset) -> None:
    with pytest.raises(ValueError, match="read-only"):
        dataset[0][0].rgb[:] = 0


def test_a_process_starts_with_an_empty_cache(dataset: Dataset) -> None:
    kept = len(pickle.dumps(dataset))
    assert dataset[0][0].rgb.nbytes > 10_000
    assert len(pickle.dumps(dataset)) == kept
    assert pickle.loads(pickle.dumps(dataset[0][0])) == dataset[0][0]


def test_nothing_that_a_method_is_given_leads_to_the_truth(dataset: Dataset) -> None:
    pair = dataset.pairs("test")[0]
    seen = pair.seen()
    assert type(seen) is Pair
    assert set(vars(seen)) == {"source", "target", "uv_a_px"}
    for given, frame in ((seen.source, pair.source), (seen.target, pair.target)):
        assert type(given) is Frame
        names = {"rgb", "mask", "depth_m", "key", "objects", "camera", "cache_key"}
        assert set(vars(given)) == names
        assert str(pair.source.sequence.dir) not in given.cache_key
        assert not {"sequence", "surface", "correspondences"} & set(dir(given))
        assert given.mask is not None
        assert frame.mask is not None
        np.testing.assert_array_equal(given.mask, frame.mask)
        assert given.key == frame.key
        assert isinstance(given.camera, Camera)
    bare = pair.seen(masks=False)
    assert bare.target.mask is None
    assert bare.target.objects is None
    assert bare.target.depth_m is not None


def test_a_frame_of_arrays_and_one_of_a_dataset_have_the_same_attributes(dataset: Dataset) -> None:
    recorded = dataset[0][0]
    assert isinstance(recorded, RecordedFrame)
    made = Frame(recorded.rgb, mask=recorded.mask)
    assert made.size == recorded.size == (256, 192)
    for each in fields(Frame):
        assert hasattr(recorded, each.name)
    changed = made.replace(key="other")
    assert (changed.key, made.key) == ("other", "")
    assert changed.rgb is made.rgb


def test_only_frames_of_the_same_contents_share_a_cache_key(
    dataset: Dataset, tmp_path: Path
) -> None:
    frame = dataset[0][0]
    assert frame.replace().cache_key == frame.cache_key == dataset[0][0].cache_key
    assert frame.without_masks().cache_key == frame.without_masks().cache_key
    blank = np.zeros_like(frame.rgb)
    others = [
        frame.cache_key,
        dataset[0][1].cache_key,
        frame.without_masks().cache_key,
        frame.replace(rgb=blank).cache_key,
        frame.replace(rgb=blank).without_masks().cache_key,
        frame.replace(rgb=blank + 1).cache_key,
        Dataset.open(shutil.copytree(dataset.root, tmp_path / "copy"))[0][0].cache_key,
    ]
    assert len(set(others)) == len(others)
    photo = Frame(blank)
    assert photo.cache_key == photo.without_masks().cache_key == ""
    assert photo.replace(key="a").cache_key == Frame(blank, key="a").cache_key == "a"


def test_cache_drops_what_was_used_least_recently() -> None:
    cache: LRUCache[str] = LRUCache(5, len)
    made: list[str] = []

    def get(key: str) -> str:
        return cache.get(key, lambda: made.append(key) or key * 2)  # type: ignore[func-returns-value]

    for key in ("a", "b", "a", "c", "a", "b", "larger", "larger", "", ""):
        assert get(key) == key * 2
    assert made == ["a", "b", "c", "b", "larger", "larger", "", ""]


def test_the_last_values_are_kept_whatever_their_sizes() -> None:
    cache: LRUCache[str] = LRUCache(10, lambda _: 40, least=2)
    copied: LRUCache[str] = pickle.loads(pickle.dumps(LRUCache(4, len, least=2)))
    for each in (cache, copied):
        for key in "abc":
            each.get(key, lambda: "made first")
        values = [each.get(key, lambda: "made again") for key in "cba"]
        assert values == ["made first", "made first", "made again"]
    assert pickle.loads(pickle.dumps(copied)).get("b", lambda: "elsewhere") == "elsewhere"
