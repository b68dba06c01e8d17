"""What a submission may contain, whichever protocol scores it."""

from __future__ import annotations

from typing import Final

MAX_POSITION_PX: Final = 1e6
"""|u| and |v| of an answer. A position outside the image is an answer like any other and is
scored by its distance; a number beyond this bound is none."""

MAX_SIGMA_PX: Final = 1e6
"""Largest standard deviation."""

MAX_MODES: Final = 64
"""Largest number of modes in one row."""

WEIGHT_TOLERANCE: Final = 1e-3
"""The weights of a row's modes sum to 1 within this."""

MAX_SUBMISSION_BYTES: Final = 16 * 2**30
"""Largest file."""

MAX_EXCESS_ROWS: Final = 1_000_000
"""So many rows more than there are queries are still read, to name the superfluous ones."""

MAX_MATCHES_PER_PAIR: Final = 100_000
"""Largest number of keypoint matches of one image pair."""
