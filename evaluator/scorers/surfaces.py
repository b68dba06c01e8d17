"""What the target images' surface layer says about answers: matter under them, silhouettes."""

from __future__ import annotations

from collections import OrderedDict
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np
import numpy.typing as npt

from pliant.evaluator.arrays import BoolArray, FloatArray
from pliant.evaluator.metrics.geodesic import (
    farthest_material_m,
    nearest_object_pixel,
    silhouette_distance_px,
    surface_material,
)
from pliant.evaluator.submission.blocks import Block
from pliant.evaluator.submission.queries import Queries
from pliant.spec.dataset import Dataset
from pliant.spec.errors import SpecError
from pliant.spec.model import MaterialObject
from pliant.spec.sequence import SequenceRecord
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


@dataclass(frozen=True)
class SurfaceFacts:
    """What the surfaces say about the queries of a block.

    Attributes:
        known: bool (N,), queries whose target frame has a surface image.
        on_object: bool (N,), answers that lie on the queried object.
        geodesic_m: float64 (N,), distance on the material; NaN off the object.
        silhouette_px: float64 (N,), of the true position to the silhouette; NaN if not known.
    """

    known: BoolArray
    on_object: BoolArray
    geodesic_m: FloatArray
    silhouette_px: FloatArray


class Surfaces:
    """Reads surface images and point tables of a dataset, each as rarely as it can.

    Args:
        dataset: The dataset.
        search_px: So many rows and columns about an answer's pixel are searched for the object.
    """

    def __init__(self, dataset: Dataset, search_px: int = 1) -> None:
        self._dataset = dataset
        self._search_px = search_px
        self._frames: OrderedDict[tuple[str, int], ObjectSurface | None] = OrderedDict()
        self._points: dict[str, FloatArray] = {}
        self._last: tuple[int, SurfaceFacts] | None = None

    def queried(self, tier: str) -> MaterialObject:
        """Return the object of a tier that queries are on."""
        return self._dataset.tiers[tier].queried

    def frame(self, sequence: str, frame: int) -> ObjectSurface | None:
        """Return the queried object in a frame, or None if the dataset holds no surface of it."""
        key = (sequence, frame)
        if key in self._frames:
            self._frames.move_to_end(key)
            return self._frames[key]
        found = self._read(self._dataset.sequence(sequence), frame)
        self._frames[key] = found
        if len(self._frames) > _CACHED_FRAMES:
            self._frames.popitem(last=False)
        return found

    def path(self, sequence: str, frame: int) -> Path:
        """Return where a frame's surface image lies, or would lie."""
        return self._dataset.sequence(sequence).dir / layout.depth_name(frame)

    def _read(self, sequence: SequenceRecord, frame: int) -> ObjectSurface | None:
        if not sequence.has(layout.depth_name(frame)):
            return None
        surface = sequence.surface(frame)
        queried = sequence.described.queried_object
        return ObjectSurface(surface.object_id == queried, surface.m0, surface.m1)

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

    def facts(self, block: Block, queries: Queries) -> SurfaceFacts:
        """Look a block's answers and true positions up in the target frames."""
        if self._last is not None and self._last[0] == block.first_row:
            return self._last[1]
        count = len(block.state)
        facts = SurfaceFacts(
            np.zeros(count, bool), np.zeros(count, bool), np.full(count, np.nan),
            np.full(count, np.nan),
        )  # fmt: skip
        for index in range(len(block.starts) - 1):
            pair = block.first_pair + index
            sequence = queries.sequences[queries.sequence_b[pair]]
            surface = self.frame(sequence, int(queries.frame_b[pair]))
            material = self.point_material(sequence)
            if surface is None or material is None:
                continue
            rows = np.arange(block.starts[index], block.starts[index + 1])
            rows = rows[block.counted[rows]]
            tier = queries.tiers[queries.tier[pair]]
            self._look_up(block, rows, surface, material, tier, facts)
        self._last = (block.first_row, facts)
        return facts

    def _look_up(
        self,
        block: Block,
        rows: npt.NDArray[np.int64],
        surface: ObjectSurface,
        material: FloatArray,
        tier: str,
        facts: SurfaceFacts,
    ) -> None:
        if not len(rows) or block.point is None:
            return
        facts.known[rows] = True
        facts.silhouette_px[rows] = silhouette_distance_px(surface.on_object, block.true_px[rows])
        answered = rows
        if block.missing is not None:
            answered = rows[~block.missing[rows]]
            missing = rows[block.missing[rows]]
            facts.geodesic_m[missing] = farthest_material_m(self.queried(tier))
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
        under = surface_material(surface.m0, surface.m1, row[found], column[found])
        right = material[points[found]]
        facts.geodesic_m[answered[found]] = self.queried(tier).distance_m(under, right)
