"""Figures of a dataset: contact sheets, index colours, depth, tracks.

They are drawn from the files alone, so that they show what a reader of the dataset gets.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Final

import numpy as np
import numpy.typing as npt
from PIL import Image

from pliant.evaluator.metrics.blocks import positions_px
from pliant.evaluator.report.colours import material_colours
from pliant.evaluator.report.contact_sheet import contact_sheet, evenly
from pliant.spec.arrays import FloatArray
from pliant.spec.conventions import VISIBLE
from pliant.spec.dataset import Dataset
from pliant.spec.errors import CallError
from pliant.spec.io.writing import replacing
from pliant.spec.point_mesh import PosedMesh, states_of
from pliant.spec.sequence import SequenceRecord
from pliant.spec.storage import layout
from pliant.viewer.drawing import DRAWINGS, PICTURES, check_ending, show

_SHEETS: Final = ("sheet", "index", "depth")
FIGURES: Final = (*_SHEETS, "tracks")

_NEEDED: Final = {
    "index": layout.depth_name(0),
    "depth": layout.depth_name(0),
    "tracks": layout.POINTS_TABLE,
}

_STEPS: Final = 8  # panels of tracks at most
_POINTS: Final = 12
_COLUMNS: Final = 4
_WIDTH_IN: Final = 4.1
_DPI: Final = 100
_TITLE_IN: Final = 0.3
_TRAIL: Final = 60


def draw_figure(
    root: Path,
    out: Path,
    *,
    figure: str = "sheet",
    sequence: str | None = None,
    count: int = 24,
) -> Path:
    """Draw a figure of a dataset.

    Args:
        root: The dataset's folder.
        out: The image to write; `.png`, `.jpg`, `.webp`, and for `tracks` also `.pdf` and
            `.svg`.
        figure: One of `FIGURES`.
        sequence: Id of a sequence; None takes all (sheets) or the first that fits (tracks).
        count: Images on a sheet, or of `tracks`.

    Returns:
        `out`.

    Raises:
        CallError: The sequence or the file's ending cannot be served.
    """
    if count < 1:
        raise CallError("invalid number of images", where="--count", found=count, required=">= 1")
    check_ending(out, PICTURES if figure in _SHEETS else DRAWINGS)
    dataset = Dataset.open(root)
    chosen = [dataset.chosen(sequence)] if sequence else list(dataset.sequences)
    if not chosen:
        raise CallError("the dataset has no sequences", path=root)
    if figure in _NEEDED:  # withheld sequences and imported ones do not have it
        chosen = [each for each in chosen if each.has(_NEEDED[figure])]
    if not chosen:
        raise CallError(
            "the dataset does not contain what the figure shows",
            path=root,
            where=f"--figure {figure}",
            required=f"a sequence with {_NEEDED[figure]}",
            fix="Draw the pictures alone, with --figure sheet.",
        )
    out.parent.mkdir(parents=True, exist_ok=True)
    with replacing(out) as partial:
        if figure in _SHEETS:
            sheet = Image.fromarray(contact_sheet(dataset, chosen, figure, count))
            sheet.save(partial, quality=88)  # PNG has none
        else:
            episode = next((s for s in chosen if s.temporal), chosen[0])
            frames = evenly(min(count, _STEPS), episode.frames)
            _draw_tracks(episode, frames, partial)
    return out


def _true_tracks(
    sequence: SequenceRecord,
) -> tuple[FloatArray, npt.NDArray[np.bool_], FloatArray]:
    """Return where N points spread over the queried object are in every one of T frames.

    Returns:
        Positions in pixels, float64 (T, N, 2); whether they are visible, bool (T, N); colours,
        float64 (N, 3), 0 to 1.
    """
    tier, mesh = sequence.described, PosedMesh.of(sequence)
    m = mesh.material
    if tier.kind == "rope":  # along one side
        order = np.lexsort((np.abs(m[:, 1] - np.pi / 2), np.round(m[:, 0], 6)))
        chosen = order[np.linspace(0, len(order) - 1, _POINTS).round().astype(int)]
        colours = material_colours(m[chosen, 0], np.zeros(len(chosen)), tier)
    else:
        grid = np.stack(np.meshgrid([0.1, 0.37, 0.63, 0.9], [0.15, 0.5, 0.85]), -1).reshape(-1, 2)
        chosen = np.argmin(((m[None] - grid[:, None]) ** 2).sum(-1), axis=1)
        colours = material_colours(m[chosen, 0], m[chosen, 1], tier)
    table, rows = sequence.correspondences(), mesh.rows[chosen]
    uv_px = positions_px(table, "u_px", "v_px").reshape(sequence.frames, -1, 2)
    visible = (states_of(table, sequence.id) == VISIBLE).reshape(sequence.frames, -1)
    return uv_px[:, rows], visible[:, rows], colours


def _draw_tracks(sequence: SequenceRecord, frames: Sequence[int], out: Path) -> None:
    """Write frames as panels, row by row, with dots for the points, in episodes with their trails.

    A dot is hollow where its point is not visible.

    Args:
        sequence: The sequence.
        frames: The frames to show.
        out: The image to write.
    """
    from matplotlib.figure import Figure

    uv_px, visible, colours = _true_tracks(sequence)
    size = sequence.size
    columns = min(len(frames), _COLUMNS)
    rows = -(-len(frames) // columns)
    image_in = _WIDTH_IN * size[1] / size[0]
    tall = rows * (image_in + _TITLE_IN)
    figure = Figure(figsize=(_WIDTH_IN * columns, tall), dpi=_DPI, facecolor="white")
    figure.subplots_adjust(
        0.004, 0.005, 0.996, 1 - _TITLE_IN / tall, wspace=0.02, hspace=_TITLE_IN / image_in
    )
    axes = list(figure.subplots(rows, columns, squeeze=False).ravel())
    for unused in axes[len(frames) :]:
        unused.set_axis_off()
    for axis, frame in zip(axes, frames, strict=False):
        show(axis, sequence.rgb(frame), f"{sequence.id}, frame {frame}")
        for k, colour in enumerate(colours):
            if sequence.temporal:
                trail = uv_px[max(0, frame - _TRAIL) : frame + 1, k]
                axis.plot(*trail.T, color="black", lw=2.2, alpha=0.5)
                axis.plot(*trail.T, color=colour, lw=1.3)
            face, edge = (colour, "white") if visible[frame, k] else ("none", colour)
            axis.plot(*uv_px[frame, k], "o", ms=6, mfc=face, mec=edge, mew=1.0)
    figure.savefig(out)
