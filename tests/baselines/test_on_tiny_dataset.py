"""What methods are given of rendered pictures."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from pliant.spec.dataset import Dataset
from tests.known import known

pytestmark = pytest.mark.blender


def test_masks_are_the_queried_object(tiny_dataset: Path) -> None:
    """The rope without its ball."""
    dataset = Dataset.open(tiny_dataset)
    rope = next(s for s in dataset.sequences if s.tier == "rope" and s.split == "test")
    view = rope[0]
    surface = rope.surface(0)
    assert set(np.unique(surface.object_id)) == {0, 1, 2}
    np.testing.assert_array_equal(known(view.mask), surface.object_id == 1)
    assert view.depth_m is not None
