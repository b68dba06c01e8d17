"""A split is walked in blocks of whole pairs: their size changes no figure."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pytest

from pliant.evaluator import evaluate, scoring
from pliant.evaluator.metrics import blocks
from tests.evaluator.figures import assert_same
from tests.evaluator.references import answers_of


@pytest.mark.parametrize("kind", ["sigma", "holes"])
def test_a_block_for_each_pair_gives_the_figures_of_one_block(
    kind: str, scene: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    table = answers_of(scene, 3, kind)
    path = scene.submit(tmp_path / "s.parquet", table)
    whole = evaluate(path, scene.root, allow_missing=True)
    assert sum(whole.per_pair["answered"].to_pylist()) == table.num_rows
    assert not {"geodesic", "causes"} & set(whole.document["notes"])  # no pair is left out
    monkeypatch.setattr(scoring, "_PAIRS_WITH_IMAGES", 1)
    split = evaluate(path, scene.root, allow_missing=True)
    for name in ("overall", "tiers", "curves", "slices", "causes"):
        # The last digits of sums depend on the order of their terms.
        assert_same(split.document[name], whole.document[name], name, 1e-12)
    assert split.per_pair.column_names == whole.per_pair.column_names
    for name in whole.per_pair.column_names:
        assert split.per_pair[name].to_pylist() == whole.per_pair[name].to_pylist(), name


def test_partners_of_several_chunks_follow_each_other() -> None:
    def place(u: float, visibility: str) -> dict[str, Any]:
        return {"u": u, "v": u + 0.5, "visibility": visibility}

    rows = [[], [place(1, "visible"), place(2, "occluded")], [place(3, "visible")]]
    column = pa.array(rows)
    whole = pa.chunked_array([column.slice(0, 2), column.slice(2), column.slice(1)])
    found = blocks._partners(whole)
    np.testing.assert_array_equal(found.begin, [0, 0, 2, 3, 5, 6])
    np.testing.assert_array_equal(found.uv_px[:, 0], [1, 2, 3, 1, 2, 3])
    np.testing.assert_array_equal(found.uv_px[:, 1], found.uv_px[:, 0] + 0.5)
    np.testing.assert_array_equal(found.visible, [True, False, True, True, False, True])
