"""A cloth that is folded while the camera goes around it."""

import math
import sys
from pathlib import Path

import numpy as np

from pliant import scene

out = Path(sys.argv[1] if len(sys.argv) > 1 else "out")

cloth = scene.Cloth(side_m=0.5, towel=True, settings={"points_a_side": 33, "tracked_a_side": 17})
film = scene.Film(cloth, scene.camera((0.0, -0.6, 0.9), size=(320, 240)), seed=4)


def shoot() -> None:
    """Take the next picture from a place further around."""
    angle = math.radians(4 * len(film.shots) - 90)
    film.shoot(scene.camera((0.6 * math.cos(angle), 0.6 * math.sin(angle), 0.9), size=(320, 240)))


shoot()
cloth.pull(uv=(0.0, 0.0), carry=(0.22, 0.22), lift_m=0.12)  # a corner over the middle
cloth.settle(0.3, each=shoot)  # 30 pictures a second while it falls

hidden = [1 - shot.visible.mean() for shot in film.shots]
print(
    f"{len(film.shots)} pictures; hidden points: {hidden[0]:.0%} at first, {hidden[-1]:.0%} at last"
)

# The depth image and the points agree: a visible point is at the depth of its pixel.
shot = film.shots[-1]
columns, rows = np.floor(shot.uv_px[shot.visible]).astype(int).T
gap = np.abs(shot.depth_m[rows, columns] - shot.truth.depth_m[shot.visible])
print(f"median difference to the depth image: {1000 * np.median(gap):.2f} mm")
film.write(out / "fold")
