"""What a user should know of two pictures before trusting an answer, as sentences."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from itertools import compress
from typing import Final

from pliant.spec.arrays import Mask, border

PICTURES: Final = ("source", "target")

_CUT: Final = 0.02
"""Share of a picture's longer side: a mask that covers more of the border goes on outside."""


def pictures_where(holds: Iterable[bool]) -> str:
    """Return the names of the pictures for which something holds; empty for neither."""
    return " and the ".join(compress(PICTURES, holds))


def unread_remarks(read: Iterable[bool], name: str, shown: str, kind: str) -> list[str]:
    """Return which pictures a method cannot read.

    Args:
        read: Whether it reads the source and the target.
        name: The method.
        shown: What the masks lack, such as `with four corners`.
        kind: Kind of the object.
    """
    return [
        f"The {picture} has no mask {shown}, so {name} answers with the middle of the target: "
        f"give a mask of the {kind}."
        for picture, is_read in zip(PICTURES, read, strict=True)
        if not is_read
    ]


def cut_object_remarks(masks: Sequence[Mask | None]) -> list[str]:
    """Return which objects leave their pictures.

    Args:
        masks: bool (H, W) of source and target, or None where the object's place is unknown.
    """
    cut = pictures_where(
        mask is not None and bool(border(mask).sum() > _CUT * max(mask.shape)) for mask in masks
    )
    if not cut:
        return []
    return [
        f"The object leaves the picture of the {cut}: places are answered as if both pictures "
        "showed all of it."
    ]
