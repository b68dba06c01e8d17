"""A value that may be missing elsewhere, and is there in this test."""

from __future__ import annotations

from typing import TypeVar

Value = TypeVar("Value")


def known(value: Value | None) -> Value:
    """Return a value that is not None; where it is, the test fails."""
    assert value is not None
    return value
