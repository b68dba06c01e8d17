"""Draws a sparse method's best keypoint matches of a pair, coloured by whether they are right."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np
import pyarrow.compute as pc

from pliant.evaluator.arrays import BoolArray, FloatArray
from pliant.evaluator.protocols.protocol import read_protocol
from pliant.evaluator.report.drawings import PAIR_GAP, panel_svg
from pliant.evaluator.scorers.match_scoring import dense_truth
from pliant.evaluator.scorers.surfaces import Surfaces
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
        drawn: How many matches there were to draw, at most the number asked for.
        right: How many of them lie within `radius_px` of the truth.
        radius_px: What counted as right, px.
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
        The drawing; a match is right if the matter under its source keypoint shows in the
        target within a twentieth of the image's longer side of where the match says.

    Raises:
        SpecError: The dataset holds no surface image of the pair.
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
    footprints = read_protocol("matches").metrics["matches"]["visible_within_footprints"]
    truth = dense_truth(
        source, target, uv_a, dataset.tiers[pair["tier"]].queried, float(footprints)
    )
    error_px = np.linalg.norm(uv_b - truth.uv_b_px, axis=1)
    return truth.visible & (np.nan_to_num(error_px, nan=np.inf) <= radius_px)


def _draw(
    dataset: Dataset, pair: dict[str, Any], uv_a: FloatArray, uv_b: FloatArray, right: BoolArray
) -> str:
    size = dataset.sequence(pair["sequence_a"]).size
    width, height = size
    unit = width / 160  # symbols keep their size relative to the picture
    shift = width + PAIR_GAP * unit
    parts = [
        f'<svg class="pair" role="img" aria-label="best matches" '
        f'viewBox="0 0 {shift + width:g} {height:g}" xmlns="http://www.w3.org/2000/svg">',
        panel_svg(dataset, pair["sequence_a"], pair["frame_a"], 0.0, size),
        panel_svg(dataset, pair["sequence_b"], pair["frame_b"], shift, size),
    ]
    for (ua, va), (ub, vb), good in zip(uv_a, uv_b, right, strict=True):
        colour = RIGHT if good else WRONG
        parts.append(
            f'<path d="M{ua:.1f} {va:.1f}L{ub + shift:.1f} {vb:.1f}" stroke="{colour}" '
            f'stroke-width="{0.7 * unit:g}" stroke-opacity="0.9" fill="none"/>'
        )
        for u, v in ((ua, va), (ub + shift, vb)):
            parts.append(
                f'<circle cx="{u:.1f}" cy="{v:.1f}" r="{1.3 * unit:g}" fill="{colour}" '
                f'stroke="#fff" stroke-width="{0.35 * unit:g}"/>'
            )
    return "".join([*parts, "</svg>"])
