"""Impossible settings are refused before anything is made, by the name of their field."""

from __future__ import annotations

import pytest

from pliant.generator.objects.rope import RopeSettings, rope_tier, sample_rope
from pliant.generator.seeding import RandomStreams, SequenceTask
from pliant.spec.configuration import settings_from
from pliant.spec.errors import CallError
from pliant.spec.model import Symmetry


def test_defaults_keep_the_papers_proportions() -> None:
    settings = RopeSettings()
    assert settings.control_points == 12
    assert settings.strands == 4
    assert settings.ball_radius_m == pytest.approx(7.5 * settings.strand_radius_m)
    # Four equal circles side by side within a circle: R = r (1 + sqrt 2).
    assert settings.radius_m == pytest.approx(settings.strand_radius_m * (1 + 2**0.5))
    assert sum(settings.shapes.values()) == pytest.approx(1)
    assert settings.shapes["loop"] + settings.shapes["knot"] == pytest.approx(0.45)


@pytest.mark.parametrize(
    ("values", "field"),
    [
        ({"length_m": 0.5}, "radius_m"),
        ({"radius_m": 0.05}, "radius_m"),
        ({"strands": 2}, "strands"),
        ({"structure": "tube"}, "strands"),
        ({"ring": 7}, "ring"),
        ({"turns": 100}, "rows"),
        ({"rows": 100, "turns": 5}, "rows"),
        ({"ball_strand_radii": 1.0}, "ball_strand_radii"),
        ({"ball_strand_radii": 30.0}, "ball_strand_radii"),
        ({"knot_diameters": {"overhand": (22, 60), "figure-eight": (31, 39)}}, "overhand"),
        ({"knot_diameters": {"overhand": (5, 30), "figure-eight": (31, 39)}}, "overhand"),
        ({"knot_diameters": {"overhand": (22, 30)}}, "figure-eight"),
        ({"loop_radius_m": (0.01, 0.05)}, "loop_radius_m"),
        ({"point_stations": 400}, "point_stations"),
        ({"point_angles": 40}, "point_angles"),
        ({"particles": 20}, "particles"),
        ({"substeps": 2}, "substeps"),
        ({"frame_rate_hz": 30.0}, "substeps"),
        (
            {
                "length_m": 0.6,
                "radius_m": 0.006,
                "loop_radius_m": (0.025, 0.04),
                "hand_speed_m_s": (0.1, 0.3),
            },
            "substeps",
        ),
        ({"hand_speed_m_s": (0.2, 0.7)}, "hand_speed_m_s"),
        ({"workspace": (0.2, 0.2)}, "workspace"),
    ],
)
def test_impossible_settings_name_their_field(values: dict[str, object], field: str) -> None:
    with pytest.raises(CallError) as refused:
        settings_from(RopeSettings, values, "rope")
    assert refused.value.where is not None
    assert refused.value.where.startswith("rope.")
    assert refused.value.where.endswith(field)
    assert refused.value.exit_code == 2


def test_a_knot_longer_than_the_rope_is_allowed_where_it_is_never_drawn() -> None:
    sizes = {"overhand": (22.0, 32.0), "figure-eight": (31.0, 60.0)}
    RopeSettings(knot_diameters=sizes, knots={"overhand": 1.0})
    with pytest.raises(CallError, match="longer than the rope"):
        settings_from(RopeSettings, {"knot_diameters": sizes})


@pytest.mark.parametrize(("frames", "temporal"), [(0, False), (3001, True)])
def test_impossible_frames_are_refused(frames: int, temporal: bool) -> None:
    streams = RandomStreams(0, SequenceTask("r", "test", 0))
    with pytest.raises(CallError, match="frames"):
        sample_rope(RopeSettings(), streams, frames, temporal=temporal)


def test_tier_lists_the_reversal_only_without_the_ball() -> None:
    plain = rope_tier(RopeSettings(ball=False), "rope-2")
    assert plain.name == "rope-2"
    assert [each.name for each in plain.objects] == ["rope"]
    assert plain.symmetries == (Symmetry("reversal", ((-1, 0), (0, -1)), (1, 0)),)
    with_ball = rope_tier(RopeSettings())
    assert [each.id for each in with_ball.objects] == [1, 2]
    assert with_ball.symmetries == ()
    s, theta = with_ball.objects[0].material
    assert s.metres_per_unit == 1.2
    assert s.period is None
    assert theta.period == pytest.approx(theta.max - theta.min)
