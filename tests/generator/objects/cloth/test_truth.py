"""The truth of a real heap of cloth, thin folds and all, against rays cast by embree."""

from __future__ import annotations

import numpy as np
import pytest

from pliant.generator.objects.cloth import ClothSettings, sample_cloth
from pliant.generator.scene.camera import Camera, sample_camera
from pliant.generator.scene.scene_object import SceneObject
from pliant.generator.seeding import RandomStreams, SequenceTask
from pliant.generator.settings import CameraSettings
from pliant.generator.truth.frame_truth import FrameTruth, frame_truth

Seen = tuple[SceneObject, Camera, FrameTruth]


@pytest.fixture(scope="module", params=[1.0, 0.0], ids=["top", "oblique"])
def seen(request: pytest.FixtureRequest) -> Seen:
    scene_object = sample_cloth(
        ClothSettings(points_a_side=33), RandomStreams(0, SequenceTask("cloth-3", "train", 0))
    )
    settings = CameraSettings(top=request.param, oblique=1.0 - request.param)
    camera = sample_camera(np.random.default_rng(1), scene_object, settings, (640, 480))
    return scene_object, camera, frame_truth(scene_object, scene_object.pose(0), camera)


def first_hits(seen: Seen, uv_px: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Cast a ray through each image position: world positions hit (NaN: none), triangles."""
    trimesh = pytest.importorskip("trimesh")
    embree = pytest.importorskip("trimesh.ray.ray_pyembree")
    scene_object, camera, truth = seen
    mesh = trimesh.Trimesh(truth.world_vertices, scene_object.parts[0].faces, process=False)
    through = np.column_stack([uv_px, np.ones(len(uv_px))]) @ np.linalg.inv(camera.K).T
    rays = through @ camera.world_to_camera[:3, :3]
    eye = -camera.world_to_camera[:3, :3].T @ camera.world_to_camera[:3, 3]
    triangle = embree.RayMeshIntersector(mesh).intersects_first(
        np.broadcast_to(eye, rays.shape), rays
    )
    # embree says which triangle, in float32; where on it is worked out here in float64.
    corner = mesh.vertices[mesh.faces[triangle, 0]]
    normal = np.cross(
        mesh.vertices[mesh.faces[triangle, 1]] - corner,
        mesh.vertices[mesh.faces[triangle, 2]] - corner,
    )
    reach = ((corner - eye) * normal).sum(axis=1) / (rays * normal).sum(axis=1)
    places = eye + reach[:, None] * rays
    places[triangle < 0] = np.nan
    return places, triangle


def planar_depth(camera: Camera, places: np.ndarray) -> np.ndarray:
    return places @ camera.world_to_camera[2, :3] + camera.world_to_camera[2, 3]


def test_depth_is_what_a_ray_meets(seen: Seen) -> None:
    _, camera, truth = seen
    row, column = np.mgrid[: camera.height, : camera.width]
    centres = np.stack([column.ravel() + 0.5, row.ravel() + 0.5], axis=1)
    depth = planar_depth(camera, first_hits(seen, centres)[0])
    ours = truth.surface.depth_m.ravel().astype(np.float64)
    both = np.isfinite(depth) & np.isfinite(ours)
    assert both.mean() > 0.05
    agree = (np.isfinite(depth) == np.isfinite(ours)) & ~(np.abs(depth - ours) > 1e-5)
    assert agree.mean() >= 0.9999


def test_points_reproject_and_their_states_are_what_rays_say(seen: Seen) -> None:
    scene_object, camera, truth = seen
    own = truth.world_vertices[scene_object.points.vertex]
    local = own @ camera.world_to_camera[:3, :3].T + camera.world_to_camera[:3, 3]
    uvw = local @ camera.K.T
    assert np.abs(uvw[:, :2] / uvw[:, 2:] - truth.uv_px).max() < 1e-9
    np.testing.assert_allclose(truth.depth_m, local[:, 2], atol=1e-12)

    # The first hit on a point's ray is one of its own triangles, or it is hidden. Points within
    # 0.5 px of a silhouette are left out: there the answer hangs on float32 rays.
    turn = np.arange(8) * np.pi / 4
    around = truth.uv_px[:, None] + 0.5 * np.stack([np.cos(turn), np.sin(turn)], axis=1)
    ring = planar_depth(camera, first_hits(seen, around.reshape(-1, 2))[0]).reshape(-1, 8)
    inner = np.isfinite(ring).all(axis=1) & (np.ptp(np.nan_to_num(ring), axis=1) < 3e-3)
    places, _ = first_hits(seen, truth.uv_px)
    hidden = planar_depth(camera, places) < local[:, 2] - 2e-5
    ours = np.array(truth.visibility) == "self_occluded"
    assert inner.mean() > 0.4
    assert 0.3 < ours.mean() < 0.8  # a heap hides much of itself
    assert (ours == hidden)[inner].mean() >= 0.999


def test_material_of_a_pixel_is_the_material_there(seen: Seen) -> None:
    scene_object, _, truth = seen
    rows, columns = np.nonzero(truth.surface.object_id == 1)
    pick = np.random.default_rng(0).permutation(len(rows))[:4000]
    rows, columns = rows[pick], columns[pick]
    places, triangle = first_hits(seen, np.stack([columns + 0.5, rows + 0.5], axis=1))
    part = scene_object.parts[0]
    hit = triangle >= 0
    corners = truth.world_vertices[part.faces[triangle[hit]]]
    weights = np.stack(
        [
            np.linalg.lstsq(np.vstack([corner.T, np.ones(3)]), np.append(place, 1.0), rcond=None)[0]
            for corner, place in zip(corners, places[hit], strict=True)
        ]
    )
    expected = np.einsum("nk,nkc->nc", weights, part.rest[part.faces[triangle[hit]]][..., :2])
    found = np.stack([truth.surface.m0, truth.surface.m1], axis=-1)[rows[hit], columns[hit]]
    close = np.abs(found - expected).max(axis=1) < 1e-5
    assert hit.mean() > 0.999
    assert close.mean() > 0.999
