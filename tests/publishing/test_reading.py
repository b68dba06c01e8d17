"""Packed, remote and divided datasets read and score like the loose one they were made of."""

from __future__ import annotations

import builtins
import json
import os
import pickle
import re
import shlex
import shutil
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from pliant.baselines import METHODS
from pliant.baselines.predict import predict
from pliant.cli.main import run
from pliant.evaluator import evaluate
from pliant.spec.dataset import Dataset
from pliant.spec.errors import SpecError
from pliant.spec.io.reading import Blob
from pliant.spec.storage import layout
from pliant.spec.storage.packed import PackedFiles


@pytest.fixture(scope="module")
def submission(halves: Any, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Random answers to the public half's questions, made from the public half alone."""
    out = tmp_path_factory.mktemp("submission") / "random.parquet"
    predict(Dataset.open(halves.public), "test", METHODS["random"](), out)
    return out


@pytest.mark.parametrize("protocol", ["standard", "paper", "tapvid", "matches"])
def test_the_halves_score_as_the_whole_does(
    halves: Any, submission: Path, protocol: str, tmp_path: Path
) -> None:
    if protocol == "matches":
        pytest.importorskip("cv2")
        submission = tmp_path / "orb.parquet"
        predict(Dataset.open(halves.public), "test", METHODS["orb"](), submission, kind="matches")
    whole = evaluate(submission, halves.whole, protocol=protocol)
    divided = evaluate(submission, halves.public, truth=halves.private, protocol=protocol)
    assert divided.document == whole.document
    assert divided.per_pair.equals(whole.per_pair)
    if protocol == "standard":
        geodesic = [name for name in whole.overall if "geodesic" in name]
        assert geodesic
        assert all(whole.overall[name] is not None for name in geodesic)


def test_the_scoring_program_of_another_platform(
    halves: Any,
    submission: Path,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    """The documented command refuses perfect answers of a split whose truth is public."""
    page = (Path(__file__).resolve().parents[2] / "docs" / "competitions.md").read_text()
    (text,) = re.findall(r"\npliant (evaluate sub.*?) > scores.json", page, re.DOTALL)
    command = shlex.split(text.replace("\\\n", ""))
    monkeypatch.chdir(tmp_path)
    Path("public").symlink_to(halves.public)
    Path("private").symlink_to(halves.private)
    shutil.copy(submission, "submission.parquet")
    assert run(command) == 0
    figures = json.loads(capsys.readouterr().out)["overall"]
    assert len(figures) == 7
    predict(Dataset.open(halves.public), "val", METHODS["oracle"](), Path("submission.parquet"))
    assert run(command) == 1
    assert "found val; required: test (--split)" in capsys.readouterr().err


def test_the_truth_alone_scores_what_needs_no_surface(halves: Any, submission: Path) -> None:
    whole = evaluate(submission, halves.whole, protocol="paper")
    truth = halves.private / "truth" / "test.parquet"
    assert evaluate(submission, halves.public, truth=truth, protocol="paper").overall == (
        whole.overall
    )
    for given, said in (
        (None, "split test was not found.*--truth"),
        (halves.whole, "not a private"),
    ):
        with pytest.raises(SpecError, match=said):
            evaluate(submission, halves.public, truth=given)
    with pytest.raises(SpecError, match=r"no truth for split 'test'; required: one of val$"):
        Dataset.open(halves.public).truth("test")
    with pytest.raises(SpecError, match=r"private half.*Name that one"):
        Dataset.open(halves.private)


def same_frames(ours: Dataset, theirs: Dataset, split: str) -> int:
    """Compare everything that can be read of a split's sequences; return the frames seen."""
    count = 0
    for a, b in zip(ours.sequences, theirs.sequences, strict=True):
        if a.split != split:
            continue
        assert (a.id, a.frames, a.tier, a.shape) == (b.id, b.frames, b.tier, b.shape)
        assert a.points().equals(b.points())
        for frame in range(a.frames):
            assert (a.rgb(frame) == b.rgb(frame)).all()
            one, two = a.surface(frame), b.surface(frame)
            for name in ("depth_m", "m0", "m1", "object_id"):
                assert (getattr(one, name) == getattr(two, name)).all()
            assert a.correspondences(frame).equals(b.correspondences(frame))
            one_camera, two_camera = a.camera(frame), b.camera(frame)
            assert (one_camera.K == two_camera.K).all()
            assert (one_camera.world_to_camera == two_camera.world_to_camera).all()
            count += 1
    return count


def test_the_packed_set_reads_like_the_loose_one(halves: Any) -> None:
    assert same_frames(Dataset.open(halves.whole), Dataset.open(halves.public), "train") == 12


@pytest.fixture
def in_memory(halves: Any) -> Any:
    """The public half in fsspec's memory filesystem: (its URL, the filesystem)."""
    fsspec = pytest.importorskip("fsspec")
    filesystem = fsspec.filesystem("memory")
    filesystem.put(f"{halves.public}/", "/bucket/tiny", recursive=True)
    yield "memory://bucket/tiny", filesystem
    filesystem.rm("/bucket", recursive=True)


def test_streaming_from_a_remote_filesystem(halves: Any, in_memory: Any, submission: Path) -> None:
    url, _ = in_memory
    remote = Dataset.open(url)
    assert same_frames(Dataset.open(halves.whole), remote, "val") == 6
    assert remote.address == url
    sent = pickle.loads(pickle.dumps(remote))  # as to a worker process
    first = remote.sequences[0]
    assert (sent.sequences[0].rgb(0) == first.rgb(0)).all()
    scores = evaluate(submission, remote, truth=halves.private)
    assert scores.document == evaluate(submission, halves.whole).document


def test_a_remote_frame_costs_its_own_bytes(
    in_memory: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    url, filesystem = in_memory
    dataset = Dataset.open(url)
    fetched: list[tuple[str, int]] = []
    cat = type(filesystem).cat_file

    def counting(self: Any, path: str, start: Any = None, end: Any = None, **more: Any) -> bytes:
        data: bytes = cat(self, path, start=start, end=end, **more)
        fetched.append((path.rsplit("/", 2)[-2], len(data)))
        return data

    monkeypatch.setattr(type(filesystem), "cat_file", counting)
    sequence = dataset.sequences[0]
    sequence.rgb(0)
    sequence.rgb(1)
    sizes = [f["bytes"] for f in sequence.info["files"] if f["path"].startswith("rgb/")]
    assert [size for folder, size in fetched if folder == "frames"] == sizes
    index = filesystem.size("/bucket/tiny/index.parquet")
    assert [size for folder, size in fetched if folder == "tiny"] == [index]  # once


def test_opening_reads_two_files_and_lists_none(
    halves: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Whatever the number of frames: what grows with them is not looked at."""
    opened: list[str] = []
    plain_open = builtins.open

    def watched(path: Any, *arguments: Any, **more: Any) -> Any:
        opened.append(str(path))
        return plain_open(path, *arguments, **more)

    def refuse(*_: Any) -> Any:
        raise AssertionError("a folder was listed")

    monkeypatch.setattr(builtins, "open", watched)
    for name in ("scandir", "listdir", "walk"):
        monkeypatch.setattr(os, name, refuse)
    dataset = Dataset.open(halves.public)
    inside = {Path(path).name for path in opened if path.startswith(str(halves.public))}
    assert inside == {layout.DATASET_JSON, layout.SEQUENCES_TABLE}
    dataset.sequences[0].rgb(0)
    folders = {Path(path).parent.name for path in opened if path.startswith(str(halves.public))}
    assert folders == {halves.public.name, "frames"}


def test_the_loaders_see_no_difference(halves: Any) -> None:
    pytest.importorskip("torch")
    from pliant.loaders import FrameStore, PairDataset

    samples = [
        PairDataset(FrameStore(Dataset.open(root), "cloth-1", "train", (80, 60)))[3]
        for root in (halves.whole, halves.public)
    ]
    assert samples[0].keys() == samples[1].keys()
    for name, value in samples[0].items():
        other = samples[1][name]
        assert np.array_equal(np.asarray(value), np.asarray(other), equal_nan=True), name


def test_a_wrong_index_is_refused(halves: Any) -> None:
    good = Dataset.open(halves.public)
    ids = [sequence.id for sequence in good.sequences]
    storage = good.files._storage  # type: ignore[attr-defined]
    shifted = PackedFiles(storage, [f"other-{k}" for k in range(300)] + ids)
    with pytest.raises(SpecError, match=r"index\.parquet.*does not list"):
        shifted.get(f"sequences/rope/{ids[0]}/rgb/000000.png")
    assert not good.has("sequences/rope/nobody/rgb/000000.png")
    with pytest.raises(SpecError, match="not there"):
        good.files.get(f"sequences/rope/{ids[0]}/rgb/999999.png")


def test_a_shard_that_was_cut_short_is_noticed(halves: Any, tmp_path: Path) -> None:
    from pliant.spec.storage.files import LocalFiles

    whole = halves.public / "frames" / "test-00000.parquet"
    (tmp_path / "frames").mkdir()
    (tmp_path / "frames" / whole.name).write_bytes(whole.read_bytes()[:1000])
    with pytest.raises(SpecError, match="1000 bytes instead of 2000"):
        LocalFiles(tmp_path).read_range(f"frames/{whole.name}", 0, 2000)


def test_a_damaged_picture_without_a_file_is_named() -> None:
    from pliant.spec.io.png import read_rgb

    with pytest.raises(SpecError, match=r"nonsense\.png"):
        read_rgb(Blob("nonsense.png", b"nonsense"))
