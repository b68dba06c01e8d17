"""The problems of a submission: those that a dataset's validation collects, all of one file."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

import numpy as np

from pliant.spec.arrays import BoolArray
from pliant.spec.errors import Issue
from pliant.spec.validation.findings import LISTED_PER_CODE, FileProblems, Findings, RowDescription
from pliant.spec.validation.issue_codes import make_issue

PLACES: Final = 3
"""So many places of one cause are named."""


class Problems(FileProblems):
    """The problems of one file, of which the first few of each code are put in words.

    Args:
        path: The file, as the user named it.

    Attributes:
        causes: One issue for each rule that is broken: the first problem in words, the first
            places, and how often.
        hints: Sentences about what looks wrong in a submission that can be scored.
    """

    def __init__(self, path: object) -> None:
        super().__init__(Findings(LISTED_PER_CODE), str(path))
        self.causes: list[Issue] = []
        self.hints: list[str] = []

    def __bool__(self) -> bool:
        return bool(self.counts)

    def add(self, code: str, where: str, message: str) -> None:
        """Add one problem: field, row or frame; found, required and what to do."""
        self.add_many(code, 1, [(where, message)])

    def differs(self, code: str, where: str, found: str, required: object) -> None:
        """Add one problem: something was found that is not what is required."""
        self.add(code, where, f"found {found}; required: {required}")

    def add_rows(self, code: str, bad: BoolArray, describe: RowDescription) -> None:
        """Add a problem for every true element; see `Findings.add_rows`."""
        super().add_rows(code, bad, describe)
        rows = np.flatnonzero(bad)
        if len(rows):
            self._add_cause(code, len(rows), [describe(row) for row in rows[:PLACES].tolist()])

    def add_many(self, code: str, count: int, described: Sequence[tuple[str, str]]) -> None:
        """Add `count` problems of one code, of which some are described by (where, message)."""
        for where, message in described:
            self.findings.add(code, self.path, where, message)
        self.counts[code] += count - len(described)
        self._add_cause(code, count, described)

    def include(self, other: Problems) -> None:
        """Add the problems that another process found in the same file."""
        self.findings.merge(other.findings)
        self.causes += other.causes

    def issues(self) -> list[Issue]:
        """Return the issues, and after those of a capped code one with their total."""
        result: list[Issue] = []
        for code, total in self.counts.items():
            listed = [issue for issue in self.findings.issues if issue.code == code]
            result += listed
            if total > len(listed):
                message = f"{total:,} in all; the first {len(listed)} are listed"
                result.append(make_issue(code, self.path, "", message))
        return result

    def _add_cause(self, code: str, count: int, described: Sequence[tuple[str, str]]) -> None:
        places = [where for where, _ in described[:PLACES] if where]
        places += ["…"] * bool(places and count > PLACES)
        message = described[0][1] + (f" ({count:,} times)" if count > 1 else "")
        self.causes.append(make_issue(code, self.path, "; ".join(places), message))
