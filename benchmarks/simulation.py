"""How fast cloth and rope are simulated, in CPU time on one core.

    python benchmarks/simulation.py [--quick] [--json FILE]

`cloth_ms_per_step_N`: a cloth of N x N points held by two corners, without self-contact;
`…_self`: with it.
`cloth_cpu_s_tier_N`: a finished cloth of a tier, refused tries and the calm phase included.
`rope_frames_per_s`: a rope episode that a hand moves.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from record import Value, cpu_s, main

from pliant.generator.config import GenerateConfig
from pliant.generator.objects.cloth.contact_pbd import PairContact
from pliant.generator.objects.cloth.grid import flat_positions
from pliant.generator.objects.cloth.grid_shape import GridShape
from pliant.generator.objects.cloth.simulator import Sheet, Simulator
from pliant.generator.objects.rope.body import RopeBody
from pliant.generator.objects.rope.episode import Episode
from pliant.generator.objects.tiers import sample_scene_object
from pliant.generator.seeding import SequenceTask
from pliant.generator.settings import RopeSettings

POINTS_A_SIDE = (25, 50, 100)
GRAVITY = (0.0, 0.0, -9.8)


def measure(quick: bool) -> dict[str, Value]:
    figures: dict[str, Value] = {}
    repeats = 3 if quick else 7
    for points in POINTS_A_SIDE:
        steps = max(50, (200_000 if quick else 800_000) // points**2)
        for suffix, contact in (("", False), ("_self", True)):
            figures[f"cloth_ms_per_step_{points}{suffix}"] = _best_ms_per_step(
                lambda p=points, c=contact: _hanging(p, c), steps, repeats
            )
    _cpu_s_per_cloth(1, 1)  # compiles
    for level in (1, 2, 3):
        figures[f"cloth_cpu_s_tier_{level}"] = _cpu_s_per_cloth(level, 2 if quick else 12)
    return figures | {"rope_frames_per_s": _rope_frames_per_s(600 if quick else 3000)}


def _best_ms_per_step(make: Callable[[], Simulator], steps: int, repeats: int) -> float:
    """Return the least CPU time of several runs: what other processes disturb least."""
    spent = []
    for _ in range(repeats):
        simulator = make()
        simulator.run(5)  # compiles, and fills the caches
        spent.append(cpu_s(lambda: simulator.run(steps)))  # noqa: B023
    return min(spent) / steps * 1e3


def _hanging(points: int, contact: bool) -> Simulator:
    sheet = Sheet(grid=GridShape(points, points))
    start = flat_positions(sheet.grid, 1.0)
    colliders = (PairContact.of(sheet, sheet.spacing_m).collide,) if contact else ()
    simulator = Simulator(sheet, start, gravity=GRAVITY, colliders=colliders)
    simulator.free[[0, points - 1]] = 0.0
    return simulator


def _cpu_s_per_cloth(level: int, cloths: int) -> float:
    tier = f"cloth-{level}"
    config = GenerateConfig(tiers=(tier,), seed=7, frames=cloths)
    scene_object = sample_scene_object(config, SequenceTask(tier, "train", 0))
    return cpu_s(lambda: [scene_object.pose(frame) for frame in range(cloths)]) / cloths


def _rope_frames_per_s(frames: int) -> float:
    episode = Episode(RopeBody(RopeSettings()), "loop", lambda: np.random.default_rng(1))
    episode.pose(5)  # compiles
    return frames / cpu_s(lambda: [episode.step() for _ in range(frames)])


if __name__ == "__main__":
    main("simulation", measure, __doc__)
