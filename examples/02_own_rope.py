"""A rope that crosses itself, with a ball at one end, and queries to be answered."""

import math
import sys
from pathlib import Path

import pliant
from pliant import scene

out = Path(sys.argv[1] if len(sys.argv) > 1 else "out")
radius = 0.01


# Where a rope crosses itself, its curve needs heights: here the second pass goes over.
def loop(side: int) -> list[tuple[float, float, float]]:
    """Return a curve with a loop to the left (1) or to the right (-1)."""
    points = []
    for t in [-math.pi + 2 * math.pi * step / 60 for step in range(61)]:
        x, y = 0.12 * t - 0.25 * math.sin(t), -0.25 * side * math.cos(t)
        over = 3 * radius * math.exp(-(((t - 1.93) / 0.4) ** 2))
        points.append((x, y, 1.1 * radius + over))
    return points


films = []
for split, side in (("train", 1), ("test", -1)):
    rope = scene.Rope(loop(side), radius_m=radius, ball=True)
    view = scene.camera((0.0, 0.0, 1.3), size=(320, 240))
    film = scene.Film(rope, view, seed=len(films), split=split)
    film.shoot()
    rope.settle(10)
    film.shoot()
    films.append(film)

# Films of one kind of body become the sequences of one dataset; `test` gets queries.
folder = scene.write(films, out / "loops", title="A loop that is let go")
report = pliant.validate(folder)
print(f"{report.sequences} sequences, {report.total} problems")
