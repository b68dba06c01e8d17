"""Masks of a rope from an image alone: without its shadow, and with the ball kept apart."""

from __future__ import annotations

import pickle
from pathlib import Path

import numpy as np
import pytest
from scipy import ndimage

from pliant.baselines.conditions import noise_of
from pliant.loaders.frame_store import FrameStore
from pliant.models.don import described
from pliant.models.don.ball import BallNetwork, ball_in
from pliant.models.don.described import ViewDescriber
from pliant.models.don.matcher import DonMatcher
from pliant.models.don.one_rope import resized
from pliant.models.don.segmentation import (
    cloth_mask,
    cloth_probability,
    denoised,
    rope_masks,
    shown,
)
from pliant.models.don.validation import draw_validation_pairs
from pliant.models.networks.mask_network import MaskNetwork
from pliant.models.shipped import FOLDER
from pliant.models.training.checkpoint import load_weights
from pliant.models.training.run_folder import BALL as BALL_FILE
from pliant.spec.arrays import Float32Array, FloatArray, Mask, Rgb
from pliant.spec.dataset import Dataset
from pliant.spec.frame import Frame, Pair
from pliant.spec.opening import SAMPLE
from tests.known import known
from tests.models.don.test_ball import GreenBall
from tests.models.shipped_models import shipped_don

WIDTH, HEIGHT, HALF_PX = 640, 480, 9


def encoded(linear: FloatArray) -> Rgb:
    """Return sRGB bytes of linear light."""
    curve = np.where(linear <= 0.0031308, 12.92 * linear, 1.055 * linear ** (1 / 2.4) - 0.055)
    return (curve.clip(0, 1) * 255 + 0.5).astype(np.uint8)


def describer(matcher: DonMatcher) -> ViewDescriber:
    return ViewDescriber(
        matcher.network, matcher.input, matcher.size, 1, mirrored=False, plain_table=False
    )


def overlap(a: Mask, b: Mask) -> float:
    """Return intersection over union."""
    return float((a & b).sum() / max((a | b).sum(), 1))


def scene() -> tuple[Rgb, Mask, Mask, Mask]:
    """Return a picture of a rope on a table with its shadow; the rope, its ball and the shadow."""
    rows, columns = np.mgrid[:HEIGHT, :WIDTH] + 0.5
    t = np.linspace(0, 1, 800)
    line = np.stack([110 + 420 * t, 240 + 110 * np.sin(5 * t)], axis=1)
    drawn = np.ones((HEIGHT, WIDTH), dtype=np.bool_)
    drawn[line[:, 1].astype(int), line[:, 0].astype(int)] = False
    rope = np.asarray(ndimage.distance_transform_edt(drawn) <= HALF_PX)
    ball = np.hypot(columns - line[0, 0], rows - line[0, 1]) <= 2.2 * HALF_PX
    rope &= ~ball
    shadow = np.roll(rope | ball, (14, 10), axis=(0, 1)) & ~rope & ~ball
    grain = np.random.default_rng(0).normal(1, 0.03, (HEIGHT, WIDTH, 1))
    linear = np.array([0.30, 0.22, 0.12]) * (0.7 + 0.5 * columns / WIDTH)[..., None] * grain
    linear[shadow] *= 0.45
    linear[rope] = [0.10, 0.25, 0.50]
    linear[ball] = [0.05, 0.45, 0.10]
    return encoded(linear), rope, ball, shadow


_, ROPE, BALL, SHADOW = scene()


def vague(rope: Mask, others: Mask | None = None) -> tuple[Float32Array, Float32Array]:
    """Return what a network might say of a picture at a quarter of the size: blurred, unsure.

    Returns:
        The probabilities of the rope, and of the rope or others.
    """

    def blurred(mask: Mask) -> Float32Array:
        small = mask.reshape(HEIGHT // 4, 4, WIDTH // 4, 4).mean(axis=(1, 3))
        return (0.8 * ndimage.gaussian_filter(small, 2.0)).astype(np.float32)

    own = blurred(rope)
    return own, own if others is None else blurred(rope | others)


def test_the_rope_is_cut_from_its_shadow_and_its_ball() -> None:
    rgb, rope, ball, shadow = scene()
    own, objects = known(rope_masks(rgb, *vague(rope, ball | shadow), None))
    objects = known(objects)
    assert overlap(own, rope) > 0.85
    assert overlap(objects & ~own, ball) > 0.7
    assert (objects & shadow).sum() < 0.05 * shadow.sum()


def test_a_rope_like_the_table_is_kept_where_the_network_is_sure() -> None:
    rgb, rope, _, _ = scene()
    part = rope & (np.arange(WIDTH) > WIDTH // 2)
    rgb[part] = rgb[10, 10] // 2
    seen = rope.reshape(HEIGHT // 4, 4, WIDTH // 4, 4).mean(axis=(1, 3)).astype(np.float32)
    own, _ = known(rope_masks(rgb, seen, seen, None))
    assert (own & part).sum() > 0.6 * part.sum()


def test_a_small_part_is_kept_where_the_network_knows_it() -> None:
    rgb, rope, ball, _ = scene()
    cover = rope & (np.abs(np.arange(WIDTH) - 480) < 32)
    small = rope & (np.arange(WIDTH) >= 512)
    rgb[cover] = rgb[10, 10]
    kept = []
    for known_as in (rope & ~cover, rope & ~cover & ~small):
        p = vague(known_as | ball)[0] + 0.2 * vague(small)[0]
        mask = known(shown(rgb, p))
        kept.append(mask[resized(small, mask.shape)].mean())
    assert kept[0] > 0.8
    assert kept[1] == 0


def test_a_dark_rope_in_a_grey_picture_is_no_shadow() -> None:
    rgb, rope, _, shadow = scene()
    grey = np.repeat(rgb.mean(axis=-1, keepdims=True), 3, axis=-1)
    grey[rope] = 0.6 * grey[shadow].mean()
    seen = 0.9 * rope.reshape(HEIGHT // 4, 4, WIDTH // 4, 4).mean(axis=(1, 3), dtype=np.float32)
    own, _ = known(rope_masks(grey.astype(np.uint8), seen, seen, None))
    assert overlap(own, rope) > 0.8


def test_a_ball_like_the_table_is_not_ruled_out_where_no_end_is_known() -> None:
    rgb, rope, ball, _ = scene()
    rgb[ball] = rgb[10, 10]
    own, objects = known(rope_masks(rgb, *vague(rope), None))
    assert overlap(own, rope) > 0.85
    assert objects is None


def test_a_ball_is_where_its_network_sees_it() -> None:
    rgb, rope, ball, _ = scene()
    own, objects = known(rope_masks(rgb, *vague(rope), GreenBall()))
    gap_px = np.argwhere(known(objects) & ~own).mean(axis=0) - np.argwhere(ball).mean(axis=0)
    assert np.linalg.norm(gap_px) < 3 * HALF_PX
    assert overlap(own, rope) > 0.8


def test_the_shipped_network_sees_a_ball_that_the_mask_lacks() -> None:
    network = BallNetwork()
    load_weights(network, FOLDER / "don-rope" / BALL_FILE)
    rgb, rope, ball, shadow = scene()
    bare = rgb.copy()
    bare[ball | shadow] = rgb[0, 0]
    for picture, there in (
        (rgb, True),
        (rgb[..., :1].repeat(3, 2), True),
        (bare, False),
    ):
        seen = picture[::2, ::2].astype(np.float32) / 255
        found = ball_in(seen, rope[::2, ::2], network)
        assert found.any() == there
        assert not there or (found & ball[::2, ::2]).sum() > 0.6 * ball[::2, ::2].sum()


def test_a_print_of_the_tables_colour_is_a_part_of_its_cloth() -> None:
    rgb = scene()[0]
    cloth, printed = np.zeros((2, HEIGHT, WIDTH), np.bool_)
    cloth[100:380, 150:500] = True
    printed[200:260, 220:400] = True
    rgb[cloth & ~printed] = (30, 60, 160)
    found = known(cloth_mask(rgb, vague(cloth)[0]))
    assert overlap(found, cloth) > 0.97


@pytest.mark.parametrize("p", [0.0, 1.0])
def test_nothing_is_found_where_the_network_sees_nothing_or_all(p: float) -> None:
    rgb = scene()[0]
    everywhere = np.full((HEIGHT // 4, WIDTH // 4), p, dtype=np.float32)
    assert rope_masks(rgb, everywhere, everywhere, None) is None
    assert cloth_mask(rgb, everywhere) is None


def test_nothing_stands_out_from_an_even_picture() -> None:
    even = np.full((HEIGHT, WIDTH, 3), 90, dtype=np.uint8)
    assert rope_masks(even, *vague(scene()[1]), None) is None


def test_an_uncertain_network_for_masks_is_averaged_with_the_descriptor_network() -> None:
    def cloth(p: float, shape: tuple[int, int] = (60, 80)) -> Float32Array:
        """Return a cloth of which a third has a probability."""
        found = np.zeros(shape, dtype=np.float32)
        rows, columns = shape[0] // 3, shape[1] // 8
        found[rows : 2 * rows, 3 * columns : 6 * columns] = 0.97
        found[rows : 2 * rows, 3 * columns : 4 * columns] = p
        return found

    def other() -> Float32Array:
        asked.append(True)
        return cloth(0.9, (30, 40))

    asked: list[bool] = []
    np.testing.assert_array_equal(cloth_probability(cloth(0.95), other), cloth(0.95))
    assert not asked  # its certainty is 0.93
    both = cloth_probability(cloth(0.6), other)
    assert both.shape == (60, 80)
    # The odds are the geometric mean: sqrt(0.6 / 0.4 * 0.9 / 0.1) = 3.674.
    assert both[30, 35] == pytest.approx(3.674 / 4.674, abs=1e-3)
    assert both[30, 50] == pytest.approx(0.97, abs=1e-3)
    assert both[5, 5] < 0.01
    nothing = np.zeros((60, 80), dtype=np.float32)
    np.testing.assert_array_equal(cloth_probability(nothing, other), other())


def test_the_network_decides_alone_on_a_table_as_colourful_as_the_object() -> None:
    rgb, rope, ball, _ = scene()
    rng = np.random.default_rng(0)
    tiles = rng.integers(0, 256, (HEIGHT // 40, WIDTH // 40, 3)).astype(np.uint8)
    patterned = np.repeat(np.repeat(tiles, 40, axis=0), 40, axis=1)
    patterned[rope | ball] = rgb[rope | ball]
    p = np.where(rope | ball, 0.9, 0.02).astype(np.float32)
    p[200:230, 40:400] = np.maximum(p[200:230, 40:400], 0.3)  # possible, and as colourful
    found = known(shown(patterned, p))
    assert overlap(resized(found, rope.shape), rope | ball) > 0.9


def test_a_cloth_is_found_by_the_network_for_masks_where_that_is_sure() -> None:
    matcher = shipped_don("don-cloth")
    views = describer(matcher)
    rows, columns = np.mgrid[:HEIGHT, :WIDTH]
    left, right = (np.hypot(rows - 240, columns - u) < 90 for u in (180, 460))
    rgb = np.full((HEIGHT, WIDTH, 3), 90, np.uint8)
    rgb[left | right] = [60, 150, 90]

    class Says(MaskNetwork):
        sure = 1.0

        def found(self, rgb: Rgb, width: int = 320) -> Float32Array:
            p = np.select([left, right], [self.sure, 1 - self.sure])[::2, ::2].astype(np.float32)
            return np.stack([p, p])

    views.masks = says = Says()
    mask = known(views.foreground(Frame(rgb, key="s/1")).mask)
    assert overlap(mask, left) > 0.9
    says.sure = 0.7  # the descriptor network sees both
    both = known(views.foreground(Frame(rgb, key="s/2")).mask)
    assert overlap(both, left | right) > 0.9
    whole, cut = (
        Frame(rgb, mask=left, key="s/3"),
        Frame(rgb[:, 180:], mask=left[:, 180:], key="s/4"),
    )
    (remark,) = matcher.remarks(whole, cut)
    assert remark.startswith("The object leaves the picture of the target: ")


def test_the_shipped_model_finds_masks_and_answers_without_them() -> None:
    sample = Dataset.open(SAMPLE)
    matcher = shipped_don("don-rope")
    store = FrameStore(sample, "rope", "test", sample.size)
    overlaps, errors, gaps = [], [], []
    for pair in draw_validation_pairs(store, pairs=2, queries=40, seed=1):
        source, target = (Frame(view.rgb, key=view.key) for view in (pair.source, pair.target))
        views = describer(matcher)
        mask = known(views.segmented(target).mask)
        overlaps.append(overlap(mask, known(pair.target.mask)))
        answers = matcher.answer(Pair(source, target, pair.uv_a_px))
        error = np.linalg.norm(answers.uv_px - pair.uv_b_px[:, 0], axis=1)
        errors.append(error[pair.visible[:, 0]])
        heat = matcher.heat(source, target, pair.uv_a_px[0]).values
        assert np.isnan(heat[0, 0])  # the mask that was found is what is searched
        row, column = np.unravel_index(np.nanargmax(heat), heat.shape)
        one = matcher.answer(Pair(source, target, pair.uv_a_px[:1]))
        modes = known(one.modes)[0][:, :2] - np.array([column + 0.5, row + 0.5])
        gaps.append(np.linalg.norm(modes, axis=1).min())
    assert max(gaps) < 6  # heat map and modes are of one distribution
    assert np.median(overlaps) > 0.7
    assert np.median(np.concatenate(errors)) < 25


def test_masks_are_found_once_for_all_processes(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    matcher = shipped_don("don-rope")
    matcher.share(tmp_path)
    copy = pickle.loads(pickle.dumps(matcher))
    picture = next(iter(Dataset.open(SAMPLE).pairs("test"))).source
    view = Frame(picture.rgb, key="s/0")
    mask = known(matcher.object_mask(view))

    def refuse(*_: object) -> None:
        raise AssertionError("the masks of a picture were found again")

    monkeypatch.setattr("pliant.models.don.described.rope_masks", refuse)
    for each in (matcher, copy):
        again = known(each.object_mask(view))
        assert (again == mask).all()
    with pytest.raises(AssertionError, match="found again"):
        matcher.object_mask(Frame(picture.rgb, key="s/1"))


def noisy(rgb: Rgb, deviation: float) -> Rgb:
    drawn = rgb + np.random.default_rng(1).normal(0, deviation, rgb.shape)
    return drawn.round().clip(0, 255).astype(np.uint8)


@pytest.mark.parametrize("deviation", [5.0, 12.0, 20.0])
def test_noise_is_measured_over_edges_and_gradients(deviation: float) -> None:
    v, u = np.mgrid[:240, :320]
    grey = np.where((u // 40 + v // 40) % 2, 150, 90) + u // 16
    rgb = np.repeat(grey[..., None], 3, axis=2).astype(np.uint8)
    assert noise_of(rgb) < 0.5
    # Grey is the mean of the channels, so independent noise of theirs is weaker there.
    weakened = deviation / np.sqrt(3)
    assert noise_of(noisy(rgb, deviation)) == pytest.approx(weakened, rel=0.06)


def test_a_picture_without_noise_is_left_as_it_is() -> None:
    picture = next(iter(Dataset.open(SAMPLE).pairs("test"))).source.rgb
    assert denoised(picture) is picture
    spoilt = noisy(picture, 14)
    left = denoised(spoilt).astype(float) - picture
    assert left.std() < 0.5 * (spoilt.astype(float) - picture).std()


def test_objects_are_looked_for_in_the_smoothed_picture(monkeypatch: pytest.MonkeyPatch) -> None:
    matcher = shipped_don("don-rope")
    views = describer(matcher)
    picture = next(iter(Dataset.open(SAMPLE).pairs("test"))).source.rgb
    assert views.segmented(Frame(picture, key="s/0")).mask is not None
    monkeypatch.setattr(described, "denoised", lambda rgb: np.full_like(rgb, 128))
    assert views.segmented(Frame(picture, key="s/1")).mask is None
