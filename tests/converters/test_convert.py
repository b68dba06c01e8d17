"""`pliant convert`: each target is opened by its own client, or by a reader that knows its form."""

from __future__ import annotations

import io
import json
import math
import re
import shutil
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow.parquet as pq
import pytest
from PIL import Image

from pliant.cli.convert import TARGET_NAMES
from pliant.cli.main import run
from pliant.converters.convert import TARGETS, chosen_sequences, convert
from pliant.converters.formats import read_source
from pliant.converters.targets.lerobot import DEPTH, RGB, TRACKS
from pliant.converters.targets.recording import Options, Recording, spread
from pliant.spec.dataset import Dataset
from pliant.spec.errors import CallError, SpecError
from pliant.spec.io.limits import MAX_IMAGE_FILE_BYTES
from pliant.spec.io.reading import read_bytes
from pliant.spec.model import MaterialCoordinate, MaterialObject
from pliant.spec.point_mesh import PosedMesh
from tests.conftest import Called
from tests.known import known


@pytest.fixture(scope="module")
def sample() -> Dataset:
    return Dataset.open("sample")


def written(name: str, sample: Dataset, out: Path, points: int | None = None) -> Path:
    sequences = chosen_sequences(sample, sequences=["rope-train-000000", "rope-val-000000"])
    size = convert(sequences, TARGETS[name], out, Options(points))
    assert size == sum(path.stat().st_size for path in out.rglob("*") if path.is_file())
    return out


@pytest.fixture(scope="module")
def recording(sample: Dataset) -> Recording:
    return Recording.of(sample.sequence("rope-train-000000"))


def test_points_of_a_recording(sample: Dataset, recording: Recording) -> None:
    sequence = sample.sequence("rope-train-000000")
    for frame in sequence:
        rows = frame.correspondences.to_pylist()
        for number in (0, 311, 799):
            row = rows[int(recording.mesh.rows[number])]
            assert recording.uv_px[frame.index, number].tolist() == [row["u_px"], row["v_px"]]
            assert recording.xyz_m[frame.index, number, 2] == np.float32(row["z_m"])
            assert recording.visible[frame.index, number] == (row["visibility"] == "visible")


@pytest.mark.parametrize("count", [16, 33, 64])
def test_fewer_points_cover_the_object(count: int) -> None:
    """A square of 33 x 33 points: no place is twice as far from a point as in a regular grid."""
    axis = MaterialCoordinate("u", 0, 1, 1)
    material = np.stack(np.meshgrid(*[np.linspace(0, 1, 33)] * 2), axis=-1).reshape(-1, 2)
    mesh = PosedMesh(MaterialObject(1, "cloth", (axis, axis)), np.arange(33**2), material)
    kept = material[spread(mesh, count)]
    assert len(kept) == count
    apart = np.linalg.norm(material[:, None] - kept, axis=2).min(axis=1)
    assert apart.max() < 2 * math.sqrt(0.5) / math.isqrt(count)


def test_tapvid(sample: Dataset, recording: Recording, tmp_path: Path) -> None:
    out = written("tapvid", sample, tmp_path / "out")
    with np.load(out / "rope-train-000000.npz") as arrays:
        shapes = {name: (arrays[name].shape, arrays[name].dtype.name) for name in arrays}
    points, frames, _ = recording.uv_px.transpose(1, 0, 2).shape
    width, height = sample.size
    assert shapes == {
        "video": ((frames, height, width, 3), "uint8"),
        "points": ((points, frames, 2), "float32"),
        "occluded": ((points, frames), "bool"),
    }
    clip = next(each for each in read_source(out).clips if each.name == "rope-train-000000")
    np.testing.assert_allclose(
        clip.uv_px[clip.visible], recording.uv_px.transpose(1, 0, 2)[recording.visible.T], atol=1e-4
    )
    assert (clip.visible == recording.visible.T).all()
    assert (clip.read(1) == sample.frame("rope-train-000000", 1).rgb).all()


def test_coco(sample: Dataset, tmp_path: Path) -> None:
    coco = pytest.importorskip("pycocotools.coco")
    out = written("coco", sample, tmp_path / "out", points=40)
    opened = coco.COCO(out / "annotations.json")
    frame = sample.frame("rope-val-000000", 1)
    image = next(
        each for each in opened.imgs.values() if each["file_name"] == "rope-val-000000-000001.png"
    )
    (annotation,) = opened.loadAnns(opened.getAnnIds(image["id"]))
    mask = known(frame.mask)
    assert (opened.annToMask(annotation) == mask).all()
    assert annotation["area"] == mask.sum()
    few = Recording.of(frame.sequence, 40)
    triples = np.array(annotation["keypoints"]).reshape(40, 3)
    np.testing.assert_allclose(triples[:, :2], few.uv_px[1], atol=1e-3)
    assert ((triples[:, 2] == 2) == few.visible[1]).all()
    clip = read_source(out / "annotations.json").clips[0]  # our own importer
    np.testing.assert_allclose(clip.uv_px[:, 3], few.uv_px[1], atol=1e-3)


# The client leaves a file open at its end.
open_file = pytest.mark.filterwarnings("ignore::pytest.PytestUnraisableExceptionWarning")


@open_file
def test_webdataset(sample: Dataset, recording: Recording, tmp_path: Path) -> None:
    webdataset = pytest.importorskip("webdataset")
    out = written("webdataset", sample, tmp_path / "out")
    assert sorted(path.name for path in out.iterdir()) == ["train-000000.tar", "val-000000.tar"]
    stream = webdataset.WebDataset(str(out / "train-000000.tar"), shardshuffle=False)
    first = next(iter(stream.decode("pil")))
    frame = sample.frame("rope-train-000000", 0)
    assert (np.asarray(first["rgb.png"]) == frame.rgb).all()
    assert first["camera.json"]["K"] == known(frame.camera).K.tolist()
    points = first["points.npz"]
    points = points if isinstance(points, dict) else np.load(io.BytesIO(points))
    assert (points["uv_px"] == recording.uv_px[0]).all()
    assert first["depth.exr"] == read_bytes(
        frame.sequence.file("depth/000000.exr"), MAX_IMAGE_FILE_BYTES
    )


@open_file
def test_webdataset_of_ids_with_dots(sample: Dataset, tmp_path: Path) -> None:
    """A reader takes what follows the first dot of a file's name for the ending."""
    webdataset = pytest.importorskip("webdataset")
    first = sample.sequence("rope-train-000000")

    class Renamed:
        """The files of the first sequence, whatever it is called."""

        def get(self, name: str) -> Any:
            return first.file(name.split("/", 3)[-1])

    files: Any = Renamed()
    named = [replace(first, id=each, files=files) for each in ("take.1", "take.2")]
    convert(named, TARGETS["webdataset"], tmp_path / "out", Options(9))
    shard = str(tmp_path / "out" / "train-000000.tar")
    samples = list(webdataset.WebDataset(shard, shardshuffle=False))
    found = [json.loads(each["camera.json"])["sequence"] for each in samples]
    assert found == ["take.1"] * 2 + ["take.2"] * 2


def test_rerun(sample: Dataset, recording: Recording, tmp_path: Path) -> None:
    dataframe = pytest.importorskip("rerun").dataframe
    out = written("rerun", sample, tmp_path / "out")
    opened = dataframe.load_recording(out / "rope-train-000000.rrd")
    view = opened.view(index="frame", contents="/world/points")
    table = view.select().read_all()
    name = next(each for each in table.column_names if "osition" in each)
    positions = np.array(table[name][1].as_py())
    assert (positions == recording.xyz_m[1]).all()
    depth = opened.view(index="frame", contents="/world/camera/image/depth").select().read_all()
    name = next(each for each in depth.column_names if "buffer" in each.lower())
    blob = np.array(depth[name][0].as_py()[0], np.uint8).tobytes()
    surface = known(sample.frame("rope-train-000000", 0).surface)
    seen = np.isfinite(surface.depth_m)
    found = np.frombuffer(blob, np.float32).reshape(surface.depth_m.shape)
    assert (found[seen] == surface.depth_m[seen]).all()


def test_glb(sample: Dataset, recording: Recording, tmp_path: Path) -> None:
    trimesh = pytest.importorskip("trimesh")
    out = written("glb", sample, tmp_path / "out")
    scene = trimesh.load(out / "rope-train-000000.glb")
    mesh = scene.to_geometry()
    assert mesh.faces.shape == recording.mesh.faces.shape
    # y is up in glTF: (x, y, z) of the dataset is (x, z, -y) there.
    xyz = recording.xyz_m[0]
    turned = np.stack([xyz[:, 0], xyz[:, 2], -xyz[:, 1]], axis=1)
    np.testing.assert_allclose(
        turned[recording.mesh.faces].mean(axis=1), mesh.triangles_center, atol=1e-6
    )
    document, binary = _chunks((out / "rope-train-000000.glb").read_bytes())
    target = document["meshes"][0]["primitives"][0]["targets"][0]["POSITION"]
    view = document["bufferViews"][document["accessors"][target]["bufferView"]]
    data = binary[view["byteOffset"] : view["byteOffset"] + view["byteLength"]]
    moved = np.frombuffer(data, np.float32).reshape(-1, 3)
    np.testing.assert_allclose(xyz + moved, recording.xyz_m[1], atol=1e-6)


def _chunks(data: bytes) -> tuple[Any, bytes]:
    length = int.from_bytes(data[12:16], "little")
    return json.loads(data[20 : 20 + length]), data[28 + length :]


def test_lerobot(sample: Dataset, recording: Recording, tmp_path: Path) -> None:
    datasets = pytest.importorskip("datasets")
    out = written("lerobot", sample, tmp_path / "out", points=50)
    info = json.loads((out / "meta" / "info.json").read_text())
    assert (info["codebase_version"], info["total_frames"]) == ("v3.0", 4)
    few = Recording.of(recording.sequence, 50)
    opened = (
        datasets.load_dataset(
            "parquet",
            data_files=sorted(str(path) for path in (out / "data").rglob("*.parquet")),
            split="train",
            cache_dir=str(tmp_path / "cache"),
        )
        .cast_column(RGB, datasets.Image())
        .cast_column(DEPTH, datasets.Image())
    )
    row = opened[1]
    frame = sample.frame("rope-train-000000", 1)
    assert (np.asarray(row[RGB]) == frame.rgb).all()
    assert (np.asarray(row[DEPTH]) == known(frame.surface).depth_m).all()  # with +inf: without loss
    assert (np.array(row[TRACKS], np.float32) == few.uv_px[1]).all()
    assert [row["episode_index"], row["frame_index"], row["index"]] == [0, 1, 1]
    episodes = pq.read_table(out / "meta/episodes/chunk-000/file-000.parquet").to_pylist()
    assert [each["dataset_to_index"] for each in episodes] == [2, 4]
    tiff = pq.read_table(out / "data/chunk-000/file-001.parquet")[DEPTH][0].as_py()["bytes"]
    assert Image.open(io.BytesIO(tiff)).mode == "F"


def test_the_command(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert list(TARGETS) == TARGET_NAMES
    out = tmp_path / "my out"
    call = ["convert", "sample", "--split", "val", "--to", "tapvid", "--out", str(out)]
    assert run(call) == 0
    shown = capsys.readouterr()
    assert "cannot store" in shown.err
    assert "independent configurations (their frames become consecutive)" in shown.err
    assert f"Wrote 2 sequences to {out}. Open with: numpy, " in shown.out
    assert f"`pliant import '{out}'`" in shown.out
    assert run(call) == 2  # the folder has files
    assert "exists already" in capsys.readouterr().err
    assert run([*call[:-1], str(tmp_path / "b"), "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["sequences"] == 2
    assert run([*call[:-3], "webdataset", "--out", str(tmp_path / "c")]) == 0
    opened = re.search(r'WebDataset\("(.+)"\)', capsys.readouterr().out)
    assert opened
    assert Path(opened[1].replace("SPLIT", "val")).is_file()


@pytest.mark.parametrize(
    ("target", "part"),
    [
        *(("webdataset", part) for part in ("rgb/000001.png", "depth/000001.exr")),
        *((target, "rgb/000001.png") for target in ("lerobot", "coco", "tapvid")),
    ],
)
def test_a_damaged_picture_is_refused(
    target: str, part: str, tiny_episode: Path, tmp_path: Path
) -> None:
    shutil.copytree(tiny_episode, tmp_path / "set")
    sequence = Dataset.open(tmp_path / "set").sequences[0]
    path = sequence.dir / part
    path.write_bytes(path.read_bytes()[:600])
    with pytest.raises(SpecError, match=part):
        convert([sequence], TARGETS[target], tmp_path / "out", Options(points=8))
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize("rate", ["0", "-5", "nan", "inf", "1e-300"])
def test_impossible_frame_rates(rate: str, tmp_path: Path, called: Called) -> None:
    out = tmp_path / "out"
    code, _, error = called("convert", "sample", "--to", "glb", "--out", out, "--frame-rate", rate)
    assert code == 2
    assert "--frame-rate: invalid frame rate" in error
    assert not out.exists()


def test_held_out_truth_is_not_converted(sample: Dataset) -> None:
    sample.info["held_out"] = ["test"]
    try:
        with pytest.raises(
            CallError, match=r"truth.*found split test; required: splits train, val;"
        ):
            chosen_sequences(sample, split="test")
        assert {each.split for each in chosen_sequences(sample)} == {"train", "val"}
        sample.info["held_out"] = ["train", "val", "test"]  # as an import
        with pytest.raises(
            CallError, match="found all sequences; required: a dataset with truth inside"
        ):
            chosen_sequences(sample)
        with pytest.raises(CallError, match=r"no such.*split unknown; required: splits test, tr"):
            chosen_sequences(sample, split="unknown")
    finally:
        del sample.info["held_out"]
    with pytest.raises(CallError, match="no such sequences"):
        chosen_sequences(sample, tier="cloth-9")
