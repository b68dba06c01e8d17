"""Compare a scores.json with the golden one: every number that the golden file holds must match."""

from __future__ import annotations

import json
import math
import sys
from pathlib import Path


def differences(found: object, golden: object, place: str = "") -> list[str]:
    """Return the places where `found` does not hold what `golden` holds."""
    if isinstance(golden, dict):
        if not isinstance(found, dict):
            return [f"{place}: {found!r} is no object"]
        return [
            line
            for key, value in golden.items()
            for line in differences(found.get(key), value, f"{place}/{key}")
        ]
    if isinstance(golden, list) and isinstance(found, list) and len(golden) == len(found):
        return [
            line
            for index, values in enumerate(zip(found, golden, strict=True))
            for line in differences(*values, f"{place}/{index}")
        ]
    if isinstance(golden, float) and isinstance(found, int | float):
        close = math.isclose(found, golden, rel_tol=1e-9, abs_tol=1e-9)
        return [] if close else [f"{place}: found {found!r}, golden {golden!r}"]
    return [] if found == golden else [f"{place}: found {found!r}, golden {golden!r}"]


if __name__ == "__main__":
    scores, golden = (json.loads(Path(name).read_text()) for name in sys.argv[1:3])
    wrong = differences(scores, golden)
    sys.exit("\n".join(wrong) if wrong else 0)
