"""`pliant.scene`: what it shows is what was built, and what it writes is valid."""

from __future__ import annotations

import json
import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest

pytest.importorskip("numba")

import pliant
from pliant import scene
from pliant.generator.runner.manifest import RunFolder
from pliant.publishing import PublishSettings, publish
from pliant.spec.errors import CallError, GenerationError
from tests.known import known

LINE = [(-0.4, 0.0), (0.0, 0.0), (0.4, 0.0)]
SIZE = (160, 120)
TURN = np.linspace(-np.pi / 2, np.pi / 2, 9)
HAIRPIN = [
    *((x, -0.0125) for x in (-0.4, -0.3, -0.2, -0.1, -0.05)),
    *zip(0.0125 * np.cos(TURN), 0.0125 * np.sin(TURN), strict=True),
    *((x, 0.0125) for x in (-0.05, -0.1, -0.2, -0.3, -0.4)),
]


def test_a_straight_rope_is_where_it_was_put() -> None:
    rope = scene.Rope(LINE, radius_m=0.01)
    view = scene.camera((0.0, 0.0, 1.0), size=SIZE, fov_deg=60)
    shot = scene.Film(rope, view).shoot()
    # A pinhole straight above, by hand: u = 80 + f x / z, v = 60 - f y / z.
    focal = 80 / np.tan(np.radians(30))
    x, y, z = shot.xyz_m.T
    expected = np.stack([80 + focal * x / (1 - z), 60 - focal * y / (1 - z)], axis=1)
    np.testing.assert_allclose(shot.uv_px, expected, atol=1e-9)
    material = rope.points.material[~rope.points.centreline]
    np.testing.assert_allclose(x[: len(material)], 0.8 * material[:, 0] - 0.4, atol=1e-6)
    radius = np.hypot(y, z - 0.01)[: len(material)]
    assert 0.004 < radius.min() < radius.max() <= 0.01 + 1e-6
    assert shot.visible.any()
    assert (shot.xyz_m[shot.visible, 2] > 0.005).all()  # only its upper side is seen
    middle = shot.depth_m[60, 80]
    assert 0.98 - 1e-6 <= middle < 0.985
    assert shot.surface.m0[60, 80] == pytest.approx(0.5, abs=0.01)


def line_of(rope: scene.Rope) -> Any:
    line = known(rope.pose().centreline)
    return line


def test_a_hand_takes_the_end_with_it() -> None:
    rope = scene.Rope(LINE, ball=True)
    frames: list[float] = []
    rope.pull(1.0, to=(0.3, 0.2, 0.1), each=lambda: frames.append(line_of(rope)[-1][2]))
    assert len(frames) == np.ceil(np.linalg.norm([0.1, 0.2, 0.09]) / 0.3 * 30)
    end = line_of(rope)[-1]
    np.testing.assert_allclose(end, (0.3, 0.2, 0.1), atol=0.02)
    rope.settle(40)
    line = line_of(rope)
    assert line[-1][2] < 0.02
    assert np.linalg.norm(np.diff(line, axis=0), axis=1).sum() == pytest.approx(0.8, rel=0.03)


@pytest.mark.parametrize(
    ("curve", "message"),
    [
        ([(0, 0), (1, 0, 0)], "list of points"),
        ([(0, 0)], "list of points"),
        ([(0, 0), (0, 0), (1, 0)], "no two in a row"),
        ([(0, 0, -0.2), (0.4, 0, 0.01), (0.8, 0, 0.01)], "under the table"),
        (HAIRPIN, "bends more tightly"),
        ([(-0.3, -0.2), (0.3, 0.2), (0.3, -0.2), (-0.3, 0.2)], "passes through itself"),
        ([(0.0, 0.0), (0.05, 0.0)], "length_m"),
    ],
)
def test_impossible_ropes(curve: list[tuple[float, ...]], message: str) -> None:
    with pytest.raises(CallError, match=message):
        scene.Rope(curve)


def test_a_cloth_is_folded(tmp_path: Path) -> None:
    settings = {"points_a_side": 25, "tracked_a_side": 13}
    cloth = scene.Cloth(side_m=0.5, settings=settings)
    film = scene.Film(cloth, size=SIZE, split="test", episode=False)
    flat = film.shoot()
    assert flat.visible.all()
    assert flat.pose.info["coverage"] == pytest.approx(1, abs=0.01)
    cloth.pull((0.0, 0.0), carry=(0.25, 0.25))
    cloth.settle()
    folded = film.shoot()
    corner = int(np.argmin(np.abs(cloth.points.material).sum(axis=1)))
    np.testing.assert_allclose(folded.xyz_m[corner, :2], (0.0, 0.0), atol=0.06)
    assert 0.75 < folded.pose.info["coverage"] < 0.95
    assert (~folded.visible).mean() > 0.05
    dataset = pliant.load(film.write(tmp_path / "out"))
    report = pliant.validate(tmp_path / "out")
    assert report.valid, report.issues
    read = dataset.frame("cloth-1-test-000000", 1)
    assert (read.rgb == folded.rgb).all()
    assert (known(read.surface).depth_m == folded.depth_m).all()
    assert len(dataset.pairs("test")) > 0
    with pytest.raises(CallError, match="is there already"):
        film.write(tmp_path / "out")


def test_a_cloth_of_any_shape() -> None:
    cloth = scene.Cloth(side_m=0.5, settings={"points_a_side": 25, "tracked_a_side": 13})
    bend = 0.15
    cloth.drape(
        lambda u, v: (0.5 * u, bend * np.sin(0.5 * v / bend), 0.2 + bend * np.cos(0.5 * v / bend))
    )
    _, y, z = cloth.pose().vertices["cloth"].T
    np.testing.assert_allclose(np.hypot(y, z - 0.2), bend, atol=2e-3)

    def loop(u: Any, v: Any) -> Any:  # its cross-section crosses itself
        t = 2 * np.pi * (v - 0.5)
        return 0.5 * u, 0.06 * t - 0.1 * np.sin(t), 0.3 - 0.1 * np.cos(t)

    cloth.drape(loop)
    with pytest.raises(GenerationError, match="intersects itself"):
        cloth.pose()


def test_films_that_do_not_go_together(tmp_path: Path) -> None:
    ropes = [scene.Rope(LINE), scene.Rope([(-0.3, 0.0), (0.3, 0.0)])]
    films = [scene.Film(rope, scene.camera((0, 0, 1), size=SIZE)) for rope in ropes]
    with pytest.raises(CallError, match="no picture was taken"):
        scene.write(films, tmp_path / "out")
    for film in films:
        film.shoot()
    with pytest.raises(CallError, match="have one settings"):
        scene.write(films, tmp_path / "out")
    with pytest.raises(CallError, match="no such setting changes them; found noise"):
        films[0].write(tmp_path / "out", noise={})
    with pytest.raises(CallError, match="one size"):
        films[0].shoot(scene.camera((0, 0, 1), size=(80, 60)))
    assert not (tmp_path / "out").exists()


def test_moving_the_camera_changes_the_picture_and_not_the_points() -> None:
    film = scene.Film(scene.Rope(LINE), scene.camera((0, 0, 1), size=SIZE))
    above, beside = film.shoot(), film.shoot(scene.camera((0.2, -0.7, 0.6), size=SIZE))
    assert (above.xyz_m == beside.xyz_m).all()
    assert (above.rgb != beside.rgb).any()
    again = film.shoot(above.camera)
    assert (again.rgb == above.rgb).all()


@pytest.fixture(scope="module")
def bodies() -> tuple[scene.Rope, scene.Cloth]:
    return scene.Rope(LINE), scene.Cloth(settings={"points_a_side": 33})


@pytest.mark.parametrize(
    ("call", "says"),
    [
        (lambda rope, _: rope.pull(1.01, to=(0, 0, 0.1)), "s: .*found 1.01; required: 0 to 1"),
        (
            lambda rope, _: rope.pull(1.0, to=(0, 0)),
            r"to: .*found \(0, 0\); required: \(x, y, z\), metres",
        ),
        (lambda rope, _: rope.pull(1.0, to=(0, 0, 0.1), speed_m_s=0), "speed_m_s: .*found 0"),
        (lambda _, cloth: cloth.pull((0, -1), carry=(0.1, 0)), r"uv: .*found \(0, -1\)"),
        (lambda _, cloth: cloth.pull((0, 0), carry=(np.nan, 0)), "carry: .*found .*nan"),
        (lambda _, cloth: cloth.pull((0, 0), carry=(0.1, 0), lift_m=-0.1), "lift_m: .*found -0.1"),
        (
            lambda _, cloth: cloth.drape(lambda u, v: (u, v)),
            r"shape: .*found \(an array \(1089,\), an array \(1089,\)\); required: \(x, y, z\)",
        ),
        (lambda _, cloth: cloth.drape(lambda u, v: (u, v, np.nan)), r"found \(.*, nan\); required"),
        (
            lambda _, cloth: cloth.drape(lambda u, v: np.stack([u, v, v], axis=1)),
            r"shape: .*found an array \(1089, 3\); required: \(x, y, z\)",
        ),
        (lambda _, cloth: cloth.drape(lambda u, v: 3), "shape: .*found 3; required"),
        (
            lambda _, cloth: cloth.drape(lambda u, v: (u, v, np.full_like(v, np.nan))),
            "values that are not finite",
        ),
        (lambda _, cloth: cloth.settle(-1.0), "seconds: .*found -1.0"),
        (lambda rope, _: rope.settle(-1), "frames: .*found -1; required: >= 0"),
        (lambda rope, _: rope.settle(2.5), "frames: .*found 2.5"),
        (lambda *_: scene.Rope(LINE, radius_m="1 cm"), "radius_m: .*found '1 cm'"),  # type: ignore[arg-type]
        (
            lambda *_: scene.Rope(LINE, settings={"length_m": 0.9}),
            r"settings.length_m: .*found 0.9",
        ),
        (lambda *_: scene.Cloth(seed=-1), "seed: .*found -1"),
        (lambda rope, _: scene.Film(rope, seed=-1), "seed: .*found -1"),
        (lambda rope, _: scene.Film(rope, size=64), "size: .*found 64; .*width, height"),  # type: ignore[arg-type]
        (lambda *_: scene.camera((0, 0, 0)), "target: the camera is where it looks"),
        (lambda *_: scene.camera("abc"), "eye: .*found 'abc'"),  # type: ignore[arg-type]
        (lambda *_: scene.camera((0, 0, 1), size=(64, 0)), "size: .*found 0; required: >= 1"),
        (lambda *_: scene.camera((0, 0, 1), size=64), "size: .*found 64; .*width, height"),  # type: ignore[arg-type]
        (lambda *_: scene.camera((0, 0, 1), fov_deg=180), "fov_deg: .*found 180"),
        (
            lambda rope, _: scene.Film(rope, split="dev"),
            "split: .*found dev; required: train, val, test",
        ),
    ],
)
def test_an_impossible_argument_is_named(
    call: Any, says: str, bodies: tuple[scene.Rope, scene.Cloth]
) -> None:
    with pytest.raises(CallError, match=says):
        call(*bodies)


def test_one_picture_is_a_dataset_without_an_episode_or_random_scenes(tmp_path: Path) -> None:
    film = scene.Film(scene.Rope(LINE), scene.camera((0, 0, 1), size=SIZE))
    film.shoot()
    out = film.write(tmp_path / "one")
    dataset = pliant.load(out)
    assert not dataset[0].temporal
    assert pliant.validate(out).total == 0
    config = dataset.info["provenance"]["config"]
    assert config.keys() == {"made_with", "rope", "queries", "style"}
    with pytest.raises(CallError, match="something else"):  # nothing is mixed into the film
        RunFolder(out).check()


def test_answers_of_a_film_can_be_held_out(tmp_path: Path) -> None:
    rope = scene.Rope(LINE)
    film = scene.Film(rope, scene.camera((0, 0, 1), size=SIZE), split="test", episode=False)
    film.shoot()
    rope.pull(1.0, to=(0.3, 0.2, 0.1))
    film.shoot()
    out = film.write(tmp_path / "own", secret_seed=True)
    assert pliant.validate(out).total == 0
    published = publish(out, tmp_path / "public", PublishSettings(hold_out=("test",)))
    assert not any("are public" in text for text in published.warnings)
    card = (published.public / "README.md").read_text()
    assert not re.search("correspondences`|Coverage", card)  # no split has public answers
    croissant = json.loads((published.public / "croissant.json").read_text())
    assert not re.search("distributions|One object", croissant["rai:dataLimitations"])
