from __future__ import annotations

import json
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from pliant.loaders.frame_store import FrameStore
from pliant.loaders.views import TrainingFrame
from pliant.spec.dataset import Dataset
from pliant.spec.errors import CallError, SpecError
from pliant.spec.io.png import write_rgb
from pliant.spec.io.resizing import resize_mask, resize_nearest, resize_rgb
from tests.loaders.sheet_dataset import write_sheet_dataset


@pytest.mark.parametrize("size", [(160, 120), (256, 192), (427, 320), (640, 192), (800, 720)])
def test_resizing_keeps_positions(size: tuple[int, int]) -> None:
    """A blob's centre of mass moves to (u w / W, v h / H): no half-pixel shift."""
    u, v = np.meshgrid(np.arange(640) + 0.5, np.arange(480) + 0.5)
    blob = 250 * np.exp(-((u - 203.3) ** 2 + (v - 318.9) ** 2) / (2 * 12**2))
    rgb = np.repeat(blob.round().astype(np.uint8)[..., None], 3, axis=2)
    small = resize_rgb(rgb, size)[..., 0].astype(float)
    u, v = np.meshgrid(np.arange(size[0]) + 0.5, np.arange(size[1]) + 0.5)
    centre = np.array([(small * u).sum(), (small * v).sum()]) / small.sum()
    np.testing.assert_allclose(centre, [203.3 * size[0] / 640, 318.9 * size[1] / 480], atol=0.02)


def test_mask_is_where_half_the_pixel_is_covered() -> None:
    mask = np.zeros((4, 4), bool)
    mask[:2, 0] = True  # half of the first 2x2 block
    mask[0, 2] = True  # a quarter of the second
    mask[2:, 2:] = True  # all of the last
    assert resize_mask(mask, (2, 2)).tolist() == [[True, False], [False, True]]
    third = np.arange(5)[None].repeat(2, 0) < 2  # 0.8 of the first of two, nothing of the second
    assert resize_mask(third, (2, 2)).tolist() == [[True, False]] * 2
    assert resize_mask(~third, (2, 2)).tolist() == [[False, True]] * 2


def test_depth_is_picked_never_averaged() -> None:
    depth = np.full((4, 4), np.inf, np.float32)
    depth[:, 2:] = 0.7
    small = resize_nearest(depth, (2, 2))
    assert small.tolist() == [[np.inf, np.float32(0.7)]] * 2


def test_cached_frames_equal_decoded_ones(sheet_dataset: Dataset, tmp_path: Path) -> None:
    plain = FrameStore(sheet_dataset, "sheet", "train", (80, 60))
    cached = FrameStore(sheet_dataset, "sheet", "train", (80, 60), cache=tmp_path)
    size: Any = np.int64(80), np.int64(60)
    again = FrameStore(sheet_dataset, "sheet", "train", size, cache=tmp_path)
    for index in range(len(plain)):
        for store in (cached, cached, again):
            for name in ("rgb", "mask", "objects", "depth_m", "uv_px", "visible"):
                expected = getattr(plain.view(index), name)
                np.testing.assert_array_equal(getattr(store.view(index), name), expected)


def test_a_frame_is_laid_out_alike_the_first_time(sheet_dataset: Dataset, tmp_path: Path) -> None:
    """Sums of another order have other last digits: a resumed run would measure other errors."""
    store = FrameStore(sheet_dataset, "sheet", "train", (80, 60), cache=tmp_path)
    first, again = store.view(0), store.view(0)
    assert first.rgb.strides == again.rgb.strides == (80 * 3, 3, 1)
    assert first.mask.strides == again.mask.strides


def test_a_cached_frame_needs_no_file(tmp_path: Path) -> None:
    root = write_sheet_dataset(tmp_path / "set", {"train": 1})
    dataset = Dataset.open(root)
    FrameStore(dataset, "sheet", "train", (80, 60), cache=tmp_path / "cache").view(0)
    (dataset.sequences[0].dir / "rgb" / "000000.png").unlink()
    FrameStore(dataset, "sheet", "train", (80, 60), cache=tmp_path / "cache").view(0)


def test_frames_that_were_made_again_are_decoded_again(tmp_path: Path) -> None:
    """The table of sequences stays the same then; the checksums in sequence.json do not."""
    root = write_sheet_dataset(tmp_path / "set", {"train": 1})
    folder = Dataset.open(root).sequences[0].dir
    for number, shade in enumerate((50, 200)):
        write_rgb(folder / "rgb" / "000000.png", np.full((120, 160, 3), shade, np.uint8))
        (folder / "sequence.json").write_text(f"checksums {number}")
        store = FrameStore(Dataset.open(root), "sheet", "train", (8, 6), cache=tmp_path / "cache")
        assert (store.view(0).rgb == shade).all()


PROGRAM = """
import resource, sys
from pathlib import Path

from pliant.loaders import FrameStore
from pliant.spec.dataset import Dataset
from pliant.spec.errors import PliantError

resource.setrlimit(resource.RLIMIT_FSIZE, (200_000, 200_000))
store = FrameStore(Dataset.open("sample"), "rope", "train", cache=Path(sys.argv[1]))
try:
    for number in range(len(store)):
        store.view(number)
except PliantError as error:
    sys.exit(str(error))
"""


@pytest.mark.long
def test_too_little_room_is_one_line(tmp_path: Path) -> None:
    done = subprocess.run(
        [sys.executable, "-c", PROGRAM, str(tmp_path)], capture_output=True, text=True, check=False
    )
    assert done.returncode == 1, done.returncode  # -7 is SIGBUS, -25 SIGXFSZ
    assert "there is no room for the cache of decoded frames" in done.stderr
    assert done.stderr.count("\n") == 1
    assert list(tmp_path.iterdir()) == []


def test_cache_has_its_full_size_on_the_disk(tmp_path: Path) -> None:
    store = FrameStore(Dataset.open("sample"), "rope", "train", cache=tmp_path)
    store.view(0)
    (file,) = tmp_path.iterdir()
    assert file.stat().st_blocks * 512 >= file.stat().st_size


def first(name: str, value: Any) -> Callable[[pa.Table], pa.Table]:
    """Return a change that puts a value into the first row of a column."""

    def changed(table: pa.Table) -> pa.Table:
        field = table.schema.field(name)
        values = [value, *table[name].to_pylist()[1:]]
        return table.set_column(table.schema.names.index(name), field, pa.array(values, field.type))

    return changed


@pytest.mark.parametrize(
    ("table", "change", "message"),
    [
        ("correspondences", lambda t: t.take([1, 0, *range(2, len(t))]), "row 0: .*ascending"),
        ("correspondences", lambda t: t.sort_by("point"), "row 1: .*found frame 1, point 0"),
        ("correspondences", lambda t: t.slice(2), "every point of every frame; found 336 rows"),
        ("points", first("partners", [999]), "partners: .*required: 1, surface points"),
        ("points", first("partners", None), "partners: .*required: 1, surface points"),
        ("points", first("m0", 0.5), "000001/points.parquet: the points differ from those of"),
        ("points", lambda t: t.slice(0, 0), "the queried object has no surface points"),
    ],
)
def test_tables_that_break_the_specification_give_no_frame(
    tmp_path: Path, table: str, change: Callable[[pa.Table], pa.Table], message: str
) -> None:
    root = write_sheet_dataset(tmp_path / "set", {"train": 2}, frames=2, symmetric=True)
    path = Dataset.open(root).sequences[0].dir / f"{table}.parquet"
    whole = pq.read_table(path)
    pq.write_table(change(whole).replace_schema_metadata(whole.schema.metadata), path)

    def all_frames() -> list[TrainingFrame]:
        store = FrameStore(Dataset.open(root), "sheet", "train", (8, 6))
        return [store.view(number) for number in range(4)]

    with pytest.raises(SpecError, match=message):
        all_frames()


def test_unknown_tier_and_empty_split_are_refused(sheet_dataset: Dataset) -> None:
    with pytest.raises(CallError, match="no such tier"):
        FrameStore(sheet_dataset, "rope", "train", (80, 60))
    with pytest.raises(CallError, match=r"no sequence in split 'test'.*validation\.split"):
        FrameStore(sheet_dataset, "sheet", "test", (80, 60))


def test_withheld_truth_is_no_damaged_dataset(tmp_path: Path) -> None:
    """Splits of imported annotations and of published tests have nothing to train on."""
    root = write_sheet_dataset(tmp_path / "set", {"train": 1, "test": 1})
    for held_out, required in ((["test"], "one of train"), (["test", "train"], "pliant generate")):
        info = json.loads((root / "dataset.json").read_text())
        (root / "dataset.json").write_text(json.dumps(info | {"held_out": held_out}))
        with pytest.raises(CallError, match=f"split 'test' with depth and dense .*{required}"):
            FrameStore(Dataset.open(root), "sheet", "test", (80, 60))
