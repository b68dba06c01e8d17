"""What the frames of a sequence say together, gathered while each file is decoded once."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from pliant.spec.arrays import Rgb
from pliant.spec.camera import Camera
from pliant.spec.model import Tier
from pliant.spec.storage import layout
from pliant.spec.validation.findings import FileProblems
from pliant.spec.validation.rules.agreement import check_agreement
from pliant.spec.validation.rules.alignment import Alignment
from pliant.spec.validation.rules.colour import MAX_FRAMES, Colours, is_blank
from pliant.spec.validation.rules.correspondences import FrameRows
from pliant.spec.validation.rules.diagnosis import RowSample, diagnose_rows
from pliant.spec.validation.rules.episodes import unordered
from pliant.spec.validation.rules.files import SequenceFiles
from pliant.spec.validation.rules.precision import GREY, JPEG, coarse_form
from pliant.spec.validation.rules.result import FrameKeys, digest_of, shape_key
from pliant.spec.validation.rules.surfaces import ShownSurface
from pliant.spec.validation.rules.windows import SoundFrame

PRECISION_FRAMES = 2
"""Frames of a sequence whose values are looked at for a coarser format."""

MIN_SHOWN = 50
"""Pixels of objects from which a picture of one colour, or of two frames, is wrong."""

MOVED_PX = 2.0
"""Points that move farther cannot have one and the same picture."""

_IN_COLOUR = ("photo", "fast", "raster")
"""Styles whose pictures have colours."""

_VISIBILITY = ("VISIBLE_DISAGREES", "MATERIAL_DISAGREES", "OCCLUDED_DISAGREES")


@dataclass
class Evidence:
    """The evidence of one sequence.

    Attributes:
        frames: Frames of the sequence.
        rows: Some rows, for the diagnosis of errors that all rows share.
        fitting: Visible points against surface images that show most of them.
        others: Visible points of the other frames.
        colours: Colour images against the surface images.
        keys: What identifies each frame.
        blank: Frames whose picture is one colour.
        looked: Pictures looked at for a coarser form.
        coarse: Coarser form -> frames that have it.
    """

    frames: int
    rows: RowSample = field(default_factory=RowSample)
    fitting: Alignment = field(default_factory=Alignment)
    others: Alignment = field(default_factory=Alignment)
    colours: Colours = field(default_factory=Colours)
    keys: FrameKeys = field(default_factory=FrameKeys)
    blank: list[int] = field(default_factory=list)
    looked: int = 0
    coarse: dict[str, list[int]] = field(default_factory=dict)

    def add_picture(self, frame: int, rgb: Rgb) -> None:
        """Note a colour image."""
        if is_blank(rgb):
            self.blank.append(frame)
        else:
            self.keys.pictures[frame] = digest_of(rgb[::4])  # a quarter of the rows tells
            if self.looked < PRECISION_FRAMES:
                self.looked += 1
                form = coarse_form(rgb)
                if form is not None:
                    self.coarse.setdefault(form, []).append(frame)

    def add_shown(self, frame: int, surface: ShownSurface) -> None:
        """Note a frame's surface image: where nothing is seen, pictures may be empty and equal."""
        if not surface.count:
            self.keys.depths.pop(frame, None)
        if surface.count < MIN_SHOWN:
            self.keys.pictures.pop(frame, None)
            if frame in self.blank:
                self.blank.remove(frame)

    def add_rows(self, camera: Camera, rows: FrameRows) -> None:
        """Note the rows of a frame."""
        self.rows.add(rows)
        self.keys.shapes[rows.frame] = shape_key(camera, rows)

    def add_surface(self, view: SoundFrame, rgb: Rgb | None, fits: bool) -> None:
        """Note how a frame's points and picture agree with its surface image.

        Args:
            view: The frame.
            rgb: Its picture, None if that breaks a rule.
            fits: Whether the surface image shows most of the points.
        """
        (self.fitting if fits else self.others).add(view)
        frame = view.rows.frame
        block = self.frames // MAX_FRAMES + 1  # two frames in a row, then a gap
        if fits and rgb is not None and frame not in self.blank and (frame // 2) % block == 0:
            self.colours.add(frame, rgb, view.surface.mask)

    def conclude(
        self,
        tier: Tier,
        info: dict[str, Any],
        cameras: Sequence[Camera] | None,
        size: tuple[int, int],
        files: SequenceFiles,
    ) -> None:
        """Report what the frames say together.

        Args:
            tier: The sequence's tier.
            info: Its sequence.json.
            cameras: Its cameras, if sound.
            size: (width, height) of the images.
            files: Its folder.
        """
        table, pictures = files.at(layout.CORRESPONDENCES_TABLE), files.at("rgb")
        if cameras is not None:
            diagnose_rows(self.rows, cameras, size, table)
            if check_agreement(tier, self.fitting, self.others, table):
                for code in _VISIBILITY:
                    if table.counts[code] > 1:
                        table.diagnose(code, "follow from DEPTH_IMAGE_DISAGREES")
        self._check_blank(info, pictures)
        self._check_coarse(info, pictures)
        reason = unordered(self.rows.rows) if info["temporal"] else None
        if reason is not None:
            files.at(layout.SEQUENCE_JSON).add("TEMPORAL_DOUBTFUL", "temporal", reason)
        repeated = cameras is not None and self._check_repeated(cameras, pictures)
        explained = self.colours.explain()
        # A surface image that is shifted against the points is also shifted against the colours.
        if explained is not None and "OFFSET_DISAGREES" not in table.counts:
            certain, text = explained
            # Noise, a depth camera's faults and foreign pictures leave doubt about an outline.
            clean = info["noise"] is None and info["style"] in _IN_COLOUR
            code = "COLOUR_DISAGREES" if certain and clean else "COLOUR_DOUBTFUL"
            if repeated and not certain:
                return  # a repeated picture shows another frame's outline
            if pictures.counts[code]:  # blank or repeated pictures: no rows to explain
                pictures.add(code, "", text)
            else:
                pictures.diagnose(code, text)

    def _check_blank(self, info: dict[str, Any], problems: FileProblems) -> None:
        if self.blank:
            known = bool(self.keys.shapes) and info["style"] != "external"
            problems.add(
                "COLOUR_DISAGREES" if known else "COLOUR_DOUBTFUL",
                f"frame {self.blank[0]}",
                f"{len(self.blank)} of {self.frames} pictures are one colour, black for example: "
                "rendering failed?",
            )

    def _check_coarse(self, info: dict[str, Any], problems: FileProblems) -> None:
        for form, frames in self.coarse.items():
            if form == GREY and info["style"] not in _IN_COLOUR:
                continue
            if form == JPEG and (info["noise"] or {}).get("jpeg_quality"):
                continue
            if 2 * len(frames) > self.looked:
                problems.diagnose("COLOUR_LOST", f"the pictures {form}")

    def _check_repeated(self, cameras: Sequence[Camera], problems: FileProblems) -> bool:
        """A picture that is repeated although the points moved shows one of the frames wrongly."""
        first: dict[int, int] = {}
        moved = []
        for frame, picture in self.keys.pictures.items():
            earlier = first.setdefault(picture, frame)
            a, b = (self.keys.shapes.get(each) for each in (earlier, frame))
            if earlier == frame or a is None or b is None:
                continue
            focal = float(min(cameras[frame].K[[0, 1], [0, 1]]))
            if np.abs(a - b).max() * focal / max(float(a[2]), 1e-6) > MOVED_PX:
                moved.append((earlier, frame))
        if moved:
            problems.add(
                "COLOUR_DISAGREES",
                f"frame {moved[0][1]}",
                f"{len(moved)} pictures repeat that of an earlier frame, here {moved[0][0]}, "
                "though the points moved",
            )
        return bool(moved)
