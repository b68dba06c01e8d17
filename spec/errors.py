"""Exceptions, and the issues that a validation collects."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from typing import Any, Literal

from pliant.spec.text import escaped

Severity = Literal["error", "warning"]


class PliantError(Exception):
    """The base of every error that Pliant raises on purpose.

    Args:
        message: What is wrong, in one sentence.
        path: The file concerned.
        where: The field, row or frame inside it.
        found: What stands there.
        required: What the specification, or the call, requires.
        fix: What the reader should do.
    """

    exit_code = 1
    """1: the data is wrong. 2: the call is wrong."""

    def __init__(
        self,
        message: str,
        *,
        path: object | None = None,
        where: str | None = None,
        found: object | None = None,
        required: object | None = None,
        fix: str | None = None,
    ) -> None:
        self.message = message
        self.path = None if path is None else str(path)
        self.where = where
        self.found = found
        self.required = required
        self.fix = fix
        super().__init__(self._sentence())

    def __reduce__(self) -> tuple[Any, ...]:
        return _restored, (type(self), str(self), self.__dict__)

    def _sentence(self) -> str:
        place = escaped(", ".join(part for part in (self.path, self.where) if part))
        text = self.without_place()
        return escaped(f"{place}: {text}" if place else text, lines=True)

    def without_place(self) -> str:
        """Return the sentence without path and place, which an issue has in fields of their own."""
        text = self.message
        if self.found is not None:
            text += f"; found {escaped(str(self.found))}"
        if self.required is not None:
            text += f"; required: {self.required}"
        if self.fix is not None:
            text += f". {self.fix}"
        return text


def _restored(kind: type[PliantError], sentence: str, state: dict[str, Any]) -> PliantError:
    """Return an error that comes from another process."""
    error = kind.__new__(kind, sentence)
    error.__dict__.update(state)
    return error


class SpecError(PliantError):
    """A dataset file breaks the specification, or its version cannot be read."""


class SubmissionError(PliantError):
    """A submission cannot be scored; `issues` says why, all of it."""

    def __init__(self, message: str, *, issues: Sequence[Issue] = (), **kwargs: object) -> None:
        self.issues = list(issues)
        super().__init__(message, **kwargs)  # type: ignore[arg-type]


class GenerationError(PliantError):
    """A sequence could not be made."""


class TrainingError(PliantError):
    """A training run cannot start or go on."""


class CallError(PliantError):
    """The call is wrong: an argument, a setting, an output folder, a missing extra."""

    exit_code = 2


class MissingExtraError(CallError):
    """An optional dependency is not installed."""

    def __init__(self, feature: str, extra: str, install: str | None = None) -> None:
        """State what is missing.

        Args:
            feature: What needs them.
            extra: Extra of Pliant, or the name of what is missing.
            install: Command that installs it; None takes the extra's.
        """
        self.command = install or install_command(extra)
        super().__init__(
            f"{feature} needs the optional dependencies '{extra}'",
            fix=f"Install them with: {self.command}",
        )


def install_command(extra: str) -> str:
    """Return the command that installs an extra of Pliant."""
    return f"pip install 'pliant[{extra}]'"


@dataclass(frozen=True, order=True)
class Issue:
    """One problem found by a validator or by the submission check.

    Attributes:
        code: Stable code from the catalogue, such as `DEPTH_DISAGREES`.
        severity: `error` makes the file invalid; `warning` does not.
        path: File, relative to the dataset (or the submission's own path).
        where: Field, row, frame or query inside the file; empty for the whole file.
        message: Found, required and what to do, in words.
    """

    code: str
    severity: Severity
    path: str
    where: str
    message: str

    def as_dict(self) -> dict[str, str]:
        """Return the issue as a JSON object."""
        return asdict(self)

    def __str__(self) -> str:
        place = f"{self.path} [{self.where}]" if self.where else self.path
        return f"{self.severity.upper()} {self.code} {place}: {self.message}"
