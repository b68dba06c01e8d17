"""The valid datasets of the conformance suite."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from pliant.spec.arrays import FloatArray
from pliant.spec.conventions import SPEC_VERSION
from pliant.spec.dataset import Dataset
from pliant.spec.io.exr import Surface
from pliant.spec.io.jsonfiles import write_json
from pliant.spec.io.reading import file_entry
from pliant.spec.storage import layout
from tests import dataset_files
from tests.conformance.analytic import Ball, Scene, Sheet, Tube, View
from tests.dataset_files import FrameFiles, coordinate, tier

WIDTH, HEIGHT = 64, 48
FOCAL_PX = 85.0
SEED = 7

LENGTH, RADIUS = 0.5, 0.06
SIDE, GAP = 0.5, 0.08
BALL = Ball((-0.02, 0.0, 0.12), 0.1)


_TUBE_MATERIAL = [
    coordinate("s", 0.0, 1.0, LENGTH),
    coordinate("theta", -np.pi, np.pi, RADIUS, 2 * np.pi),
]
_BALL_MATERIAL = [
    coordinate("longitude", -np.pi, np.pi, BALL.radius, 2 * np.pi),
    coordinate("height", -1.0, 1.0, BALL.radius),
]
_SHEET_MATERIAL = [coordinate("u", 0.0, 1.0, SIDE), coordinate("v", 0.0, 1.0, SIDE)]

DIHEDRAL = [
    ("rotate-90", [[0, -1], [1, 0]], [1, 0]),
    ("rotate-180", [[-1, 0], [0, -1]], [1, 1]),
    ("rotate-270", [[0, 1], [-1, 0]], [0, 1]),
    ("mirror-u", [[-1, 0], [0, 1]], [1, 0]),
    ("mirror-v", [[1, 0], [0, -1]], [0, 1]),
    ("transpose", [[0, 1], [1, 0]], [0, 0]),
    ("anti-transpose", [[0, -1], [-1, 0]], [1, 1]),
]


_ROPE = {"rope": _TUBE_MATERIAL}
TIERS = {
    "rope": tier("rope", "rope", {**_ROPE, "ball": _BALL_MATERIAL}),
    "rope-bare": tier("rope-bare", "rope", _ROPE, [("reversal", [[-1, 0], [0, -1]], [1, 0])]),
    "cloth-1": tier("cloth-1", "cloth", {"cloth": _SHEET_MATERIAL}, DIHEDRAL),
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
    root: Path,
    described: dict[str, Any],
    split: str,
    index: int,
    points: NamedPoints,
    shots: list[Shot],
) -> dict[str, Any]:
    """Write one sequence of a tier; return its row of sequences.parquet."""
    name = f"{described['name']}-{split}-{index:06d}"
    folder = root / layout.sequence_name(described["name"], name)
    frames = [_frame_files(shot, points) for shot in shots]
    table = dataset_files.points_table(
        points.material, points.partners, points.object_id, points.centreline
    )
    dataset_files.write_frames(folder, table, frames)
    cameras = [
        {
            "frame": frame,
            "K": shot.view.K.tolist(),
            "world_to_camera": shot.view.world_to_camera.tolist(),
        }
        for frame, shot in enumerate(shots)
    ]
    write_json(
        folder / layout.CAMERAS_JSON,
        {"spec_version": SPEC_VERSION, "width": WIDTH, "height": HEIGHT, "frames": cameras},
        "cameras",
    )
    outer = ~points.centreline
    shares = [np.mean(np.array(each.states)[outer] == "self_occluded") for each in frames]
    row = dataset_files.listing_row(
        name,
        described["name"],
        split,
        len(shots),
        shape="open" if described["kind"] == "rope" else None,
        seed=SEED,
        style="raster",
        self_occluded=float(np.mean(shares)),
    )
    info = {
        **{key: row[key] for key in row if key not in ("coverage", "self_occluded")},
        "spec_version": SPEC_VERSION,
        "index": index,
        "noise": None,
        "parameters": {"object": "worked out by hand"},
        "frame_info": [{} for _ in shots],
        "tools": {"numpy": "1.26"},
    }
    relist(folder, info)
    return row


def relist(folder: Path, info: dict[str, Any]) -> None:
    """Write sequence.json with the sizes and checksums of the files that are there."""
    info["files"] = [
        file_entry(folder, path.relative_to(folder).as_posix())
        for path in sorted(folder.rglob("*"))
        if path.is_file() and path.name != layout.SEQUENCE_JSON
    ]
    write_json(folder / layout.SEQUENCE_JSON, info)


def _frame_files(shot: Shot, points: NamedPoints) -> FrameFiles:
    xyz = np.empty((len(points.material), 3))
    for shape in shot.scene.shapes:
        mine = points.object_id == shape.object_id
        xyz[mine] = shape.position(points.material[mine, 0], points.material[mine, 1])
        if isinstance(shape, Tube):
            line = points.centreline
            xyz[line] = shape.axis(points.material[line, 0])
    uv, depth = shot.view.project(xyz)
    s_of_line = np.where(points.centreline, points.material[:, 0], np.nan)
    states = shot.scene.states(shot.view, xyz, points.object_id, s_of_line)
    depth_m, material, object_id = shot.scene.image(shot.view)
    m = material.astype(np.float32)
    surface = Surface(
        depth_m.astype(np.float32),
        np.ascontiguousarray(m[..., 0]),
        np.ascontiguousarray(m[..., 1]),
        object_id.astype(np.uint32),
    )
    return FrameFiles(surface, _colours(surface), uv, depth, states, xyz)


def _colours(surface: Surface) -> npt.NDArray[np.uint8]:
    """Colour the material by a chequer and the table grey."""
    squares = (np.floor(surface.m0 * 8) + np.floor(surface.m1 * 4)) % 2
    rgb = np.full((*squares.shape, 3), 110, np.uint8)
    seen = surface.object_id > 0
    rgb[seen] = np.where(squares[seen][:, None] > 0, [210, 60, 40], [240, 200, 120])
    return rgb


def write_queries(root: Path, split: str, asked: list[tuple[str, int, str, int]]) -> None:
    """Write queries and truth of a split.

    Args:
        root: The dataset.
        split: The split.
        asked: (sequence A, frame A, sequence B, frame B) of each pair; five queries each.
    """
    dataset = Dataset.open(root)
    queries: list[dict[str, Any]] = []
    truth: list[dict[str, Any]] = []
    for pair_id, (name_a, frame_a, name_b, frame_b) in enumerate(asked):
        points = dataset[name_a].points().to_pylist()
        rows_a = dataset[name_a].correspondences(frame_a).to_pylist()
        rows_b = dataset[name_b].correspondences(frame_b).to_pylist()
        visible = [
            point["point"]
            for point, row in zip(points, rows_a, strict=True)
            if point["kind"] == "surface"
            and point["object"] == 1
            and row["visibility"] == "visible"
        ]
        v, u = np.nonzero(dataset[name_b].surface(frame_b).object_id == 1)
        for query_id, point in enumerate(visible[:: max(1, len(visible) // 5)][:5]):
            keys = {"pair_id": pair_id, "query_id": query_id, "tier": dataset[name_a].tier}
            source, target = rows_a[point], rows_b[point]
            frames = {
                "sequence_a": name_a, "frame_a": frame_a, "sequence_b": name_b, "frame_b": frame_b,
            }  # fmt: skip
            queries.append({**keys, **frames, "u_a": source["u_px"], "v_a": source["v_px"]})
            partners = [rows_b[partner] for partner in points[point]["partners"]]
            truth.append(
                {
                    **keys,
                    "point": point,
                    "u_b": target["u_px"],
                    "v_b": target["v_px"],
                    "visibility_b": target["visibility"],
                    "box_px": float(max(np.ptp(u), np.ptp(v)) + 1),
                    "alternatives": [
                        {"u": each["u_px"], "v": each["v_px"], "visibility": each["visibility"]}
                        for each in partners
                    ],
                }
            )
    dataset_files.write_queries(root, dataset.id, split, queries, truth)


def write_dataset(
    root: Path, name: str, rows: list[dict[str, Any]], tiers: list[dict[str, Any]]
) -> None:
    """Write sequences.parquet and dataset.json."""
    provenance = {
        "generator": "spec/conformance", "seed": SEED, "config": {}, "tools": {"numpy": "1.26"},
    }  # fmt: skip
    dataset_files.write_dataset(
        root,
        name,
        rows,
        tiers,
        (WIDTH, HEIGHT),
        title=f"Pliant conformance: {name}",
        provenance=provenance,
    )


def build_full(root: Path) -> None:
    """Write `full`: every tier, two splits, all states, symmetries, queries with truth."""
    ball, bare, cloth = rope_points(ball=True), rope_points(ball=False), cloth_points()
    rope, bare_rope, sheet = TIERS.values()
    rows = [
        write_sequence(
            root,
            rope,
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
        write_sequence(root, bare_rope, "test", index, bare, [rope_shot(eye, ball=False)])
        for index, eye in enumerate([(0.2, -0.3, 0.7), (0.3, 0.35, 0.6)])
    ]
    folded = [cloth_shot((0.3, 0.1, 0.9), flat=True), cloth_shot((0.1, 0.1, 0.8), flat=False)]
    rows.append(write_sequence(root, sheet, "test", 0, cloth, folded))
    write_dataset(root, "conformance-full", rows, [rope, bare_rope, sheet])
    asked = [
        ("rope-test-000000", 0, "rope-test-000000", 1),
        ("rope-bare-test-000000", 0, "rope-bare-test-000001", 0),
        ("cloth-1-test-000000", 0, "cloth-1-test-000000", 1),
    ]
    write_queries(root, "test", asked)


def build_minimal(root: Path) -> None:
    """Write `minimal`: one cloth in one frame, nothing optional."""
    cloth = TIERS["cloth-1"]
    shots = [cloth_shot((0.25, 0.2, 0.8), flat=False)]
    row = write_sequence(root, cloth, "train", 0, cloth_points(), shots)
    write_dataset(root, "conformance-minimal", [row], [cloth])


BASES = {"full": build_full, "minimal": build_minimal}
"""Base dataset -> what writes it into an empty folder."""
