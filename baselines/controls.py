"""Controls: answers that do not use the image, as lower and upper bounds of every table."""

from __future__ import annotations

import hashlib
from collections.abc import Mapping
from typing import Any, Final

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc

from pliant.baselines.pixels import central_position, pixel_centres, searched_mask
from pliant.spec.answers import Answers
from pliant.spec.calls import check_type
from pliant.spec.dataset import Dataset
from pliant.spec.errors import CallError, SpecError
from pliant.spec.frame import Pair
from pliant.spec.io.parquet_columns import stacked
from pliant.spec.storage.layout import truth_name

_UINT64: Final = 2**64


class Identity:
    """Answers with the query's own pixel: as if nothing had moved."""

    name = "identity"

    def describe(self) -> Mapping[str, Any]:
        """Return the method's name."""
        return {"name": self.name}

    def answer(self, pair: Pair) -> Answers:
        """Return the queries as answers.

        Args:
            pair: Its images are not looked at.
        """
        return Answers(uv_px=pair.uv_a_px.astype(np.float32))


class RandomInMask:
    """Answers with a random place on the target's object.

    The place depends on the seed, the two frames and the query alone, so that neither other
    queries nor the order of pairs change it.

    Args:
        seed: Any whole number.
    """

    name = "random"

    def __init__(self, seed: int = 0) -> None:
        check_type("seed", seed, int, required="a whole number")
        self._seed = seed

    def describe(self) -> Mapping[str, Any]:
        """Return name and seed."""
        return {"name": self.name, "seed": self._seed}

    def answer(self, pair: Pair) -> Answers:
        """Return places uniform over the object's pixels (over the image without a mask).

        Args:
            pair: The keys of its frames, the target's mask and the queries are used.
        """
        source, target, uv_a_px = pair.source, pair.target, pair.uv_a_px
        places = pixel_centres(searched_mask(target))  # (G, 2)
        if len(places) == 0:
            return Answers(uv_px=np.tile(central_position(target), (len(uv_a_px), 1)))
        prefix = f"{self._seed}\0{source.key}\0{target.key}\0".encode()
        draws = np.array(
            [
                np.frombuffer(hashlib.sha256(prefix + uv.tobytes()).digest()[:24], dtype="<u8")
                for uv in uv_a_px.astype("<f4")
            ],
            dtype=np.uint64,
        ).reshape(-1, 3)  # per query: which pixel, and where in it
        pixel = (draws[:, 0] % np.uint64(len(places))).astype(np.int64)
        inside = draws[:, 1:].astype(np.float64) / _UINT64 - 0.5  # (N, 2) in [-0.5, 0.5]
        return Answers(uv_px=places[pixel] + inside.astype(np.float32))


class MaskCentroid:
    """Answers with the centroid of the target's object, which may be off the object."""

    name = "centroid"

    def describe(self) -> Mapping[str, Any]:
        """Return the method's name."""
        return {"name": self.name}

    def answer(self, pair: Pair) -> Answers:
        """Return the mean of the mask's pixel centres, or the image's centre without a mask.

        Args:
            pair: The target's mask is used.
        """
        return Answers(uv_px=np.tile(central_position(pair.target), (len(pair.uv_a_px), 1)))


class Oracle:
    """Answers with the truth: the ceiling, and a check of the evaluator.

    It is not a `Matcher`, since it looks at no image, but a `SplitMatcher`. It gives no sigma:
    without an error there is no best one.
    """

    name = "oracle"

    def describe(self) -> Mapping[str, Any]:
        """Return the method's name."""
        return {"name": self.name}

    def answer_split(self, dataset: Dataset, split: str) -> Answers:
        """Return the true position and visibility of every query of a split, in order.

        Args:
            dataset: A dataset with its truth.
            split: The split.

        Raises:
            CallError: The truth of this split is not there.
            SpecError: The truth does not belong to the queries.
        """
        path = dataset.root / truth_name(split)
        if not dataset.has(truth_name(split)):
            raise CallError(
                "the method oracle needs the truth, which this dataset does not contain",
                path=path,
                fix="Use the complete dataset, or choose another method",
            )
        truth = dataset.truth(split)
        queries = dataset.queries(split)
        for column in ("pair_id", "query_id"):
            if not truth.column(column).equals(queries.column(column)):
                raise SpecError(
                    "the truth does not answer the queries row by row", path=path, where=column
                )
        uv_px = stacked(truth, "u_b", "v_b")
        visible = pc.equal(truth.column("visibility_b"), "visible").cast(pa.float32())
        return Answers(uv_px=uv_px, visible=visible.to_numpy())
