"""TimeCycle: correspondence learned from the cycle-consistency of time (Wang et al. 2019)."""

from typing import Final

CARRIED: Final = "carried:"
"""`carried:MODEL` is a method's name; see `carried.py`."""
