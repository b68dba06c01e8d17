"""Impossible settings are refused before anything is made, by the name of their field."""

from __future__ import annotations

import json

import pytest

from pliant.generator.config import GenerateConfig, QuerySettings
from pliant.generator.objects.tiers import describe_tier
from pliant.generator.settings import ClothSettings, RopeSettings
from pliant.spec.configuration import read_settings, settings_from
from pliant.spec.errors import CallError
from pliant.spec.io.yamlfiles import yaml_text
from pliant.spec.model import MaterialCoordinate, Symmetry
from tests.generator.world import scene

LONG_KNOT = 'rope.knot_diameters={"overhand":[22,32],"figure-eight":[31,60]}'

REFUSED = {
    "tiers=[ropes]": "tiers.0",
    "sequences=3 splits.test=3": "sequences",
    "splits.dev=3": "splits.dev",
    "splits={}": "splits",
    f"seed={2**63}": "seed",
    # What no reader would accept
    "width=8192 height=8192": "height",
    "frames=100001": "frames",
    "frames=22198": "frames",
    "episodes=true frames=3001": "frames",
    "tiers=[rope,cloth-1] splits.train=500001": "splits",
    "tiers=[cloth-1] cloth.doublings=3 cloth.points_a_side=257 "
    "cloth.tracked_a_side=2049": "cloth.tracked_a_side",
    "seed=7 secret_seed=true": "seed",
    "camera.top=0 camera.oblique=0": "camera.top",
    'look.tables={"wood":0}': "look.tables",
    "style=raster depth_camera={}": "style",
    "style=real-depth depth_camera.holes=3": "depth_camera.holes",
    # What needs an episode, and what an episode cannot have.
    "episodes=true": "frames",
    "gripper=true": "gripper",
    "queries.kind=track": "queries.kind",
    "queries.kind=tracks": "queries.kind",
    "queries.moving_share=0.5": "queries.moving_share",
    "queries.skips=[1]": "queries.skips",
    "episodes=true frames=15 queries.skips=[1,15]": "queries.skips",
    "episodes=true frames=24 queries.skips=[1] queries.kind=track": "queries.skips",
    "episodes=true frames=3 scene.distractors=[2,3]": "scene.distractors",
    "episodes=true frames=3 cloth.sides=alternate": "cloth.sides",
    # Ropes
    "rope.length_m=0.5": "rope.radius_m",
    "rope.radius_m=0.05": "rope.radius_m",
    "rope.strands=2": "rope.strands",
    "rope.structure=tube": "rope.strands",
    "rope.ring=7": "rope.ring",
    "rope.turns=100": "rope.rows",
    "rope.rows=100 rope.turns=5": "rope.rows",
    "rope.ball_strand_radii=1": "rope.ball_strand_radii",
    "rope.ball_strand_radii=30": "rope.ball_strand_radii",
    "rope.length_m=3 rope.rows=360 rope.ball_strand_radii=19": "rope.ball_strand_radii",
    'rope.knot_diameters={"overhand":[22,60]}': "rope.knot_diameters.overhand",
    'rope.knot_diameters={"overhand":[5,30]}': "rope.knot_diameters.overhand",
    'rope.knot_diameters={"overhand":[22,30]}': "rope.knot_diameters.figure-eight",
    LONG_KNOT: "rope.knot_diameters.figure-eight",
    "rope.loop_radius_m=[0.01,0.05]": "rope.loop_radius_m",
    "rope.point_stations=400": "rope.point_stations",
    "rope.point_angles=40": "rope.point_angles",
    "rope.particles=20": "rope.particles",
    "rope.substeps=2": "rope.substeps",
    "rope.frame_rate_hz=30": "rope.substeps",
    "rope.length_m=0.6 rope.radius_m=0.006 rope.loop_radius_m=[0.025,0.04] "
    "rope.hand_speed_m_s=[0.1,0.3]": "rope.substeps",
    "rope.hand_speed_m_s=[0.2,0.7]": "rope.hand_speed_m_s",
    "rope.workspace=[0.2,0.2]": "rope.workspace",
    # Ranges with an impossible end
    "rope.radius_m=[0.008,0.015]": "rope.knot_diameters.figure-eight",
    "rope.radius_m=[0.012,0.008]": "rope.radius_m",
    "rope.radius_m=[0.008]": "rope.radius_m",
    "rope.turns=[12,60]": "rope.rows",
    "rope.turns=[12.5,20]": "rope.turns.0",
    "rope.strands=[2,6]": "rope.strands",
    'rope.structure={"laid":1,"tube":1}': "rope.structure",
    # Texts that the dataset's files would be refused for, after everything was rendered
    "id=a/b": "id",
    "id=a..b": "id",
    "id=-a": "id",
    'version="1.0"': "version",
    r'title="a\u202eb"': "title",
    r'licence="MIT\a"': "licence",
    # Cloths
    "cloth.tracked_a_side=34": "cloth.tracked_a_side",  # 160 cells do not divide by 33
    "cloth.tracked_a_side=200": "cloth.tracked_a_side",  # more points than the mesh has
    "cloth.thickness_m=0.2": "cloth.thickness_m",
    "cloth.thickness_m=0.02 cloth.proportion=0.5": "cloth.thickness_m",  # of 0.3 m
    "cloth.proportion=0.3": "cloth.proportion",
    "cloth.proportion=0.7 cloth.tracked_a_side=3": "cloth.proportion",  # tracked every 0.3 m
    "cloth.coverage_band=[0.4,0.4]": "cloth.coverage_band",
    "cloth.contact_spacings=0.5": "cloth.contact_spacings",
    "cloth.hand_speed_m_s=3.5": "cloth.hand_speed_m_s",
}
"""Changes of the defaults -> the field that is named."""


SENTENCES = {
    "queries.kind=track": "only an episode can be tracked",
    "queries.kind=tracks": "Did you mean 'track'",
    "style=raster depth_camera={}": 'found "raster"; required: real-depth',
    "style=real-depth depth_camera.holes=3": "unknown setting",
    LONG_KNOT: "longer than the rope",
    "frames=22198": "at most 22,197, as there are 901 points",
    "cloth.proportion=0.7 cloth.tracked_a_side=3": "a multiple of 0.5, or a number within 10% of",
}


def config(changes: str) -> GenerateConfig:
    return settings_from(GenerateConfig, {"tiers": ["rope"]}, overrides=tuple(changes.split()))


@pytest.mark.parametrize("changes", REFUSED)
def test_impossible_settings_are_refused_by_name(changes: str) -> None:
    with pytest.raises(CallError) as refused:
        config(changes)
    assert refused.value.where == REFUSED[changes]
    assert refused.value.exit_code == 2
    assert SENTENCES.get(changes, "") in str(refused.value)


def test_a_knot_longer_than_the_rope_is_allowed_where_it_is_never_drawn() -> None:
    config(LONG_KNOT + ' rope.knots={"overhand":1}')


def test_round_trip_through_yaml_and_json(tmp_path) -> None:
    config = GenerateConfig(
        tiers=("cloth-1", "rope"),
        splits={"test": 2, "train": 5},
        frames=7,
        episodes=True,
        seed=0,
        rope=settings_from(RopeSettings, {"length_m": [1.15, 1.6], "strands": [3, 6]}),
        queries=QuerySettings(queries_per_pair=9, splits=("test",)),
    )
    (tmp_path / "c.yaml").write_text(yaml_text(config.to_dict()))
    (tmp_path / "c.json").write_text(json.dumps(config.to_dict()))
    assert read_settings(GenerateConfig, tmp_path / "c.yaml") == config
    assert read_settings(GenerateConfig, tmp_path / "c.json") == config
    assert config.tiers == ("rope", "cloth-1")
    assert list(config.counts) == ["train", "test"]


def test_the_depth_camera_is_stored_with_its_style_alone() -> None:
    assert "depth_camera" not in config("style=raster").resolved()
    plain = config("style=real-depth")
    assert plain.to_dict()["depth_camera"] is None
    filled = plain.resolved()
    assert filled["depth_camera"]["table_grey"] == [142.0, 154.0]
    assert settings_from(GenerateConfig, filled).resolved() == filled


def test_defaults_keep_the_papers_proportions() -> None:
    settings = RopeSettings()
    assert settings.control_points == 12
    assert settings.strands == 4
    assert settings.ball_radius_m == pytest.approx(7.5 * settings.strand_radius_m)
    # Four equal circles side by side within a circle: R = r (1 + sqrt 2).
    assert settings.radius_m == pytest.approx(settings.strand_radius_m * (1 + 2**0.5))
    assert sum(settings.shapes.values()) == pytest.approx(1)
    assert settings.shapes["loop"] + settings.shapes["knot"] == pytest.approx(0.45)


def test_a_rope_has_the_reversal_only_without_the_ball() -> None:
    plain = describe_tier(config("rope.ball=false"), "rope")
    assert [each.name for each in plain.objects] == ["rope"]
    assert plain.symmetries == (Symmetry("reversal", ((-1, 0), (0, -1)), (1, 0)),)
    with_ball = describe_tier(
        config("rope.length_m=[1.15,1.6] rope.radius_m=[0.008,0.0135]"), "rope"
    )
    assert [each.id for each in with_ball.objects] == [1, 2]
    assert with_ball.symmetries == ()
    s, theta = with_ball.queried.material
    # Of a range the tier has the middle.
    assert (s.metres_per_unit, theta.metres_per_unit) == pytest.approx((1.375, 0.01075))
    assert s.period is None
    assert theta.period == pytest.approx(theta.max - theta.min)


def test_a_cloth_tier_describes_its_material() -> None:
    tier = describe_tier(config("cloth.side_m=0.8"), "cloth-1")
    assert (tier.name, tier.kind) == ("cloth-1", "cloth")
    u, v = tier.objects[0].material
    assert u == MaterialCoordinate("u", min=0.0, max=1.0, metres_per_unit=0.8, period=None)
    assert v.name == "v"
    assert tier.queried_object == tier.objects[0].id == 1
    scene_object = scene("cloth-1", cloth=ClothSettings(side_m=0.8))
    assert scene_object.size_m == 0.8
    assert json.loads(json.dumps(scene_object.info)) == scene_object.info


def test_the_tier_names_the_level_unless_the_settings_do() -> None:
    assert scene("cloth-2").info["level"] == 2
    assert scene("towel", cloth=ClothSettings(level=3)).info["level"] == 3
    assert scene("cloth-3").info["coverage_band"] == [0.25, 0.42]


def test_the_step_of_a_cloth_is_stable_for_every_size() -> None:
    for points, side_m, ks in ((17, 0.6, 3000.0), (81, 0.6, 3000.0), (129, 2.0, 200.0)):
        settings = ClothSettings(points_a_side=points, side_m=side_m, ks=ks, tracked_a_side=17)
        sheet = settings.sheet()
        assert sheet.ks / sheet.steps_per_second**2 / sheet.mass_kg <= 0.2 + 1e-12
        assert sheet.steps_per_second == 30 * sheet.steps_per_frame
