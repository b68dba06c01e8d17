"""Draws a sparse method's best keypoint matches of a pair, coloured by whether they are right."""

from __future__ import annotations

from pathlib import Path
from typing import Final

import numpy as np
import pyarrow.compute as pc

from pliant.evaluator.metrics.surface_images import dense_truth
from pliant.evaluator.metrics.surfaces import Surfaces
from pliant.evaluator.protocols.protocol import read_protocol
from pliant.evaluator.report.drawings import Symbols, panel_svg, side_by_side
from pliant.spec.arrays import BoolArray, FloatArray
from pliant.spec.dataset import Dataset
from pliant.spec.io.parquet import read_table
from pliant.spec.io.parquet_columns import stacked
from pliant.spec.queries import QueryPair
from pliant.spec.sequence import RecordedFrame

RIGHT: Final = "#1b9e4b"
WRONG: Final = "#d8352a"
_SHOWN: Final = 10


def best_matches(dataset: Dataset, pair: QueryPair, submission: Path) -> tuple[str, str]:
    """Draw the ten matches of a pair that the method itself scores highest.

    Args:
        dataset: The dataset with images and surfaces.
        pair: The pair.
        submission: A submission of kind `matches`.

    Returns:
        What is drawn, in words, and both images with the matches as lines (SVG). A match is right
        if the material point under its source keypoint is visible in the target within a twentieth
        of the image's longer side of the match.

    Raises:
        SpecError: The dataset has no surface images of the pair.
    """
    table = read_table(submission, "matches")
    mine = table.filter(pc.equal(table["pair_id"], pair.pair_id))
    order = np.argsort(-mine["score"].to_numpy(), kind="stable")[:_SHOWN]
    uv_a, uv_b = (
        stacked(mine, *names)[order].astype(np.float64) for names in (("u_a", "v_a"), ("u", "v"))
    )
    size = pair.source.size
    radius_px = max(size) / 20
    right = _is_right(dataset, pair, uv_a, uv_b, radius_px)
    draw = Symbols(size[0])
    over = ""
    for a, b, good in zip(uv_a, uv_b + np.array([draw.target_px, 0.0]), right, strict=True):
        colour = RIGHT if good else WRONG
        over += draw.line(a, b, colour) + draw.disc(a, colour) + draw.disc(b, colour)
    source, target = (
        panel_svg(dataset, *_place(each), size) for each in (pair.source, pair.target)
    )
    svg = side_by_side(source, target, size, "best matches", over)
    if not len(order):
        return "no match on this pair", svg
    words = f"{right.sum()} of its {len(order)} best matches within {radius_px:.0f} px (green)"
    return words, svg


def _is_right(
    dataset: Dataset, pair: QueryPair, uv_a: FloatArray, uv_b: FloatArray, radius_px: float
) -> BoolArray:
    surfaces = Surfaces(dataset)
    source, target = (surfaces.needed_frame(*_place(each)) for each in (pair.source, pair.target))
    footprints = read_protocol("matches").settings["matches"].visible_within_footprints
    queried = dataset.tiers[pair.source.sequence.tier].queried
    truth = dense_truth(source, target, uv_a, queried, float(footprints))
    error_px = np.linalg.norm(uv_b - truth.uv_b_px, axis=1)
    return truth.visible & (np.nan_to_num(error_px, nan=np.inf) <= radius_px)


def _place(frame: RecordedFrame) -> tuple[str, int]:
    return frame.sequence.id, frame.index
