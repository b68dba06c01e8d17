"""Statistics over image pairs: ratios of sums, quantiles, bootstrap intervals, comparisons.

Intervals resample whole sequences, because the pairs of one sequence are not independent.
"""
