"""Two small scene objects on curves worked out here: a looped tube with a ball, a folded sheet."""

from __future__ import annotations

import numpy as np
import pytest

from pliant.generator.objects.cloth.sampling import cloth_parts
from pliant.generator.objects.rope.body import RopeBody
from pliant.generator.objects.rope.curve import arc_length, resample
from pliant.generator.objects.rope.static import ball_centre_of
from pliant.generator.scene.scene_object import Pose, SceneObject
from pliant.generator.settings import ClothSettings, RopeSettings
from tests.generator.runner.standin import digests, make

RADIUS_M = 0.012
SIDE_M = 0.5


@pytest.fixture(scope="session")
def tube() -> SceneObject:
    """A tube that crosses over itself once, and a ball at its start."""
    t = np.linspace(-1.35, 1.35, 4000)  # the curve (t^3 - t, t^2) crosses itself at t = -1 and 1
    height = RADIUS_M + 0.05 * np.exp(-(((t - 1) / 0.25) ** 2))
    line = np.stack([0.25 * (t**3 - t), 0.25 * (t**2 - 0.9), height], axis=1)
    length_m = float(arc_length(line)[-1])
    settings = RopeSettings(
        length_m=length_m, radius_m=RADIUS_M, structure="tube", strands=1, ball_strand_radii=2.0
    )
    body = RopeBody(settings)
    line = resample(line, settings.rows)
    ball = ball_centre_of(line, settings)

    def pose(frame: int) -> Pose:
        shift = np.array([0.004 * frame, 0.002 * frame, 0.0])
        return body.pose(line + shift, np.array([0.0, 0.0, 1.0]), ball + shift, {})

    return SceneObject(
        tier="rope",
        kind="rope",
        shape="loop",
        temporal=True,
        frames=8,
        parts=body.parts,
        points=body.points,
        pose=pose,
        size_m=length_m,
        thickness_m=2 * RADIUS_M,
    )


@pytest.fixture(scope="session")
def sheet() -> SceneObject:
    """A wavy sheet whose corner is folded over."""
    settings = ClothSettings(side_m=SIDE_M, points_a_side=61, doublings=0, tracked_a_side=21)
    parts, points = cloth_parts(settings)
    x, y = (parts[0].rest[:, :2].T - 0.5) * SIDE_M
    z = 0.006 * np.sin(24 * x + 9 * y) + 0.004 * np.sin(31 * y - 5 * x) + 0.012
    beyond = np.maximum((x + y) / np.sqrt(2) - 0.14, 0.0)
    bent = np.minimum(beyond / 0.016, np.pi)
    back = 0.016 * np.sin(bent) - np.maximum(beyond - 0.016 * np.pi, 0.0) - beyond
    x, y = x + back / np.sqrt(2), y + back / np.sqrt(2)
    z = z * np.cos(bent) ** 2 + 0.016 * (1 - np.cos(bent)) + 0.004 * (bent >= np.pi)
    vertices = np.stack([x, y, z], axis=1)
    return SceneObject(
        tier="cloth-2",
        kind="cloth",
        shape=None,
        temporal=False,
        frames=4,
        parts=parts,
        points=points,
        pose=lambda frame: Pose({"cloth": vertices + np.array([0.003 * frame, 0, 0])}),
        size_m=SIDE_M,
        thickness_m=0.002,
    )


@pytest.fixture(params=["tube", "sheet"])
def either(request: pytest.FixtureRequest) -> SceneObject:
    """The tube, then the sheet."""
    scene_object: SceneObject = request.getfixturevalue(request.param)
    return scene_object


@pytest.fixture(scope="session")
def uninterrupted(tmp_path_factory: pytest.TempPathFactory) -> dict[str, str]:
    """Digests of the small stand-in set made at once by one worker."""
    out = tmp_path_factory.mktemp("uninterrupted") / "set"
    make(out)
    return digests(out)
