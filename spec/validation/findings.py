"""What a validation run has found: every problem counted, the first few of a kind in words."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field

import numpy as np
import numpy.typing as npt

from pliant.spec.errors import Issue
from pliant.spec.io.reading import FileRefusedError
from pliant.spec.validation.issue_codes import make_issue

RowDescription = Callable[[int], tuple[str, str]]

LISTED_PER_CODE = 20
"""So many issues of one code are put in words for one file set; all are counted."""


@dataclass
class Findings:
    """The problems of one part of a dataset.

    Attributes:
        listed_per_code: So many of one code are kept in words.
        issues: Those kept.
        counts: Code -> how many there are.
        diagnoses: (code, cause) -> (file, rows) of every file that has this one cause.
    """

    listed_per_code: int = LISTED_PER_CODE
    issues: list[Issue] = field(default_factory=list)
    counts: Counter[str] = field(default_factory=Counter)
    diagnoses: dict[tuple[str, str], list[tuple[str, int]]] = field(default_factory=dict)

    def add(self, code: str, path: str, where: str, message: str) -> None:
        """Add one problem; arguments as `make_issue`."""
        if self.counts[code] < self.listed_per_code:
            self.issues.append(make_issue(code, path, where, message))
        self.counts[code] += 1

    def listed(self) -> list[Issue]:
        """Return the issues in words: one for each diagnosis, then those without."""
        found = []
        for (code, cause), files in self.diagnoses.items():
            rows = sum(count for _, count in files)
            message = f"all {rows:,} rows {cause}" if rows else cause
            where = f"and {len(files) - 1} more files" if len(files) > 1 else ""
            found.append(make_issue(code, files[0][0], where, message))
        return [*found, *self.issues]

    def merge(self, other: Findings) -> None:
        """Add the problems of another part."""
        for key, files in other.diagnoses.items():
            self.diagnoses.setdefault(key, []).extend(files)
        listed = self.counts.copy()
        for issue in other.issues:
            if listed[issue.code] < self.listed_per_code:
                self.issues.append(issue)
            listed[issue.code] += 1
        self.counts += other.counts

    @property
    def total(self) -> int:
        """How many problems there are."""
        return sum(self.counts.values())

    def at(self, path: str) -> FileProblems:
        """Return what adds problems of one file; its path is relative to the dataset."""
        return FileProblems(self, path)


@dataclass
class FileProblems:
    """Adds the problems of one file to the findings.

    Attributes:
        findings: Where they go.
        path: The file's path in issues.
    """

    findings: Findings
    path: str

    @property
    def counts(self) -> Counter[str]:
        """Code -> how many there are, of this file and all others."""
        return self.findings.counts

    @property
    def total(self) -> int:
        """How many there are, of this file and all others."""
        return self.findings.total

    def add(self, code: str, where: str, message: str) -> None:
        """Add one problem: field, row or frame; found, required and what to do."""
        self.findings.add(code, self.path, where, message)

    def add_rows(self, code: str, bad: npt.NDArray[np.bool_], describe: RowDescription) -> None:
        """Add a problem for every true element.

        Args:
            code: Issue code.
            bad: bool (N,), True where the rule is broken.
            describe: Takes an index and returns (where, message); called for those listed.
        """
        indices = np.flatnonzero(bad)
        for index in indices[: max(0, self.findings.listed_per_code - self.counts[code])]:
            where, message = describe(int(index))
            self.findings.issues.append(make_issue(code, self.path, where, message))
        if indices.size:
            self.counts[code] += int(indices.size)

    def diagnose(self, code: str, cause: str) -> None:
        """Explain every problem of one code by one cause.

        One issue then replaces those of the code listed so far, and their number stays. Equal
        causes of several files become one issue.

        Args:
            code: Issue code.
            cause: If rows have this code: what they do, in the plural. Otherwise a sentence; it
                counts as one problem.
        """
        findings = self.findings
        rows = self.counts[code]
        self.counts[code] = max(rows, 1)
        findings.issues = [issue for issue in findings.issues if issue.code != code]
        findings.diagnoses.setdefault((code, cause), []).append((self.path, rows))

    @contextmanager
    def refusals(self) -> Iterator[None]:
        """Turn the refusal of the file inside the block into an issue; the block then ends."""
        try:
            yield
        except FileRefusedError as error:
            self.add(error.code, error.where or "", error.without_place())
