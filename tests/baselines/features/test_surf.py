"""SURF: what ran is named, and it needs its extra."""

from __future__ import annotations

import sys

import numpy as np
import pytest

from pliant.baselines.features.surf import MahotasSurf
from pliant.baselines.methods import local_feature
from pliant.spec.errors import MissingExtraError


def test_the_library_is_named() -> None:
    facts = local_feature("surf").describe()
    assert (facts["name"], facts["implementation"]) == ("surf", "mahotas")
    assert facts["version"]


def test_a_missing_library_is_said_in_one_sentence(monkeypatch: pytest.MonkeyPatch) -> None:
    for name in ("mahotas", "mahotas.features"):
        monkeypatch.setitem(sys.modules, name, None)
    with pytest.raises(MissingExtraError, match=r"pip install 'pliant\[classical\]'") as caught:
        local_feature("surf")
    assert caught.value.exit_code == 2


def test_points_near_the_edge_are_described() -> None:
    image = np.random.default_rng(0).integers(0, 256, (90, 120)).astype(np.uint8)
    found = MahotasSurf().detect(image)
    assert len(found.uv_px) == len(found.descriptors) > 10
    corners = np.array([[0.5, 0.5], [119.5, 89.5]], dtype=np.float32)
    described = MahotasSurf().describe_at(image, corners)
    np.testing.assert_allclose(np.linalg.norm(described, axis=1), 1, rtol=1e-5)
