"""SURF (Bay and others, CVIU 2008) by mahotas.

OpenCV's wheels have no SURF. mahotas' is another implementation with other thresholds and another
orientation: its figures are not those of the SURF that papers usually report.

Two faults of mahotas 1.4 are corrected here. It centres a descriptor 1 px up and to the left of
its point, and at scales that are not whole it samples the cells unevenly. Its descriptors are
therefore taken 1 px further and at the nearest whole scale: of the matches of a picture with
itself turned by 180 degrees, 96 % are then right, and 42 % as it comes
(`tests/baselines/features/test_local_features.py` measures the offsets).
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Final

import numpy as np

from pliant.baselines.features.local_features import Descriptors, Keypoints, Metric
from pliant.baselines.pixels import HALF_PIXEL
from pliant.spec.arrays import Float32Array, FloatArray, ImageArray
from pliant.spec.errors import MissingExtraError

SURF_SCALE_PX: Final = 3.0
"""Scale at which given pixels are described; the descriptor covers a square of 20 scales."""

MAHOTAS_THRESHOLD: Final = 0.1
MAHOTAS_OCTAVES: Final = 4
MAHOTAS_SCALES: Final = 6
MAHOTAS_MAX_POINTS: Final = 4096
MAHOTAS_OFF_CENTRE_PX: Final = 1.0
"""How far up and to the left of its point mahotas centres a descriptor, at any whole scale."""

_Y, _X, _SCALE, _POINT_COLUMNS = 0, 1, 2, 5  # of mahotas' points: y, x, scale, score, sign


class MahotasSurf:
    """SURF of mahotas, 64 numbers a descriptor.

    Raises:
        MissingExtraError: mahotas is not installed.
    """

    name = "surf"
    metric: Metric = "euclidean"

    def __init__(self) -> None:
        try:
            import mahotas
            from mahotas.features import surf
        except ImportError as error:
            raise MissingExtraError("SURF", "classical") from error
        self._version = str(mahotas.__version__)
        self._surf: Any = surf

    def __reduce__(self) -> tuple[Any, ...]:
        return MahotasSurf, ()

    def facts(self) -> Mapping[str, Any]:
        """Return settings and versions for the submission's footer."""
        return {
            "implementation": "mahotas",
            "version": self._version,
            "threshold": MAHOTAS_THRESHOLD,
            "octaves": MAHOTAS_OCTAVES,
            "scales": MAHOTAS_SCALES,
            "max_points": MAHOTAS_MAX_POINTS,
            "query_scale_px": SURF_SCALE_PX,
            "query_orientation": "the method's own",
        }

    def detect(self, grey: ImageArray) -> Keypoints:
        """Find and describe the image's own keypoints.

        Args:
            grey: uint8 (H, W).
        """
        points = self._surf.interest_points(
            grey,
            MAHOTAS_OCTAVES,
            MAHOTAS_SCALES,
            initial_step_size=1,
            threshold=MAHOTAS_THRESHOLD,
            max_points=MAHOTAS_MAX_POINTS,
        )  # (N, 5)
        uv_px = (points[:, [_X, _Y]] + HALF_PIXEL).astype(np.float32)
        return Keypoints(uv_px, self._described(grey, points))

    def describe_at(self, grey: ImageArray, uv_px: Float32Array) -> Descriptors:
        """Describe the patches around given positions; SURF finds the orientation itself.

        Args:
            grey: uint8 (H, W).
            uv_px: float32 (N, 2), inside the image.

        Returns:
            float32 (N, 64).
        """
        points = np.ones((len(uv_px), _POINT_COLUMNS))
        points[:, [_X, _Y]] = uv_px.astype(np.float64) - HALF_PIXEL
        points[:, _SCALE] = SURF_SCALE_PX
        return self._described(grey, points)

    def _described(self, grey: ImageArray, points: FloatArray) -> Descriptors:
        """Describe mahotas' points, (N, 5), well centred and at whole scales: float32 (N, 64)."""
        if len(points) == 0:
            return np.zeros((0, 64), dtype=np.float32)
        placed = points.copy()
        placed[:, _SCALE] = np.maximum(np.rint(points[:, _SCALE]), 1)
        # mahotas leaves out points whose window crosses the edge: give every window room.
        room = int(16 * placed[:, _SCALE].max()) + 2
        placed[:, [_X, _Y]] += MAHOTAS_OFF_CENTRE_PX + room
        padded = np.pad(grey, room, mode="edge")
        rows = self._surf.descriptors(padded, placed, descriptor_only=True)
        if len(rows) != len(points):
            raise RuntimeError(f"mahotas described {len(rows)} of {len(points)} positions")
        descriptors: Float32Array = rows.astype(np.float32)
        return descriptors
