"""What the target images' surface layer says about answers: matter under them, silhouettes."""

from __future__ import annotations

import functools
import math
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np
import numpy.typing as npt

from pliant.evaluator.metrics.blocks import Block
from pliant.evaluator.submission.queries import Queries
from pliant.spec.arrays import BoolArray, FloatArray, IntArray
from pliant.spec.dataset import Dataset
from pliant.spec.errors import SpecError
from pliant.spec.model import MaterialObject
from pliant.spec.storage import layout

_CACHED_FRAMES: Final = 24


@dataclass(frozen=True)
class ObjectSurface:
    """The queried object in one frame.

    Attributes:
        on_object: bool (H, W).
        m0, m1: float32 (H, W), material coordinates where `on_object`.
    """

    on_object: BoolArray
    m0: npt.NDArray[np.float32]
    m1: npt.NDArray[np.float32]

    def material(self, row: IntArray, column: IntArray) -> FloatArray:
        """Return the material coordinates at pixels, float64 (N, 2)."""
        return np.stack([self.m0[row, column], self.m1[row, column]], axis=1).astype(np.float64)


@dataclass(frozen=True)
class SurfaceFacts:
    """What the surfaces say about the queries of a block.

    Attributes:
        known: bool (N,), queries whose target frame has a surface image.
        on_object: bool (N,), answers that are on the queried object.
        geodesic_m: float64 (N,), distance on the material; NaN off the object.
        silhouette_px: float64 (N,), of the true position to the silhouette; NaN if not known.
        steps_m: float64 (N, 2), from the right material point to the one under the answer or, off
            the object, nearest to it, along both coordinates; NaN where none is within
            `reach_px`.
        pixel_m: float64 (N,), what one pixel of the target frame typically spans on the material;
            NaN if not known.
    """

    known: BoolArray
    on_object: BoolArray
    geodesic_m: FloatArray
    silhouette_px: FloatArray
    steps_m: FloatArray
    pixel_m: FloatArray


class Surfaces:
    """Reads surface images and point tables of a dataset, each as rarely as it can.

    Args:
        dataset: The dataset.
        search_px: Number of rows and columns around an answer's pixel that are searched for the
            object.
        reach_px: Answers so near the object have `steps_m`, too.
    """

    def __init__(self, dataset: Dataset, search_px: int = 1, reach_px: float = 0) -> None:
        self._dataset = dataset
        self._search_px = search_px
        self._reach_px = reach_px
        self._points: dict[str, FloatArray] = {}
        self.frame = functools.lru_cache(_CACHED_FRAMES)(self._read)
        self._step_m = functools.cache(self._typical_step_m)
        self.facts = functools.lru_cache(1)(self._look_up_block)

    def queried(self, tier: str) -> MaterialObject:
        """Return the object of a tier that queries are on."""
        return self._dataset.tiers[tier].queried

    def path(self, sequence: str, frame: int) -> Path:
        """Return the path of a frame's surface image, whether or not it exists."""
        return self._dataset.sequence(sequence).dir / layout.depth_name(frame)

    def _read(self, name: str, frame: int) -> ObjectSurface | None:
        """Return the queried object in a frame, or None if the dataset has no surface of it."""
        sequence = self._dataset.sequence(name)
        if not sequence.has(layout.depth_name(frame)):
            return None
        surface = sequence.surface(frame)
        queried = sequence.described.queried_object
        return ObjectSurface(surface.object_id == queried, surface.m0, surface.m1)

    def _typical_step_m(self, name: str, frame: int) -> float:
        surface = self.frame(name, frame)
        tier = self._dataset.sequence(name).tier
        return 0.0 if surface is None else typical_step_m(surface, self.queried(tier))

    def point_material(self, sequence: str) -> FloatArray | None:
        """Return the material coordinates of a tier's points, float64 (points, 2), or None."""
        found = self._dataset.sequence(sequence)
        if found.tier not in self._points:
            if not found.has(layout.POINTS_TABLE):
                return None  # asked again: another sequence of the tier may have the table
            table = found.points()
            columns = [table[name].to_numpy() for name in ("m0", "m1")]
            self._points[found.tier] = np.stack(columns, axis=1).astype(np.float64)
        return self._points[found.tier]

    def _look_up_block(self, block: Block, queries: Queries) -> SurfaceFacts:
        """Look up a block's answers and true positions in the target frames."""
        count = len(block.state)
        facts = SurfaceFacts(
            np.zeros(count, bool), np.zeros(count, bool), np.full(count, np.nan),
            np.full(count, np.nan), np.full((count, 2), np.nan), np.full(count, np.nan),
        )  # fmt: skip
        for index in range(len(block.starts) - 1):
            pair = block.first_pair + index
            sequence = queries.sequences[queries.sequence_b[pair]]
            surface = self.frame(sequence, int(queries.frame_b[pair]))
            material = self.point_material(sequence)
            rows = np.arange(block.starts[index], block.starts[index + 1])
            rows = rows[block.counted[rows]]
            if surface is not None and material is not None and len(rows):
                queried = self.queried(queries.tiers[queries.tier[pair]])
                self._look_up(block, rows, surface, material, queried, facts)
                if block.point is not None:
                    facts.pixel_m[rows] = self._step_m(sequence, int(queries.frame_b[pair]))
        return facts

    def _look_up(
        self,
        block: Block,
        rows: IntArray,
        surface: ObjectSurface,
        material: FloatArray,
        queried: MaterialObject,
        facts: SurfaceFacts,
    ) -> None:
        if block.point is None:
            return
        facts.known[rows] = True
        facts.silhouette_px[rows] = silhouette_distance_px(surface.on_object, block.true_px[rows])
        answered = rows
        if block.missing is not None:
            answered = rows[~block.missing[rows]]
            facts.geodesic_m[rows[block.missing[rows]]] = farthest_material_m(queried)
        points = block.point[answered]
        if len(points) and (points.min() < 0 or points.max() >= len(material)):
            raise SpecError(
                "the truth names a point that the point table has not",
                path=self._dataset.root,
                found=int(points.max()),
                required=f"0 to {len(material) - 1}",
                fix="Run: pliant validate",
            )
        at = block.answer_px[answered].astype(np.float64)
        row, column, found = nearest_object_pixel(surface.on_object, at, self._search_px)
        facts.on_object[answered] = found
        under = surface.material(row[found], column[found])
        facts.geodesic_m[answered[found]] = queried.distance_m(under, material[points[found]])
        facts.steps_m[answered[found]] = queried.steps_m(under - material[points[found]])
        off = np.flatnonzero(~found)
        if not self._reach_px or not len(off):
            return
        row, column, near = nearest_object_pixel(surface.on_object, at[off], int(self._reach_px))
        centre_px = np.stack([column, row], axis=1) + 0.5
        near &= np.hypot(*(centre_px - at[off]).T) <= self._reach_px
        off = off[near]
        under = surface.material(row[near], column[near])
        facts.steps_m[answered[off]] = queried.steps_m(under - material[points[off]])


def pixel_steps_m(surface: ObjectSurface, queried: MaterialObject) -> tuple[FloatArray, FloatArray]:
    """Return the material distance of neighbouring pixels of the object, 0 where one is off it.

    Returns:
        across: float64 (H, W - 1), metres, from each pixel to the next one in its row.
        down: float64 (H - 1, W), metres, to the next one in its column.
    """
    field = np.stack([surface.m0, surface.m1], axis=-1).astype(np.float64)
    on = surface.on_object
    across = np.where(on[:, 1:] & on[:, :-1], queried.distance_m(field[:, 1:], field[:, :-1]), 0)
    down = np.where(on[1:] & on[:-1], queried.distance_m(field[1:], field[:-1]), 0)
    return across, down


def typical_step_m(surface: ObjectSurface, queried: MaterialObject) -> float:
    """Return the median material distance of neighbouring pixels of the object, metres; 0 for none.

    Folds and crossings, where neighbours are far apart on the material, do not move the median.
    """
    rows, columns = (np.flatnonzero(surface.on_object.any(axis=axis)) for axis in (1, 0))
    if not len(rows):
        return 0.0
    box = slice(rows[0], rows[-1] + 1), slice(columns[0], columns[-1] + 1)
    part = ObjectSurface(surface.on_object[box], surface.m0[box], surface.m1[box])
    steps = np.concatenate([each[each > 0] for each in pixel_steps_m(part, queried)])
    return float(np.median(steps)) if len(steps) else 0.0


def farthest_material_m(described: MaterialObject) -> float:
    """Return the largest distance that two points of an object can have, metres."""
    spans = [
        coordinate.metres_per_unit * (coordinate.max - coordinate.min)
        if coordinate.period is None
        else coordinate.metres_per_unit * coordinate.period / 2
        for coordinate in described.material
    ]
    return math.hypot(*spans)


def nearest_object_pixel(
    on_object: BoolArray, uv_px: FloatArray, search_px: int
) -> tuple[IntArray, IntArray, BoolArray]:
    """Return the object's pixel under each position, or the nearest in a small window about it.

    A point near a silhouette is seen in a pixel whose centre may miss the object: the pixels
    within `search_px` rows and columns are looked at as well, nearest centre first.

    Args:
        on_object: bool (H, W), pixels of the object.
        uv_px: float64 (N, 2), finite.
        search_px: Half the width of the window; 0 looks at one pixel.

    Returns:
        row, column: int64 (N,), the pixel (0, 0 where there is none).
        found: bool (N,).
    """
    height, width = on_object.shape
    # Clipped before the conversion, which a huge finite number would not survive.
    home_column = np.floor(np.clip(uv_px[:, 0], -1e6, 1e6)).astype(np.int64)
    home_row = np.floor(np.clip(uv_px[:, 1], -1e6, 1e6)).astype(np.int64)
    best = np.full(len(uv_px), np.inf)
    row = np.zeros(len(uv_px), np.int64)
    column = np.zeros(len(uv_px), np.int64)
    inside_home = (home_row >= 0) & (home_row < height) & (home_column >= 0) & (home_column < width)
    for down in range(-search_px, search_px + 1):
        for right in range(-search_px, search_px + 1):
            r, c = home_row + down, home_column + right
            inside = (r >= 0) & (r < height) & (c >= 0) & (c < width) & inside_home
            inside[inside] = on_object[r[inside], c[inside]]
            squared = (c + 0.5 - uv_px[:, 0]) ** 2 + (r + 0.5 - uv_px[:, 1]) ** 2
            if down == 0 and right == 0:
                squared = np.full(len(uv_px), -1.0)  # the pixel itself comes first
            better = inside & (squared < best)
            best[better] = squared[better]
            row[better], column[better] = r[better], c[better]
    return row, column, np.isfinite(best)


def silhouette_distance_px(on_object: BoolArray, uv_px: FloatArray) -> FloatArray:
    """Return how far positions are from the nearest pixel that is not the object's.

    Args:
        on_object: bool (H, W), pixels of the object.
        uv_px: float64 (N, 2).

    Returns:
        float64 (N,), pixels to the centre of the nearest pixel outside that touches the
        object's mask (the border of the image is outside); inf where the object fills nothing.
    """
    framed = np.pad(on_object, 1)
    touching = np.zeros_like(framed)
    touching[1:] |= framed[:-1]
    touching[:-1] |= framed[1:]
    touching[:, 1:] |= framed[:, :-1]
    touching[:, :-1] |= framed[:, 1:]
    touching &= ~framed
    rows, columns = np.nonzero(touching)
    if not len(rows):
        return np.full(len(uv_px), np.inf)
    centres = np.stack([columns - 0.5, rows - 0.5], axis=1)  # the frame shifts by one pixel
    # Imported here: only figures of surfaces need it.
    from scipy.spatial import cKDTree

    distance: FloatArray = cKDTree(centres).query(uv_px)[0]
    return distance
