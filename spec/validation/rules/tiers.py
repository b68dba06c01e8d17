"""Rules of dataset.json that a JSON Schema cannot say: tiers, objects, symmetries."""

from __future__ import annotations

from itertools import product
from typing import Any

import numpy as np
import numpy.typing as npt

from pliant.spec.storage.layout import DATASET_JSON
from pliant.spec.validation.findings import Findings

FloatArray = npt.NDArray[np.float64]

_TOLERANCE = 1e-6


def check_tiers(info: dict[str, Any], findings: Findings) -> None:
    """Check the tiers of a dataset.json that satisfies its schema.

    Args:
        info: The document.
        findings: Gets `TIER_INVALID` and `SYMMETRY_INVALID`.
    """
    names = [tier["name"] for tier in info["tiers"]]
    for name in sorted({name for name in names if names.count(name) > 1}):
        findings.add("TIER_INVALID", DATASET_JSON, "tiers", f"two tiers are named {name!r}")
    for index, tier in enumerate(info["tiers"]):
        where = f"tiers[{index}]"
        problems = _tier_problems(tier)
        for message in problems:
            findings.add("TIER_INVALID", DATASET_JSON, where, message)
        queried = queried_object(tier)
        if queried is not None and not problems:
            for number, message in _symmetry_problems(tier["symmetries"], queried["material"]):
                findings.add(
                    "SYMMETRY_INVALID", DATASET_JSON, f"{where}.symmetries[{number}]", message
                )


def queried_object(tier: dict[str, Any]) -> dict[str, Any] | None:
    """Return the object that a tier's queries lie on, or None if it is not declared."""
    for thing in tier["objects"]:
        if thing["id"] == tier["queried_object"]:
            found: dict[str, Any] = thing
            return found
    return None


def _tier_problems(tier: dict[str, Any]) -> list[str]:
    problems = []
    ids = [thing["id"] for thing in tier["objects"]]
    if len(set(ids)) != len(ids):
        problems.append("two objects have one id")
    if tier["queried_object"] not in ids:
        problems.append(f"queried_object {tier['queried_object']} is none of the objects {ids}")
    for thing in tier["objects"]:
        for coordinate in thing["material"]:
            if not coordinate["min"] < coordinate["max"]:
                problems.append(f"{coordinate['name']}: min must be less than max")
            elif coordinate["period"] is not None and (
                coordinate["max"] - coordinate["min"] > coordinate["period"] * (1 + _TOLERANCE)
            ):
                problems.append(f"{coordinate['name']}: the range is longer than the period")
    return problems


def _symmetry_problems(
    symmetries: list[dict[str, Any]], material: list[dict[str, Any]]
) -> list[tuple[int, str]]:
    """Return (index, sentence) for every symmetry that is no symmetry."""
    problems: list[tuple[int, str]] = []
    maps = [(np.array(s["matrix"], np.float64), np.array(s["offset"])) for s in symmetries]
    names = [s["name"] for s in symmetries]
    identity = (np.eye(2), np.zeros(2))
    for index, candidate in enumerate(maps):
        if names.index(names[index]) != index:
            problems.append((index, f"a second symmetry named {names[index]!r}"))
        if not _is_bijection(candidate, material):
            problems.append((index, "the map is no bijection of the object's material"))
        elif _equal(candidate, identity, material):
            problems.append((index, "the identity is never listed"))
        elif any(_equal(candidate, other, material) for other in maps[:index]):
            problems.append((index, "the same map is listed twice"))
    if not problems:
        group = [identity, *maps]
        for index, (matrix, offset) in enumerate(maps):
            for other_matrix, other_offset in maps:
                composed = (matrix @ other_matrix, matrix @ other_offset + offset)
                if not any(_equal(composed, known, material) for known in group):
                    problems.append(
                        (index, "composed with another symmetry it gives a map not listed")
                    )
                    break
    return problems


def _is_bijection(candidate: tuple[FloatArray, FloatArray], material: list[dict[str, Any]]) -> bool:
    """Return whether m' = matrix · m + offset maps the material onto itself, one to one.

    Coordinates that do not close on themselves span a box, whose corners must map to its
    corners; a coordinate that does may turn and reverse, and shift along the others.
    """
    matrix, offset = candidate
    closed = [i for i in (0, 1) if material[i]["period"] is not None]
    open_ = [i for i in (0, 1) if material[i]["period"] is None]
    span = np.array([c["max"] - c["min"] for c in material])
    if open_:
        if closed and np.any(np.abs(matrix[np.ix_(open_, closed)]) > _TOLERANCE):
            return False
        corners = np.array(
            list(product(*[(material[i]["min"], material[i]["max"]) for i in open_]))
        )
        mapped = corners @ matrix[np.ix_(open_, open_)].T + offset[open_]
        gaps = np.abs(mapped[:, None, :] - corners[None, :, :]) / span[open_]
        hits = np.all(gaps < _TOLERANCE, axis=2)
        if not (np.all(hits.sum(0) == 1) and np.all(hits.sum(1) == 1)):
            return False
    if closed:
        periods = np.array([material[i]["period"] for i in closed])
        turned = matrix[np.ix_(closed, closed)] * periods[None, :] / periods[:, None]
        whole = np.round(turned)
        if np.any(np.abs(turned - whole) > _TOLERANCE):
            return False
        if abs(abs(np.linalg.det(whole)) - 1.0) > _TOLERANCE:
            return False
    return True


def _equal(
    first: tuple[FloatArray, FloatArray],
    second: tuple[FloatArray, FloatArray],
    material: list[dict[str, Any]],
) -> bool:
    """Return whether two maps send three points in general position to the same places."""
    low = np.array([c["min"] for c in material])
    span = np.array([c["max"] - c["min"] for c in material])
    probes = low + span * np.array([[0.1, 0.2], [0.4, 0.3], [0.3, 0.9]])
    gap = (probes @ first[0].T + first[1]) - (probes @ second[0].T + second[1])
    return bool(np.all(np.abs(wrap_difference(gap, material)) < _TOLERANCE * span * 10))


def wrap_difference(gap: FloatArray, material: list[dict[str, Any]]) -> FloatArray:
    """Bring differences of material coordinates to half a period, where one closes on itself.

    Args:
        gap: float64 (..., 2), differences of material coordinates.
        material: The object's two coordinates, as in dataset.json.

    Returns:
        float64 (..., 2), in -period/2 to period/2 where there is a period.
    """
    wrapped = np.array(gap, np.float64)
    for axis, coordinate in enumerate(material):
        period = coordinate["period"]
        if period is not None:
            wrapped[..., axis] -= period * np.round(wrapped[..., axis] / period)
    return wrapped
