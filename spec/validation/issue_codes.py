"""The catalogue of issue codes, `schemas/VERSION/issue_codes.json`.

The annex of SPEC.md and `docs/errors.md` show it as tables.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final, Literal

from pliant.spec.errors import Issue, Severity
from pliant.spec.io.jsonfiles import read_shipped
from pliant.spec.text import escaped

Subject = Literal["both", "dataset", "submission"]


@dataclass(frozen=True)
class IssueCode:
    """One kind of problem.

    Attributes:
        code: Stable name; a published code never changes its meaning.
        severity: `error` makes the data invalid; `warning` does not.
        subject: Whether the code can be reported of a dataset, of a submission, or of both.
        meaning: When it is reported, in one sentence.
        cause: Its usual cause.
        remedy: What to do about that.
    """

    code: str
    severity: Severity
    subject: Subject
    meaning: str
    cause: str
    remedy: str


ISSUE_CODES: Final[dict[str, IssueCode]] = {
    name: IssueCode(name, **entry) for name, entry in read_shipped("issue_codes.json").items()
}
"""Every issue code by its name."""


def make_issue(code: str, path: str, where: str, message: str) -> Issue:
    """Return an issue with the severity of its code; unsafe characters are escaped.

    Args:
        code: A key of `ISSUE_CODES`.
        path: File, relative to the dataset (or the submission's own path).
        where: Field, row, frame or query inside the file; empty for the whole file.
        message: Found, required and what to do, in words.
    """
    return Issue(code, ISSUE_CODES[code].severity, escaped(path), escaped(where), escaped(message))
