"""The mesh of tracked points, by hand, and the blocks that the 3D tab reads."""

from __future__ import annotations

import base64
from pathlib import Path

import numpy as np
import pytest

from pliant.spec.dataset import Dataset
from pliant.spec.model import MaterialCoordinate, MaterialObject
from pliant.spec.point_mesh import PosedMesh, triangulate
from pliant.viewer.explorer.app import Explorer
from pliant.viewer.explorer.frames import FrameCache
from pliant.viewer.explorer.scene import depth_bytes, pose_bytes, scene_document
from tests.known import known

TUBE = MaterialObject(
    1,
    "rope",
    (
        MaterialCoordinate("s", 0.0, 1.0, 1.0),
        MaterialCoordinate("theta", -np.pi, np.pi, 0.01, period=2 * np.pi),
    ),
)
SHEET = MaterialObject(
    1, "cloth", (MaterialCoordinate("u", 0.0, 1.0, 0.3), MaterialCoordinate("v", 0.0, 1.0, 0.3))
)


def ring_points(rings: int, around: int) -> np.ndarray:
    s, theta = np.meshgrid(np.linspace(0, 1, rings), np.arange(around) * 2 * np.pi / around - 3.0)
    return np.stack([s.T.ravel(), theta.T.ravel()], axis=1)


def test_a_tube_closes() -> None:
    """Rings of 8: each strip between two rings has 16 triangles, and only the ends are open."""
    material = ring_points(60, 8)
    faces = triangulate(TUBE, material)
    assert len(faces) == 59 * 16
    edges = np.sort(np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]]), axis=1)
    _, counts = np.unique(edges, axis=0, return_counts=True)
    assert (counts == 1).sum() == 16  # two rims of 8 edges
    assert (counts == 2).sum() == len(counts) - 16


def test_a_sheet_is_covered_once() -> None:
    grid = np.stack(np.meshgrid(np.linspace(0, 1, 5), np.linspace(0, 1, 7)), -1).reshape(-1, 2)
    faces = triangulate(SHEET, grid)
    a, b, c = (grid[faces[:, k]] for k in range(3))
    area = 0.5 * np.abs(np.cross(b - a, c - a))
    assert len(faces) == 2 * 4 * 6
    assert area.sum() == pytest.approx(1.0)
    assert len(triangulate(SHEET, grid[:2])) == 0


def test_weights_give_the_coordinate_back() -> None:
    """Across the seam of theta too."""
    material = ring_points(60, 8)
    mesh = PosedMesh(TUBE, np.arange(len(material)), material)
    for m in ([0.503, 0.4], [0.21, np.pi - 0.01], [0.21, -np.pi + 0.01], [0.999, -1.0]):
        chosen, weights = mesh.barycentric(np.array(m))
        assert len(chosen) == 3
        assert weights.min() >= -1e-6
        off = weights @ TUBE.steps_m(material[chosen] - np.array(m))
        np.testing.assert_allclose(off, 0, atol=1e-9)


def test_blocks_have_what_the_page_expects(tiny_episode: Path) -> None:
    dataset = Dataset.open(tiny_episode)
    frames, sequence = FrameCache(dataset), dataset.sequences[0]
    document = scene_document(frames, sequence)
    count = document["points"]
    faces = np.frombuffer(base64.b64decode(document["faces"]), "<i4").reshape(-1, 3)
    assert document["frames"] == len(document["cameras"]) == 24
    assert len(faces) > count
    assert 0 <= faces.min() < faces.max() < count
    assert len(base64.b64decode(document["colours"])) == 3 * count
    table = sequence.correspondences(7)
    rows = frames.mesh(sequence[0]).rows
    block = pose_bytes(frames, sequence[7])
    assert len(block) == 13 * count
    xyz = np.frombuffer(block, "<f4", 3 * count).reshape(-1, 3)
    np.testing.assert_allclose(xyz[:, 2], table["z_m"].to_numpy()[rows], atol=1e-6)


def test_depth_is_on_the_visible_points(explorer: Explorer) -> None:
    """Where the camera sees a tracked point, it has measured the surface close by."""
    frame = explorer.dataset.frames("test", "cloth-1")[0]
    block = known(depth_bytes(explorer.frames, frame))
    count = len(block) // 15
    measured = np.frombuffer(block, "<f4", 3 * count).reshape(-1, 3)
    points = explorer.frames.points(frame)
    seen = points.xyz_m[points.state == 0]
    gap = np.linalg.norm(seen[:, None] - measured[None], axis=2).min(axis=1)
    assert len(seen) > 50
    assert np.median(gap) < 0.005
