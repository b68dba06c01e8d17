"""Loading OpenCV."""

from __future__ import annotations

from typing import Any

from pliant.spec.errors import MissingExtraError


def load_opencv(feature: str) -> Any:
    """Return the `cv2` module.

    Args:
        feature: What needs it, for the message.

    Raises:
        MissingExtraError: OpenCV is not installed.
    """
    try:
        import cv2
    except ImportError as error:
        raise MissingExtraError(feature, "classical") from error
    return cv2
