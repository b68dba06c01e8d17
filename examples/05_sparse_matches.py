"""Score keypoint matches: as they are, as the paper scored SIFT, and for every query."""

import sys
from pathlib import Path

import cv2
import numpy as np

import pliant
from pliant.baselines.adapters import from_sparse
from pliant.baselines.predict import predict

out = Path(sys.argv[1] if len(sys.argv) > 1 else "out")
out.mkdir(parents=True, exist_ok=True)


def akaze(source, target):
    """Return matched keypoints of two pictures uint8 (H, W, 3): (M, 2), (M, 2) and scores (M,)."""
    detector = cv2.AKAZE_create()
    found = [detector.detectAndCompute(image, None) for image in (source, target)]
    if any(descriptors is None for _, descriptors in found):
        return np.zeros((0, 2)), np.zeros((0, 2)), np.zeros(0)
    (keys_a, described_a), (keys_b, described_b) = found
    pairs = cv2.BFMatcher(cv2.NORM_HAMMING, crossCheck=True).match(described_a, described_b)
    # OpenCV's first pixel is at (0, 0), Pliant's at (0.5, 0.5).
    at_a = np.array([keys_a[each.queryIdx].pt for each in pairs]).reshape(-1, 2) + 0.5
    at_b = np.array([keys_b[each.trainIdx].pt for each in pairs]).reshape(-1, 2) + 0.5
    return at_a, at_b, -np.array([each.distance for each in pairs])


method = from_sparse(akaze)
ds = pliant.load("sample")
scores = pliant.evaluate(ds, pliant.predict(ds, method))  # between the matches: a smooth warp
print(f"every query: {scores.overall['rmse_px']:.1f} px")
predict(ds, "test", method, out / "matches.parquet", kind="matches")  # the matches themselves
scores = pliant.evaluate(ds, out / "matches.parquet")
print(f"the matches themselves: {scores.overall['rmse_px']:.1f} px")
