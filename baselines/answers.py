"""Checking and joining what methods answer."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any, Final

import numpy as np
import numpy.typing as npt

from pliant.spec.answers import MAX_POSITION_PX, MAX_SIGMA_PX, Answers
from pliant.spec.errors import SubmissionError

_LEAST_SIGMA_PX: Final = float(np.nextafter(np.float32(0), np.float32(1)))
_FIELDS: Final[dict[str, tuple[tuple[int, ...], float, float, str]]] = {
    "uv_px": ((2,), -MAX_POSITION_PX, MAX_POSITION_PX, "a finite position within ±1e6 px"),
    "visible": ((), 0.0, 1.0, "a probability, 0 to 1"),
    "sigma_px": ((), _LEAST_SIGMA_PX, MAX_SIGMA_PX, "greater than 0 and at most 1e6 px"),
}
"""Shape of one answer, smallest and largest value, and these in words."""


def checked_answers(found: object, count: int, method: str, where: str) -> Answers:
    """Return what a method answered as arrays, refusing all but one finite position per query.

    Args:
        found: `Answers`, or the positions alone, (N, 2), pixels: array-likes or torch tensors.
        count: Number of queries, N.
        method: The method's name, for messages.
        where: Which pair or split, for messages.

    Raises:
        SubmissionError: Wrong shapes or values.

    Examples:
        >>> answers = pliant.baselines.answers.checked_answers([[3.5, 4.5]], 1, "mine", "pair 0")
        >>> answers.uv_px.dtype.name
        'float32'
    """
    answers = found if isinstance(found, Answers) else Answers(found)  # type: ignore[arg-type]
    fields: dict[str, Any] = {}
    for name, (shape, least, most, required) in _FIELDS.items():
        given = getattr(answers, name)
        if given is None and name != "uv_px":
            continue
        values = fields[name] = _floats(given, method, where)
        if values.shape != (count, *shape):
            raise SubmissionError(
                f"the method {method!r} answered in the wrong shape",
                where=f"{where}, {name}",
                found=values.shape,
                required=(count, *shape),
            )
        wrong = ~((values >= least) & (values <= most))
        if wrong.any():
            raise SubmissionError(
                f"the method {method!r} gave a value that is not possible",
                where=f"{where}, {name}",
                found=f"{values[wrong][0]} ({int(wrong.sum())} of {values.size} values)",
                required=required,
            )
    if answers.modes is not None and len(answers.modes) != count:
        raise SubmissionError(
            f"the method {method!r} answered in the wrong shape",
            where=f"{where}, modes",
            found=len(answers.modes),
            required=count,
        )
    return replace(answers, **fields)


def to_array(values: Any) -> npt.NDArray[Any]:
    """Return an array-like or a torch tensor, on whatever device, as an array."""
    if hasattr(values, "detach"):
        values = values.detach().cpu().float().numpy()
    return np.asarray(values)


def _floats(found: object, method: str, where: str) -> npt.NDArray[np.float32]:
    """Return what a method gave as float32; a number beyond that is infinite."""
    try:
        with np.errstate(over="ignore"):
            return to_array(found).astype(np.float32, casting="same_kind", copy=False)
    except (TypeError, ValueError) as error:
        raise SubmissionError(
            f"the method {method!r} returned something else than answers",
            where=where,
            found=type(found).__name__,
            required="`Answers` of pliant.baselines, or an array (N, 2) of positions",
        ) from error


def joined(parts: Sequence[Answers], method: str) -> Answers:
    """Join the answers of all pairs; an optional field must be there for all or for none.

    Examples:
        >>> pairs = pliant.load("sample").pairs("val")
        >>> parts = [pliant.baselines.Answers(pair.uv_a_px) for pair in pairs]
        >>> len(pliant.baselines.answers.joined(parts, "mine").uv_px)
        256
    """
    found: dict[str, Any] = {"uv_px": np.zeros((0, 2), dtype=np.float32)}
    for name in ("uv_px", "visible", "sigma_px", "modes", "familiarity"):
        given = [value for part in parts if (value := getattr(part, name)) is not None]
        if given and len(given) < len(parts):
            raise SubmissionError(
                f"the method {method!r} gave {name} for some pairs and not for others"
            )
        if given:
            rows = [row for value in given for row in value] if name == "modes" else None
            found[name] = np.concatenate(given) if rows is None else rows
    return Answers(**found)
