"""What a competition platform runs: the scoring of `pliant evaluate`, and the programs around it.

The bundles that carry it are written by `pliant.publishing.competition`.
"""
