"""Errors that leave every file in order by itself, on a rendered set: each one is reported.

A mutation changes all files that follow from one another, as a program with that error would: a
shifted principal point moves u_px, v_px too. Queries and truth, which would give it away, are left
out.
"""

from __future__ import annotations

import json
import shutil
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from pliant.spec.dataset import Dataset
from pliant.spec.io.exr import Surface, read_surface, write_surface
from pliant.spec.io.png import read_rgb, write_rgb
from pliant.spec.validation.validate import Report, validate
from tests.conformance import image_changes
from tests.conformance.edits import change_exr, change_json, change_rows, listed

Array = np.ndarray[Any, Any]
Rng = np.random.Generator


@dataclass
class Loaded:
    """One sequence in memory; `save` writes it back."""

    folder: Path
    frames: int
    K: Array
    pose: Array
    table: dict[str, Array]
    schema: pa.Schema
    surfaces: list[Surface]
    rgb: list[Array]

    @classmethod
    def load(cls, folder: Path) -> Loaded:
        cameras = json.loads((folder / "cameras.json").read_text())["frames"]
        table = pq.read_table(folder / "correspondences.parquet")
        count = len(cameras)
        return cls(
            folder,
            count,
            np.array([c["K"] for c in cameras]),
            np.array([c["world_to_camera"] for c in cameras]),
            {n: np.array(table.column(n).to_pylist()) for n in table.column_names},
            table.schema,
            [read_surface(folder / f"depth/{f:06d}.exr") for f in range(count)],
            [read_rgb(folder / f"rgb/{f:06d}.png").copy() for f in range(count)],
        )

    @property
    def xyz(self) -> Array:
        return np.stack([self.table[f"{a}_m"] for a in "xyz"], axis=1).astype(np.float64)

    @xyz.setter
    def xyz(self, value: Array) -> None:
        for axis, name in enumerate("xyz"):
            self.table[f"{name}_m"] = value[:, axis]

    def project(self) -> None:
        """Compute u_px, v_px, depth_m again from the positions."""
        frame = self.table["frame"]
        local = np.einsum("nij,nj->ni", self.pose[frame, :3, :3], self.xyz)
        local += self.pose[frame, :3, 3]
        for axis, name in enumerate(("u_px", "v_px")):
            K = self.K[frame]
            self.table[name] = K[:, axis, axis] * local[:, axis] / local[:, 2] + K[:, axis, 2]
        self.table["depth_m"] = local[:, 2]

    def move_to(self, uv: Array) -> None:
        """Move every point parallel to its image plane, so that it projects to uv."""
        frame, z = self.table["frame"], self.table["depth_m"].astype(np.float64)
        K = self.K[frame]
        local = np.stack(
            [
                (uv[:, 0] - K[:, 0, 2]) / K[:, 0, 0] * z,
                (uv[:, 1] - K[:, 1, 2]) / K[:, 1, 1] * z,
                z,
            ],
            axis=1,
        )
        local -= self.pose[frame, :3, 3]
        self.xyz = np.einsum("nji,nj->ni", self.pose[frame, :3, :3], local)
        self.project()

    @property
    def uv(self) -> Array:
        return np.stack([self.table["u_px"], self.table["v_px"]], axis=1).astype(np.float64)

    def save(self) -> None:
        document = json.loads((self.folder / "cameras.json").read_text())
        for entry, K, pose in zip(document["frames"], self.K, self.pose, strict=True):
            entry.update(K=K.tolist(), world_to_camera=pose.tolist())
        (self.folder / "cameras.json").write_text(json.dumps(document))
        arrays = [pa.array(self.table[f.name].tolist(), f.type) for f in self.schema]
        pq.write_table(
            pa.Table.from_arrays(arrays, schema=self.schema),
            self.folder / "correspondences.parquet",
        )
        for frame in range(self.frames):
            write_surface(self.folder / f"depth/{frame:06d}.exr", self.surfaces[frame])
            write_rgb(self.folder / f"rgb/{frame:06d}.png", np.ascontiguousarray(self.rgb[frame]))


Change = Callable[[list[Loaded]], None]


def centre(du: float, dv: float) -> Change:
    """Move the principal point and the tables with it; the images stay."""

    def change(sequences: list[Loaded]) -> None:
        for sequence in sequences:
            sequence.K[:, 0, 2] += du
            sequence.K[:, 1, 2] += dv
            sequence.project()

    return change


def surface(edit: Callable[[Surface, Loaded, int], Surface]) -> Change:
    """Change every surface image."""

    def change(sequences: list[Loaded]) -> None:
        for sequence in sequences:
            for frame in range(sequence.frames):
                sequence.surfaces[frame] = edit(sequence.surfaces[frame], sequence, frame)

    return change


def depth(edit: Callable[[Array], Array]) -> Change:
    """Change Z of every pixel of an object."""

    def one(old: Surface, sequence: Loaded, frame: int) -> Surface:
        z = old.depth_m.astype(np.float64)
        seen = np.isfinite(z)
        z[seen] = edit(z[seen])
        return Surface(z.astype(np.float32), old.m0, old.m1, old.object_id)

    return surface(one)


def material(edit: Callable[[Array], Array]) -> Change:
    """Change both material channels where an object is seen."""

    def one(old: Surface, sequence: Loaded, frame: int) -> Surface:
        seen = old.object_id > 0
        planes = []
        for plane in (old.m0, old.m1):
            new = plane.astype(np.float64).copy()
            new[seen] = edit(new[seen])
            planes.append(np.clip(new, plane.min(), plane.max()).astype(np.float32))
        return Surface(old.depth_m, planes[0], planes[1], old.object_id)

    return surface(one)


def rolled(rows: int, columns: int) -> Change:
    def one(old: Surface, sequence: Loaded, frame: int) -> Surface:
        shift = (rows, columns)
        return Surface(
            np.roll(old.depth_m, shift, (0, 1)),
            np.roll(old.m0, shift, (0, 1)),
            np.roll(old.m1, shift, (0, 1)),
            np.roll(old.object_id, shift, (0, 1)),
        )

    return surface(one)


def ray_length(old: Surface, sequence: Loaded, frame: int) -> Surface:
    K = sequence.K[frame]
    v, u = np.indices(old.depth_m.shape) + 0.5
    x, y = (u - K[0, 2]) / K[0, 0], (v - K[1, 2]) / K[1, 1]
    length = old.depth_m * np.sqrt(1 + x * x + y * y)
    return Surface(length.astype(np.float32), old.m0, old.m1, old.object_id)


def colour(edit: Callable[[list[Array]], list[Array]]) -> Change:
    def change(sequences: list[Loaded]) -> None:
        for sequence in sequences:
            sequence.rgb = edit(sequence.rgb)

    return change


def jitter(size_px: float) -> Change:
    def change(sequences: list[Loaded]) -> None:
        rng = np.random.default_rng(1)
        for sequence in sequences:
            sequence.move_to(sequence.uv + rng.normal(0, size_px, sequence.uv.shape))

    return change


def rounded(sequences: list[Loaded]) -> None:
    for sequence in sequences:
        sequence.move_to(np.floor(sequence.uv) + 0.5)


def zoomed(factor: float) -> Change:
    def change(sequences: list[Loaded]) -> None:
        for sequence in sequences:
            sequence.K[:, [0, 1], [0, 1]] *= factor
            sequence.project()

    return change


def world(factor: float) -> Change:
    """Write every length in another unit, metres_per_unit apart."""

    def change(sequences: list[Loaded]) -> None:
        for sequence in sequences:
            sequence.xyz = sequence.xyz * factor
            sequence.pose[:, :3, 3] *= factor
            sequence.project()
        depth(lambda z: z * factor)(sequences)

    return change


def eight_bits(values: Array) -> Array:
    low, high = values.min(), values.max()
    return low + np.rint((values - low) / (high - low) * 255) / 255 * (high - low)


def noise(size: float) -> Callable[[Array], Array]:
    rng = np.random.default_rng(2)
    return lambda values: values + rng.normal(0, size, values.shape)


def next_tables(sequences: list[Loaded]) -> None:
    """Give every frame the rows of the next one: tables and images a frame apart."""
    for sequence in sequences:
        count = sequence.frames
        frame = sequence.table["frame"]
        order = np.concatenate([np.flatnonzero(frame == (f + 1) % count) for f in range(count)])
        for name in sequence.table:
            if name != "frame":
                sequence.table[name] = sequence.table[name][order]
        sequence.K, sequence.pose = np.roll(sequence.K, -1, 0), np.roll(sequence.pose, -1, 0)


def other_sequence(sequences: list[Loaded]) -> None:
    """Exchange the pictures of the two training sequences of a tier."""
    first, second = sequences[0], sequences[1]
    first.rgb, second.rgb = second.rgb, first.rgb


def grey(value: int) -> Change:
    return colour(lambda rgb: [np.full_like(each, value) for each in rgb])


def per_row(edit: Callable[[Loaded], None]) -> Change:
    def change(sequences: list[Loaded]) -> None:
        for sequence in sequences:
            edit(sequence)

    return change


def table_shift(sequence: Loaded) -> None:
    sequence.table["u_px"] = sequence.table["u_px"] - 0.5
    sequence.table["v_px"] = sequence.table["v_px"] - 0.5


def table_swap(sequence: Loaded) -> None:
    table = sequence.table
    table["u_px"], table["v_px"] = table["v_px"], table["u_px"]


def table_flip(sequence: Loaded) -> None:
    sequence.table["v_px"] = sequence.rgb[0].shape[0] - sequence.table["v_px"]


def table_unit(sequence: Loaded) -> None:
    height, width = sequence.rgb[0].shape[:2]
    sequence.table["u_px"] = sequence.table["u_px"] / width
    sequence.table["v_px"] = sequence.table["v_px"] / height


def table_mm(sequence: Loaded) -> None:
    sequence.table["depth_m"] = sequence.table["depth_m"] * 1000


def table_ray(sequence: Loaded) -> None:
    K = sequence.K[sequence.table["frame"]]
    slope = (sequence.uv - K[:, [0, 1], 2]) / K[:, [0, 1], [0, 1]]
    sequence.table["depth_m"] = sequence.table["depth_m"] * np.sqrt(1 + (slope**2).sum(1))


def table_axes(sequence: Loaded) -> None:
    sequence.xyz = sequence.xyz[:, [0, 2, 1]]


def table_xyz_mm(sequence: Loaded) -> None:
    sequence.xyz = sequence.xyz * 1000


def pose_inverse(sequence: Loaded) -> None:
    sequence.pose = np.linalg.inv(sequence.pose)
    sequence.pose[:, 3] = [0, 0, 0, 1]


def pose_opengl(sequence: Loaded) -> None:
    sequence.pose = np.diag([1.0, -1, -1, 1]) @ sequence.pose


SHIFT, DEPTH, FEW = "OFFSET_DISAGREES", "DEPTH_IMAGE_DISAGREES", "PRECISION_LOST"
COLOUR = "COLOUR_DISAGREES"
LOST, DEEP = "REPROJECTION_DISAGREES", "DEPTH_DISAGREES"

MUTATIONS: dict[str, tuple[Change, str]] = {}
"""Name -> (change of the sequences of one tier, code that is reported; empty: any)."""


def mutation(name: str, code: str, change: Change) -> None:
    MUTATIONS[name] = (change, code)


mutation("opencv-centres", SHIFT, centre(-0.5, -0.5))
mutation("half-pixel-more", SHIFT, centre(0.5, 0.5))
mutation("quarter-pixel-right", SHIFT, centre(0.25, 0.0))
mutation("half-pixel-down", SHIFT, centre(0.0, 0.5))
mutation("exr-one-column-right", SHIFT, rolled(0, 1))
mutation("exr-one-row-down", SHIFT, rolled(1, 0))
mutation("exr-one-pixel-both", SHIFT, rolled(-1, -1))
mutation("jitter-0.5px", "OFFSET_SCATTERS", jitter(0.5))
mutation("jitter-0.3px", "OFFSET_SCATTERS", jitter(0.3))
mutation("rounded-to-pixel-centres", "OFFSET_SCATTERS", rounded)
mutation("focal-length-1-percent", "OFFSET_SCATTERS", zoomed(1.01))
mutation("material-8-bits", FEW, material(eight_bits))
mutation("material-float16", FEW, material(lambda m: m.astype(np.float16)))
mutation("material-noise", "SURFACE_NOISY", material(noise(0.004)))
mutation("depth-float16", FEW, depth(lambda z: z.astype(np.float16)))
mutation("depth-8-bits", FEW, depth(eight_bits))
mutation("depth-whole-millimetres", FEW, depth(lambda z: np.round(z, 3)))
mutation("depth-noise-1mm", "DEPTH_IMAGE_SCATTERS", depth(noise(1e-3)))
mutation("depth-5mm-more", DEPTH, depth(lambda z: z + 5e-3))
mutation("depth-2-percent-more", DEPTH, depth(lambda z: z * 1.02))
mutation("depth-times-1000", DEPTH, depth(lambda z: z * 1000))
mutation("depth-ray-length", DEPTH, surface(ray_length))
mutation("depth-disparity", DEPTH, depth(lambda z: 1 / z))
mutation("world-in-millimetres", "SCALE_DISAGREES", world(1000.0))
mutation("world-in-centimetres", "SCALE_DISAGREES", world(100.0))
mutation("tables-of-the-next-frame", "", next_tables)
mutation("rgb-grey", "COLOUR_LOST", colour(image_changes.grey))
mutation("rgb-enlarged", "COLOUR_LOST", colour(image_changes.enlarged))
mutation("rgb-jpeg-25", "COLOUR_LOST", colour(image_changes.jpeg))
mutation("rgb-next-frame", COLOUR, colour(lambda rgb: rgb[1:] + rgb[:1]))
mutation("rgb-frame-before", COLOUR, colour(lambda rgb: rgb[-1:] + rgb[:-1]))
mutation("rgb-other-sequence", "COLOUR_DOUBTFUL", other_sequence)
mutation("rgb-upside-down", COLOUR, colour(lambda rgb: [each[::-1] for each in rgb]))
mutation("rgb-mirrored", COLOUR, colour(lambda rgb: [each[:, ::-1] for each in rgb]))
mutation("rgb-turned", COLOUR, colour(lambda rgb: [each[::-1, ::-1] for each in rgb]))
mutation("rgb-1px-right", COLOUR, colour(lambda rgb: [np.roll(each, 1, 1) for each in rgb]))
mutation("rgb-1px-up", COLOUR, colour(lambda rgb: [np.roll(each, -1, 0) for each in rgb]))
mutation("rgb-2px-down", COLOUR, colour(lambda rgb: [np.roll(each, 2, 0) for each in rgb]))
mutation("rgb-5px-right", COLOUR, colour(lambda rgb: [np.roll(each, 5, 1) for each in rgb]))
mutation("rgb-black", COLOUR, grey(0))
mutation("rgb-one-grey", COLOUR, grey(128))
mutation("rgb-repeated", COLOUR, colour(lambda rgb: [rgb[0]] * len(rgb)))
mutation(
    "rgb-random",
    "COLOUR_DOUBTFUL",
    colour(lambda rgb: [np.random.default_rng(i).integers(0, 256, each.shape, np.uint8)
                        for i, each in enumerate(rgb)]),
)  # fmt: skip

DIAGNOSED = {
    "table-opencv": (table_shift, LOST, "OpenCV convention?"),
    "table-swapped": (table_swap, LOST, "swapped axes"),
    "table-v-upwards": (table_flip, LOST, "v upwards"),
    "table-normalised": (table_unit, LOST, "divided by the image size"),
    "table-depth-mm": (table_mm, DEEP, "millimetres"),
    "table-depth-ray": (table_ray, DEEP, "length of the ray"),
    "table-axes-swapped": (table_axes, LOST, "axes swapped"),
    "table-positions-mm": (table_xyz_mm, LOST, "1000 times too large: millimetres"),
    "pose-inverse": (pose_inverse, LOST, "inverse pose"),
    "pose-opengl": (pose_opengl, DEEP, "OpenGL"),
}


@pytest.fixture
def copy(rendered_dataset: Path, tmp_path: Path) -> Path:
    ignored = shutil.ignore_patterns("queries", "truth", ".*")
    return Path(shutil.copytree(rendered_dataset, tmp_path / "set", ignore=ignored))


def mutate(root: Path, change: Change) -> Report:
    by_tier: dict[str, list[Loaded]] = {}
    for folder in sorted(root.glob("sequences/*/*")):
        by_tier.setdefault(folder.parent.name, []).append(Loaded.load(folder))
    for sequences in by_tier.values():
        change(sequences)
        for sequence in sequences:
            sequence.save()
    listed()(root)
    return validate(root)


def test_the_set_is_valid_as_rendered(copy: Path) -> None:
    report = mutate(copy, lambda sequences: None)
    assert [str(issue) for issue in report.issues] == []


@pytest.mark.parametrize("name", list(MUTATIONS))
def test_consistent_mutation(copy: Path, name: str) -> None:
    change, code = MUTATIONS[name]
    report = mutate(copy, change)
    assert report.counts, name
    found = {issue.code for issue in report.issues}
    assert not code or code in found, [str(issue) for issue in report.issues][:6]


@pytest.mark.parametrize("name", list(DIAGNOSED))
def test_errors_of_all_rows_are_diagnosed_once(copy: Path, name: str) -> None:
    edit, code, text = DIAGNOSED[name]
    report = mutate(copy, per_row(edit))
    issues = [issue for issue in report.issues if issue.code == code]
    assert report.counts[code] > 1000
    assert len(issues) <= 2, [str(issue) for issue in issues][:4]
    assert text in issues[0].message


def test_independent_frames_called_an_episode(copy: Path) -> None:
    for path in copy.glob("sequences/*/*/sequence.json"):
        change_json(str(path.relative_to(copy)), lambda d: d.update(temporal=True))(copy)
    change_rows("sequences.parquet", lambda rows: [row | {"temporal": True} for row in rows])(copy)
    report = validate(copy)
    assert set(report.counts) == {"TEMPORAL_DOUBTFUL"}
    doubted = {issue.path.split("/")[1] for issue in report.issues}
    assert "rope" in doubted


@pytest.mark.parametrize("factor", [10.0, 0.1, 1000.0, 0.001])
def test_metres_per_unit(copy: Path, factor: float) -> None:
    path = copy / "dataset.json"
    document = json.loads(path.read_text())
    for tier in document["tiers"]:
        for coordinate in tier["objects"][0]["material"]:
            coordinate["metres_per_unit"] *= factor
    path.write_text(json.dumps(document))
    assert "SCALE_DISAGREES" in validate(copy).counts


@pytest.mark.parametrize("what", ["files", "tables", "pictures"])
@pytest.mark.parametrize("split", ["test", "train"])
def test_content_that_is_there_twice(copy: Path, what: str, split: str) -> None:
    """A sequence appears again in another split, written by other encoders."""
    sequences = Dataset.open(copy).sequences
    source = next(s for s in sequences if s.tier == "rope" and s.split == "train")
    others = [s for s in sequences if s.tier == "rope" and s.split == split and s.id != source.id]
    target = others[0]
    for path in source.dir.rglob("*"):
        name = path.relative_to(source.dir)
        wanted = {
            "files": path.suffix != ".json" or path.name == "cameras.json",
            "tables": path.suffix == ".parquet" or path.name == "cameras.json",
            "pictures": path.suffix == ".png",
        }[what]
        if path.is_file() and wanted:
            shutil.copyfile(path, target.dir / name)
    for frame in range(source.frames):
        image = target.dir / f"rgb/{frame:06d}.png"
        write_rgb(image, read_rgb(image), level=9)
        change_exr(f"{target.dir.relative_to(copy)}/depth/{frame:06d}.exr", lambda c: None,
                   "NO_COMPRESSION")(copy)  # fmt: skip
    listed()(copy)
    code = "SPLIT_SHARED" if split == "test" else "FRAME_REPEATED"
    assert code in validate(copy).counts
