"""Traces a rope in its mask, from one end to the other."""

from pliant.baselines.tracing.crossings import Crossing, Overlap, VisibleStrand, self_crossings
from pliant.baselines.tracing.hypotheses import Likelihood, Trace, rope_traces
from pliant.baselines.tracing.mask_shape import MaskShape, half_width_px, has_ball
from pliant.baselines.tracing.reframing import Reframed, rectified, untilted
from pliant.baselines.tracing.rope_tracer import RopeTracer, rope_remarks
from pliant.baselines.tracing.strands import Skeleton
from pliant.baselines.tracing.tilt import Nadir
from pliant.baselines.tracing.transfer import (
    Located,
    completed,
    located,
    pair_log_odds,
    placed,
    with_cut_ends,
)

__all__ = [
    "Crossing",
    "Likelihood",
    "Located",
    "MaskShape",
    "Nadir",
    "Overlap",
    "Reframed",
    "RopeTracer",
    "Skeleton",
    "Trace",
    "VisibleStrand",
    "completed",
    "half_width_px",
    "has_ball",
    "located",
    "pair_log_odds",
    "placed",
    "rectified",
    "rope_remarks",
    "rope_traces",
    "self_crossings",
    "untilted",
    "with_cut_ends",
]
