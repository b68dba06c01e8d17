"""Number of available CPU cores."""

from __future__ import annotations

import os


def cpu_cores() -> int:
    """Return how many CPU cores this process may use, >= 1.

    On Linux that can be fewer than the machine has (containers, `taskset`). macOS restricts no
    process, and knows no `sched_getaffinity`.
    """
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1
