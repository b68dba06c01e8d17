"""Rate limit of failed sign-in attempts."""

from __future__ import annotations

import time
from collections import OrderedDict, deque
from typing import Final

from pliant.service.submissions import NotAcceptedError

_FAILURES_PER_MINUTE: Final = 10
_MOST_CLIENTS: Final = 10_000


class Throttle:
    """Counts events per client, and says when there are too many."""

    def __init__(self) -> None:
        self._times: OrderedDict[str, deque[float]] = OrderedDict()

    def check(self, client: str) -> None:
        """Refuse a client with too many events in the last minute."""
        times = self._times.get(client, deque())
        while times and times[0] < time.monotonic() - 60:
            times.popleft()
        if len(times) >= _FAILURES_PER_MINUTE:
            raise NotAcceptedError(
                "TOO_MANY_REQUESTS", 429, "too many wrong tokens", fix="Wait a minute."
            )

    def add(self, client: str) -> None:
        """Count an event."""
        self._times.setdefault(client, deque()).append(time.monotonic())
        self._times.move_to_end(client)
        while len(self._times) > _MOST_CLIENTS:
            self._times.popitem(last=False)
