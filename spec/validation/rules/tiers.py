"""Rules of dataset.json that a JSON Schema cannot say: tiers, objects, symmetries."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import product

import numpy as np

from pliant.spec.arrays import FloatArray
from pliant.spec.model import MaterialObject, Symmetry, Tier
from pliant.spec.validation.findings import FileProblems

_TOLERANCE = 1e-6

_PROBES = np.array([[0.1, 0.2], [0.4, 0.3], [0.3, 0.9]])
"""Three places in general position, as shares of the range."""


def check_tiers(tiers: Sequence[Tier], problems: FileProblems) -> None:
    """Check the tiers of a dataset.json that satisfies its schema.

    Args:
        tiers: The tiers.
        problems: Gets `TIER_INVALID` and `SYMMETRY_INVALID`.
    """
    names = [tier.name for tier in tiers]
    for name in sorted({name for name in names if names.count(name) > 1}):
        problems.add("TIER_INVALID", "tiers", f"two tiers are named {name!r}")
    for index, tier in enumerate(tiers):
        where = f"tiers[{index}]"
        messages = _tier_problems(tier)
        for message in messages:
            problems.add("TIER_INVALID", where, message)
        if not messages:
            for number, message in _symmetry_problems(tier):
                problems.add("SYMMETRY_INVALID", f"{where}.symmetries[{number}]", message)


def _tier_problems(tier: Tier) -> list[str]:
    problems = []
    ids = [each.id for each in tier.objects]
    if len(set(ids)) != len(ids):
        problems.append("two objects have one id")
    if tier.queried_object not in ids:
        problems.append(f"queried_object {tier.queried_object} is none of the objects {ids}")
    for each in tier.objects:
        for coordinate in each.material:
            if not coordinate.min < coordinate.max:
                problems.append(f"{coordinate.name}: min must be less than max")
            elif coordinate.period is not None and (
                coordinate.span > coordinate.period * (1 + _TOLERANCE)
            ):
                problems.append(f"{coordinate.name}: the range is longer than the period")
    return problems


def _symmetry_problems(tier: Tier) -> list[tuple[int, str]]:
    """Return (index, sentence) for every symmetry that is not a symmetry.

    Maps are compared by the places to which they send three points in general position.
    """
    problems: list[tuple[int, str]] = []
    queried = tier.queried
    names = [each.name for each in tier.symmetries]
    low, span = (np.array([getattr(c, n) for c in queried.material]) for n in ("min", "span"))
    probes = low + span * _PROBES
    group = np.array([probes, *(each.apply(probes) for each in tier.symmetries)])

    def known(places: FloatArray, maps: FloatArray) -> bool:
        gap = np.abs(queried.wrapped(places - maps))
        return bool(np.any(np.all(gap < _TOLERANCE * span * 10, axis=(1, 2))))

    for index, candidate in enumerate(tier.symmetries):
        if names.index(candidate.name) != index:
            problems.append((index, f"a second symmetry named {candidate.name!r}"))
        if not _is_bijection(candidate, queried):
            problems.append((index, "the map is not a bijection of the object's material"))
        elif known(group[index + 1], group[:1]):
            problems.append((index, "the identity is never listed"))
        elif known(group[index + 1], group[1 : index + 1]):
            problems.append((index, "the same map is listed twice"))
    if not problems:
        for index, candidate in enumerate(tier.symmetries):
            if not all(known(candidate.apply(other), group) for other in group[1:]):
                text = "composed with another symmetry it gives a map not listed"
                problems.append((index, text))
    return problems


def _is_bijection(candidate: Symmetry, queried: MaterialObject) -> bool:
    """Return whether m' = matrix · m + offset maps the material onto itself, one to one.

    Coordinates that do not close on themselves span a box, whose corners must map to its
    corners; a coordinate that does may turn and reverse, and shift along the others.
    """
    matrix, offset = np.array(candidate.matrix, np.float64), np.array(candidate.offset)
    material = queried.material
    closed = [i for i in (0, 1) if material[i].period is not None]
    open_ = [i for i in (0, 1) if material[i].period is None]
    span = np.array([each.span for each in material])
    if open_:
        if closed and np.any(np.abs(matrix[np.ix_(open_, closed)]) > _TOLERANCE):
            return False
        corners = np.array(list(product(*[(material[i].min, material[i].max) for i in open_])))
        mapped = corners @ matrix[np.ix_(open_, open_)].T + offset[open_]
        gaps = np.abs(mapped[:, None, :] - corners[None, :, :]) / span[open_]
        hits = np.all(gaps < _TOLERANCE, axis=2)
        if not (np.all(hits.sum(0) == 1) and np.all(hits.sum(1) == 1)):
            return False
    if closed:
        periods = np.array([material[i].period for i in closed], np.float64)
        turned = matrix[np.ix_(closed, closed)] * periods[None, :] / periods[:, None]
        whole = np.round(turned)
        if np.any(np.abs(turned - whole) > _TOLERANCE):
            return False
        if abs(abs(np.linalg.det(whole)) - 1.0) > _TOLERANCE:
            return False
    return True
