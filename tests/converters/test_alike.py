"""Points that look alike become alternatives; a made-up set in the layout of aRTF."""

from __future__ import annotations

import json
from itertools import chain
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image, ImageDraw

from pliant import evaluate
from pliant.converters.alike import alike
from pliant.spec.errors import CallError
from pliant.spec.io.parquet import read_table
from tests.converters.conftest import Rejected
from tests.converters.importing import imported

CORNERS = ("corner0", "corner1", "corner2", "corner3")
SHOWN = (
    [(20, 15), (90, 20), (85, 50), (18, 48)],
    [(30, 10), (80, 12), (84, 55), (26, 52)],
    [(40, 8), (100, 30), (70, 58), (22, 40)],
)


def artf(root: Path, *, unlabelled: bool = False) -> Path:
    """Three towels in `towels-test_resized_512x256/`; a corner of the last may lack its label."""
    folder = root / "towels-test_resized_512x256"
    (folder / "images").mkdir(parents=True)
    images, annotations = [], []
    for number, corners in enumerate(SHOWN):
        picture = Image.new("RGB", (128, 64), (40 * number, 90, 120))
        ImageDraw.Draw(picture).polygon(corners, fill=(240, 230, 210))
        picture.save(folder / f"images/{number}.png")
        size = {"width": 128, "height": 64}
        images.append({"id": number, "file_name": f"images/{number}.png", **size})
        triples = [[u, v, 2] for u, v in corners]
        if unlabelled and number == 2:
            triples[3] = [0, 0, 0]
        annotations.append(
            {"id": number, "image_id": number, "category_id": 1, "keypoints": list(chain(*triples))}
        )
    category = {"id": 1, "name": "towel", "keypoints": list(CORNERS)}
    document = {"images": images, "annotations": annotations, "categories": [category]}
    path = folder / "towels-test.json"
    path.write_text(json.dumps(document))
    return path


Rows = list[dict[str, Any]]


def towels(root: Path, **of: bool) -> tuple[Rows, Rows]:
    """Import the towels; return queries and truth."""
    out = root / "ARTF"
    dataset = imported(artf(root, **of), out, "--kind", "towel", "--alike", ",".join(CORNERS))
    assert len(dataset.tiers["ARTF"].symmetries) == 7
    assert "symmetries" not in json.loads((out / "dataset.json").read_bytes())["description"]
    queries = read_table(out / "queries" / "test.parquet", "queries").to_pylist()
    return queries, read_table(root / "ARTF-truth" / "test.parquet", "truth").to_pylist()


def scored(root: Path, uv_px: list[tuple[float, ...]]) -> list[float]:
    """RMSE: strict, under the best map of each pair, and under that of each point."""
    truth = root / "ARTF-truth" / "test.parquet"
    figures = evaluate(root / "ARTF", np.array(uv_px), truth=truth).overall
    names = ("rmse_px", "symmetric_rmse_px", "point_symmetric_rmse_px")
    return [figures[name] or 0.0 for name in names]


def test_corners_of_a_towel_are_alternatives(tmp_path: Path) -> None:
    """Answers that are a quarter turn off score perfectly where symmetries are forgiven."""
    exact: list[tuple[float, ...]] = []
    turned: list[tuple[float, ...]] = []
    for query, row in zip(*towels(tmp_path), strict=True):
        shown = [tuple(map(float, corner)) for corner in SHOWN[query["frame_b"]]]
        corner = shown.index((row["u_b"], row["v_b"]))
        places = [(each["u"], each["v"]) for each in row["alternatives"]]
        # Of the seven maps one keeps a corner, two move it to each of the others.
        assert sorted(places) == sorted(
            [shown[corner], *2 * (shown[:corner] + shown[corner + 1 :])]
        )
        exact.append(shown[corner])
        turned.append(shown[(corner + 1) % 4])
    assert scored(tmp_path, exact) == [0.0, 0.0, 0.0]
    strict, by_pair, by_point = scored(tmp_path, turned)
    assert strict > 20
    assert (by_pair, by_point) == (0.0, 0.0)


def test_a_corner_without_a_label_is_no_alternative(tmp_path: Path) -> None:
    queries, truth = towels(tmp_path, unlabelled=True)
    alternatives = [
        each
        for query, row in zip(queries, truth, strict=True)
        for each in row["alternatives"]
        if query["frame_b"] == 2
    ]
    assert {each["visibility"] for each in alternatives} == {"visible", "out_of_frame"}
    unlabelled = [each for each in alternatives if each["visibility"] == "out_of_frame"]
    assert {(each["u"], each["v"]) for each in unlabelled} == {(-1, -1)}
    assert scored(tmp_path, [(row["u_b"], row["v_b"]) for row in truth]) == [0.0, 0.0, 0.0]


@pytest.mark.parametrize(
    ("groups", "required"),
    [
        (("a,b,c",), "two names each"),
        (("a,b", "a,c"), "every point once"),
        (("a,b", "c,d,e,f"), "two names each"),
        (("a,",), "every point once"),
    ],
)
def test_wrong_groups_are_one_sentence(groups: tuple[str, ...], required: str) -> None:
    with pytest.raises(CallError, match=required):
        alike(groups)


def test_left_and_right_are_exchanged_together() -> None:
    (swap,) = alike(["hip_left,hip_right", "knee_left,knee_right"])
    assert swap.renamed["hip_left"] == "hip_right"
    assert swap.renamed["knee_right"] == "knee_left"


def test_a_corner_that_is_not_annotated_is_named(tmp_path: Path, rejected: Rejected) -> None:
    said = rejected(artf(tmp_path), "--alike", "corner0,corner9", code=2)
    assert "found corner9; required: one of corner0, corner1" in said
