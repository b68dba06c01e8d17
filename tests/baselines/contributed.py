"""Skips what needs OpenCV's contributed modules, which the plain wheel lacks."""

from __future__ import annotations

import importlib.util

import pytest

found = importlib.util.find_spec("cv2") is not None
if found:
    import cv2

    found = hasattr(cv2, "xfeatures2d")

needs_contributed_opencv = pytest.mark.skipif(
    not found, reason="needs opencv-contrib-python-headless"
)
