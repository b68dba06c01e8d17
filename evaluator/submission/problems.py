"""Collects a submission's problems: every kind with its true total, the first few in words."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Final

from pliant.spec.errors import Issue
from pliant.spec.validation.issue_codes import make_issue

LISTED_PER_CODE: Final = 20
"""So many issues of one code are written out; the total is always told."""


class Problems:
    """The problems of one file, capped per code, counted in full.

    Args:
        path: The file they are about, as the user named it.
        listed: So many of one code are written out.

    Attributes:
        hints: Sentences about what looks wrong in a submission that can be scored.
    """

    def __init__(self, path: Path | str, *, listed: int = LISTED_PER_CODE) -> None:
        self.path = str(path)
        self._listed = listed
        self._issues: dict[str, list[Issue]] = {}
        self._totals: dict[str, int] = {}
        self.hints: list[str] = []

    def __bool__(self) -> bool:
        return bool(self._totals)

    @property
    def total(self) -> int:
        """Problems found, listed or not."""
        return sum(self._totals.values())

    @property
    def totals(self) -> dict[str, int]:
        """Problems found of each code, listed or not."""
        return dict(self._totals)

    def add(self, code: str, where: str, message: str) -> None:
        """Add one problem.

        Args:
            code: A code of the catalogue.
            where: Column, row or footer field; empty for the whole file.
            message: What was found, what is required and what to do.
        """
        self.add_many(code, 1, [(where, message)])

    def add_many(self, code: str, count: int, described: Iterable[tuple[str, str]]) -> None:
        """Add `count` problems of one code, of which `described` yields (where, message)."""
        if count <= 0:
            return
        issues = self._issues.setdefault(code, [])
        self._totals[code] = self._totals.get(code, 0) + count
        for where, message in described:
            if len(issues) >= self._listed:
                break
            issues.append(make_issue(code, self.path, where, message))

    def add_rows(
        self, code: str, rows: Iterable[int], count: int, describe: Callable[[int], tuple[str, str]]
    ) -> None:
        """Add `count` problems, one a row; `describe` is called only for those listed."""
        self.add_many(code, count, (describe(int(row)) for row in rows))

    def issues(self) -> list[Issue]:
        """Return the issues, and after a capped code one line that tells its total."""
        result: list[Issue] = []
        for code, issues in self._issues.items():
            result += issues
            total = self._totals[code]
            if total > len(issues):
                result.append(
                    make_issue(
                        code, self.path, "", f"{total:,} in all; the first {len(issues)} are listed"
                    )
                )
        return result
