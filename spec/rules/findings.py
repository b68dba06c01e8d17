"""What a validation run has found: every problem counted, the first few of a kind in words."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field

import numpy as np
import numpy.typing as npt

from pliant.spec.errors import Issue
from pliant.spec.issue_codes import make_issue
from pliant.spec.reading import FileRefusedError

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
    """

    listed_per_code: int = LISTED_PER_CODE
    issues: list[Issue] = field(default_factory=list)
    counts: dict[str, int] = field(default_factory=dict)

    def add(self, code: str, path: str, where: str, message: str) -> None:
        """Add one problem; arguments as `make_issue`."""
        seen = self.counts.get(code, 0)
        self.counts[code] = seen + 1
        if seen < self.listed_per_code:
            self.issues.append(make_issue(code, path, where, message))

    def add_rows(
        self,
        code: str,
        path: str,
        bad: npt.NDArray[np.bool_],
        describe: RowDescription,
    ) -> None:
        """Add a problem for every true element.

        Args:
            code: Issue code.
            path: The file.
            bad: bool (N,), True where the rule is broken.
            describe: Takes an index and returns (where, message); called for those listed.
        """
        indices = np.flatnonzero(bad)
        seen = self.counts.get(code, 0)
        if indices.size:
            self.counts[code] = seen + int(indices.size)
        for index in indices[: max(0, self.listed_per_code - seen)]:
            where, message = describe(int(index))
            self.issues.append(make_issue(code, path, where, message))

    def merge(self, other: Findings) -> None:
        """Add the problems of another part."""
        listed = {code: 0 for code in other.counts}
        for issue in other.issues:
            kept = self.counts.get(issue.code, 0) + listed[issue.code]
            if kept < self.listed_per_code:
                self.issues.append(issue)
            listed[issue.code] += 1
        for code, count in other.counts.items():
            self.counts[code] = self.counts.get(code, 0) + count

    @property
    def total(self) -> int:
        """How many problems there are."""
        return sum(self.counts.values())

    @contextmanager
    def refusals(self, path: str) -> Iterator[None]:
        """Turn the refusal of a file inside the block into an issue; the block then ends.

        Args:
            path: The file, relative to the dataset.
        """
        try:
            yield
        except FileRefusedError as error:
            self.add(error.code, path, error.where or "", reason(error))


def reason(error: FileRefusedError) -> str:
    """Return an error's sentence without the place, which an issue carries itself."""
    text = error.message
    if error.found is not None:
        text += f"; found {error.found}"
    if error.required is not None:
        text += f"; required: {error.required}"
    if error.fix is not None:
        text += f". {error.fix}"
    return text
