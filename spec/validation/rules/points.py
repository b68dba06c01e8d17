"""Rules of points.parquet: identities, material coordinates, symmetry partners."""

from __future__ import annotations

import hashlib
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import numpy.typing as npt
import pyarrow as pa

from pliant.spec.conventions import POINT_KINDS
from pliant.spec.io import limits
from pliant.spec.io.parquet_columns import codes, stacked
from pliant.spec.model import Tier
from pliant.spec.validation.findings import FileProblems
from pliant.spec.validation.rules.tables import (
    check_place,
    check_table,
    numbers,
    report_not_finite,
)

MATERIAL_TOLERANCE = 1e-5
"""How far a float32 material coordinate may be off, as a share of its range."""


@dataclass(frozen=True)
class PointSet:
    """The points of a sequence, sound enough for the rules that build on them.

    Attributes:
        object_id: int32 (P,).
        centreline: bool (P,).
        material: float64 (P, 2).
        partners: int32 (P, S).
        digest: Hash of the table's contents, equal for equal points.
    """

    object_id: npt.NDArray[np.int32]
    centreline: npt.NDArray[np.bool_]
    material: npt.NDArray[np.float64]
    partners: npt.NDArray[np.int32]
    digest: bytes

    def __len__(self) -> int:
        return len(self.object_id)


def check_points(path: Path, tier: Tier, problems: FileProblems) -> PointSet | None:
    """Check a point table.

    Args:
        path: The file.
        tier: Its tier.
        problems: Gets the problems.

    Returns:
        The points, or None where a problem leaves nothing to build on.
    """
    table = check_table(path, "points", problems, max_rows=limits.MAX_POINTS)
    if table is None:
        return None
    check_place(table)
    if not table.whole:
        return None
    if table.rows == 0:
        problems.add("ROW_MISSING", "", "a sequence must have at least one point")
        return None
    before = problems.total
    rows = table.read()
    if rows is None:
        return None
    ids = numbers(rows, "point")
    problems.add_rows(
        "ROW_ORDER",
        ids != np.arange(len(ids)),
        lambda i: (f"row {i}, point", f"found {ids[i]}; required: the row's number"),
    )
    object_id = numbers(rows, "object")
    known = np.isin(object_id, [each.id for each in tier.objects])
    problems.add_rows(
        "VALUE_OUT_OF_RANGE",
        ~known,
        lambda i: (f"row {i}, object", f"found {object_id[i]}, no object of {tier.name}"),
    )
    kind = codes(rows.column("kind"), POINT_KINDS)
    problems.add_rows(
        "VALUE_OUT_OF_RANGE",
        kind < 0,
        lambda i: (f"row {i}, kind", f"required: {' | '.join(POINT_KINDS)}"),
    )
    flat = np.isin(object_id, [each.id for each in tier.objects if each.diameter_m == 0])
    problems.add_rows(
        "VALUE_OUT_OF_RANGE",
        flat & (kind == 1),
        lambda i: (
            f"row {i}, kind",
            f"found centreline; required: surface, as m1 of object {object_id[i]} has no period",
        ),
    )
    finite = report_not_finite(rows, ["m0", "m1"], 0, problems)
    material = stacked(rows, "m0", "m1").astype(np.float64)
    inside = np.zeros(len(material), np.bool_)
    for each in tier.objects:
        mine = object_id == each.id
        inside[mine] = np.all(
            [
                c.contains(material[mine, i], MATERIAL_TOLERANCE)
                for i, c in enumerate(each.material)
            ],
            axis=0,
        )
    problems.add_rows(
        "VALUE_OUT_OF_RANGE",
        known & finite & ~inside,
        lambda i: (f"row {i}, m0, m1", f"found {material[i].tolist()}, outside the object"),
    )
    partners = _partners(rows, len(tier.symmetries), problems)
    if partners is None or problems.total != before:
        return None
    points = PointSet(object_id, kind == 1, material, partners, _digest(rows))
    _check_partners(points, tier, problems)
    return points


def _partners(
    rows: pa.Table, symmetries: int, problems: FileProblems
) -> npt.NDArray[np.int32] | None:
    column = rows.column("partners").combine_chunks()
    column = column.chunk(0) if isinstance(column, pa.ChunkedArray) else column
    lengths = np.diff(column.offsets.to_numpy())
    problems.add_rows(
        "VALUE_OUT_OF_RANGE",
        lengths != symmetries,
        lambda i: (
            f"row {i}, partners",
            f"found {lengths[i]}; required: one for each of the tier's {symmetries} symmetries",
        ),
    )
    if np.any(lengths != symmetries):
        return None
    partners = column.flatten().to_numpy().reshape(len(lengths), symmetries)
    outside = np.any((partners < 0) | (partners >= len(lengths)), axis=1)
    problems.add_rows(
        "VALUE_OUT_OF_RANGE",
        outside,
        lambda i: (f"row {i}, partners", f"found {partners[i].tolist()}, no points"),
    )
    return None if outside.any() else partners


def _check_partners(points: PointSet, tier: Tier, problems: FileProblems) -> None:
    """Check that every partner is the point that the symmetry maps a point to."""
    queried = tier.queried
    tolerance = MATERIAL_TOLERANCE * np.array([each.span for each in queried.material])
    mine = points.object_id == queried.id
    for number, symmetry in enumerate(tier.symmetries):
        partner = points.partners[:, number]
        wrong = (points.object_id[partner] != points.object_id) | (
            points.centreline[partner] != points.centreline
        )
        wrong |= ~mine & (partner != np.arange(len(points)))
        gap = queried.wrapped(points.material[partner] - symmetry.apply(points.material))
        far = np.abs(gap) > tolerance
        far[points.centreline, 1] = False
        wrong |= mine & far.any(axis=1)
        problems.add_rows(
            "PARTNER_DISAGREES",
            wrong,
            lambda i, n=number, p=partner: (  # type: ignore[misc]
                f"row {i}, partners[{n}]",
                f"point {p[i]} is not where {tier.symmetries[n].name} maps point {i}",
            ),
        )


def _digest(rows: pa.Table) -> bytes:
    digest = hashlib.sha256()
    for name in ("object", "m0", "m1"):
        digest.update(np.ascontiguousarray(numbers(rows, name)).tobytes())
    digest.update(codes(rows.column("kind"), POINT_KINDS).tobytes())
    for chunk in rows.column("partners").chunks:
        digest.update(np.diff(chunk.offsets.to_numpy()).tobytes())
        digest.update(np.ascontiguousarray(chunk.flatten().to_numpy()).tobytes())
    return digest.digest()
