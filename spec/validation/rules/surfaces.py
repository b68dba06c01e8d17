"""Rules of a frame's two images: kind, size, depth, and what the surface layer may hold."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import numpy.typing as npt

from pliant.spec.io import limits
from pliant.spec.io.exr import Surface, read_camera_depth, read_surface
from pliant.spec.io.png import png_remarks, read_mask, read_rgb
from pliant.spec.io.reading import read_bytes
from pliant.spec.mask_box import mask_box
from pliant.spec.model import Tier
from pliant.spec.storage import layout
from pliant.spec.validation.findings import FileProblems
from pliant.spec.validation.rules.context import Context
from pliant.spec.validation.rules.files import SequenceFiles
from pliant.spec.validation.rules.points import MATERIAL_TOLERANCE


@dataclass(frozen=True)
class ShownSurface:
    """A frame's surface image and where it shows an object.

    Attributes:
        image: The image.
    """

    image: Surface

    @cached_property
    def mask(self) -> npt.NDArray[np.bool_]:
        """Bool (H, W), True where an object is seen."""
        mask: npt.NDArray[np.bool_] = self.image.object_id != 0
        return mask

    @cached_property
    def count(self) -> int:
        """Number of pixels that show an object."""
        return int(np.count_nonzero(self.mask))

    @cached_property
    def pixels(self) -> npt.NDArray[np.int64]:
        """Flat indices of these pixels, int64 (N,)."""
        return np.flatnonzero(self.mask)

    def of_object(self, object_id: int) -> npt.NDArray[np.bool_]:
        """Return the pixels that show one object, bool (H, W)."""
        return self.image.object_id == object_id

    def box_px(self, object_id: int) -> float:
        """Return the longer side of the box around an object's pixels, 1 if it is not seen.

        Returns:
            Pixels, from the outer edge of the first pixel to that of the last.
        """
        box = mask_box(self.of_object(object_id))
        return float(max(1, *(side.stop - side.start for side in box)))


def check_rgb(context: Context, files: SequenceFiles, frame: int) -> npt.NDArray[np.uint8] | None:
    """Check a frame's colour image: its checksum, and (full run) that it decodes.

    Args:
        context: The dataset.
        files: The sequence's folder.
        frame: The frame.

    Returns:
        uint8 (H, W, 3) if it breaks no rule and this is a full run.
    """
    name = layout.rgb_name(frame)
    file = files.contents(name)
    if file is not None and not context.quick:
        problems = files.at(name)
        with problems.refusals():
            rgb = read_rgb(file, size=context.size)
            for remark in png_remarks(read_bytes(file, limits.MAX_IMAGE_FILE_BYTES)):
                problems.add("IMAGE_AMBIGUOUS", "", remark)
            return rgb
    return None


def check_recorded(context: Context, tier: Tier, files: SequenceFiles, frame: int) -> None:
    """Check a frame's mask and camera depth, where it has them; arguments as `check_surface`."""
    name = layout.mask_name(frame)
    file = files.contents(name)
    if file is not None and not context.quick:
        with files.at(name).refusals():
            ids = set(np.unique(read_mask(file, size=context.size)).tolist())
            known = {0, *(each.id for each in tier.objects)}
            if not ids <= known:
                text = f"found object ids {sorted(ids - known)[:8]}; the tier has {sorted(known)}"
                files.at(name).add("SURFACE_INVALID", "", text)
    name = layout.camera_depth_name(frame)
    file = files.contents(name)
    if file is not None and not context.quick:
        with files.at(name).refusals():
            depth_m = read_camera_depth(file, size=context.size)
            if not (depth_m > 0).all():
                text = "found depth <= 0 or NaN; required: > 0, or +inf where it is not known"
                files.at(name).add("DEPTH_INVALID", "", text)


def check_surface(
    context: Context, tier: Tier, files: SequenceFiles, frame: int
) -> ShownSurface | None:
    """Check a frame's depth and surface image.

    Args:
        context: The dataset.
        tier: The sequence's tier.
        files: The sequence's folder.
        frame: The frame.

    Returns:
        The surface if it breaks no rule and this is a full run.
    """
    name = layout.depth_name(frame)
    file = files.contents(name)
    if file is None or context.quick:
        return None
    problems = files.at(name)
    with problems.refusals():
        surface = ShownSurface(read_surface(file, size=context.size, writable=False))
        before = problems.total
        _check_values(surface, tier, problems)
        if problems.total == before:
            return surface
    return None


def _check_values(shown: ShownSurface, tier: Tier, problems: FileProblems) -> None:
    """Check every pixel; the usual case costs a few passes over the image."""
    image, mask = shown.image, shown.mask
    depth, object_id = image.depth_m, image.object_id
    # The background is +inf, which the smallest value does not see, and nothing else is.
    if not (np.array_equal(depth < np.inf, mask) and (depth.min() > 0)):
        with np.errstate(invalid="ignore"):
            bad = np.where(mask, ~((depth > 0) & (depth < np.inf)), depth != np.inf)
        _report(
            problems,
            "DEPTH_INVALID",
            bad,
            lambda at: (
                f"Z is {depth[at]} where the object id is {object_id[at]}; required: "
                "positive and finite on an object, +inf elsewhere"
            ),
        )
    # Bits are compared faster than floats; -0.0 is sorted out below.
    layer = (image.m0.view(np.uint32) | image.m1.view(np.uint32)) != 0
    if np.any(layer > mask) or not _in_range(shown, tier):
        bad = ~mask & ((image.m0 != 0) | (image.m1 != 0))
        bad |= mask & ~np.isin(object_id, [each.id for each in tier.objects])
        for each in tier.objects:
            for channel, coordinate in zip((image.m0, image.m1), each.material, strict=True):
                outside = ~coordinate.contains(channel, MATERIAL_TOLERANCE)
                bad |= outside & shown.of_object(each.id)
        _report(
            problems,
            "SURFACE_INVALID",
            bad,
            lambda at: (
                f"object id {object_id[at]}, material ({image.m0[at]}, {image.m1[at]}); required: "
                f"an object of {tier.name} and a coordinate in its range, or all 0"
            ),
        )


def _in_range(shown: ShownSurface, tier: Tier) -> bool:
    """Return True only if every pixel has a known object and material in its range."""
    image = shown.image
    left = shown.count
    for each in tier.objects:
        mine = shown.of_object(each.id)
        count = int(np.count_nonzero(mine))
        left -= count
        for channel, coordinate in zip((image.m0, image.m1), each.material, strict=True):
            # The zeros of the background do no harm to a range that contains 0.
            values = channel if count == shown.count and count else channel[mine]
            if not values.size:
                continue
            ends = np.array([values.min(), values.max()])
            if not coordinate.contains(ends, MATERIAL_TOLERANCE).all():
                return False
    return left == 0


def _report(
    problems: FileProblems,
    code: str,
    bad: npt.NDArray[np.bool_],
    describe: Callable[[tuple[int, int]], str],
) -> None:
    """Report one issue for an image: the first bad pixel, and how many there are."""
    count = int(np.count_nonzero(bad))
    if count:
        row, column = divmod(int(np.flatnonzero(bad)[0]), bad.shape[1])
        text = f"{describe((row, column))} ({count} pixels)"
        problems.add(code, f"row {row}, column {column}", text)
