"""A rope, a camera, two pictures, and the exact place of every point in both."""

import sys
from pathlib import Path

import numpy as np
from PIL import Image

from pliant import scene

out = Path(sys.argv[1] if len(sys.argv) > 1 else "out")
out.mkdir(parents=True, exist_ok=True)

# Three points of the centre line, metres on the table (z up); the rope is as long as its curve.
rope = scene.Rope([(-0.4, 0.0), (0.0, 0.15), (0.4, 0.0)], radius_m=0.012)
film = scene.Film(rope, scene.camera(eye=(0.0, -0.6, 1.1), size=(320, 240)))

before = film.shoot()
rope.pull(s=1.0, to=(0.1, 0.3, 0.15))  # a hand takes the end and lifts it
rope.settle()  # and lets go
after = film.shoot()

# Row i of both is the same material point: this is the correspondence, in pixels.
both = before.visible & after.visible
moved_px = np.linalg.norm(after.uv_px[both] - before.uv_px[both], axis=1)
print(f"{both.sum()} points are seen in both pictures; the largest move: {moved_px.max():.0f} px")
Image.fromarray(before.rgb).save(out / "before.png")
Image.fromarray(after.rgb).save(out / "after.png")
print(film.write(out / "dataset"))  # everything: pictures, depth, points, cameras
