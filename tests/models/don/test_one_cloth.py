"""Other cloths are removed from the mask of a cloth, its prints are not."""

from __future__ import annotations

import cv2
import numpy as np
import pytest

from pliant.models.don.one_cloth import of_one_cloth
from pliant.models.don.segmentation import cloth_mask
from pliant.spec.arrays import Float32Array, Mask, Rgb
from tests.known import known

SHAPE = (240, 320)
CLOTH = [[60, 70], [210, 60], [200, 190], [80, 200]]
BESIDE = [[190, 40], [260, 55], [245, 110], [180, 95]]  # a part of it is on the cloth


def drawn(corners: list[list[int]]) -> Mask:
    """Return a polygon, corners (column, row)."""
    image = np.zeros(SHAPE, dtype=np.uint8)
    return cv2.fillPoly(image, [np.array(corners)], [1]).astype(np.bool_)


def picture(*painted: tuple[Mask, tuple[int, int, int]]) -> Rgb:
    """Return a table with objects in their colours, lit unevenly, with noise."""
    linear = np.full((*SHAPE, 3), 0.3)
    for mask, colour in painted:
        linear[mask] = (np.array(colour) / 255) ** 2.2
    linear *= np.linspace(0.7, 1.2, SHAPE[1])[None, :, None]
    noise = np.random.default_rng(0).normal(0, 3, (*SHAPE, 3))
    return (linear.clip(0, 1) ** (1 / 2.2) * 255 + noise).clip(0, 255).astype(np.uint8)


def overlap(a: Mask, b: Mask) -> float:
    """Return intersection over union."""
    return float((a & b).sum() / (a | b).sum())


@pytest.mark.parametrize("colour", [(200, 60, 40), (60, 160, 200), (20, 30, 24)])
def test_another_cloth_that_makes_the_outline_concave_is_removed(
    colour: tuple[int, int, int],
) -> None:
    cloth, other = drawn(CLOTH), drawn(BESIDE)
    rgb = picture((cloth, (40, 150, 70)), (other, colour))
    found = of_one_cloth(rgb, cloth | other)
    assert overlap(found, cloth & ~other) > 0.95
    both: Float32Array = np.where(cloth | other, 0.97, 0.02).astype(np.float32)
    assert overlap(known(cloth_mask(rgb, both)), cloth & ~other) > 0.95


def test_a_cloth_in_two_colours_stays_whole() -> None:
    cloth = drawn(CLOTH)
    corner = cloth & drawn([[150, 50], [230, 50], [230, 120], [150, 120]])
    stripe = cloth & drawn([[0, 120], [320, 120], [320, 150], [0, 150]])
    for part in (corner, stripe, corner | stripe):
        rgb = picture((cloth, (40, 150, 70)), (part, (200, 60, 40)))
        np.testing.assert_array_equal(of_one_cloth(rgb, cloth), cloth)


def test_a_part_between_concave_corners_of_its_cloth_is_a_print() -> None:
    cloth = drawn([[60, 50], [240, 50], [240, 200], [60, 200]])
    cloth &= ~drawn([[60, 100], [110, 100], [110, 150], [60, 150]])
    patch = drawn([[111, 100], [150, 100], [150, 150], [111, 150]])
    rgb = picture((cloth, (40, 150, 70)), (patch, (200, 60, 40)))
    np.testing.assert_array_equal(of_one_cloth(rgb, cloth), cloth)


def test_a_bent_band_is_not_another_cloth() -> None:
    """Such as the hem of a fold, which is in the colour of the underside."""
    cloth = drawn([[100, 80], [220, 80], [220, 180], [100, 180]])
    band = drawn([[80, 60], [240, 60], [240, 220], [220, 220], [220, 80], [80, 80]])
    rgb = picture((cloth | band, (40, 150, 70)), (band, (200, 60, 40)))
    np.testing.assert_array_equal(of_one_cloth(rgb, cloth | band), cloth | band)


def test_what_joins_two_halves_is_a_part_of_both() -> None:
    halves = drawn([[60, 60], [120, 60], [120, 200], [60, 200]])
    halves |= drawn([[180, 60], [240, 60], [240, 200], [180, 200]])
    bridge = drawn([[110, 100], [190, 100], [190, 130], [110, 130]])
    rgb = picture((halves | bridge, (40, 150, 70)), (bridge, (200, 60, 40)))
    np.testing.assert_array_equal(of_one_cloth(rgb, halves | bridge), halves | bridge)


def test_a_cloth_in_two_pieces_keeps_both() -> None:
    """A stripe of it looked like the table, and one piece has a patch at its end."""
    cloth, stripe = drawn(CLOTH), drawn([[0, 120], [320, 120], [320, 135], [0, 135]])
    patch = cloth & drawn([[60, 160], [110, 160], [110, 210], [60, 210]])
    rgb = picture((cloth, (40, 150, 70)), (patch, (200, 60, 40)))
    np.testing.assert_array_equal(of_one_cloth(rgb, cloth & ~stripe), cloth & ~stripe)


def test_a_cloth_of_a_few_pixels_with_a_border_stays_whole() -> None:
    distance = np.hypot(*(np.mgrid[: SHAPE[0], : SHAPE[1]] - 100))
    rgb = np.full((*SHAPE, 3), 120, dtype=np.uint8)
    rgb[distance <= 5.5] = (40, 150, 70)
    rgb[distance <= 3.5] = (200, 60, 40)
    np.testing.assert_array_equal(of_one_cloth(rgb, distance <= 5.5), distance <= 5.5)


def test_a_neighbour_in_the_same_colour_cannot_be_told_apart() -> None:
    both = drawn(CLOTH) | drawn(BESIDE)
    np.testing.assert_array_equal(of_one_cloth(picture((both, (40, 150, 70))), both), both)
