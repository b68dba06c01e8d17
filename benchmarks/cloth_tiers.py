"""100 cloths per tier: coverage in its band, no self-intersection by an independent count.

    python benchmarks/cloth_tiers.py [--quick] [--json FILE]

Each tier is also made with a hand of 3 m/s, the fastest the settings allow. `--quick` makes 2
cloths per tier on a coarser grid; the full run takes about 25 CPU minutes.
"""

from __future__ import annotations

import time

import numpy as np
from independent_intersections import count_intersections
from record import Value, main

from pliant.generator.objects.cloth import ClothSettings, sample_cloth
from pliant.generator.seeding import RandomStreams, SequenceTask
from pliant.generator.settings.cloth import COVERAGE_BANDS, LARGEST_HAND_SPEED_M_S


def measure(quick: bool) -> dict[str, Value]:
    grid = {"points_a_side": 33} if quick else {}
    cloths, fast = (2, 1) if quick else (100, 20)
    sample_cloth(
        ClothSettings(points_a_side=17, tracked_a_side=17),
        RandomStreams(0, SequenceTask("cloth-1", "test", 0)),
    ).pose(0)
    figures: dict[str, Value] = {"cloths_per_tier": cloths, "fast_cloths_per_tier": fast}
    for level in COVERAGE_BANDS:
        figures.update(_tier(ClothSettings(**grid), level, cloths, f"tier_{level}"))
        quickly = ClothSettings(hand_speed_m_s=LARGEST_HAND_SPEED_M_S, **grid)
        figures.update(_tier(quickly, level, fast, f"fast_tier_{level}"))
    return figures


def _tier(settings: ClothSettings, level: int, cloths: int, label: str) -> dict[str, Value]:
    band = COVERAGE_BANDS[level]
    scene_object = sample_cloth(
        settings, RandomStreams(2024, SequenceTask(f"cloth-{level}", "test", 0)), cloths
    )
    faces = scene_object.parts[0].faces
    rows: list[tuple[float, ...]] = []
    intersections = not_finite = poking = 0
    for frame in range(cloths):
        begin = time.process_time()
        pose = scene_object.pose(frame)
        cpu_s = time.process_time() - begin
        vertices = pose.vertices["cloth"]
        not_finite += int(not np.isfinite(vertices).all())
        intersections += count_intersections(vertices, faces)
        info = pose.info
        poking += info["refused"].get("pokes through itself", 0)
        rows.append(
            (
                cpu_s,
                info["coverage"],
                info["coverage_hull"],
                info["self_occluded_area"],
                len(info["hidden_corners"]),
                info["tries"],
                info["mean_speed_m_s"],
            )
        )
    table = np.array(rows)
    coverage = table[:, 1]
    return {
        f"intersections_{label}": intersections,
        f"not_finite_{label}": not_finite,
        f"in_band_{label}": int(((coverage >= band[0]) & (coverage <= band[1])).sum()),
        f"coverage_min_{label}": float(coverage.min()),
        f"coverage_mean_{label}": float(coverage.mean()),
        f"coverage_max_{label}": float(coverage.max()),
        f"coverage_hull_mean_{label}": float(table[:, 2].mean()),
        f"self_occluded_mean_{label}": float(table[:, 3].mean()),
        f"hidden_corners_mean_{label}": float(table[:, 4].mean()),
        f"tries_mean_{label}": float(table[:, 5].mean()),
        f"refused_for_poking_{label}": poking,
        f"speed_max_m_s_{label}": float(table[:, 6].max()),
        f"cpu_s_mean_{label}": float(table[:, 0].mean()),
    }


if __name__ == "__main__":
    main("cloth_tiers", measure, __doc__)
