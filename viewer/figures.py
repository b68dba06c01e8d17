"""Figures of a dataset: contact sheets, index colours, depth, the rope's anatomy, tracks.

They are drawn from the files alone, so that they show what a reader of the dataset gets.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from pathlib import Path
from typing import Any, Final

import numpy as np
import numpy.typing as npt

from pliant.spec.dataset import Dataset
from pliant.spec.errors import CallError
from pliant.spec.io.writing import replacing
from pliant.spec.model import Tier
from pliant.spec.sequence import SequenceRecord
from pliant.spec.storage.layout import depth_name
from pliant.viewer.colours import depth_image, index_image, material_colours
from pliant.viewer.tracks import ANIMATIONS, draw_tracks, read_predicted_tracks

Rgb = npt.NDArray[np.uint8]

FIGURES: Final = ("sheet", "index", "depth", "anatomy", "tracks")

_TILE_PX: Final = 240
_GAP_PX: Final = 6
_UNKNOWN_GREY: Final = 235
_DPI: Final = 100


def draw_figure(
    root: Path,
    out: Path,
    *,
    figure: str = "sheet",
    sequence: str | None = None,
    frame: int = 0,
    count: int = 24,
) -> Path:
    """Draw a figure of a dataset.

    Args:
        root: The dataset's folder.
        out: The image to write; `.png`, `.jpg`, `.webp`, and for `anatomy` and `tracks` also `.pdf`
            and `.svg`.
        figure: One of `FIGURES`.
        sequence: Id of a sequence; None takes all (sheets) or the first that fits (the others).
        frame: Frame of `anatomy`.
        count: Images on a sheet, or steps of `tracks`.

    Returns:
        `out`.

    Raises:
        CallError: The figure, the sequence, the frame or the file's ending cannot be served.
    """
    if figure not in FIGURES:
        raise CallError(
            "unknown figure", where="--figure", found=figure, required=", ".join(FIGURES)
        )
    if count < 1:
        raise CallError("no images are asked for", where="--count", found=count, required=">= 1")
    _check_ending(out, figure)
    dataset = Dataset.open(root)
    chosen = [dataset.sequence(sequence)] if sequence else list(dataset.sequences)
    if not chosen:
        raise CallError("the dataset has no sequences", path=root)
    out.parent.mkdir(parents=True, exist_ok=True)
    with replacing(out) as partial:
        if figure in ("sheet", "index", "depth"):
            _save(contact_sheet(dataset, chosen, figure, count), partial)
        elif figure == "anatomy":
            _anatomy(dataset, chosen[0], frame, partial)
        else:
            _tracks(dataset, next((s for s in chosen if s.temporal), chosen[0]), count, partial)
    return out


def draw_predicted_tracks(
    root: Path,
    submission: Path,
    out: Path,
    *,
    sequence: str | None = None,
    frames: list[int] | None = None,
) -> Path:
    """Draw a submission's tracks through an episode.

    Args:
        root: The dataset's folder.
        submission: The submission, of kind `answers`.
        out: The image (as for `tracks`), or a `.gif` or `.mp4` of all frames.
        sequence: Id of an episode; None takes the first that is asked about.
        frames: Frames of the image; None takes 0, 22 and 87 where there are those.

    Returns:
        `out`.

    Raises:
        CallError: The submission, the episode, a frame or the file's ending cannot be served.
        MissingExtraError: `.mp4` without OpenCV.
    """
    if out.suffix.lower() not in ANIMATIONS:
        _check_ending(out, "tracks", also=ANIMATIONS)
    tracks = read_predicted_tracks(Dataset.open(root), submission, sequence)
    out.parent.mkdir(parents=True, exist_ok=True)
    with replacing(out) as partial:
        draw_tracks(tracks, partial, frames)
    return out


def contact_sheet(
    dataset: Dataset, sequences: list[SequenceRecord], layer: str = "sheet", count: int = 24
) -> Rgb:
    """Draw frames beside one another, spread evenly over the sequences.

    Args:
        dataset: The dataset.
        sequences: Where the frames come from.
        layer: `sheet` (colour over index colours and depth), `index`, `depth` or `rgb` alone; the
            last needs no surface images.
        count: Number of frames at most.

    Returns:
        uint8 (H, W, 3).
    """
    tiles = []
    # Held-out and imported sequences come without surface images: grey, or nothing if all do.
    bare = layer == "sheet" and not any(s.has(depth_name(0)) for s in sequences)
    for sequence, frame in _spread_frames(sequences, count):
        height = round(_TILE_PX * sequence.size[1] / sequence.size[0])
        shape = f" {sequence.shape}" if sequence.shape else ""
        label = f"{sequence.id} #{frame}{shape}"
        if layer == "rgb" or bare:
            tiles.append(_labelled(_resized(sequence.rgb(frame), (_TILE_PX, height)), label))
            continue
        if layer == "sheet" and not sequence.has(depth_name(frame)):
            rgb = _resized(sequence.rgb(frame), (_TILE_PX, height))
            below = np.full((height // 2, _TILE_PX, 3), _UNKNOWN_GREY, np.uint8)
            tiles.append(_labelled(np.concatenate([rgb, below]), label))
            continue
        surface = sequence.surface(frame)
        tier = dataset.tiers[sequence.tier]
        if layer == "sheet":
            half = (_TILE_PX // 2, height // 2)
            rgb = _resized(sequence.rgb(frame), (_TILE_PX, height))
            below = np.concatenate(
                [
                    _resized(index_image(surface, tier), half),
                    _resized(depth_image(surface), (_TILE_PX - half[0], half[1])),
                ],
                axis=1,
            )
            tile = np.concatenate([rgb, below])
        else:
            image = index_image(surface, tier) if layer == "index" else depth_image(surface)
            tile = _resized(image, (_TILE_PX, height))
        tiles.append(_labelled(tile, label))
    columns = min(len(tiles), max(1, math.ceil(math.sqrt(1.5 * len(tiles)))))
    rows = -(-len(tiles) // columns)
    tall, wide = tiles[0].shape[:2]
    sheet = np.full(
        (rows * (tall + _GAP_PX) + _GAP_PX, columns * (wide + _GAP_PX) + _GAP_PX, 3), 255, np.uint8
    )
    for k, tile in enumerate(tiles):
        top = _GAP_PX + (k // columns) * (tall + _GAP_PX)
        left = _GAP_PX + (k % columns) * (wide + _GAP_PX)
        sheet[top : top + tall, left : left + wide] = tile
    return sheet


def _spread_frames(sequences: list[SequenceRecord], count: int) -> list[tuple[SequenceRecord, int]]:
    """Choose frames: each sequence once before any a second time, evenly over its frames."""
    if count <= len(sequences):
        picks = np.linspace(0, len(sequences) - 1, count).round().astype(int)
        return [(sequences[k], 0) for k in picks]
    chosen = []
    for k, sequence in enumerate(sequences):
        share = count // len(sequences) + (k < count % len(sequences))
        several = min(share, sequence.frames)
        frames = np.unique(np.linspace(0, sequence.frames - 1, several).round().astype(int))
        chosen += [(sequence, int(frame)) for frame in frames]
    return chosen


def _anatomy(dataset: Dataset, sequence: SequenceRecord, frame: int, out: Path) -> None:
    """Draw how a frame came about: curve with handles, mesh, depth, index colours."""
    if not 0 <= frame < sequence.frames:
        raise CallError(
            "no such frame", where="--frame", found=frame, required=f"0 to {sequence.frames - 1}"
        )
    import matplotlib.pyplot as plt

    surface, rgb = sequence.surface(frame), sequence.rgb(frame)
    tier = dataset.tiers[sequence.tier]
    figure, axes = plt.subplots(1, 5, figsize=(18, 3.0), dpi=_DPI, facecolor="white")
    figure.subplots_adjust(0.005, 0.01, 0.995, 0.9, wspace=0.02)
    faint = (0.65 * 255 + 0.35 * rgb).astype(np.uint8)
    panels: list[tuple[str, Rgb, Callable[[Any], None] | None]] = [
        (_curve_title(sequence, frame), faint, lambda axis: _draw_curve(axis, sequence, frame)),
        (
            "material grid, visible points",
            np.full_like(rgb, 255),
            lambda axis: _draw_mesh(axis, sequence, frame, tier),
        ),
        ("image", rgb, None),
        ("depth", depth_image(surface), None),
        ("index colours", index_image(surface, tier), None),
    ]
    width, height = sequence.size
    left, right, top, bottom = _closer(surface.object_id > 0)
    for axis, (title, image, draw) in zip(axes, panels, strict=True):
        axis.imshow(image, extent=(0, width, height, 0))
        if draw:
            draw(axis)
        axis.set(xlim=(left, right), ylim=(bottom, top), xticks=[], yticks=[])
        axis.set_title(title, fontsize=11)
    figure.savefig(out)
    plt.close(figure)


def _closer(mask: npt.NDArray[np.bool_]) -> tuple[float, float, float, float]:
    """Return left, right, top, bottom of a window of the image's proportions around a mask."""
    height, width = mask.shape
    columns, rows = np.flatnonzero(mask.any(axis=0)), np.flatnonzero(mask.any(axis=1))
    if len(columns) == 0:
        return 0.0, float(width), 0.0, float(height)
    share = 0.08 + max(float(np.ptp(columns)) / width, float(np.ptp(rows)) / height)
    half = min(share, 1.0) * width / 2, min(share, 1.0) * height / 2
    u = float(np.clip((columns[0] + columns[-1]) / 2, half[0], width - half[0]))
    v = float(np.clip((rows[0] + rows[-1]) / 2, half[1], height - half[1]))
    return u - half[0], u + half[0], v - half[1], v + half[1]


def _curve_title(sequence: SequenceRecord, frame: int) -> str:
    if "control_points_m" in sequence.info["frame_info"][frame]:
        return "Bézier curve and handles"
    return "centre line" if sequence.info["parameters"].get("radius_m") else "tracked points"


def _draw_curve(axis: Any, sequence: SequenceRecord, frame: int) -> None:
    """Draw the Bezier curve with its handles, or the tracked points where there is no curve."""
    info = sequence.info["frame_info"][frame]
    if "control_points_m" not in info:
        table = sequence.correspondences(frame)
        line = np.asarray(sequence.points()["kind"].to_pylist()) == "centreline"
        uv = np.stack([table["u_px"].to_numpy(), table["v_px"].to_numpy()], axis=1)
        if line.any():
            axis.plot(*uv[line].T, color="#1f4e9c", lw=1.6)
        else:
            axis.plot(*uv.T, ".", color="#1f4e9c", ms=2)
        return
    radius = float(sequence.info["parameters"].get("radius_m", 0.0))
    nodes, handles = (
        _project(sequence, frame, _lifted(np.asarray(info[key], np.float64), radius))
        for key in ("control_points_m", "handles_m")
    )
    t = np.linspace(0, 1, 24)[:, None]
    for k in range(len(nodes) - 1):
        a, b, c, d = nodes[k], handles[k, 1], handles[k + 1, 0], nodes[k + 1]
        curve = (1 - t) ** 3 * a + 3 * (1 - t) ** 2 * t * b + 3 * (1 - t) * t**2 * c + t**3 * d
        axis.plot(*curve.T, color="#1f4e9c", lw=1.8)
    for node, (left, right) in zip(nodes, handles, strict=True):
        axis.plot(*np.stack([left, node, right]).T, color="#d1495b", lw=0.8)
        axis.plot(*np.stack([left, right]).T, "o", color="#d1495b", ms=2.2)
        axis.plot(*node, "s", color="#edae49", mec="#5c4310", ms=4.5, mew=0.6)


def _lifted(flat: npt.NDArray[np.float64], height: float) -> npt.NDArray[np.float64]:
    """Put plane points at a height; points in space stay."""
    if flat.shape[-1] == 3:
        return flat
    return np.concatenate([flat, np.full((*flat.shape[:-1], 1), height)], axis=-1)


def _project(
    sequence: SequenceRecord, frame: int, points: npt.NDArray[np.float64]
) -> npt.NDArray[np.float64]:
    K, pose = sequence.camera(frame)
    local = points @ pose[:3, :3].T + pose[:3, 3]
    image = local @ K.T
    uv: npt.NDArray[np.float64] = image[..., :2] / image[..., 2:]
    return uv


def _draw_mesh(axis: Any, sequence: SequenceRecord, frame: int, tier: Tier) -> None:
    """Draw the lines of constant material coordinate, and the visible material points."""
    surface = sequence.surface(frame)
    on = surface.object_id == tier.queried_object
    height, width = on.shape
    rope = tier.kind == "rope"
    steps = (80, 6) if rope else (32, 32)
    lines = np.zeros(on.shape, bool)
    for values, step, field in zip(
        (surface.m0, surface.m1), steps, tier.queried.material, strict=True
    ):
        cell = np.floor((values - field.min) / (field.max - field.min) * step)
        cell = np.where(on, cell, -1)
        lines[:, 1:] |= cell[:, 1:] != cell[:, :-1]
        lines[1:] |= cell[1:] != cell[:-1]
    image = np.full((height, width, 3), 255, np.uint8)
    image[on] = (232, 238, 247)
    image[lines] = (90, 110, 140)
    axis.imshow(image, extent=(0, width, height, 0), interpolation="nearest")
    table = sequence.correspondences(frame)
    seen = np.asarray(table["visibility"].to_pylist()) == "visible"
    seen &= np.asarray(sequence.points()["kind"].to_pylist()) == "surface"
    uv = np.stack([table["u_px"].to_numpy(), table["v_px"].to_numpy()], axis=1)[seen]
    axis.plot(*uv.T, ".", color="#d1495b", ms=1.0)


def _tracks(dataset: Dataset, sequence: SequenceRecord, count: int, out: Path) -> None:
    """Draw a strip of frames with a dozen points and where they went; hollow: not visible."""
    import matplotlib.pyplot as plt

    steps = np.unique(np.linspace(0, sequence.frames - 1, min(count, 8)).round().astype(int))
    tier = dataset.tiers[sequence.tier]
    uv, states, colours = _point_tracks(sequence, tier)
    columns = min(len(steps), 4)
    rows = -(-len(steps) // columns)
    width, height = sequence.size
    figure, axes = plt.subplots(
        rows,
        columns,
        figsize=(4.1 * columns, (4.1 * height / width + 0.25) * rows),
        dpi=_DPI,
        facecolor="white",
        squeeze=False,
    )
    figure.subplots_adjust(0.005, 0.005, 0.995, 0.96, wspace=0.02, hspace=0.09)
    for axis in axes.ravel():
        axis.set_axis_off()
    for axis, frame in zip(axes.ravel(), steps, strict=False):
        axis.imshow(sequence.rgb(int(frame)), extent=(0, width, height, 0))
        for k, colour in enumerate(colours):
            if sequence.temporal:
                trail = uv[max(0, frame - 60) : frame + 1, k]
                axis.plot(*trail.T, color="black", lw=2.2, alpha=0.5)
                axis.plot(*trail.T, color=colour, lw=1.3)
            seen = states[frame, k] == "visible"
            axis.plot(
                *uv[frame, k],
                "o",
                ms=6.5,
                mfc=colour if seen else "none",
                mec="white" if seen else colour,
                mew=1.2,
            )
        axis.set(xlim=(0, width), ylim=(height, 0))
        axis.set_title(f"{sequence.id}, frame {frame}", fontsize=9)
    figure.savefig(out)
    plt.close(figure)


def _point_tracks(
    sequence: SequenceRecord, tier: Tier, count: int = 12
) -> tuple[npt.NDArray[np.float64], npt.NDArray[np.str_], npt.NDArray[np.float64]]:
    """Return uv (frames, points, 2), states (frames, points) and colours of spread points."""
    points = sequence.points()
    of_object = np.asarray(points["object"].to_numpy()) == tier.queried_object
    rows = np.flatnonzero(of_object & (np.asarray(points["kind"].to_pylist()) == "surface"))
    m0, m1 = (points[name].to_numpy().astype(np.float64) for name in ("m0", "m1"))
    if tier.kind == "rope":
        order = rows[np.lexsort((np.abs(m1[rows] - np.pi / 2), np.round(m0[rows], 6)))]
        chosen = order[np.linspace(0, len(order) - 1, count).round().astype(int)]
    else:
        grid = np.stack(np.meshgrid([0.1, 0.37, 0.63, 0.9], [0.15, 0.5, 0.85]), -1).reshape(-1, 2)
        place = np.stack([m0[rows], m1[rows]], axis=1)
        chosen = rows[np.argmin(((place[None] - grid[:, None]) ** 2).sum(-1), axis=1)]
    table = sequence.correspondences()
    shape = (sequence.frames, len(points))
    uv = np.stack([table["u_px"].to_numpy(), table["v_px"].to_numpy()], axis=1).astype(np.float64)
    states = np.asarray(table["visibility"].to_pylist()).reshape(shape)
    colours = material_colours(m0[chosen], np.zeros(len(chosen)), tier)
    if tier.kind != "rope":
        colours = material_colours(m0[chosen], m1[chosen], tier)
    return uv.reshape(*shape, 2)[:, chosen], states[:, chosen], colours


def _resized(image: Rgb, size: tuple[int, int]) -> Rgb:
    from PIL import Image

    return np.asarray(Image.fromarray(image).resize(size, Image.Resampling.LANCZOS))


def _labelled(tile: Rgb, text: str) -> Rgb:
    """Write a line of text over a tile."""
    from PIL import Image, ImageDraw, ImageFont

    strip = Image.new("RGB", (tile.shape[1], 16), "white")
    ImageDraw.Draw(strip).text((1, 1), text, fill=(40, 40, 40), font=ImageFont.load_default(11))
    return np.concatenate([np.asarray(strip), tile])


def _save(image: Rgb, out: Path) -> None:
    from PIL import Image

    if out.suffix.lower() in (".jpg", ".jpeg"):
        Image.fromarray(image).save(out, quality=88)
    else:
        Image.fromarray(image).save(out)


def _check_ending(out: Path, figure: str, also: tuple[str, ...] = ()) -> None:
    allowed = [".png", ".jpg", ".jpeg", ".webp"]
    if figure in ("anatomy", "tracks"):
        allowed += [".pdf", ".svg"]
    if out.suffix.lower() not in allowed:
        raise CallError(
            "the figure cannot be written in this format",
            path=out,
            found=out.suffix or "no ending",
            required=", ".join([*allowed, *also]),
        )
