"""What a user should know of two pictures of ropes before trusting an answer, as sentences."""

from __future__ import annotations

from collections.abc import Sequence

from pliant.baselines.remarks import PICTURES, pictures_where
from pliant.baselines.tracing.hypotheses import Trace
from pliant.baselines.tracing.mask_shape import MaskShape, has_ball
from pliant.spec.frame import Frame


def rope_remarks(
    views: Sequence[Frame],
    shapes: Sequence[MaskShape | None],
    traces: Sequence[Sequence[Trace]],
) -> list[str]:
    """Return what is to be said of the masks of ropes and of how they are read.

    Args:
        views: Source and target with the masks that are used.
        shapes: Shapes of the masks, or None without a mask.
        traces: Traces of each, from `with_cut_ends`, the most plausible first.
    """
    named = zip(PICTURES, shapes, strict=True)
    found = [shape.remark(name) for name, shape in named if shape is not None]
    remarks = [remark for remark in found if remark]
    bare = pictures_where(view.mask is not None and not has_ball(view) for view in views)
    if bare and not remarks:
        remarks.append(
            f"No ball is known at an end of the rope in the {bare}: without one, both ends look "
            "alike, and all answers may run the other way along the rope."
        )
    if cut := pictures_where(bool(each) and any(each[0].cut) for each in traces):
        remarks.append(
            f"The rope leaves the picture of the {cut}: how much of it is outside is taken from "
            "its width, as if both pictures showed one and the same rope."
        )
    if back := pictures_where(bool(each) and each[0].comes_back for each in traces):
        remarks.append(
            f"The rope leaves the picture of the {back} and comes back: the way that it takes "
            "outside is a guess."
        )
    return remarks
