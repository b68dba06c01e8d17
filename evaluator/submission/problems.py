"""The problems of a submission: those that a dataset's validation collects, all of one file."""

from __future__ import annotations

from collections.abc import Sequence

from pliant.spec.errors import Issue
from pliant.spec.validation.findings import LISTED_PER_CODE, FileProblems, Findings
from pliant.spec.validation.issue_codes import make_issue


class Problems(FileProblems):
    """The problems of one file, of which the first few of each code are put in words.

    Args:
        path: The file, as the user named it.
        listed: Number of problems of one code that are put in words.

    Attributes:
        hints: Sentences about what looks wrong in a submission that can be scored.
    """

    def __init__(self, path: object, *, listed: int = LISTED_PER_CODE) -> None:
        super().__init__(Findings(listed), str(path))
        self.hints: list[str] = []

    def __bool__(self) -> bool:
        return bool(self.counts)

    def differs(self, code: str, where: str, found: str, required: object) -> None:
        """Add one problem: something was found that is not what is required."""
        self.add(code, where, f"found {found}; required: {required}")

    def add_many(self, code: str, count: int, described: Sequence[tuple[str, str]]) -> None:
        """Add `count` problems of one code, of which some are described by (where, message)."""
        for where, message in described:
            self.add(code, where, message)
        self.counts[code] = self.counts.get(code, 0) + count - len(described)

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
