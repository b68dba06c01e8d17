from __future__ import annotations

from pathlib import Path

import pytest

from pliant.models.don.settings import DonSettings, LossSettings
from pliant.models.don.trainer import shipped_recipe
from pliant.spec.configuration import read_settings
from pliant.spec.dataset import Dataset
from pliant.spec.errors import CallError


@pytest.mark.parametrize(
    ("override", "message"),
    [
        ("loss.sigma_px=-1", "invalid setting; found -1; required: > 0 px"),
        ("network.name=vgg", 'invalid setting; found "vgg"; required: one of unet'),
        ("network.descriptor_dim=1000000000", "found 1000000000; required: 1 to 1024"),
        ("network.widths=[8, 1000000000]", "required: 8 to 1024"),
        ("network.widths=[8,8,8,8,8,8,8,8,32]", "two to eight multiples of 8"),
        ("network.global_blocks=1000000000", "required: 0 to 64"),
        ("batch=1000000000", "required: 1 to 4096"),
        ("workers=1000000000", "required: 0 to 256"),
        ("seed=20301130123456", "found 20301130123456; required: 0 to 4294967295"),
        ("loss.time_weight=1", "required: 'sequence' or 'next' for loss.time_weight above 0"),
        ("answer.rotations=3", "unknown value; found 3; required: one of 1, 2 or 4"),
    ],
)
def test_wrong_settings_are_one_sentence(override: str, message: str) -> None:
    with pytest.raises(CallError) as caught:
        read_settings(DonSettings, None, [override])
    assert message in str(caught.value)


def test_a_blank_picture_needs_a_picture_and_masks() -> None:
    for other in ("pairs.masks=false", "pairs.input=depth"):
        with pytest.raises(CallError, match=r"augment\.picture_drop: .*required: 0 unless"):
            read_settings(
                DonSettings, None, ["pairs.masks=true", other, "augment.picture_drop=0.1"]
            )


def test_the_target_narrows_over_the_first_half() -> None:
    loss = LossSettings(sigma_px=1.0, sigma_start_px=4.0)
    assert [loss.sigma_at(p) for p in (0.0, 0.25, 0.5, 1.0)] == pytest.approx([4.0, 2.0, 1.0, 1.0])
    assert LossSettings(sigma_px=1.5).sigma_at(0.1) == 1.5


def test_a_cloth_is_trained_with_another_recipe_than_a_rope(tiny_dataset: Path) -> None:
    """A rope may be turned any way; a blank cloth must lie as it lay, or no corner is told."""
    dataset = Dataset.open(tiny_dataset)
    rope = read_settings(DonSettings, shipped_recipe(dataset, "rope"))
    cloth = read_settings(DonSettings, shipped_recipe(dataset, "cloth-1"))
    assert rope.augment.rotate_deg == 180
    assert cloth.augment.rotate_deg < 45
    assert not cloth.loss.symmetric
    with pytest.raises(CallError, match="name the tier"):
        shipped_recipe(dataset, "")
    with pytest.raises(CallError, match="no such tier"):
        shipped_recipe(dataset, "sail")
