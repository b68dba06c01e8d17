"""Annotated points that look alike: corners of a towel, left and right sleeve."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from pliant.spec.errors import CallError
from pliant.spec.model import SQUARE_MIRRORS, SQUARE_ROTATIONS, Symmetry

_CORNERS = np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]])


@dataclass(frozen=True)
class Alike:
    """A renaming of all points at once under which the object looks the same.

    Attributes:
        symmetry: The same as a map of a unit square whose corners, in order, are the points of a
            group; a group of two are its left and its right half.
        renamed: Point -> point; others keep their names.
    """

    symmetry: Symmetry
    renamed: Mapping[str, str]


def alike(groups: Sequence[str]) -> list[Alike]:
    """Return the renamings of some groups of points, without the identity.

    Args:
        groups: Names with commas between them. All groups have two names, which are exchanged in
            all groups at once, or four names in their order around the object: it may be turned by
            quarters, and turned over.

    Raises:
        CallError: The groups differ in size, or a name is repeated or missing.
    """
    split = [[name.strip() for name in group.split(",")] for group in groups]
    names = [name for group in split for name in group]
    size = len(split[0]) if split else 2
    if any(len(group) != size for group in split) or size not in (2, 4):
        required = "two names each, or four names each in their order around the object"
    elif len(set(names)) < len(names) or not all(names):
        required = "every point once"
    else:
        maps = SQUARE_ROTATIONS + SQUARE_MIRRORS if size == 4 else SQUARE_MIRRORS[:1]
        return [_renaming(split, symmetry) for symmetry in maps] if split else []
    raise CallError(
        "the points that look alike are not given as groups",
        where="--alike",
        found="; ".join(groups)[:80],
        required=required,
    )


def _renaming(groups: Sequence[Sequence[str]], symmetry: Symmetry) -> Alike:
    corners = _CORNERS if len(groups[0]) == 4 else _CORNERS[:2]
    images = symmetry.apply(corners)
    order = np.linalg.norm(images[:, None] - corners, axis=2).argmin(axis=1)
    renamed = {group[k]: group[to] for group in groups for k, to in enumerate(order)}
    return Alike(symmetry, renamed)
