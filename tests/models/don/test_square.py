"""A blank square that is turned far: four equal answers; one that is nearly upright: one."""

from __future__ import annotations

from pathlib import Path
from typing import Literal

import cv2
import numpy as np
import pytest
import torch
from torch import nn

from pliant.baselines.outline import angle_from_upright
from pliant.baselines.tracing import Reframed
from pliant.models.don.certainty import Calibration
from pliant.models.don.described import ViewDescriber
from pliant.models.don.matcher import DonMatcher
from pliant.models.don.prints import upright_turn
from pliant.models.don.settings import AnswerSettings
from pliant.spec.arrays import Float32Array, FloatArray
from pliant.spec.frame import Frame, Pair
from tests.known import known
from tests.models.don.planted import planted
from tests.models.shipped_models import made_like_training_set, shipped_don

SIZE = (160, 120)
MIDDLE = np.array(SIZE) / 2
SIDE_PX = 72.0
ASKED = np.array([[18.0, -10.0], [-25.0, 6.0], [4.0, 28.0]])
"""Places on the upright square, from its middle."""


class PlaceInPicture(nn.Module):
    """A descriptor says where in the picture a pixel is: what upright cloths teach."""

    def forward(self, image: torch.Tensor) -> torch.Tensor:
        height, width = image.shape[-2:]
        v, u = torch.meshgrid(torch.arange(height), torch.arange(width), indexing="ij")
        return torch.stack([u, v]).float()[None] / 10


def turned(places: FloatArray, angle_deg: float) -> FloatArray:
    cosine, sine = np.cos(np.deg2rad(angle_deg)), np.sin(np.deg2rad(angle_deg))
    return np.asarray(places @ np.array([[cosine, sine], [-sine, cosine]]))


def square(angle_deg: float, *, masked: bool = True) -> Frame:
    """Return a picture of a square that is turned from right to down."""
    v, u = np.mgrid[0 : SIZE[1], 0 : SIZE[0]] + 0.5
    there = turned(np.stack([u, v], axis=-1).reshape(-1, 2) - MIDDLE, -angle_deg)
    mask = (np.abs(there).max(axis=1) < SIDE_PX / 2).reshape(u.shape)
    rgb = np.where(mask[..., None], 200, 40).astype(np.uint8).repeat(3, axis=2)
    return Frame(rgb, mask if masked else None, key=f"square {angle_deg} {masked}")


def matcher(blank_square: Literal["no", "upright", "any"]) -> DonMatcher:
    made = planted(PlaceInPicture(), SIZE, AnswerSettings(blank_square=blank_square))
    made.calibration = Calibration(stray=0.0)
    return made


def nearest_px(modes: Float32Array, place: FloatArray) -> float:
    return float(np.linalg.norm(modes[:, :2] - place, axis=1).min())


@pytest.mark.parametrize("angle_deg", [40, -38])
def test_a_square_that_is_turned_far_has_four_answers(angle_deg: float) -> None:
    pair = Pair(square(5), square(angle_deg), (turned(ASKED, 5) + MIDDLE).astype(np.float32))
    found = matcher("upright").answer(pair)
    orbit = [turned(ASKED, angle_deg + 90 * quarter) + MIDDLE for quarter in range(4)]
    for row, modes in enumerate(known(found.modes)):
        large = modes[modes[:, 3] > 0.15]
        assert len(large) == 4
        np.testing.assert_allclose(large[:, 3], 0.25, atol=0.03)
        # The source is 5 degrees from upright, which the network is taught to overlook.
        assert max(nearest_px(large, each[row]) for each in orbit) < 4
    # All answers are of the same side: the one nearest to upright.
    assert np.linalg.norm(found.uv_px - orbit[0], axis=1).max() < 4


@pytest.mark.parametrize(("gain", "turned_upright"), [(0.1, True), (0.0, True), (-0.1, False)])
def test_a_turned_outline_decides_only_where_the_network_is_no_less_sure_of_it(
    gain: float, *, turned_upright: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The edges of a scrunched cloth may point in any direction, however the cloth is turned."""
    view = square(40)

    def confidence(views: ViewDescriber, seen: Frame) -> float:
        return -2.0 + (0.0 if seen.cache_key == view.cache_key else gain)

    monkeypatch.setattr(ViewDescriber, "confidence", confidence)
    seen = matcher("upright").reader.seen(view)
    assert seen.turned == turned_upright
    assert (seen.homography is not None) == turned_upright


@pytest.mark.parametrize(
    ("blank_square", "angle_deg", "modes"), [("no", 40, 1), ("upright", 10, 1), ("any", 10, 4)]
)
def test_nearly_upright_squares_have_one_answer_unless_nothing_is_known(
    blank_square: Literal["no", "upright", "any"], angle_deg: float, modes: int
) -> None:
    """A towel's sides differ, so that it is never turned: its network finds out itself."""
    pair = Pair(square(0), square(angle_deg), (ASKED + MIDDLE).astype(np.float32))
    found = matcher(blank_square).answer(pair)
    assert [int((rows[:, 3] > 0.15).sum()) for rows in known(found.modes)] == [modes] * len(ASKED)
    np.testing.assert_allclose(found.uv_px, ASKED + MIDDLE, atol=0.6)


@pytest.mark.parametrize(
    ("gains", "turn_deg"),
    [
        pytest.param({-30: 0.1, 30: -0.2}, -30, id="one side gains enough"),
        pytest.param({-30: 0.05, 30: -0.2}, 0, id="no side gains enough"),
        pytest.param({-30: 0.2, 30: 0.22, -15: 0.1, 15: 0.05}, -30, id="both gain alike"),
        pytest.param({-30: 0.2, 30: 0.3, -15: 0.1, 15: 0.05}, 30, id="both gain, one more"),
    ],
)
def test_turns_are_tried_where_the_outline_says_nothing(
    gains: dict[int, float], turn_deg: int
) -> None:
    triangle = np.tri(*SIZE[::-1], dtype=np.bool_)
    view = Frame(square(0).rgb, triangle, key="triangle")

    def confidence(seen: Frame) -> float:
        if seen.cache_key == view.cache_key:
            return -2.0
        return -2.0 + gains[int(seen.cache_key.rsplit(" ", 1)[1])]

    turn = upright_turn(Reframed.unchanged(view), triangle, confidence)
    assert np.degrees(turn) == pytest.approx(turn_deg)


def test_scrunched_cloths_whose_outline_says_nothing_are_turned_back(tmp_path: Path) -> None:
    """Pictures of three upright ones, each turned to either side; the shipped network decides."""
    straight = {"camera": {"top": 1.0, "oblique": 0.0}, "cloth": {"yaw_max_rad": 0.0}}
    dataset = made_like_training_set("don-cloth", tmp_path / "set", 3, **straight)
    reader = shipped_don("don-cloth").reader
    shares = []
    for number, picture in enumerate(dataset.frames("test")):
        shown = known(picture.mask)
        assert angle_from_upright(cv2, shown) is None
        assert not reader.seen(picture).turned
        for angle_deg in (30, -30):
            middle = tuple(side / 2 for side in picture.size)
            step = cv2.getRotationMatrix2D(middle, -angle_deg, 0.8)
            rgb = cv2.warpAffine(picture.rgb, step, picture.size, borderMode=cv2.BORDER_REFLECT)
            mask = cv2.warpAffine(shown.astype(np.uint8), step, picture.size) > 0
            seen = reader.seen(
                Frame(rgb.astype(np.uint8), mask, key=f"{number} turned by {angle_deg}")
            )
            turn = np.eye(3) if seen.homography is None else seen.homography
            shares.append(np.degrees(np.arctan2(turn[1, 0], turn[0, 0])) / -angle_deg)
    np.testing.assert_allclose(shares, np.round(shares), atol=0.01)
    assert min(shares) > -0.5, "none is turned further away"
    assert sum(shares) > 3.5, shares


def test_what_is_no_square_or_unknown_stays_as_it_is() -> None:
    triangle = np.tri(*SIZE[::-1], dtype=np.bool_)
    rgb = square(0).rgb
    unknown = square(40, masked=False)
    for view in (Frame(rgb, triangle), Frame(rgb, np.zeros_like(triangle)), unknown):
        assert matcher("upright").reader.seen(view).homography is None
