"""Draws a sparse method's best keypoint matches of a pair, coloured by whether they are right."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np
import pyarrow.compute as pc

from pliant.evaluator.arrays import BoolArray, FloatArray
from pliant.evaluator.metrics.dense_truth import dense_truth
from pliant.evaluator.metrics.surfaces import Surfaces
from pliant.evaluator.protocols.protocol import read_protocol
from pliant.evaluator.report.drawings import Symbols, panel_svg, side_by_side
from pliant.spec.dataset import Dataset
from pliant.spec.errors import SpecError
from pliant.spec.io.parquet import read_table

RIGHT: Final = "#1b9e4b"
WRONG: Final = "#d8352a"


@dataclass(frozen=True)
class BestMatches:
    """The best matches of one pair.

    Attributes:
        svg: Both images with the matches as lines.
        drawn: Number of matches drawn, at most the number asked for.
        right: Number of them within `radius_px` of the truth.
        radius_px: Largest error of a right match, px.
    """

    svg: str
    drawn: int
    right: int
    radius_px: float


def best_matches(
    dataset: Dataset, split: str, submission: Path, pair_id: int, count: int = 10
) -> BestMatches:
    """Draw the matches of a pair that the method itself scores highest.

    Args:
        dataset: The dataset with images and surfaces.
        split: The split the matches are of.
        submission: A submission of kind `matches`.
        pair_id: The pair.
        count: How many matches at most.

    Returns:
        The drawing; a match is right if the material point under its source keypoint is visible
        in the target within a twentieth of the image's longer side of the match.

    Raises:
        SpecError: The dataset has no surface images of the pair.
    """
    queries = dataset.queries(split)
    pair = queries.filter(pc.equal(queries["pair_id"], pair_id)).slice(0, 1).to_pylist()[0]
    table = read_table(submission, "matches")
    mine = table.filter(pc.equal(table["pair_id"], pair_id))
    order = np.argsort(-mine["score"].to_numpy(), kind="stable")[:count]
    uv_a, uv_b = (
        np.stack([mine[name].to_numpy()[order] for name in names], axis=1).astype(np.float64)
        for names in (("u_a", "v_a"), ("u", "v"))
    )
    width, height = dataset.sequence(pair["sequence_a"]).size
    radius_px = max(width, height) / 20
    right = _is_right(dataset, pair, uv_a, uv_b, radius_px)
    return BestMatches(
        _draw(dataset, pair, uv_a, uv_b, right), len(order), int(right.sum()), radius_px
    )


def _is_right(
    dataset: Dataset, pair: dict[str, Any], uv_a: FloatArray, uv_b: FloatArray, radius_px: float
) -> BoolArray:
    surfaces = Surfaces(dataset)
    source, target = (
        surfaces.frame(pair[f"sequence_{side}"], pair[f"frame_{side}"]) for side in "ab"
    )
    if source is None or target is None:
        raise SpecError("the pair has no surface images", path=dataset.root, where=str(pair))
    footprints = read_protocol("matches").settings["matches"].visible_within_footprints
    truth = dense_truth(
        source, target, uv_a, dataset.tiers[pair["tier"]].queried, float(footprints)
    )
    error_px = np.linalg.norm(uv_b - truth.uv_b_px, axis=1)
    return truth.visible & (np.nan_to_num(error_px, nan=np.inf) <= radius_px)


def _draw(
    dataset: Dataset, pair: dict[str, Any], uv_a: FloatArray, uv_b: FloatArray, right: BoolArray
) -> str:
    size = dataset.sequence(pair["sequence_a"]).size
    draw = Symbols(size[0])
    source, target = (
        panel_svg(dataset, pair[f"sequence_{side}"], pair[f"frame_{side}"], size) for side in "ab"
    )
    shown_b = uv_b + np.array([draw.target_px, 0.0])
    over = ""
    for a, b, good in zip(uv_a, shown_b, right, strict=True):
        colour = RIGHT if good else WRONG
        over += draw.line(a, b, colour) + draw.disc(a, colour) + draw.disc(b, colour)
    return side_by_side(source, target, size, "best matches", over)
