"""Whether ropes are physically possible: many knots and loops, many long episodes.

    python benchmarks/rope_physics.py [--quick] [--json FILE]

Distances are those of all pairs of segments of the centre line that the mesh follows, by a
check of its own in plain numpy. `*_min_diameters`: least distance of two stretches with at least
2.5 diameters of rope between them; `*_stretch_max`: largest change of length, of the whole
curve and of the stretches between particles; `*_bend_min_radii`: tightest bend in rope radii;
`*_below`: how many configurations or frames break the rule (0.98, in an episode 0.90).
"""

from __future__ import annotations

import numpy as np
from record import Value, main

from pliant.generator.objects.rope import RopeSettings
from pliant.generator.objects.rope.body import RopeBody
from pliant.generator.objects.rope.contact import EPISODE_RULE, NEIGHBOUR_DIAMETERS, STATIC_RULE
from pliant.generator.objects.rope.curve import arc_length, tightest_bend
from pliant.generator.objects.rope.episode import Episode
from pliant.generator.objects.rope.static import sample_configuration
from pliant.generator.settings.rope import SHAPES
from pliant.spec.arrays import FloatArray


def closest_stretches(points: FloatArray, length_m: float, diameter_m: float) -> float:
    """Return the least distance of two stretches that are not neighbours, by brute force.

    Args:
        points: float64 (n, 3), metres, equal steps.
        length_m: Length of the curve, metres.
        diameter_m: Diameter of the rope, metres.
    """
    step = length_m / (len(points) - 1)
    apart = int(np.ceil(NEIGHBOUR_DIAMETERS * diameter_m / step)) + 1
    a, b = np.triu_indices(len(points) - 1, apart)
    # A segment is within a step of its first point: the far ones need no exact distance.
    rough = np.linalg.norm(points[a] - points[b], axis=1)
    near = rough < rough.min() + 2.5 * step
    a, b = a[near], b[near]
    p, q = points[a], points[b]
    u, v = points[a + 1] - p, points[b + 1] - q
    best = np.full(len(a), np.inf)
    # Nearest points are inside both segments, or one is an end of a segment.
    uu, vv, uv = (u * u).sum(1), (v * v).sum(1), (u * v).sum(1)
    r = p - q
    det = uu * vv - uv * uv
    inside_s = (uv * (v * r).sum(1) - vv * (u * r).sum(1)) / np.where(det > 0, det, np.inf)
    inside_t = (uu * (v * r).sum(1) - uv * (u * r).sum(1)) / np.where(det > 0, det, np.inf)
    inside = (det > 0) & (inside_s > 0) & (inside_s < 1) & (inside_t > 0) & (inside_t < 1)
    gap = np.linalg.norm(r + inside_s[:, None] * u - inside_t[:, None] * v, axis=1)
    best[inside] = gap[inside]
    for s in (0.0, 1.0):
        t = np.clip(((r + s * u) * v).sum(1) / vv, 0, 1)
        best = np.minimum(best, np.linalg.norm(r + s * u - t[:, None] * v, axis=1))
        t = np.clip(((s * v - r) * u).sum(1) / uu, 0, 1)
        best = np.minimum(best, np.linalg.norm(r + t[:, None] * u - s * v, axis=1))
    return float(best.min())


def measure(quick: bool) -> dict[str, Value]:
    settings = RopeSettings()
    figures: dict[str, Value] = {}
    figures |= _configurations(settings, 40 if quick else 500)
    figures |= _episodes(settings, 3 if quick else 20, 300 if quick else 3000)
    return figures


def _configurations(settings: RopeSettings, each: int) -> dict[str, Value]:
    figures: dict[str, Value] = {}
    for shape in SHAPES:
        distances, lengths, bends, attempts = [], [], [], []
        for seed in range(each):
            made = sample_configuration(shape, settings, np.random.default_rng(seed))
            line = made.centreline
            distances.append(closest_stretches(line, settings.length_m, settings.diameter_m))
            lengths.append(arc_length(line)[-1] / settings.length_m - 1)
            bends.append(tightest_bend(line) / settings.radius_m)
            attempts.append(made.attempts)
        diameters = np.array(distances) / settings.diameter_m
        figures |= {
            f"{shape}_configurations": each,
            f"{shape}_min_diameters": float(diameters.min()),
            f"{shape}_below": int((diameters < STATIC_RULE).sum()),
            f"{shape}_stretch_max": float(np.abs(lengths).max()),
            f"{shape}_bend_min_radii": float(np.min(bends)),
            f"{shape}_attempts_mean": float(np.mean(attempts)),
        }
    return figures


def _episodes(settings: RopeSettings, episodes: int, frames: int) -> dict[str, Value]:
    body = RopeBody(settings)
    spacing = settings.length_m / (settings.particles - 1)
    distances, whole, pieces, bends, crossed, stray = [], [], [], [], [], []
    for number in range(episodes):
        seed = np.random.SeedSequence([7, number])
        episode = Episode(
            body, SHAPES[number % len(SHAPES)], lambda seed=seed: np.random.default_rng(seed)
        )
        for frame in range(frames):
            if frame:
                episode.step()
            line = episode.centreline()
            distances.append(closest_stretches(line, settings.length_m, settings.diameter_m))
            whole.append(abs(arc_length(line)[-1] / settings.length_m - 1))
            steps = np.linalg.norm(np.diff(episode.state.chain, axis=0), axis=1)
            pieces.append(np.abs(steps / spacing - 1).max())
            bends.append(tightest_bend(line) / settings.radius_m)
            crossed.append(_crosses(episode.state.chain))
            half = np.array(settings.workspace) * settings.length_m / 2
            stray.append((np.abs(line[:, :2]) - half).max())
    diameters = np.array(distances) / settings.diameter_m
    return {
        "episodes": episodes,
        "episode_frames": len(diameters),
        "episode_min_diameters": float(diameters.min()),
        "episode_below": int((diameters < EPISODE_RULE).sum()),
        "episode_stretch_max": float(np.max(whole)),
        "episode_piece_stretch_max": float(np.max(pieces)),
        "episode_pieces_over_3_percent": int((np.array(pieces) > 0.03).sum()),
        "episode_bend_min_radii": float(np.min(bends)),
        "episode_share_crossed": float(np.mean(crossed)),
        "episode_outside_max_m": float(np.max(stray)),
        "episode_share_outside": float((np.array(stray) > 0).mean()),
    }


def _crosses(chain: FloatArray) -> bool:
    """Return whether the rope crosses itself as seen from above."""
    p, d = chain[:-1, :2], np.diff(chain[:, :2], axis=0)
    i, j = np.triu_indices(len(p), 2)
    det = d[i, 0] * d[j, 1] - d[i, 1] * d[j, 0]
    r = p[j] - p[i]
    with np.errstate(divide="ignore", invalid="ignore"):
        s = (r[:, 0] * d[j, 1] - r[:, 1] * d[j, 0]) / det
        t = (r[:, 0] * d[i, 1] - r[:, 1] * d[i, 0]) / det
    return bool(((s > 0) & (s < 1) & (t > 0) & (t < 1)).any())


if __name__ == "__main__":
    main("rope_physics", measure, __doc__)
