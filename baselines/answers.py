"""Checks and concatenates the answers of methods."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from typing import Any, Final, NoReturn

import numpy as np
import numpy.typing as npt

from pliant.baselines.matcher import Heat
from pliant.spec.answers import (
    MAX_MODES,
    MAX_POSITION_PX,
    MAX_SIGMA_PX,
    WEIGHT_TOLERANCE,
    Answers,
    Matches,
)
from pliant.spec.arrays import Float32Array
from pliant.spec.errors import SubmissionError

Bounds = tuple[float, float, str]
"""Smallest and largest value, and these in words."""

_POSITION: Final[Bounds] = (-MAX_POSITION_PX, MAX_POSITION_PX, "a finite position within ±1e6 px")
_PROBABILITY: Final[Bounds] = (0.0, 1.0, "a probability, 0 to 1")
_SIGMA: Final[Bounds] = (
    float(np.nextafter(np.float32(0), np.float32(1))),
    MAX_SIGMA_PX,
    "greater than 0 and at most 1e6 px",
)
_WEIGHT: Final[Bounds] = (0.0, 1.0, "a weight, 0 to 1")
_SUM: Final[Bounds] = (1 - WEIGHT_TOLERANCE, 1 + WEIGHT_TOLERANCE, "weights that sum to 1")
_SCORE: Final[Bounds] = (
    float(np.finfo(np.float32).min),
    float(np.finfo(np.float32).max),
    "a finite number",
)


@contextmanager
def placed_errors(method: str, place: str) -> Iterator[None]:
    """Add to an error of a method where it was."""
    try:
        yield
    except Exception as error:
        error.add_note(f"The method {method!r} was at {place}")
        raise


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
    check = _Check(method, where)
    fields: dict[str, Any] = {"uv_px": check.values("uv_px", answers.uv_px, (count, 2), _POSITION)}
    check.precision("uv_px", answers.uv_px)
    for name, bounds in (
        ("visible", _PROBABILITY),
        ("sigma_px", _SIGMA),
        ("familiarity", _PROBABILITY),
    ):
        if (given := getattr(answers, name)) is not None:
            fields[name] = check.values(name, given, (count,), bounds)
    if answers.modes is not None:
        fields["modes"] = check.modes(answers.modes, count)
        if answers.sigma_px is not None:
            raise SubmissionError(
                f"the method {method!r} gave both sigma_px and modes",
                where=where,
                required="one of them or none",
            )
    return replace(answers, **fields)


def checked_matches(
    found: Any, method: str, where: str | None = None, *, index: bool = False
) -> Matches:
    """Return a method's keypoint matches as arrays.

    Args:
        found: `Matches`, or array-likes or torch tensors (M, 2), (M, 2) and where there are
            scores (M,).
        method: The method's name, for messages.
        where: Which pair, for messages.
        index: Whether positions are column and row numbers, which may be integers.

    Raises:
        SubmissionError: Wrong shapes or values.

    Examples:
        >>> found = pliant.baselines.answers.checked_matches(([[3.5, 4.5]], [[5.5, 6.5]]), "mine")
        >>> found.score.tolist()
        [1.0]
    """
    if isinstance(found, Matches):
        found = (found.uv_a_px, found.uv_b_px, found.score)
    check = _Check(method, where)
    parts = [to_array(part) for part in found] if isinstance(found, tuple | list) else []
    # An empty list has no second dimension.
    parts[:2] = [part.reshape(0, 2) if part.shape == (0,) else part for part in parts[:2]]
    count = len(parts[0]) if parts and parts[0].ndim else 0
    shapes = [(count, 2), (count, 2), (count,)]
    if len(parts) not in (2, 3) or [part.shape for part in parts] != shapes[: len(parts)]:
        raise SubmissionError(
            f"the method {method!r} returned no matches",
            where=where,
            found=[part.shape for part in parts] if parts else type(found).__name__,
            required="`Matches`, or arrays (M, 2), (M, 2) and optionally scores (M,)",
        )
    score = parts[2] if len(parts) == 3 else np.ones(count)
    if not index:
        for name, given in zip(("uv_a_px", "uv_b_px"), found, strict=False):
            check.precision(name, given)
    return Matches(
        check.values("uv_a_px", parts[0], (count, 2), _POSITION),
        check.values("uv_b_px", parts[1], (count, 2), _POSITION),
        check.values("score", score, (count,), _SCORE),
    )


def checked_heat(found: Heat, shape: tuple[int, ...], method: str) -> Heat:
    """Return a method's heat map, refusing one of another size than the target's.

    Args:
        found: The heat map; its values are an array-like or a torch tensor.
        shape: (H, W) of the target.
        method: The method's name, for messages.

    Raises:
        SubmissionError: Wrong shape, or a confidence outside 0 to 1.
    """
    if not isinstance(found, Heat):
        raise SubmissionError(
            f"the method {method!r} returned no heat map",
            found=type(found).__name__,
            required="`Heat` of pliant.baselines",
        )
    check = _Check(method, "heat")
    values = _floats(found.values, method, "heat")
    if values.shape != shape:
        check.refuse_shape("values", values.shape, shape)
    check.values("confidence", found.confidence, (), _PROBABILITY)
    return replace(found, values=values, confidence=float(found.confidence))


@dataclass(frozen=True)
class _Check:
    """Refuses wrong arrays, naming the method and the pair."""

    method: str
    where: str | None

    def values(
        self, name: str, given: object, shape: tuple[int, ...], bounds: Bounds
    ) -> Float32Array:
        """Return an array as float32 if it has this shape and its values are within bounds."""
        values = _floats(given, self.method, self.where)
        if values.shape != shape:
            self.refuse_shape(name, values.shape, shape)
        least, most, required = bounds
        wrong = ~((values >= least) & (values <= most))
        if wrong.any():
            raise SubmissionError(
                f"the method {self.method!r} returned an invalid value",
                where=self._place(name),
                found=f"{values[wrong][0]} ({int(wrong.sum())} of {values.size} values)",
                required=required,
            )
        return values

    def precision(self, name: str, given: object) -> None:
        """Refuse positions of a type that cannot give the centre of every pixel."""
        kind = str(getattr(given, "dtype", None) or to_array(given).dtype)
        if "int" in kind or "bool" in kind or "float16" in kind:
            raise SubmissionError(
                f"the method {self.method!r} gave positions that lose up to half a pixel",
                where=self._place(name),
                found=kind.removeprefix("torch."),
                required="float32 or float64",
                fix="The centre of the first pixel is at (0.5, 0.5): add 0.5 to a column or row "
                "number",
            )

    def modes(self, given: Any, count: int) -> list[Float32Array]:
        """Return the mixtures of all queries as float32 (M_i, 4)."""
        try:
            given = list(given)
        except TypeError:
            self.refuse_shape("modes", type(given).__name__, f"{count} arrays (M, 4)")
        rows = [_floats(row, self.method, self.where) for row in given]
        if len(rows) != count:
            self.refuse_shape("modes", len(rows), count)
        for row in rows:
            if row.ndim != 2 or row.shape[1] != 4 or not 1 <= len(row) <= MAX_MODES:
                required = f"(M, 4) per query, M from 1 to {MAX_MODES}"
                self.refuse_shape("modes", row.shape, required)
        fields = np.concatenate([np.zeros((0, 4), np.float32), *rows]).T  # (4, sum of M_i)
        names = ("u", "v", "sigma", "weight")
        for name, field, bounds in zip(
            names, fields, (_POSITION, _POSITION, _SIGMA, _WEIGHT), strict=True
        ):
            self.values(f"modes, {name}", field, field.shape, bounds)
        sums = np.array([row[:, 3].sum() for row in rows])
        self.values("modes, weight", sums, sums.shape, _SUM)
        return rows

    def refuse_shape(self, name: str, found: object, required: object) -> NoReturn:
        """Refuse an answer of a wrong shape."""
        raise SubmissionError(
            f"the method {self.method!r} answered in the wrong shape",
            where=self._place(name),
            found=found,
            required=required,
        )

    def _place(self, name: str) -> str:
        return f"{self.where}, {name}" if self.where else name


def to_array(values: Any) -> npt.NDArray[Any]:
    """Return an array-like or a torch tensor, on whatever device, as an array."""
    if hasattr(values, "detach"):
        values = values.detach().cpu().float().numpy()
    return np.asarray(values)


def _floats(found: object, method: str, where: str | None) -> Float32Array:
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
