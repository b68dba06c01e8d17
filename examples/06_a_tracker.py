"""Score a tracker on an episode: points of the first frame, followed through all of them."""

import sys
from itertools import pairwise
from pathlib import Path

import cv2
import numpy as np

import pliant
from pliant import scene
from pliant.baselines.adapters import from_tracker

out = Path(sys.argv[1] if len(sys.argv) > 1 else "out")

# An episode of one's own; `pliant generate rope --episodes` makes many.
rope = scene.Rope([(-0.35, 0.0), (0.0, 0.1), (0.35, 0.0)])
film = scene.Film(rope, scene.camera((0.0, 0.0, 1.1), size=(320, 240)), seed=1, split="test")
film.shoot()
rope.pull(1.0, to=(0.2, 0.2, 0.08), each=film.shoot)
film.write(out / "episode", queries={"kind": "track"})


def lucas_kanade(frames, points):
    """Follow points (N, 2) from the first of frames (T, H, W, 3): positions (T, N, 2), visible."""
    grey = [cv2.cvtColor(frame, cv2.COLOR_RGB2GRAY) for frame in frames]
    tracks, seen = [points], [np.ones(len(points), bool)]
    for before, after in pairwise(grey):
        start = (tracks[-1] - 0.5).astype(np.float32)[:, None]
        end, found, _ = cv2.calcOpticalFlowPyrLK(before, after, start, None)
        tracks.append(end[:, 0] + 0.5)
        seen.append(seen[-1] & (found[:, 0] == 1))
    return np.stack(tracks), np.stack(seen)


ds = pliant.load(out / "episode")
for name, method in (("Lucas-Kanade", from_tracker(lucas_kanade)), ("identity", "identity")):
    scores = pliant.evaluate(ds, pliant.predict(ds, method), protocol="track")
    print(f"{name:13} RMSE {scores.overall['rmse_px']:5.1f} px, AJ {scores.overall['aj']:.3f}")
