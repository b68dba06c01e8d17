"""Reading a dataset through `Dataset`."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pyarrow.parquet as pq
import pytest

from pliant.spec.dataset import Dataset
from pliant.spec.errors import CallError, SpecError
from pliant.spec.io.parquet_columns import stacked
from tests.conformance.edits import ROPE_TEST, change_json, change_rows, remove
from tests.spec.conftest import DATASETS

Copy = Callable[[str], Path]


def test_what_a_dataset_tells() -> None:
    dataset = Dataset.open(DATASETS / "full")
    assert (dataset.id, dataset.version, dataset.size) == ("conformance-full", "1.0.0", (64, 48))
    assert list(dataset.tiers) == ["rope", "rope-bare", "cloth-1"]
    assert dataset.splits_with_queries() == ["test"]
    assert dataset.held_out == []
    assert len(dataset.queries("test")) == len(dataset.truth("test")) == 15
    sequence = dataset.sequence("rope-test-000000")
    assert (sequence.tier, sequence.split, sequence.shape) == ("rope", "test", "open")
    assert (sequence.frames, sequence.temporal, sequence.size) == (2, False, (64, 48))
    assert sequence.info["id"] == "rope-test-000000"
    assert sequence.rgb(1).shape == (48, 64, 3)
    assert sequence.points().num_rows == 93


def test_a_dataset_that_is_moved_while_it_is_open(copy_of: Copy) -> None:
    root = copy_of("full")
    dataset = Dataset.open(root)
    root.rename(root.with_name("elsewhere"))
    with pytest.raises(SpecError, match=r"000001\.png: the file is not there"):
        dataset.sequence("rope-test-000000").rgb(1)


def test_a_frame_is_a_slice_whatever_the_row_groups(copy_of: Copy) -> None:
    root = copy_of("full")
    path = root / ROPE_TEST / "correspondences.parquet"
    whole = Dataset.open(root).sequence("rope-test-000000").correspondences()
    for size in (1000, 93, 50, 7):
        pq.write_table(pq.read_table(path), path, row_group_size=size)
        sequence = Dataset.open(root).sequence("rope-test-000000")
        for frame in range(2):
            rows = sequence.correspondences(frame)
            assert rows.equals(whole.slice(frame * 93, 93))
            assert set(rows.column("frame").to_pylist()) == {frame}


def test_projection_by_the_formula() -> None:
    for frame in Dataset.open(DATASETS / "full").sequence("rope-test-000000"):
        assert frame.camera is not None
        K, pose = frame.camera.K, frame.camera.world_to_camera
        rows = frame.correspondences
        xyz = stacked(rows, "x_m", "y_m", "z_m").astype(np.float64)
        uvz = stacked(rows, "u_px", "v_px", "depth_m").astype(np.float64)
        local = xyz @ pose[:3, :3].T + pose[:3, 3]
        uv = local[:, :2] / local[:, 2:] * K[[0, 1], [0, 1]] + K[:2, 2]
        for found in (np.column_stack([uv, local[:, 2]]), frame.camera.project(xyz)):
            np.testing.assert_allclose(found[:, :2], uvz[:, :2], rtol=0, atol=1e-4)
            np.testing.assert_allclose(found[:, 2], uvz[:, 2], rtol=0, atol=1e-6)


def test_cameras_cannot_be_written_to() -> None:
    camera = Dataset.open(DATASETS / "minimal").sequences[0].camera(0)
    assert (camera.K[0, 0], camera.size) == (85, (64, 48))
    with pytest.raises(ValueError, match="read-only"):
        camera.K[:] = 0


def test_what_is_not_there_says_so(tmp_path: Path) -> None:
    with pytest.raises(SpecError, match="not a Pliant dataset"):
        Dataset.open(tmp_path)
    dataset = Dataset.open(DATASETS / "full")
    with pytest.raises(SpecError, match="no such sequence"):
        dataset.sequence("rope-test-000009")
    with pytest.raises(SpecError, match=r"required: one of test$"):
        dataset.queries("val")
    with pytest.raises(CallError, match="required: 0 to 1"):
        dataset.sequence("rope-test-000000").rgb(2)


@pytest.mark.parametrize(
    ("damage", "message"),
    [
        (
            change_rows("sequences.parquet", lambda rows: rows[0].update(id="../../etc")),
            "invalid name",
        ),
        (
            change_rows(f"{ROPE_TEST}/correspondences.parquet", lambda rows: rows.pop() and None),
            "every point of every frame",
        ),
        (remove(f"{ROPE_TEST}/cameras.json"), r"cameras\.json: the file is not there"),
    ],
    ids=["climbing id", "missing row", "missing cameras"],
)
def test_a_damaged_dataset_is_refused(
    copy_of: Copy, damage: Callable[[Path], object], message: str
) -> None:
    damage(root := copy_of("full"))

    def read() -> None:
        sequence = Dataset.open(root).sequence("rope-test-000000")
        sequence.correspondences(1)
        sequence.camera(0)

    with pytest.raises(SpecError, match=message):
        read()


def test_the_sample_of_the_package_opens_by_its_name(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    sample = Dataset.open("sample")
    assert (len(sample), sample.root.is_dir()) == (12, True)
    assert sample.queries("test").num_rows == 768
    (tmp_path / "sample").mkdir()  # a folder of that name comes first
    with pytest.raises(SpecError, match="this is not a Pliant dataset"):
        Dataset.open("sample")


def test_a_fingerprint_knows_how_the_pictures_were_made(copy_of: Copy) -> None:
    root = copy_of("full")
    first = Dataset.open(root).fingerprint()
    change_json("dataset.json", lambda info: info.update(title="Other", licence="MIT"))(root)
    assert Dataset.open(root).fingerprint() == first
    change_json("dataset.json", lambda info: info["provenance"]["config"].update(noise={}))(root)
    noisy = Dataset.open(root).fingerprint()
    change_json("dataset.json", lambda info: info["image_size"].update(width=8))(root)
    assert len({first, noisy, Dataset.open(root).fingerprint()}) == 3


def test_truth_from_a_file_next_to_the_dataset(copy_of: Copy, tmp_path: Path) -> None:
    """As `pliant import` leaves it."""
    root, truth = copy_of("full"), tmp_path / "truth-of-test.parquet"
    (root / "truth" / "test.parquet").rename(truth)
    dataset = Dataset.open(root)
    with pytest.raises(SpecError, match=r"no truth for split 'test'$"):
        dataset.truth("test")
    whole = Dataset.open(DATASETS / "full").truth("test")
    assert dataset.with_truth(truth).truth("test").equals(whole)
    (tmp_path / "full-truth").mkdir()
    (tmp_path / "full-truth" / "test.parquet").hardlink_to(truth)
    assert dataset.with_truth(tmp_path / "full-truth").truth("test").equals(whole)
    with pytest.raises(SpecError, match="does not belong to these queries"):
        dataset.with_truth(root / "queries" / "test.parquet")
