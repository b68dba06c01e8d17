"""The straight rope: closed strands, exact reversal, charts, the ball, the points."""

from __future__ import annotations

import math
from collections import Counter

import numpy as np
import pytest

from pliant.generator.objects.rope.body import rope_points
from pliant.generator.objects.rope.mesh import (
    RopeMesh,
    ball_chart,
    ball_mesh,
    bend,
    rope_chart,
    rope_mesh,
)
from pliant.generator.settings import RopeSettings

KINDS = {
    "laid-4": RopeSettings(ball=False),
    "laid-3": RopeSettings(ball=False, strands=3, turns=21),
    "tube": RopeSettings(ball=False, structure="tube", strands=1),
}


@pytest.fixture(params=KINDS, scope="module")
def kind(request: pytest.FixtureRequest) -> tuple[RopeSettings, RopeMesh]:
    settings = KINDS[request.param]
    return settings, rope_mesh(settings)


def signed_volume(vertices: np.ndarray, faces: np.ndarray) -> float:
    a, b, c = vertices[faces].transpose(1, 0, 2)
    return float((np.cross(a, b) * c).sum() / 6)


def check_closed(faces: np.ndarray) -> None:
    """Every edge belongs to two triangles that run along it in opposite directions."""
    starts, ends = faces.ravel().tolist(), np.roll(faces, -1, axis=1).ravel().tolist()
    edges = Counter(zip(starts, ends, strict=True))
    assert set(edges.values()) == {1}
    assert all((b, a) in edges for a, b in edges)


def test_strands_are_closed_and_wound_outward(kind: tuple[RopeSettings, RopeMesh]) -> None:
    settings, mesh = kind
    check_closed(mesh.faces)
    full = math.pi * settings.radius_m**2 * settings.length_m
    for strand in np.unique(mesh.strand):
        assert signed_volume(mesh.rest, mesh.faces[mesh.strand[mesh.faces[:, 0]] == strand]) > 0
    # Strands leave gaps and overlap a little, but fill most of the rope and never leave it.
    assert 0.4 * full < signed_volume(mesh.rest, mesh.faces) < 1.05 * full
    reach = np.hypot(mesh.rest[:, 1], mesh.rest[:, 2])
    assert reach.max() == pytest.approx(settings.radius_m, rel=0.03)
    assert reach.max() <= settings.radius_m * (1 + 1e-12)


def test_reversal_maps_the_mesh_onto_itself(kind: tuple[RopeSettings, RopeMesh]) -> None:
    settings, mesh = kind
    np.testing.assert_array_equal(mesh.mirror[mesh.mirror], np.arange(len(mesh.rest)))
    there = mesh.rest[mesh.mirror]
    np.testing.assert_array_equal(there[:, 1], mesh.rest[:, 1])
    np.testing.assert_array_equal(there[:, 2], -mesh.rest[:, 2])
    np.testing.assert_allclose(there[:, 0], settings.length_m - mesh.rest[:, 0], atol=1e-15)
    # The triangles too, so that the reversed rope cannot be told from the rope.
    triangles = {tuple(sorted(face)) for face in mesh.faces.tolist()}
    assert {tuple(sorted(face)) for face in mesh.mirror[mesh.faces].tolist()} == triangles


def test_chart_undoes_the_rest_shape(kind: tuple[RopeSettings, RopeMesh]) -> None:
    settings, mesh = kind
    material = rope_chart(settings.length_m)(mesh.rest)
    reach = np.hypot(mesh.rest[:, 1], mesh.rest[:, 2])
    back = np.stack(
        [
            settings.length_m * material[:, 0],
            reach * np.cos(material[:, 1]),
            reach * np.sin(material[:, 1]),
        ],
        axis=1,
    )
    np.testing.assert_allclose(back, mesh.rest, atol=1e-15)
    assert material[:, 0].min() == 0.0
    assert material[:, 0].max() == 1.0


def test_outer_vertices_see_the_outside() -> None:
    settings, mesh = KINDS["laid-4"], rope_mesh(KINDS["laid-4"])
    reach = np.hypot(mesh.rest[:, 1], mesh.rest[:, 2])
    assert mesh.outer[reach > 0.999 * settings.radius_m].all()
    assert not mesh.outer[reach < 0.4 * settings.radius_m].any()
    tube = rope_mesh(KINDS["tube"])
    assert tube.outer.all()


def test_a_straight_rope_bent_along_a_straight_line_is_the_rest_shape() -> None:
    settings = KINDS["laid-4"]
    mesh = rope_mesh(settings)
    line = np.zeros((settings.rows, 3))
    line[:, 0] = np.linspace(0, settings.length_m, settings.rows)
    frames = np.broadcast_to(np.eye(3), (settings.rows, 3, 3))
    np.testing.assert_allclose(bend(mesh, line, frames), mesh.rest, atol=1e-12)


def test_points_are_paired_by_the_reversal(kind: tuple[RopeSettings, RopeMesh]) -> None:
    settings, mesh = kind
    points = rope_points(settings, mesh)
    partner = points.partners[:, 0]
    np.testing.assert_array_equal(partner[partner], np.arange(len(partner)))
    there = points.material[partner]
    np.testing.assert_allclose(there[:, 0], 1 - points.material[:, 0], atol=1e-7)
    turn = there[:, 1] + points.material[:, 1]
    np.testing.assert_allclose(np.sin(turn / 2), 0, atol=1e-7)
    surface = ~points.centreline
    assert points.centreline.sum() == settings.centreline_points
    assert surface.sum() == settings.point_stations * settings.point_angles
    assert len(np.unique(points.vertex[surface])) == surface.sum()
    assert mesh.outer[points.vertex[surface]].all()
    np.testing.assert_array_equal(
        points.material[surface],
        rope_chart(settings.length_m)(mesh.rest[points.vertex[surface]]).astype(np.float32),
    )


def test_ball_is_a_closed_sphere_with_its_pole_on_the_axis() -> None:
    rest, faces = ball_mesh(0.04)
    np.testing.assert_allclose(np.linalg.norm(rest, axis=1), 0.04)
    check_closed(faces)
    assert signed_volume(rest, faces) == pytest.approx(4 / 3 * math.pi * 0.04**3, rel=0.02)
    np.testing.assert_allclose(
        ball_chart(np.array([[0.04, 0, 0], [0, 0.04, 0], [0, 0, -0.04], [-0.04, 0, 0]])),
        [[0.0, 0], [math.pi / 2, 0], [math.pi / 2, -math.pi / 2], [math.pi, 0]],
    )
