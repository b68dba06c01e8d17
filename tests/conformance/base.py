"""The valid datasets of the conformance suite."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
import pyarrow as pa

from pliant.spec.arrays import FloatArray
from pliant.spec.conventions import CONVENTIONS, SPEC_VERSION
from pliant.spec.io.exr import Surface, write_surface
from pliant.spec.io.jsonfiles import write_json
from pliant.spec.io.parquet import read_table, write_table
from pliant.spec.io.png import write_rgb
from pliant.spec.io.reading import sha256_file
from pliant.spec.storage import layout
from pliant.spec.tables import CORRESPONDENCES, POINTS, QUERIES, SEQUENCES, TRUTH
from tests.conformance.analytic import Ball, Scene, Sheet, Tube, View

WIDTH, HEIGHT = 64, 48
FOCAL_PX = 85.0
SEED = 7

LENGTH, RADIUS = 0.5, 0.06
SIDE, GAP = 0.5, 0.08
BALL = Ball((-0.02, 0.0, 0.12), 0.1)


def _coordinate(
    name: str, low: float, high: float, metres: float, period: float | None = None
) -> dict[str, Any]:
    return {
        "name": name,
        "min": low,
        "max": high,
        "metres_per_unit": metres,
        "period": period,
    }


_TUBE_MATERIAL = [
    _coordinate("s", 0.0, 1.0, LENGTH),
    _coordinate("theta", -np.pi, np.pi, RADIUS, 2 * np.pi),
]
_BALL_MATERIAL = [
    _coordinate("longitude", -np.pi, np.pi, BALL.radius, 2 * np.pi),
    _coordinate("height", -1.0, 1.0, BALL.radius),
]
_SHEET_MATERIAL = [_coordinate("u", 0.0, 1.0, SIDE), _coordinate("v", 0.0, 1.0, SIDE)]

DIHEDRAL = [
    ("rotate-90", [[0, -1], [1, 0]], [1, 0]),
    ("rotate-180", [[-1, 0], [0, -1]], [1, 1]),
    ("rotate-270", [[0, 1], [-1, 0]], [0, 1]),
    ("mirror-u", [[-1, 0], [0, 1]], [1, 0]),
    ("mirror-v", [[1, 0], [0, -1]], [0, 1]),
    ("transpose", [[0, 1], [1, 0]], [0, 0]),
    ("anti-transpose", [[0, -1], [-1, 0]], [1, 1]),
]


def _tier(
    name: str, kind: str, objects: list[dict[str, Any]], symmetries: list[Any]
) -> dict[str, Any]:
    return {
        "name": name,
        "kind": kind,
        "variant": "plain",
        "queried_object": 1,
        "objects": objects,
        "symmetries": [
            {"name": label, "matrix": matrix, "offset": offset}
            for label, matrix, offset in symmetries
        ],
    }


TIERS = {
    "rope": _tier(
        "rope",
        "rope",
        [
            {"id": 1, "name": "rope", "material": _TUBE_MATERIAL},
            {"id": 2, "name": "ball", "material": _BALL_MATERIAL},
        ],
        [],
    ),
    "rope-bare": _tier(
        "rope-bare",
        "rope",
        [{"id": 1, "name": "rope", "material": _TUBE_MATERIAL}],
        [("reversal", [[-1, 0], [0, -1]], [1, 0])],
    ),
    "cloth-1": _tier(
        "cloth-1",
        "cloth",
        [{"id": 1, "name": "cloth", "material": _SHEET_MATERIAL}],
        DIHEDRAL,
    ),
}


@dataclass(frozen=True)
class NamedPoints:
    """The points of a tier: where they are on the material, and partners.

    Attributes:
        object_id: int64 (P,).
        centreline: bool (P,).
        material: float64 (P, 2).
        partners: int64 (P, S).
    """

    object_id: npt.NDArray[np.int64]
    centreline: npt.NDArray[np.bool_]
    material: FloatArray
    partners: npt.NDArray[np.int64]


def rope_points(*, ball: bool) -> NamedPoints:
    """Return 9 x 8 points of the tube, its centre line, and 12 of the ball if there is one."""
    s, theta = np.meshgrid(np.linspace(0.05, 0.95, 9), np.arange(8) * np.pi / 4 - 7 * np.pi / 8)
    surface = np.stack([s.ravel(), theta.ravel()], axis=1)
    line = np.stack([np.linspace(0.05, 0.95, 9), np.zeros(9)], axis=1)
    parts, ids = [surface, line], [1] * (len(surface) + len(line))
    if ball:
        longitude, height = np.meshgrid(np.linspace(-3, 3, 4), [-0.6, 0.1, 0.7])
        parts.append(np.stack([longitude.ravel(), height.ravel()], axis=1))
        ids += [2] * 12
    material = np.concatenate(parts)
    centreline = np.zeros(len(material), np.bool_)
    centreline[len(surface) : len(surface) + len(line)] = True
    partners = np.zeros((len(material), 0 if ball else 1), np.int64)
    if not ball:
        # (s, theta) -> (1 - s, -theta): row j of 8, column i of 9 goes to row 7 - j, column 8 - i.
        row, column = np.divmod(np.arange(72), 9)
        partners[:72, 0] = (7 - row) * 9 + 8 - column
        partners[72:, 0] = 72 + 8 - np.arange(9)
    return NamedPoints(np.array(ids), centreline, material, partners)


def cloth_points() -> NamedPoints:
    """Return a 9 x 9 grid of the cloth, with the partners of the square's symmetries."""
    grid = np.linspace(0, 1, 9)
    u, v = np.meshgrid(grid, grid)
    material = np.stack([u.ravel(), v.ravel()], axis=1)
    partners = np.empty((81, len(DIHEDRAL)), np.int64)
    for number, (_, matrix, offset) in enumerate(DIHEDRAL):
        mapped = np.rint((material @ np.array(matrix).T + offset) * 8).astype(np.int64)
        partners[:, number] = mapped[:, 1] * 9 + mapped[:, 0]
    return NamedPoints(np.ones(81, np.int64), np.zeros(81, np.bool_), material, partners)


@dataclass(frozen=True)
class Shot:
    """One frame: a scene and a camera."""

    scene: Scene
    view: View


def rope_shot(eye: tuple[float, float, float], *, ball: bool, height: float = RADIUS) -> Shot:
    """Return a frame of the tube, which lies at some height over the table."""
    tube = Tube(LENGTH, RADIUS, height)
    scene = Scene((tube, BALL) if ball else (tube,), 2 * RADIUS, LENGTH)
    target = np.array([0.22, 0.0, 0.05])
    return Shot(scene, View.looking(np.array(eye), target, FOCAL_PX, WIDTH, HEIGHT))


def cloth_shot(eye: tuple[float, float, float], *, flat: bool) -> Shot:
    """Return a frame of the cloth, flat or folded."""
    sheet = Sheet(SIDE, GAP, flat)
    target = np.array([SIDE / 2 if flat else SIDE / 4, SIDE / 2, 0.02])
    return Shot(Scene((sheet,)), View.looking(np.array(eye), target, FOCAL_PX, WIDTH, HEIGHT))


def write_sequence(
    root: Path, tier: str, split: str, index: int, points: NamedPoints, shots: list[Shot]
) -> dict[str, Any]:
    """Write one sequence; return its row of sequences.parquet."""
    name = f"{tier}-{split}-{index:06d}"
    folder = layout.sequence_dir(root, tier, name)
    (folder / "rgb").mkdir(parents=True)
    (folder / "depth").mkdir()
    cameras, tables, shares = [], [], []
    for frame, shot in enumerate(shots):
        rows = _frame_rows(frame, shot, points)
        tables.append(rows)
        states = np.array(rows.column("visibility").to_pylist())
        shares.append(float(np.mean(states[~points.centreline] == "self_occluded")))
        depth, material, object_id = shot.scene.image(shot.view)
        surface = Surface(
            depth.astype(np.float32),
            material[..., 0].astype(np.float32),
            material[..., 1].astype(np.float32),
            object_id.astype(np.uint32),
        )
        write_surface(folder / layout.depth_name(frame), surface)
        write_rgb(folder / layout.rgb_name(frame), _colours(surface))
        cameras.append(
            {
                "frame": frame,
                "K": shot.view.K.tolist(),
                "world_to_camera": shot.view.world_to_camera.tolist(),
            }
        )
    write_table(folder / layout.POINTS_TABLE, _point_table(points), "points")
    write_table(folder / layout.CORRESPONDENCES_TABLE, pa.concat_tables(tables), "correspondences")
    write_json(
        folder / layout.CAMERAS_JSON,
        {"spec_version": SPEC_VERSION, "width": WIDTH, "height": HEIGHT, "frames": cameras},
        "cameras",
    )
    kind = TIERS[tier]["kind"]
    info: dict[str, Any] = {
        "spec_version": SPEC_VERSION,
        "id": name,
        "tier": tier,
        "split": split,
        "shape": "open" if kind == "rope" else None,
        "index": index,
        "seed": SEED,
        "temporal": False,
        "frames": len(shots),
        "style": "raster",
        "noise": None,
        "parameters": {"object": "worked out by hand"},
        "frame_info": [{} for _ in shots],
        "tools": {"numpy": "1.26"},
        "files": [],
    }
    write_json(folder / layout.SEQUENCE_JSON, info, "sequence")
    relist(folder, info)
    row = {field: info[field] for field in SEQUENCES.names if field in info}
    return {**row, "coverage": None, "self_occluded": float(np.mean(shares))}


def relist(folder: Path, info: dict[str, Any]) -> None:
    """Write sequence.json with the sizes and checksums of the files that are there."""
    info["files"] = [
        {
            "path": path.relative_to(folder).as_posix(),
            "sha256": sha256_file(path),
            "bytes": path.stat().st_size,
        }
        for path in sorted(folder.rglob("*"))
        if path.is_file() and path.name != layout.SEQUENCE_JSON
    ]
    write_json(folder / layout.SEQUENCE_JSON, info)


def _point_table(points: NamedPoints) -> pa.Table:
    return pa.table(
        {
            "point": np.arange(len(points.material), dtype=np.int32),
            "object": points.object_id.astype(np.int32),
            "kind": ["centreline" if line else "surface" for line in points.centreline],
            "m0": points.material[:, 0].astype(np.float32),
            "m1": points.material[:, 1].astype(np.float32),
            "partners": pa.array(points.partners.tolist(), POINTS.field("partners").type),
        }
    )


def _frame_rows(frame: int, shot: Shot, points: NamedPoints) -> pa.Table:
    xyz = np.empty((len(points.material), 3))
    for shape in shot.scene.shapes:
        mine = points.object_id == shape.object_id
        xyz[mine] = shape.position(points.material[mine, 0], points.material[mine, 1])
        if isinstance(shape, Tube):
            line = points.centreline
            xyz[line] = shape.axis(points.material[line, 0])
    uv, depth = shot.view.project(xyz)
    s_of_line = np.where(points.centreline, points.material[:, 0], np.nan)
    count = len(xyz)
    columns = [
        np.full(count, frame, np.int32),
        np.arange(count, dtype=np.int32),
        uv[:, 0].astype(np.float32),
        uv[:, 1].astype(np.float32),
        depth.astype(np.float32),
        shot.scene.states(shot.view, xyz, points.object_id, s_of_line),
        *(xyz[:, axis].astype(np.float32) for axis in range(3)),
    ]
    arrays = [pa.array(c, f.type) for c, f in zip(columns, CORRESPONDENCES, strict=True)]
    return pa.Table.from_arrays(arrays, schema=CORRESPONDENCES)


def _colours(surface: Surface) -> npt.NDArray[np.uint8]:
    """Colour the material by a chequer and the table grey."""
    squares = (np.floor(surface.m0 * 8) + np.floor(surface.m1 * 4)) % 2
    rgb = np.full((*squares.shape, 3), 110, np.uint8)
    seen = surface.object_id > 0
    rgb[seen] = np.where(squares[seen][:, None] > 0, [210, 60, 40], [240, 200, 120])
    return rgb


def write_queries(
    root: Path, split: str, asked: list[tuple[str, int, str, int]], dataset: dict[str, str]
) -> None:
    """Write queries and truth of a split.

    Args:
        root: The dataset.
        split: The split.
        asked: (sequence A, frame A, sequence B, frame B) of each pair; five queries each.
        dataset: Its id and version.
    """
    queries: list[dict[str, Any]] = []
    truth: list[dict[str, Any]] = []
    for pair_id, (name_a, frame_a, name_b, frame_b) in enumerate(asked):
        tier = name_a.rsplit(f"-{split}-", 1)[0]
        points = read_table(
            layout.sequence_dir(root, tier, name_a) / layout.POINTS_TABLE, "points"
        ).to_pylist()
        rows_a = _rows_of(root, tier, name_a, frame_a)
        rows_b = _rows_of(root, tier, name_b, frame_b)
        visible = [
            point["point"]
            for point, row in zip(points, rows_a, strict=True)
            if point["kind"] == "surface"
            and point["object"] == 1
            and row["visibility"] == "visible"
        ]
        box = _box_px(root, tier, name_b, frame_b)
        for query_id, point in enumerate(visible[:: max(1, len(visible) // 5)][:5]):
            keys = {"pair_id": pair_id, "query_id": query_id, "tier": tier}
            queries.append(
                {
                    **keys,
                    "sequence_a": name_a,
                    "frame_a": frame_a,
                    "sequence_b": name_b,
                    "frame_b": frame_b,
                    "u_a": rows_a[point]["u_px"],
                    "v_a": rows_a[point]["v_px"],
                }
            )
            truth.append(
                {
                    **keys,
                    "point": point,
                    "u_b": rows_b[point]["u_px"],
                    "v_b": rows_b[point]["v_px"],
                    "visibility_b": rows_b[point]["visibility"],
                    "box_px": box,
                    "alternatives": [
                        {
                            "u": rows_b[partner]["u_px"],
                            "v": rows_b[partner]["v_px"],
                            "visibility": rows_b[partner]["visibility"],
                        }
                        for partner in points[point]["partners"]
                    ],
                }
            )
    footer = {"dataset": dataset, "split": split}
    path = layout.queries_path(root, split)
    path.parent.mkdir(exist_ok=True)
    layout.truth_path(root, split).parent.mkdir(exist_ok=True)
    write_table(path, pa.Table.from_pylist(queries, schema=QUERIES), "queries", footer)
    write_table(
        layout.truth_path(root, split),
        pa.Table.from_pylist(truth, schema=TRUTH),
        "truth",
        {**footer, "queries_sha256": sha256_file(path)},
    )


def _rows_of(root: Path, tier: str, name: str, frame: int) -> list[dict[str, Any]]:
    path = layout.sequence_dir(root, tier, name) / layout.CORRESPONDENCES_TABLE
    rows = read_table(path, "correspondences").to_pylist()
    return [row for row in rows if row["frame"] == frame]


def _box_px(root: Path, tier: str, name: str, frame: int) -> float:
    from pliant.spec.io.exr import read_surface

    path = layout.sequence_dir(root, tier, name) / layout.depth_name(frame)
    v, u = np.nonzero(read_surface(path).object_id == 1)
    return float(max(np.ptp(u), np.ptp(v)) + 1)


def write_dataset(root: Path, name: str, rows: list[dict[str, Any]], tiers: list[str]) -> None:
    """Write sequences.parquet and dataset.json."""
    dataset = {"id": name, "version": "1.0.0"}
    table = pa.Table.from_pylist(rows, schema=SEQUENCES)
    write_table(root / layout.SEQUENCES_TABLE, table, "sequences", {"dataset": dataset})
    write_json(
        root / layout.DATASET_JSON,
        {
            "spec_version": SPEC_VERSION,
            **dataset,
            "title": f"Pliant conformance: {name}",
            "description": "Scenes in closed form, for testing readers and validators.",
            "licence": "CC0-1.0",
            "conventions": CONVENTIONS,
            "image_size": {"width": WIDTH, "height": HEIGHT},
            "tiers": [TIERS[tier] for tier in tiers],
            "splits": sorted({row["split"] for row in rows}, reverse=True),
            "provenance": {
                "generator": "spec/conformance",
                "seed": SEED,
                "config": {},
                "tools": {"numpy": "1.26"},
            },
        },
        "dataset",
    )


def build_full(root: Path) -> None:
    """Write `full`: every tier, two splits, all states, symmetries, queries with truth."""
    ball, bare, cloth = rope_points(ball=True), rope_points(ball=False), cloth_points()
    rows = [
        write_sequence(
            root,
            "rope",
            split,
            0,
            ball,
            [
                rope_shot((-0.25 + x, -0.1, 0.75), ball=True),
                rope_shot((0.75 + x, 0.1, 0.55), ball=True, height=RADIUS + 0.03),
            ],
        )
        for split, x in (("train", 0.0), ("test", 0.07))
    ]
    rows += [
        write_sequence(root, "rope-bare", "test", index, bare, [rope_shot(eye, ball=False)])
        for index, eye in enumerate([(0.2, -0.3, 0.7), (0.3, 0.35, 0.6)])
    ]
    rows += [
        write_sequence(
            root,
            "cloth-1",
            "test",
            0,
            cloth,
            [
                cloth_shot((0.3, 0.1, 0.9), flat=True),
                cloth_shot((0.1, 0.1, 0.8), flat=False),
            ],
        )
    ]
    write_dataset(root, "conformance-full", rows, ["rope", "rope-bare", "cloth-1"])
    asked = [
        ("rope-test-000000", 0, "rope-test-000000", 1),
        ("rope-bare-test-000000", 0, "rope-bare-test-000001", 0),
        ("cloth-1-test-000000", 0, "cloth-1-test-000000", 1),
    ]
    write_queries(root, "test", asked, {"id": "conformance-full", "version": "1.0.0"})


def build_minimal(root: Path) -> None:
    """Write `minimal`: one cloth in one frame, nothing optional."""
    row = write_sequence(
        root, "cloth-1", "train", 0, cloth_points(), [cloth_shot((0.25, 0.2, 0.8), flat=False)]
    )
    write_dataset(root, "conformance-minimal", [row], ["cloth-1"])


BASES = {"full": build_full, "minimal": build_minimal}
"""Base dataset -> what writes it into an empty folder."""
