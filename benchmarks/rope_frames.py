"""How many frames of a rope episode one core simulates in a second."""

from __future__ import annotations

import time

import numpy as np
from record import Value, main

from pliant.generator.objects.rope import RopeSettings
from pliant.generator.objects.rope.body import RopeBody
from pliant.generator.objects.rope.episode import Episode


def measure_rope(quick: bool) -> dict[str, Value]:
    """Return the rates of the rope: physics alone, and with the mesh of every frame.

    CPU time of one process, so that other work on the machine does not count.
    """
    settings = RopeSettings()
    body = RopeBody(settings)
    frames = 600 if quick else 3000
    episode = Episode(body, "loop", lambda: np.random.default_rng(1))
    episode.pose(5)  # compiles
    start = time.process_time()
    for _ in range(frames):
        episode.state.advance()
    still = time.process_time() - start

    episode = Episode(body, "loop", lambda: np.random.default_rng(1))
    start = time.process_time()
    for _ in range(frames):
        episode.step()
    moved = time.process_time() - start

    episode = Episode(body, "loop", lambda: np.random.default_rng(1))
    start = time.process_time()
    for frame in range(frames):
        episode.pose(frame)
    meshed = time.process_time() - start
    return {
        "rope_frames_per_s": frames / moved,
        "rope_frames_per_s_at_rest": frames / still,
        "rope_frames_per_s_with_mesh": frames / meshed,
        "rope_particles": settings.particles,
        "rope_substeps": settings.substeps,
    }


if __name__ == "__main__":
    main("rope_frames", measure_rope, __doc__)
