"""The problems of a submission: those that a dataset's validation collects, all of one file."""

from __future__ import annotations

from collections.abc import Sequence

from pliant.evaluator.arrays import BoolArray
from pliant.spec.errors import Issue
from pliant.spec.validation.findings import LISTED_PER_CODE, Findings, RowDescription
from pliant.spec.validation.issue_codes import make_issue


class Problems:
    """The problems of one file, of which the first few of each code are put in words.

    Args:
        path: The file, as the user named it.
        listed: Number of problems of one code that are put in words.

    Attributes:
        hints: Sentences about what looks wrong in a submission that can be scored.
    """

    def __init__(self, path: object, *, listed: int = LISTED_PER_CODE) -> None:
        self.path = str(path)
        self.hints: list[str] = []
        self._found = Findings(listed)

    def __bool__(self) -> bool:
        return bool(self.totals)

    @property
    def total(self) -> int:
        """Number of problems, listed or not."""
        return self._found.total

    @property
    def totals(self) -> dict[str, int]:
        """Code -> number of problems, listed or not."""
        return self._found.counts

    def add(self, code: str, where: str, message: str) -> None:
        """Add one problem.

        Args:
            code: A code of the catalogue.
            where: Column, row or footer field; empty for the whole file.
            message: What was found, what is required and what to do.
        """
        self._found.add(code, self.path, where, message)

    def differs(self, code: str, where: str, found: str, required: object) -> None:
        """Add one problem: something was found that is not what is required."""
        self.add(code, where, f"found {found}; required: {required}")

    def add_many(self, code: str, count: int, described: Sequence[tuple[str, str]]) -> None:
        """Add `count` problems of one code, of which some are described by (where, message)."""
        for where, message in described:
            self.add(code, where, message)
        self.totals[code] = self.totals.get(code, 0) + count - len(described)

    def add_rows(self, code: str, wrong: BoolArray, describe: RowDescription) -> None:
        """Add a problem for every true element; see `Findings.add_rows`."""
        self._found.add_rows(code, self.path, wrong, describe)

    def issues(self) -> list[Issue]:
        """Return the issues, and after those of a capped code one with their total."""
        result: list[Issue] = []
        for code, total in self.totals.items():
            listed = [issue for issue in self._found.issues if issue.code == code]
            result += listed
            if total > len(listed):
                message = f"{total:,} in all; the first {len(listed)} are listed"
                result.append(make_issue(code, self.path, "", message))
        return result
