"""Pictures at their silhouettes: a grey box before a darker background, and contrasts by hand."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
import pytest
from scipy.stats import ttest_1samp

from pliant.spec.validation.rules.colour import (
    CERTAIN,
    MIN_BLOCKS,
    REACH,
    Colours,
    Edges,
    Silhouette,
    _Alternative,
    _spread,
    is_blank,
    probability,
    profile,
    recognised,
    shift_of,
)

HEIGHT, WIDTH = 60, 80
Picture = npt.NDArray[np.uint8]


def box(top: int = 12, left: int = 18, height: int = 26, width: int = 30) -> npt.NDArray[np.bool_]:
    """Return where a box is seen."""
    seen = np.zeros((HEIGHT, WIDTH), np.bool_)
    seen[top : top + height, left : left + width] = True
    return seen


def picture(seen: npt.NDArray[np.bool_], grain: int = 0) -> Picture:
    """Return a box that is brighter by 20, 30 and 40 than what is behind it."""
    rgb = np.where(seen[..., None], (70, 90, 110), (50, 60, 70))
    noise = np.random.default_rng(0).integers(-grain, grain + 1, rgb.shape)
    return (rgb + noise).astype(np.uint8)


def test_the_contrast_at_a_silhouette() -> None:
    silhouette = Silhouette.of(box())
    rows, columns = silhouette.across
    assert sorted(set(rows.tolist())) == list(range(12, 38))
    assert sorted(set(columns.tolist())) == [17, 47]
    rows, columns = silhouette.down
    assert sorted(set(rows.tolist())) == [11, 37]
    assert sorted(set(columns.tolist())) == list(range(18, 48))
    across, down = silhouette.edges(picture(box()))
    for each, count, side in ((across, 52, 17), (down, 60, 11)):
        expected = np.zeros((count, 2 * REACH + 1))
        expected[:, REACH] = 90
        np.testing.assert_array_equal(each.contrast, expected)
        places = silhouette.across[1] if side == 17 else silhouette.down[0]
        np.testing.assert_array_equal(each.enters, places == side)
    np.testing.assert_allclose(profile([across, down])[:, REACH], [90, 90])
    assert recognised(profile([across, down])) == 181
    # Blocks of 5x5 pixels: 26 rows from row 12 on are in 6 of them, on two sides.
    assert len(np.unique(across.block)) == 12
    assert len(np.unique(down.block)) == 2 * 7


def test_a_silhouette_near_the_border_is_left_out() -> None:
    seen = np.zeros((HEIGHT, WIDTH), np.bool_)
    seen[6:, 6:] = True  # edges between 5 and 6: too near
    assert not len(Silhouette.of(seen).across[0])
    assert not len(Silhouette.of(seen).down[0])
    seen[:] = False
    seen[7:53, 7:73] = True  # edges between 6 and 7, and 52 and 53, 72 and 73
    assert set(Silhouette.of(seen).across[1].tolist()) == {6, 72}
    assert set(Silhouette.of(seen).down[0].tolist()) == {6, 52}
    seen[7:54, 7:74] = True
    assert set(Silhouette.of(seen).across[1].tolist()) == {6}
    assert set(Silhouette.of(seen).down[0].tolist()) == {6}


def test_places_are_spread_over_the_picture() -> None:
    edge = np.ones((20, 30), np.bool_)
    rows, columns = _spread(edge, (2, 18), (5, 25))
    assert len(rows) == 128
    assert (rows.min(), rows.max(), columns.min(), columns.max()) == (2, 17, 5, 24)
    assert (np.diff(rows * 30 + columns) > 0).all()
    few = _spread(edge, (2, 3), (5, 25))
    np.testing.assert_array_equal(few[0], [2] * 20)
    np.testing.assert_array_equal(few[1], np.arange(5, 25))
    assert not len(_spread(edge, (6, 6), (5, 25))[0])
    assert not len(_spread(edge, (2, 18), (9, 8))[0])


def edges(
    at_none: float, best: float, away: float = 10.0, count: int = 24, at: int = REACH + 2
) -> Edges:
    """Return the same contrast at every place: at no shift, at one of 2 px, and elsewhere."""
    contrast = np.full((count, 2 * REACH + 1), away)
    contrast[:, REACH], contrast[:, at] = at_none, best
    return Edges(contrast, np.arange(count) % 2 == 0, np.arange(count))


@pytest.mark.parametrize(
    ("measured", "shift"),
    [
        (edges(40, 51), 2),
        (edges(40, 51, at=3), -3),
        (edges(40, 49), 0),  # not 1.25 times the contrast at none
        (edges(12, 15.5), 2),
        (edges(11, 14.5), 0),  # not 1.5 times the contrast away
        (edges(40, 51, count=23), 0),  # too few places
    ],
)
def test_a_shift_has_clearly_more_contrast(measured: Edges, shift: int) -> None:
    found, doubt = shift_of(measured)
    assert found == shift
    assert doubt == pytest.approx(0 if shift else 1, abs=1e-12)


def test_a_shift_moves_both_sides_of_an_object() -> None:
    for side in (0, 1):
        measured = edges(40, 60)
        measured.contrast[side::2, REACH + 2] = 40
        assert shift_of(measured) == (0, 1.0)
    measured = edges(40, 60)
    assert shift_of(Edges(measured.contrast, np.ones(24, np.bool_), measured.block)) == (0, 1.0)
    measured.contrast[:, REACH + 2] += np.random.default_rng(0).normal(0, 30, 24)
    gain = measured.contrast[:, REACH + 2] - 40
    chance = 26 * probability(gain, measured.block)
    assert 0 < chance < 1
    found, doubt = shift_of(measured)
    assert found == 2
    assert doubt == pytest.approx(chance)


def test_a_shadow_on_one_side_is_no_certain_shift() -> None:
    """A shadow raises the contrast on one side much and, by chance, on the other a little."""
    measured = edges(40, 90, count=48)
    measured.contrast[1::2, REACH + 2] = 44 + np.random.default_rng(0).normal(0, 20, 24)
    gain = measured.contrast[:, REACH + 2] - 40
    assert gain[1::2].mean() > 0
    assert 26 * probability(gain, measured.block) < CERTAIN
    assert shift_of(measured) == (2, CERTAIN)
    measured.contrast[1::2, REACH + 2] += 26
    assert shift_of(measured)[1] < CERTAIN


def test_pictures_are_joined_on_the_scale_of_their_contrast() -> None:
    one, other = edges(40, 51), edges(400, 510, away=100, count=30)
    joined = Edges.joined([one, edges(1, 2, count=23), other])
    assert len(joined.contrast) == len(joined.enters) == len(joined.block) == 54
    np.testing.assert_allclose(joined.contrast[0], joined.contrast[-1])
    assert joined.contrast.mean() == pytest.approx(1)
    assert Edges.joined([edges(1, 2, count=23)]).contrast.shape == (0, 13)


def test_contrast_is_recognised_along_either_axis() -> None:
    contrast = np.full((2, 13), np.nan)
    assert np.isnan(recognised(contrast))
    contrast[0] = [8, 6, 50, 50, 50, 50, 19, 50, 50, 50, 50, 2, 4]
    assert recognised(contrast) == (19 + 1) / (5 + 1)
    contrast[1] = [1] * 6 + [10] + [1] * 6
    assert recognised(contrast) == (29 + 1) / (6 + 1)


def test_the_gain_of_another_explanation() -> None:
    own, other = [edges(20, 0), edges(0.5, 0, away=0.5)], [edges(60, 0, away=20), edges(3, 0)]
    found = _Alternative.of(own, other)
    np.testing.assert_allclose(found.gain, [60 / 20 - 20 / 10] * 24 + [3 / 10 - 0.5 / 1] * 24)
    np.testing.assert_array_equal(found.block, np.tile(np.arange(24), 2))
    assert found.ratio == (63 + 1) / (30 + 1)


def test_an_axis_without_places_gains_nothing() -> None:
    few, none = edges(20, 0), edges(0, 0, count=0)
    found = _Alternative.of([few, none], [edges(40, 0), none])
    np.testing.assert_allclose(found.gain, [2.0] * 24)
    np.testing.assert_array_equal(found.block, np.arange(24))


def test_places_of_a_block_count_once() -> None:
    """Blocks are a twelfth of the shorter side, 4 to 8 pixels; each has its own number."""
    for height, width, side in ((40, 90, 4), (60, 80, 5), (84, 100, 7), (200, 210, 8)):
        seen = np.zeros((height, width), np.bool_)
        seen[10:30, 10:30] = True
        rgb = np.zeros((height, width, 3), np.uint8)
        for each, places in zip(
            Silhouette.of(seen).edges(rgb), (Silhouette.of(seen).across, Silhouette.of(seen).down),
            strict=True,
        ):  # fmt: skip
            pairs = {(r // side, c // side): b for r, c, b in zip(*places, each.block, strict=True)}
            assert len(set(each.block.tolist())) == len(set(pairs.values())) == len(pairs)


def test_frames_in_a_row_may_be_exchanged() -> None:
    """Explanations are tried of pictures that are not clearly right, of neighbours in time."""
    right, hidden = picture(box(), 3), picture(np.zeros((HEIGHT, WIDTH), np.bool_), 3)
    colours = Colours()
    for frame in (0, 1, 2):
        colours.add(frame, right, box())
    assert (len(colours.own), colours.others) == (3, {})
    for frame in (3, 5, 6):
        colours.add(frame, hidden, box())
    assert len(colours.own) == 6
    tried = {name: len(found) for name, found in colours.others.items()}
    assert tried == {
        "the pictures are upside down": 3, "the pictures are mirrored": 3,
        "the pictures are turned by 180 degrees": 3,
        "a silhouette is that of the picture of the frame before": 2,
        "a silhouette is that of the picture of the frame after": 2,
    }  # fmt: skip
    colours.add(7, right, np.zeros((HEIGHT, WIDTH), np.bool_))  # nothing to be seen
    assert len(colours.own) == 6
    colours.add(8, right, box())
    assert len(colours.others["a silhouette is that of the picture of the frame after"]) == 2


@pytest.mark.parametrize(
    ("found", "expected"),
    [
        (((2, 0.9e-4), (0, 1.0)), (True, "(+2, +0) px")),
        (((2, 1.1e-4), (-3, 0.9e-2)), (False, "(+2, -3) px")),
        (((2, 1.1e-2), (1, 0.9e-2)), (False, "(+0, +1) px")),
        (((2, 1.1e-2), (1, 1.1e-2)), None),
    ],
)
def test_how_certain_a_shift_is(
    found: tuple[tuple[int, float], tuple[int, float]],
    expected: tuple[bool, str] | None,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    along = iter(found)
    monkeypatch.setattr("pliant.spec.validation.rules.colour.shift_of", lambda _: next(along))
    colours = Colours()
    colours.add(0, picture(box(), 3), box())
    explanation = colours.explain()
    assert (explanation is None) is (expected is None)
    if explanation is not None and expected is not None:
        assert explanation[0] is expected[0]
        assert f"are seen {expected[1]} (u, v) from" in explanation[1]


def unclear(ratio: float) -> tuple[Edges, Edges]:
    """Return a picture with this contrast ratio: (20 x + 1) over (20 + 1) is the ratio."""
    middle = (ratio * 21 - 1) / 2
    return edges(middle, 10), edges(middle, 10)


@pytest.mark.parametrize(
    ("own", "ratio", "gain", "found"),
    [
        ((1.0,), 1.51, np.ones(30), True),
        ((1.0,), 1.49, np.ones(30), False),
        ((1.2,), 1.81, np.ones(30), True),
        ((1.2,), 1.79, np.ones(30), False),
        ((1.2, 2.0, 2.0), 1.81, np.ones(30), True),  # of the pictures that are not recognised
        ((1.31,), 9.0, np.ones(30), None),
        ((1.29, 1.31, 1.31), 9.0, np.ones(30), True),
        ((1.29, 1.31, 1.31), 1.0, np.ones(30), None),
        ((1.29, 1.31), 1.0, np.ones(30), False),
        ((1.0,), 9.0, -np.ones(30), False),
    ],
)
def test_another_explanation_fits_clearly_better(
    own: tuple[float, ...], ratio: float, gain: npt.NDArray[np.float64], found: bool | None
) -> None:
    other = _Alternative(ratio, gain, np.arange(30))
    colours = Colours([unclear(each) for each in own], {"other pictures": [other]})
    explanation = colours.explain()
    assert (None if explanation is None else explanation[0]) is found
    if explanation is not None:
        start = "other pictures (contrast ratio" if found else "in "
        assert explanation[1].startswith(start)


@pytest.mark.parametrize(("chance", "found"), [(1.9e-5, True), (2.1e-5, False)])
def test_another_explanation_is_no_chance(
    chance: float, found: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    """One in ten thousand, for five explanations."""
    monkeypatch.setattr("pliant.spec.validation.rules.colour.probability", lambda *_: chance)
    first = _Alternative(1.0, np.ones(4), np.arange(4))
    other = _Alternative(9.0, np.ones(4), np.arange(4))
    colours = Colours(
        [unclear(1.0)], {"turned": [first], "of another frame": [first, other, other]}
    )
    explanation = colours.explain()
    assert explanation is not None
    assert explanation[0] is found


def explained(*frames: tuple[npt.NDArray[np.bool_], Picture]) -> tuple[bool, str] | None:
    colours = Colours()
    for frame, (seen, rgb) in enumerate(frames):
        colours.add(frame, rgb, seen)
    return colours.explain()


def test_right_pictures_need_no_explanation() -> None:
    assert explained() is None
    assert explained((box(), picture(box(), 3)), (box(20, 30), picture(box(20, 30), 3))) is None


@pytest.mark.parametrize(("v", "u"), [(0, 2), (-3, 0), (-3, 2), (1, -6)])
def test_shifted_pictures(v: int, u: int) -> None:
    frames = [
        (box(*place), np.roll(picture(box(*place), 3), (v, u), (0, 1)))
        for place in ((12, 18), (14, 25), (22, 30))
    ]
    found = explained(*frames)
    assert found is not None
    assert found[0]
    assert found[1].startswith(f"the silhouettes are seen ({u:+d}, {v:+d}) px (u, v) from")


def test_turned_pictures() -> None:
    for name, turn in (
        ("upside down", np.s_[::-1]),
        ("mirrored", np.s_[:, ::-1]),
        ("turned by 180 degrees", np.s_[::-1, ::-1]),
    ):
        seen = [box(9 + k, 11 + k, 14, 16) for k in range(3)]
        frames = [(each, picture(each, 3)[turn]) for each in seen]
        found = explained(*frames)
        assert found is not None, name
        assert found[0]
        assert found[1].startswith(f"the pictures are {name} (contrast ratio ")


@pytest.mark.parametrize(("step", "word"), [(1, "after"), (-1, "before")])
def test_pictures_of_the_next_frame(step: int, word: str) -> None:
    seen = [box(8 + 8 * (k % 3), 10 + 9 * k) for k in range(5)]
    pictures = [picture(each, 3) for each in seen]
    found = explained(*zip(seen, np.roll(pictures, step, axis=0), strict=True))
    assert found is not None
    assert found[0]
    assert f"silhouette is that of the picture of the frame {word}" in found[1]


def test_objects_that_the_background_hides() -> None:
    right = (box(), picture(box(), 3))
    hidden = (box(24, 40), picture(np.zeros((HEIGHT, WIDTH), np.bool_), 3))
    assert explained(right, right, hidden) is None
    found = explained(right, hidden, right, hidden)
    assert found is not None
    assert not found[0]
    assert found[1].startswith("in 2 of 4 frames the colour changes no more at the silhouette")
    small = np.zeros((HEIGHT, WIDTH), np.bool_)
    small[20:25, 20:25] = True  # 10 places along each axis say nothing
    assert explained((small, hidden[1])) is None


def test_chance_is_that_of_a_t_test_over_blocks() -> None:
    gain = np.random.default_rng(0).normal(0.3, 1.0, MIN_BLOCKS + 5)
    block = np.arange(len(gain)) * 7
    expected = ttest_1samp(gain, 0, alternative="greater").pvalue
    assert probability(gain, block) == pytest.approx(expected)
    # Places of a block that say the same count once.
    assert probability(np.repeat(gain, 3), np.repeat(block, 3)) == pytest.approx(expected)
    assert probability(gain[:MIN_BLOCKS], block[:MIN_BLOCKS]) < 1
    assert probability(gain[1:MIN_BLOCKS], block[1:MIN_BLOCKS]) == 1
    assert probability(gain[:0], block[:0]) == 1


def test_a_picture_of_one_colour_is_blank() -> None:
    rgb = np.full((40, 50, 3), (7, 100, 200), np.uint8)
    assert is_blank(rgb)
    for step, blank in ((2, True), (3, False)):
        one = rgb.copy()
        one[3, 5] += np.uint8(step)  # a pixel between those that are looked at first
        assert is_blank(one) is blank
        one = rgb.copy()
        one[4, 6, 1] -= np.uint8(step)
        assert is_blank(one) is blank
