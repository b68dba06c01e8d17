"""How a dataset is published."""

from __future__ import annotations

import re
from dataclasses import dataclass
from datetime import date
from typing import Final

from pliant.spec.conventions import SPLITS
from pliant.spec.errors import CallError
from pliant.spec.storage.packing import SHARD_BYTES
from pliant.spec.text import name_fault

_LEAST_SHARD_BYTES: Final = 2**16
_URL: Final = re.compile(r"""[A-Za-z][A-Za-z0-9+.-]*:[^\s"'<>\\^`{|}]+""")


@dataclass(frozen=True)
class PublishSettings:
    """How a dataset is published.

    Attributes:
        hold_out: Splits whose answers go into the private half.
        shard_bytes: About how large a shard becomes.
        answers_are_public: Publish a set whose held-out answers anybody can generate again.
        authors: Who publishes it; empty names the dataset itself.
        url: Where it will be hosted, or None.
        date: Day of the release, YYYY-MM-DD, or None: then the papers carry none, and equal data
            gives equal bytes on any day.
    """

    hold_out: tuple[str, ...] = ()
    shard_bytes: int = SHARD_BYTES
    answers_are_public: bool = False
    authors: tuple[str, ...] = ()
    url: str | None = None
    date: str | None = None

    def __post_init__(self) -> None:
        for split in self.hold_out:
            if split not in SPLITS:
                raise CallError(
                    "unknown split", where="--hold-out", found=split, required=", ".join(SPLITS)
                )
        if self.shard_bytes < _LEAST_SHARD_BYTES:
            raise CallError(
                "shards would be too small",
                where="--shard-size",
                found=f"{self.shard_bytes} bytes",
                required=f">= {_LEAST_SHARD_BYTES}",
            )
        for name in self.authors:
            if (fault := name_fault(name)) is not None:
                raise CallError("invalid name of an author", where="--author", found=fault)
        if self.url is not None and not _URL.fullmatch(self.url):
            raise CallError(
                "this is not an address",
                where="--url",
                found=repr(self.url)[:100],
                required="such as https://… or hf://datasets/USER/NAME, without spaces",
            )
        if self.date is not None and not _is_day(self.date):
            raise CallError(
                "the date cannot be read", where="--date", found=self.date, required="YYYY-MM-DD"
            )


def _is_day(text: str) -> bool:
    try:
        return date.fromisoformat(text).isoformat() == text
    except ValueError:
        return False
