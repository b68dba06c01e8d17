"""Statistics over image pairs: ratios of sums, quantiles, bootstrap intervals, comparisons.

Intervals resample both sequences of every pair, because pairs that share one are not independent.
"""
