"""Following a rope through its mask, from one end to the other."""

from pliant.baselines.tracing.crossings import Crossing, Overlap, overlap, self_crossings
from pliant.baselines.tracing.hypotheses import Likelihood, Trace, rope_traces
from pliant.baselines.tracing.rectification import Rectified, rectified
from pliant.baselines.tracing.rope_tracer import RopeTracer
from pliant.baselines.tracing.transfer import best_pairs, transferred

__all__ = [
    "Crossing",
    "Likelihood",
    "Overlap",
    "Rectified",
    "RopeTracer",
    "Trace",
    "best_pairs",
    "overlap",
    "rectified",
    "rope_traces",
    "self_crossings",
    "transferred",
]
