"""Checking and joining what methods answer."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import numpy.typing as npt

from pliant.spec.answers import Answers
from pliant.spec.errors import SubmissionError


def checked_answers(found: object, count: int, method: str, where: str) -> Answers:
    """Return what a method answered as `Answers`, refusing all but one finite position per query.

    Args:
        found: `Answers`, or the positions alone: an array-like (N, 2), pixels.
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
    answers = found if isinstance(found, Answers) else _of_positions(found, method, where)
    fields: dict[str, tuple[npt.NDArray[np.float32], tuple[int, ...]]] = {
        "uv_px": (answers.uv_px, (count, 2))
    }
    if answers.visible is not None:
        fields["visible"] = (answers.visible, (count,))
    if answers.sigma_px is not None:
        fields["sigma_px"] = (answers.sigma_px, (count,))
    for name, (values, shape) in fields.items():
        if values.shape != shape:
            raise SubmissionError(
                f"the method {method!r} answered in the wrong shape",
                where=f"{where}, {name}",
                found=values.shape,
                required=shape,
            )
        if not np.isfinite(values).all():
            raise SubmissionError(
                f"the method {method!r} gave a value that is not finite",
                where=f"{where}, {name}",
                found=f"{int((~np.isfinite(values)).sum())} of {values.size}",
                required="one finite answer for every query",
            )
    if answers.modes is not None and len(answers.modes) != count:
        raise SubmissionError(
            f"the method {method!r} answered in the wrong shape",
            where=f"{where}, modes",
            found=len(answers.modes),
            required=count,
        )
    return answers


def _of_positions(found: object, method: str, where: str) -> Answers:
    """Return positions alone as answers."""
    try:
        return Answers(np.asarray(found).astype(np.float32, casting="same_kind"))
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
