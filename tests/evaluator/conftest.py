"""An analytic dataset whose truth is a formula, and submissions to it.

A flat cloth lies under an affine map in every frame: material (x, y) is seen at
centre + R(angle) (W (x - 0.5), H (y - 0.5)). A rope is such a strip whose second coordinate
is an angle: (s, theta) is seen at centre + R(angle) (L (s - 0.5), r sin theta), and hidden by
itself where cos theta < 0.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from pliant.evaluator import Scores, evaluate, write_report
from pliant.spec.conventions import SPEC_VERSION
from pliant.spec.dataset import Dataset
from pliant.spec.io.exr import Surface, write_surface
from pliant.spec.io.parquet import write_table
from pliant.spec.io.png import write_rgb
from pliant.spec.storage import layout
from tests.dataset_files import (
    coordinate,
    listing_row,
    points_table,
    tier,
    write_dataset,
    write_queries,
)

WIDTH, HEIGHT = 160, 120
CLOTH = tier(
    "cloth",
    "cloth",
    {"cloth": [coordinate("x", 0, 1, 0.8), coordinate("y", 0, 1, 0.5)]},
    [("half-turn", [[-1, 0], [0, -1]], [1, 1]), ("mirror", [[-1, 0], [0, 1]], [1, 0])],
    "two-sided",
)
_ANGLE = coordinate("theta", -np.pi, np.pi, 0.012, 2 * np.pi)
ROPE = tier("rope", "rope", {"rope": [coordinate("s", 0, 1, 1.2), _ANGLE]})
SIZES = {"cloth": (96.0, 60.0), "rope": (110.0, 8.0)}  # px
_POSES = ((70.0, 90.0), (50.0, 70.0), (-0.5, 0.5))  # limits of centre u, centre v and angle


@dataclass(frozen=True)
class Scene:
    """A dataset on disk with its tables in memory."""

    root: Path
    split: str
    queries: pa.Table
    truth: pa.Table

    @property
    def dataset(self) -> Dataset:
        return Dataset.open(self.root)

    @property
    def rows(self) -> int:
        return self.queries.num_rows

    @property
    def true_px(self) -> np.ndarray:
        return np.stack([self.truth[n].to_numpy() for n in ("u_b", "v_b")], axis=1).astype(float)

    @property
    def visible(self) -> np.ndarray:
        return np.array([s == "visible" for s in self.truth["visibility_b"].to_pylist()])

    @property
    def pair(self) -> np.ndarray:
        return self.queries["pair_id"].to_numpy()

    def footer(self, **changes: Any) -> dict[str, Any]:
        dataset = self.dataset
        return {
            "dataset": {"id": dataset.id, "version": dataset.version},
            "split": self.split,
            "queries_sha256": dataset.queries_sha256(self.split),
            "method": {"name": "test"},
        } | changes

    def table(self, uv: np.ndarray | None = None, **columns: Any) -> pa.Table:
        """Return answers, by default the truth; further columns as given."""
        uv = self.true_px if uv is None else uv
        data = {
            "pair_id": self.queries["pair_id"],
            "query_id": self.queries["query_id"],
            "u": pa.array(uv[:, 0].astype(np.float32)),
            "v": pa.array(uv[:, 1].astype(np.float32)),
        }
        return pa.table(data | {name: pa.array(v) for name, v in columns.items()})

    def edited(self, column: str, row: int, value: Any) -> pa.Table:
        """Return the truth as answers, with another value in one place."""
        table = self.table()
        values = table[column].to_pylist()
        values[row] = value
        array = pa.array(values, table.schema.field(column).type)
        return table.set_column(table.column_names.index(column), column, array)

    def submit(
        self, path: Path, table: pa.Table | None = None, *, kind: str = "answers", **footer: Any
    ) -> Path:
        """Write a submission without checking anything about its table."""
        content = {"spec_version": SPEC_VERSION, "table": kind, **self.footer(**footer)}
        table = self.table() if table is None else table
        metadata = {b"pliant": json.dumps(content).encode()}
        pq.write_table(table.replace_schema_metadata(metadata), path)
        return path

    def score(
        self, folder: Path, table: pa.Table | None = None, *, name: str = "test", **options: Any
    ) -> Scores:
        """Score answers of a method, by default the truth; `options` are those of `evaluate`."""
        path = self.submit(folder / f"{name}.parquet", table, method={"name": name})
        return evaluate(path, self.root, **options)

    def reports(self, folder: Path, off_px: dict[str, float], **options: Any) -> Path:
        """Write the reports of methods that answer so much to the right; return their folder."""
        for name, off in off_px.items():
            table = self.table(self.true_px + np.array([off, 0]))
            scores = self.score(folder, table, name=name, **options)
            write_report(scores, folder / "reports" / name, data=self.root)
        return folder / "reports"


def project(kind: str, pose: np.ndarray, material: np.ndarray) -> np.ndarray:
    """Project material (N, 2) under a pose (centre u, centre v, angle): (N, 2), pixels."""
    length, breadth = SIZES[kind]
    across = (material[:, 1] - 0.5) * breadth
    if kind == "rope":
        across = np.sin(material[:, 1]) * breadth / 2
    local = np.stack([(material[:, 0] - 0.5) * length, across], axis=1)
    c, s = np.cos(pose[2]), np.sin(pose[2])
    return pose[:2] + local @ np.array([[c, s], [-s, c]])


def surface_of(kind: str, pose: np.ndarray) -> Surface:
    """Return the exact surface image of a pose."""
    length, breadth = SIZES[kind]
    u, v = np.meshgrid(np.arange(WIDTH) + 0.5, np.arange(HEIGHT) + 0.5)
    c, s = np.cos(pose[2]), np.sin(pose[2])
    along = (u - pose[0]) * c + (v - pose[1]) * s
    across = -(u - pose[0]) * s + (v - pose[1]) * c
    on = (np.abs(along) <= length / 2) & (np.abs(across) <= breadth / 2)
    m0 = along / length + 0.5
    m1 = across / breadth + 0.5
    if kind == "rope":
        m1 = np.arcsin(np.clip(across / (breadth / 2), -1, 1))
    zero = np.float32(0)
    return Surface(
        depth_m=np.where(on, np.float32(1), np.float32(np.inf)),
        m0=np.where(on, m0, zero).astype(np.float32),
        m1=np.where(on, m1, zero).astype(np.float32),
        object_id=on.astype(np.uint32),
    )


def material_points(kind: str) -> np.ndarray:
    """Return the named points, symmetric as a set: (P, 2)."""
    if kind == "rope":
        s, theta = np.meshgrid(np.linspace(0.02, 0.98, 40), [-2.2, -1.1, 0.0, 1.1, 2.2])
        return np.stack([s.ravel(), theta.ravel()], axis=1).astype(np.float32)
    x, y = np.meshgrid(np.linspace(0.05, 0.95, 15), np.linspace(0.05, 0.95, 11))
    return np.stack([x.ravel(), y.ravel()], axis=1).astype(np.float32)


def make_scene(
    root: Path,
    *,
    tiers: tuple[str, ...] = ("cloth", "rope"),
    sequences: int = 3,
    frames: int = 2,
    temporal: bool = False,
    queries: int = 20,
    seed: int = 0,
    images: bool = True,
    split: str = "test",
    sources: int = 1,
    hidden: float = 0.0,
) -> Scene:
    """Write a dataset: in every sequence the first `sources` frames are asked against later ones.

    About a quarter of the symmetric partners is called occluded, and a share `hidden` of the
    points.
    """
    rng = np.random.default_rng(seed)
    described: list[dict[str, Any]] = [{"cloth": CLOTH, "rope": ROPE}[name] for name in tiers]
    root.mkdir(parents=True, exist_ok=True)
    rows: list[dict[str, Any]] = []
    asked: list[dict[str, Any]] = []
    true: list[dict[str, Any]] = []
    frame_pairs = [(a, b) for a in range(sources) for b in range(a + 1, frames)]
    for each in described:
        kind = each["name"]
        points = material_points(kind)
        for index in range(sequences):
            name = f"{kind}-{split}-{index:06d}"
            poses = np.stack([rng.uniform(*limits, frames) for limits in _POSES], axis=1)
            facts: dict[str, Any] = {"temporal": temporal, "style": "raster", "self_occluded": 0.1}
            facts |= {"shape": "open"} if kind == "rope" else {"coverage": 0.5 + 0.1 * index}
            rows.append(listing_row(name, kind, split, frames, **facts))
            if images:
                _write_images(root / layout.sequence_name(kind, name), kind, poses, points, each)
            for a, b in frame_pairs:
                pair = {"pair_id": len(asked) // queries, "tier": kind}
                seen_in = {"sequence_a": name, "frame_a": a, "sequence_b": name, "frame_b": b}
                drawn = _draw_queries(rng, each, points, poses[[a, b]], queries, hidden)
                for query, (pixel, answer) in enumerate(drawn):
                    asked.append({**pair, "query_id": query, **seen_in, **pixel})
                    true.append({**pair, "query_id": query, **answer})
    write_dataset(root, "analytic", rows, described, (WIDTH, HEIGHT), splits=[split])
    queries_table, truth_table = write_queries(root, "analytic", split, asked, true)
    return Scene(root, split, queries_table, truth_table)


def _draw_queries(
    rng: np.random.Generator,
    described: dict[str, Any],
    points: np.ndarray,
    poses: np.ndarray,
    count: int,
    hidden: float,
) -> Iterator[tuple[dict[str, Any], dict[str, Any]]]:
    """Draw queries of a pair of frames: the pixel of each, and its answer."""
    kind = described["name"]
    chosen = rng.choice(len(points), count, replace=False)
    material = points[chosen].astype(float)
    at_a, at_b = (project(kind, pose, material) for pose in poses)
    partners = _partners(described, material, kind, poses[1])
    seen = rng.random(partners.shape[:2]) < 0.75
    covered = rng.random(count) < hidden if hidden else np.zeros(count, bool)
    facing = np.cos(material[:, 1]) > 0 if kind == "rope" else np.ones(count, bool)
    states = np.select([covered, facing], ["occluded", "visible"], "self_occluded")
    for query in range(count):
        (u_a, v_a), (u_b, v_b) = at_a[query], at_b[query]
        others = [
            {"u": u, "v": v, "visibility": "visible" if fine else "occluded"}
            for (u, v), fine in zip(partners[query], seen[query], strict=True)
        ]
        answer = {"point": int(chosen[query]), "u_b": u_b, "v_b": v_b, "box_px": SIZES[kind][0]}
        answer |= {"visibility_b": str(states[query]), "alternatives": others}
        yield {"u_a": u_a, "v_a": v_a}, answer


def _partners(
    described: dict[str, Any], material: np.ndarray, kind: str, pose: np.ndarray
) -> np.ndarray:
    """Project the partners of points: (N, S, 2), pixels."""
    maps = [(np.array(s["matrix"]), np.array(s["offset"])) for s in described["symmetries"]]
    found = [project(kind, pose, material @ matrix.T + offset) for matrix, offset in maps]
    return np.stack(found, axis=1) if found else np.empty((len(material), 0, 2))


def _write_images(
    folder: Path, kind: str, poses: np.ndarray, points: np.ndarray, described: dict[str, Any]
) -> None:
    (folder / "rgb").mkdir(parents=True)
    (folder / "depth").mkdir()
    partners = [
        [int(np.argmin(np.abs(points - (np.array(s["matrix"]) @ m + s["offset"])).sum(axis=1)))
         for s in described["symmetries"]]
        for m in points
    ]  # fmt: skip
    table = points_table(points, np.array(partners, np.int64).reshape(len(points), -1))
    write_table(folder / layout.POINTS_TABLE, table, "points")
    for frame, pose in enumerate(poses):
        surface = surface_of(kind, pose)
        write_surface(folder / layout.depth_name(frame), surface)
        on = surface.object_id > 0
        hue = np.stack([surface.m0, (surface.m1 + 1.6) / 3.2, 0.5 + 0 * surface.m0], axis=-1)
        rgb = np.where(on[..., None], 40 + 200 * np.clip(hue, 0, 1), 30)
        write_rgb(folder / layout.rgb_name(frame), rgb.astype(np.uint8))


@pytest.fixture(scope="session")
def scene(tmp_path_factory: pytest.TempPathFactory) -> Scene:
    """A cloth and a rope tier, three sequences each, with images; to be read only."""
    return make_scene(tmp_path_factory.mktemp("analytic"))


@pytest.fixture(scope="session")
def scene_maker() -> Callable[..., Scene]:
    """The function that makes other scenes."""
    return make_scene
