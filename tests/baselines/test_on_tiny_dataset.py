"""What methods are given of rendered pictures."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from pliant.baselines.pixels import lies_on
from pliant.spec.dataset import Dataset
from tests.known import known

pytestmark = pytest.mark.blender


def test_masks_are_the_queried_object(tiny_dataset: Path) -> None:
    """The rope without its ball; queries lie on it to within a pixel of its edge."""
    dataset = Dataset.open(tiny_dataset)
    queries = dataset.queries("test")
    rope = next(s for s in dataset.sequences if s.tier == "rope" and s.split == "test")
    view = rope[0]
    surface = rope.surface(0)
    assert set(np.unique(surface.object_id)) == {0, 1, 2}
    np.testing.assert_array_equal(known(view.mask), surface.object_id == 1)
    assert view.depth_m is not None
    inside = []
    for row in queries.to_pylist()[::7]:
        mask = known(dataset.frame(row["sequence_a"], row["frame_a"]).mask)
        near = mask.copy()
        for axis in (0, 1):
            near = near | np.roll(near, 1, axis) | np.roll(near, -1, axis)
        uv_px = np.array([[row["u_a"], row["v_a"]]], dtype=np.float32)
        assert lies_on(uv_px, near)[0]
        inside.append(lies_on(uv_px, mask)[0])
    assert np.mean(inside) > 0.8
