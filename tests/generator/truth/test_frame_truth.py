from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from pliant.generator.scene.appearance import Light
from pliant.generator.scene.camera import looking_at, sample_camera
from pliant.generator.scene.scene_object import Part, Points, Pose, SceneMesh, SceneObject
from pliant.generator.settings import CameraSettings, ClothSettings
from pliant.generator.truth.frame_truth import FrameTruth, frame_truth
from pliant.spec.camera import Camera
from tests.generator.world import scene as sampled


def embree(
    world: np.ndarray, faces: np.ndarray, camera: Camera, uv: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return planar depth, triangle and place of the first hit at image positions, by embree."""
    trimesh = pytest.importorskip("trimesh")
    from trimesh.ray.ray_pyembree import RayMeshIntersector

    mesh = trimesh.Trimesh(world, faces, process=False)
    rays = np.concatenate(
        [(uv - camera.K[:2, 2]) / [camera.K[0, 0], camera.K[1, 1]], np.ones((len(uv), 1))], axis=1
    )
    directions = rays @ camera.world_to_camera[:3, :3]
    centre = np.broadcast_to(camera.centre_m, directions.shape)
    triangle = RayMeshIntersector(mesh).intersects_first(centre, directions)
    # embree says which triangle, in float32; where on it is worked out here in float64.
    a, b, c = np.moveaxis(world[faces[triangle]], 1, 0)
    normal = np.cross(b - a, c - a)
    reach = ((a - camera.centre_m) * normal).sum(1) / (directions * normal).sum(1)
    # The rays have z = 1, so the reach is the planar depth.
    depth = np.where(triangle >= 0, reach, np.inf)
    return depth, triangle, camera.centre_m + reach[:, None] * directions


@pytest.fixture(scope="module", params=["tube", "sheet", "heap"])
def scene(request: pytest.FixtureRequest) -> tuple[SceneObject, Camera, FrameTruth]:
    if request.param == "heap":
        cloth = ClothSettings(points_a_side=33)
        scene_object = sampled("cloth-3", frames=3, cloth=cloth)
    else:
        scene_object = request.getfixturevalue(request.param)
    settings = CameraSettings(top=0.0)
    camera = sample_camera(np.random.default_rng(5), scene_object, settings, (640, 480))
    return scene_object, camera, frame_truth(scene_object, scene_object.pose(2), camera)


Scene = tuple[SceneObject, Camera, FrameTruth]


def test_depth_equals_an_independent_ray_cast(scene: Scene) -> None:
    scene_object, camera, truth = scene
    faces = SceneMesh.of(scene_object).faces
    v, u = np.mgrid[: camera.height, : camera.width]
    uv = np.stack([u.ravel() + 0.5, v.ravel() + 0.5], axis=1)
    depth = embree(truth.world_vertices, faces, camera, uv)[0]
    ours = truth.surface.depth_m.ravel().astype(np.float64)
    same = (np.isinf(depth) & np.isinf(ours)) | (
        np.abs(np.where(np.isinf(depth), 0, depth) - np.where(np.isinf(ours), 0, ours)) <= 1e-5
    )
    assert same.mean() >= 0.9999
    assert np.isfinite(ours).mean() > 0.01


def test_visibility_equals_an_independent_ray_cast(scene: Scene) -> None:
    scene_object, camera, truth = scene
    faces = SceneMesh.of(scene_object).faces
    surface = np.flatnonzero(~scene_object.points.centreline)
    uv = truth.uv_px[surface]
    depth = embree(truth.world_vertices, faces, camera, uv)[0]
    hidden = depth < truth.depth_m[surface] - 2e-5
    turn = np.arange(8) * np.pi / 4
    around = uv[:, None] + 0.5 * np.stack([np.cos(turn), np.sin(turn)], axis=1)
    ring = embree(truth.world_vertices, faces, camera, around.reshape(-1, 2))[0].reshape(-1, 8)
    ring = np.where(np.isinf(ring), 9.0, ring)
    smooth = (ring.max(axis=1) - ring.min(axis=1) < 4e-3) & np.isfinite(depth)
    assert smooth.mean() > 0.4
    ours = np.array(truth.visibility)[surface] != "visible"
    assert (ours == hidden)[smooth].mean() >= 0.999
    assert 0.05 < ours.mean() < 0.95


def test_material_of_a_pixel_is_the_material_that_a_ray_meets(scene: Scene) -> None:
    scene_object, camera, truth = scene
    part, mesh = scene_object.parts[0], SceneMesh.of(scene_object)
    rows, columns = np.nonzero(truth.surface.object_id == part.object_id)
    pick = np.random.default_rng(0).permutation(len(rows))[:3000]
    rows, columns = rows[pick], columns[pick]
    uv = np.stack([columns + 0.5, rows + 0.5], axis=1)
    _, triangle, places = embree(truth.world_vertices, mesh.faces, camera, uv)
    hit = (triangle >= 0) & (triangle < len(part.faces))
    corners = truth.world_vertices[mesh.faces[triangle[hit]]]
    sides = corners[:, 1:] - corners[:, :1]
    normal = np.cross(sides[:, 0], sides[:, 1])
    basis = np.concatenate([sides, normal[:, None]], axis=1).transpose(0, 2, 1)
    share = np.linalg.solve(basis, (places[hit] - corners[:, 0])[..., None])[:, :2, 0]
    weights = np.column_stack([1.0 - share.sum(axis=1), share])
    rest = np.einsum("nk,nkc->nc", weights, part.rest[part.faces[triangle[hit]]])
    found = np.stack([truth.surface.m0, truth.surface.m1], axis=-1)[rows[hit], columns[hit]]
    off = (found - part.chart(rest) + np.pi) % (2 * np.pi) - np.pi  # theta has a period
    assert hit.mean() > 0.999
    assert (np.abs(off).max(axis=1) < 1e-4).mean() > 0.999


def _plates(height: float, one_object: bool) -> tuple[SceneObject, Camera]:
    """A large plate at z = 0 and a small one `height` over its first corner."""
    corners = np.array([[0.0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0], [0, -1, 0]])
    over = corners * 0.1 + [-0.05, -0.02, height]
    faces = np.array([[0, 1, 2], [0, 2, 3], [0, 4, 1]], np.int32)

    def part(object_id: int, name: str, triangles: np.ndarray) -> Part:
        count = int(triangles.max()) + 1
        zeros = np.zeros(count, np.int32)
        return Part(object_id, name, triangles, np.zeros((count, 3)), _flat, zeros, True)

    if one_object:  # the small plate's triangles come first
        parts: tuple[Part, ...] = (part(1, "low", np.concatenate([faces + np.int32(5), faces])),)
        pose = Pose({"low": np.concatenate([corners, over])})
    else:
        parts = (part(1, "low", faces), part(2, "high", faces))
        pose = Pose({"low": corners, "high": over})
    points = Points(
        np.array([1, 1, 1 if one_object else 2], np.int32),
        np.array([0, 2, 5 if one_object else 0], np.int32),
        np.zeros(3, bool),
        np.zeros((3, 2), np.float32),
        np.zeros((3, 0), np.int32),
    )
    scene_object = SceneObject(
        "t", "cloth", None, False, 1, parts, points, lambda _: pose, size_m=1.0, thickness_m=0.01
    )
    return scene_object, looking_at((0, 0, 2), (0, 0, 0), (64, 64), fov_deg=40.0)


def _flat(rest: np.ndarray) -> np.ndarray:
    return rest[:, :2]


@pytest.mark.parametrize(
    ("height", "one_object", "state"),
    [
        (0.01, True, "self_occluded"),
        (0.01, False, "occluded"),
        (-0.01, False, "visible"),
        (-0.01, True, "visible"),
        (0.0, False, "visible"),  # two surfaces at one place: neither hides the other
        (1e-5, False, "occluded"),
    ],
)
def test_states_worked_out_by_hand(height: float, one_object: bool, state: str) -> None:
    scene_object, camera = _plates(height, one_object)
    truth = frame_truth(scene_object, scene_object.pose(0), camera)
    # Point 0 is under the small plate (if that lies higher); point 1 leaves a 40 degree view;
    # point 2 is a corner of the small plate that juts out.
    assert truth.visibility == [state, "out_of_frame", "visible"]
    np.testing.assert_allclose(truth.uv_px[0], [32, 32], atol=1e-9)
    np.testing.assert_allclose(truth.xyz_m[2], [-0.05, -0.02, height], atol=1e-12)
    assert truth.surface.object_id[20, 40] == 1


def test_behind_the_camera_is_out_of_frame(sheet: SceneObject) -> None:
    camera = looking_at((0, 0, 0.5), (0, 0, 1.0), (32, 32))
    truth = frame_truth(sheet, sheet.pose(0), camera)
    assert set(truth.visibility) == {"out_of_frame"}
    assert np.isfinite(truth.uv_px).all()
    assert (truth.surface.object_id == 0).all()
    assert np.isinf(truth.surface.depth_m).all()


def test_the_centre_line_is_seen_through_its_own_surface_only(tube: SceneObject) -> None:
    camera = looking_at((0, 0, 1.2), (0, 0, 0), (320, 240), fov_deg=50.0)
    truth = frame_truth(tube, tube.pose(0), camera)
    line = tube.points.centreline
    states, s = np.array(truth.visibility)[line], tube.points.material[line, 0]
    uv, depth = truth.uv_px[line], truth.depth_m[line]
    diameter_px = camera.K[0, 0] * tube.thickness_m / depth.min()
    for k in np.flatnonzero((s > 0.08) & (s < 0.98)):  # away from the ball and the end
        across = np.linalg.norm(uv - uv[k], axis=1)
        other = np.abs(s - s[k]) > 0.15
        if (other & (across < 0.4 * diameter_px) & (depth < depth[k] - 0.02)).any():
            assert states[k] == "self_occluded"
        elif (across[other] > 1.5 * diameter_px).all():
            assert states[k] == "visible"
    assert {"visible", "self_occluded"} <= set(states)
    # What counts is the length in metres, in diameters: ten times of both changes nothing.
    large = replace(tube, size_m=10 * tube.size_m, thickness_m=10 * tube.thickness_m)
    assert frame_truth(large, tube.pose(0), camera).visibility == truth.visibility


SIZE = (320, 240)
COARSE_CLOTH = ClothSettings(points_a_side=25, tracked_a_side=9, coverage_band=(0.1, 1.1))


@pytest.mark.blender
@pytest.mark.parametrize("tier", ["rope", "cloth-1", "cloth-2", "cloth-3"])
def test_the_truth_equals_the_passes_of_cycles(tier: str) -> None:
    """Cycles works in float32: a pixel whose centre lies on an outline may fall either way."""
    from benchmarks.cycles_passes import PassRenderer, compare_with_cycles

    scene_object = sampled(tier, cloth=COARSE_CLOTH)
    pose = scene_object.pose(0)
    renderer = PassRenderer(SIZE)
    ids, depths = 0, 0
    for seed in range(3):
        rng = np.random.default_rng(seed)
        camera = sample_camera(rng, scene_object, CameraSettings(), SIZE, [pose])
        truth = frame_truth(scene_object, pose, camera)
        found = compare_with_cycles(renderer, scene_object, truth, camera)
        assert found.object_pixels > 500
        ids += found.id_mismatch_px
        depths += found.depth_errors
    assert ids <= 1
    assert depths <= 2


@pytest.mark.blender
def test_light_without_a_sun_is_white() -> None:
    """The setting look.sun_share may be 0: the colour of no light was 0 / 0."""
    bpy = pytest.importorskip("bpy")
    from pliant.generator.rendering.blender import new_scene, place_light

    made = new_scene((16, 16), 1, gpu=False)
    for irradiance, energy, colour in (((0, 0, 0), 0, [1, 1, 1]), ((2, 4, 1), 4, [0.5, 1, 0.25])):
        place_light(made, Light((0, 0, 1), irradiance, 0.1, (1, 1, 1)))
        assert bpy.data.objects["sun"].data.energy == energy
        assert list(bpy.data.objects["sun"].data.color) == colour
