"""The part of `benchmarks/` that is installed: what `pliant benchmark` runs."""
