"""Keypoint matches, scored through the dense truth of both frames.

A match counts where the matter under its source keypoint shows in the target; where it does not
show, the match cannot be right and is counted as not visible.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from pliant.evaluator.metrics.base import Groups, Metric, Positive, ScoringContext, Summary
from pliant.evaluator.metrics.blocks import Block
from pliant.evaluator.metrics.surface_images import dense_truth, nearest_object_pixel
from pliant.evaluator.submission.answers import PlacedMatches
from pliant.spec.configuration import Settings
from pliant.spec.conventions import OCCLUDED, VISIBLE


class MatchesSettings(Settings):
    """Settings of `matches`.

    Attributes:
        visible_within_footprints: The matter shows where a target pixel is within so many times
            what one pixel spans there.
    """

    visible_within_footprints: Positive


class Matches(Metric[MatchesSettings]):
    """How many matches there are, and on what they are."""

    Settings = MatchesSettings

    def update(self, block: Block) -> None:
        """Take in one block."""
        if block.source_on_object is None or block.target_on_object is None:
            return
        self.add_sums(
            block,
            matches=np.ones(len(block.state)),
            on_object=block.source_on_object,
            target_on_object=block.source_on_object & block.target_on_object,
        )

    def finish(self, groups: Groups, summary: Summary) -> None:
        """Add which pairs have a match that could be scored."""
        self.table.put("matched", slice(None), self.table.columns["counted"] > 0)


def match_blocks(
    found: PlacedMatches, context: ScoringContext, footprints: float
) -> Iterator[Block]:
    """Yield the matches of each pair that has some, with their truth.

    Args:
        found: The matches.
        context: What is scored.
        footprints: See `MatchesSettings`.

    Raises:
        SpecError: The dataset has no surface images of a pair.
    """
    queries, surfaces = context.queries, context.surfaces
    for pair in np.flatnonzero(np.diff(found.starts)).tolist():
        first, end = int(found.starts[pair]), int(found.starts[pair + 1])
        source, target = (
            surfaces.needed_frame(queries.sequences[sequence[pair]], int(frame[pair]))
            for sequence, frame in (
                (queries.sequence_a, queries.frame_a),
                (queries.sequence_b, queries.frame_b),
            )
        )
        queried = surfaces.queried(queries.tiers[queries.tier[pair]])
        truth = dense_truth(source, target, found.uv_a_px[first:end], queried, footprints)
        answer_px = found.uv_b_px[first:end]
        yield Block(
            first_row=first,
            first_pair=pair,
            starts=np.array([0, end - first]),
            true_px=truth.uv_b_px,
            state=np.where(truth.visible, VISIBLE, OCCLUDED).astype(np.uint8),
            answer_px=answer_px,
            missing=None,
            missing_px=queries.diagonal_px,
            source_on_object=truth.on_object,
            target_on_object=nearest_object_pixel(target.on_object, answer_px, 0)[2],
        )
