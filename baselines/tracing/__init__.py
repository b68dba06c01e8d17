"""Following a rope through its mask, from one end to the other."""

from pliant.baselines.tracing.hypotheses import Likelihood, Trace, rope_traces
from pliant.baselines.tracing.rectification import Rectified, rectified
from pliant.baselines.tracing.rope_tracer import RopeTracer
from pliant.baselines.tracing.transfer import best_pairs, transferred

__all__ = [
    "Likelihood",
    "Rectified",
    "RopeTracer",
    "Trace",
    "best_pairs",
    "rectified",
    "rope_traces",
    "transferred",
]
