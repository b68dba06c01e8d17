"""Wrong calls of the Python API end in one clear error, not in one from deep inside."""

# mypy: disable-error-code="arg-type, index, call-arg, call-overload, list-item"

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

import pliant
from pliant.loaders import (
    AugmentSettings,
    ClipDataset,
    FrameStore,
    MixedPairs,
    NetworkInput,
    PairDataset,
    PairSettings,
    StepOrder,
)
from pliant.spec.dataset import Dataset
from pliant.spec.errors import PliantError

UV = np.zeros((3, 2))
STORE = r"store: .*required: FrameStore\. Make one: FrameStore\(pliant\.load"

Call = Callable[[Any, Any], object]

CALLS: dict[str, tuple[Call, str]] = {
    "load(None)": (lambda ds, _: pliant.load(None), "dataset: .*None.*a folder, a URL"),
    "load(missing)": (lambda ds, _: pliant.load("/nope"), "^/nope: folder not found"),
    "load of a long name": (lambda ds, _: pliant.load("n" * 5000), "n: folder not found"),
    "load of a long Hub id": (lambda ds, _: pliant.load(f"a/{'n' * 300}"), "folder .*not found"),
    "predict without method": (lambda ds, _: pliant.predict(ds, None), "not a method"),
    "predict swapped": (lambda ds, _: pliant.predict("identity", ds), "folder not found"),
    "predict of a sequence": (lambda ds, _: pliant.predict(ds[0], "identity"), "SequenceRecord"),
    "predict split 3": (lambda ds, _: pliant.predict(ds, "identity", 3), "split: .*str"),
    "predict split tets": (lambda ds, _: pliant.predict(ds, "identity", "tets"), "val or test"),
    "predict workers '2'": (
        lambda ds, _: pliant.predict(ds, "identity", workers="2"),
        "workers: .*whole number; found '2'; required: >= 1",
    ),
    "predict workers True": (lambda ds, _: pliant.predict(ds, "identity", workers=True), "True"),
    "predict progress 3": (
        lambda ds, _: pliant.predict(ds, "identity", progress=3),
        "progress: .*function",
    ),
    "predict with a class": (lambda ds, _: pliant.predict(ds, object), "this is a class"),
    "write(None)": (lambda ds, _: pliant.predict(ds, "identity").write(None), "out: .*None"),
    "write of a long name": (
        lambda ds, _: pliant.predict(ds, "identity").write("n" * 300),
        "the file cannot be written; found File name too long",
    ),
    "open_method of a long name": (lambda ds, _: pliant.open_method("n" * 300), "no method"),
    "open_method(None)": (lambda ds, _: pliant.open_method(None), "method: .*name of a method"),
    "open_method option": (lambda ds, _: pliant.open_method("random", sed=3), "options seed"),
    "open_method value": (lambda ds, _: pliant.open_method("random", seed="x"), "seed: .*'x'"),
    "evaluate(None)": (lambda ds, _: pliant.evaluate(ds, None), "answers: .*what predict returns"),
    "evaluate(ds, ds)": (lambda ds, _: pliant.evaluate(ds, ds), "answers: .*what predict returns"),
    "evaluate swapped": (lambda ds, _: pliant.evaluate(UV, ds), r"dataset: .*\(ndarray\)"),
    "evaluate flat": (lambda ds, _: pliant.evaluate(ds, np.zeros(3)), r"number of queries, 2"),
    "evaluate short": (lambda ds, _: pliant.evaluate(ds, UV), "one per query.*found 3"),
    "evaluate missing": (lambda ds, _: pliant.evaluate(ds, "nope.parquet"), "file is not there"),
    "evaluate split 3": (lambda ds, _: pliant.evaluate(ds, UV, 3), "split: .*str"),
    "evaluate truth 3": (lambda ds, _: pliant.evaluate(ds, UV, truth=3), "truth: .*a file"),
    "evaluate protocol 3": (lambda ds, _: pliant.evaluate(ds, UV, protocol=3), "protocol: "),
    "evaluate protocol": (lambda ds, _: pliant.evaluate(ds, UV, protocol="x"), "found 'x'.*auc"),
    "evaluate allow": (
        lambda ds, _: pliant.evaluate(ds, UV, allow_missing="yes"),
        r"allow_missing: .*found 'yes' \(str\); required: bool",
    ),
    "validate(None)": (lambda ds, _: pliant.validate(None), "a folder or a Dataset"),
    "validate of a URL": (
        lambda ds, _: pliant.validate("https://a.b/c"),
        "^https://a.b/c: only a folder on this machine",
    ),
    "validate of a long name": (lambda ds, _: pliant.validate("n" * 300), "folder not found"),
    "rgb of frame '0'": (lambda ds, _: ds[0].rgb("0"), r"rope.*, frame: .*'0'; required: 0 to"),
    "rgb of frame 0.5": (lambda ds, _: ds[0].rgb(0.5), "whole number; found 0.5"),
    "with_truth of a long name": (lambda ds, _: ds.with_truth("n" * 300), "truth not found"),
    "validate workers": (lambda ds, _: pliant.validate(ds, workers="x"), "workers: .*'x'"),
    "stream steps": (
        lambda ds, store: pliant.stream({}, steps=5, start=6),
        "steps: .*whole number; found 5; required: >= 6",
    ),
    "PairDataset(ds)": (lambda ds, store: PairDataset(ds), STORE),
    "PairDataset(FrameStore)": (lambda ds, store: PairDataset(FrameStore), "the class FrameStore"),
    "PairDataset settings": (lambda ds, store: PairDataset(store, "train"), "settings: .*'train'"),
    "PairDataset seed": (lambda ds, store: PairDataset(store, seed=-1), "seed: .*-1.*>= 0"),
    "PairDataset augmentation": (
        lambda ds, store: PairDataset(store, augmentation=True),
        r"AugmentSettings\(\.\.\.\) or None",
    ),
    "PairDataset['a']": (lambda ds, store: PairDataset(store)["a"], "index: .*'a'"),
    "FrameStore('sample')": (
        lambda ds, store: FrameStore("sample", "rope", "train"),
        "dataset: .*'sample'.*required: Dataset. Open it",
    ),
    "FrameStore tier": (lambda ds, store: FrameStore(ds, "rop", "train"), "no such tier"),
    "FrameStore tiers": (lambda ds, store: FrameStore(ds, ["rope"], "train"), "tier: .*str"),
    "FrameStore split": (lambda ds, store: FrameStore(ds, "rope", "tets"), "no sequence in split"),
    "FrameStore size 160": (lambda ds, store: FrameStore(ds, "rope", "train", 9), "width, height"),
    "FrameStore size 0": (lambda ds, store: FrameStore(ds, "rope", "train", (0, 9)), "size: .*0"),
    "FrameStore limit": (lambda ds, store: FrameStore(ds, "rope", "train", limit=0), "limit: .*0"),
    "FrameStore cache": (
        lambda ds, store: FrameStore(ds, "rope", "train", cache=__file__),
        "this is not a folder",
    ),
    "ClipDataset(ds)": (lambda ds, store: ClipDataset(ds), STORE),
    "ClipDataset length": (lambda ds, store: ClipDataset(store, length=1), "length: .*>= 2"),
    "ClipDataset step_max": (
        lambda ds, store: ClipDataset(store, length=2, step=3, step_max=2),
        "step_max: .*found 2; required: >= 3",
    ),
    "ClipDataset input": (
        lambda ds, store: ClipDataset(store, length=2, input="rgb"),
        "input: .*'rgb'.*required: NetworkInput",
    ),
    "ClipDataset augmentation": (
        lambda ds, store: ClipDataset(store, augmentation=AugmentSettings(symmetric=1, recolour=1)),
        "augmentation: clips do not have .*; found recolour, symmetric; required: rotate_deg",
    ),
    "ClipDataset no episode": (lambda ds, store: ClipDataset(store), "no episode of 4 frames"),
    "MixedPairs([])": (lambda ds, store: MixedPairs([]), "no dataset to draw from"),
    "MixedPairs([ds])": (lambda ds, store: MixedPairs([ds]), "parts: .*required: PairDataset"),
    "MixedPairs['a']": (
        lambda ds, store: MixedPairs([PairDataset(store)], batch=2)["a"],
        "index: .*whole number; found 'a'",
    ),
    "MixedPairs[1.5]": (
        lambda ds, store: MixedPairs([PairDataset(store)], batch=2)[1.5],
        "index: .*whole number; found 1.5",
    ),
    "StepOrder": (lambda ds, store: StepOrder(0, 0, 2), "batch: .*>= 1"),
    "StepOrder rank": (lambda ds, store: StepOrder(1, 0, 2, rank=3, world=2), "0 to 1"),
    "NetworkInput": (lambda ds, store: NetworkInput("x"), "one of rgb, grey"),
    "PairSettings views": (lambda ds, store: PairSettings(views=1), "^views: .*>= 2$"),
    "ds.frame(-1)": (lambda ds, store: ds.frame(ds[0].id, -1), "index: .*0 to 1"),
    "ds.pairs('tets')": (lambda ds, store: ds.pairs("tets"), "no queries for split 'tets'"),
}  # fmt: skip

OTHERS: dict[str, tuple[Call, type[Exception], str]] = {
    "ds[99]": (lambda ds, store: ds[99], IndexError, "12 sequences, and no sequence 99"),
    "ds[0][9]": (lambda ds, store: ds[0][9], IndexError, "2 frames, and no frame 9"),
    "store.view(99)": (lambda ds, store: store.view(99), IndexError, "frame 99 of 8 frames"),
    "PairDataset[-1]": (lambda ds, store: PairDataset(store)[-1], IndexError, "from 0"),
}


@pytest.fixture(scope="module")
def ds() -> Dataset:
    return pliant.load("sample")


@pytest.fixture(scope="module")
def store(ds: Dataset) -> FrameStore:
    return FrameStore(ds, "rope", "train")


@pytest.mark.parametrize("name", CALLS)
def test_wrong_call_says_what_is_wrong(name: str, ds: Dataset, store: FrameStore) -> None:
    call, message = CALLS[name]
    with pytest.raises(PliantError, match=message):
        call(ds, store)


@pytest.mark.parametrize("name", OTHERS)
def test_wrong_value_or_index(name: str, ds: Dataset, store: FrameStore) -> None:
    call, kind, message = OTHERS[name]
    with pytest.raises(kind, match=message):
        call(ds, store)


def test_what_load_takes(ds: Dataset) -> None:
    assert pliant.load(ds) is ds
