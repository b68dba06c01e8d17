"""Noise of a picture, measured and taken away before objects are looked for."""

from __future__ import annotations

import numpy as np
import pytest

from pliant.baselines.conditions import noise_of
from pliant.models.don import described
from pliant.models.don.described import ViewDescriber
from pliant.models.don.segmentation import denoised
from pliant.spec.arrays import Rgb
from pliant.spec.dataset import SAMPLE, Dataset
from pliant.spec.frame import Frame
from tests.models.shipped_models import shipped_don


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
    views = ViewDescriber(
        matcher.network, matcher.input, matcher.size, 1, mirrored=False, plain_table=False
    )
    picture = next(iter(Dataset.open(SAMPLE).pairs("test"))).source.rgb
    assert views.segmented(Frame(picture, key="s/0")).mask is not None
    monkeypatch.setattr(described, "denoised", lambda rgb: np.full_like(rgb, 128))
    assert views.segmented(Frame(picture, key="s/1")).mask is None
