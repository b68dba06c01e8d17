"""Scenes written in Python: make a rope or a cloth, move it, look at it, keep what was seen.

    from pliant import scene

    rope = scene.Rope([(-0.4, 0.0), (0.0, 0.15), (0.4, 0.0)])  # metres on the table
    film = scene.Film(rope, scene.camera((0.0, -0.6, 1.1)))
    shot = film.shoot()  # shot.rgb, shot.depth_m, shot.uv_px, shot.visible …
    rope.pull(1.0, to=(0.2, 0.3, 0.1), each=film.shoot)  # a frame of the film per frame of time
    film.write("DATA")  # a valid dataset

The world is in metres, x to the right, z up, the table at z = 0. `pliant generate` makes its
datasets of the same objects, renderers, truth and writer. Needs the extra `generate`.
"""

from pliant.generator.scene.appearance import Appearance
from pliant.scene.bodies import Body, Cloth, Rope
from pliant.scene.film import Film, Shot, camera, write
from pliant.spec.camera import Camera

__all__ = ["Appearance", "Body", "Camera", "Cloth", "Film", "Rope", "Shot", "camera", "write"]
