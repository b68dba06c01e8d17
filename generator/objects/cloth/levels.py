"""The three levels: the actions on a flat cloth until its coverage is in the level's range.

The actions follow gym-cloth (Seita et al. 2019): short pulls at the rim for level 1, a
standing cloth that falls and is pulled over itself for level 2, a lift near the middle for
level 3. Where coverage is still above the level's band, one more action of the level's kind
follows; below the band, the configuration is dropped and a new one is begun.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Final

import numpy as np

from pliant.generator import portable
from pliant.generator.objects.cloth.grid import corner_vertices
from pliant.generator.objects.cloth.handling import Handling

MOST_ACTIONS: Final = {1: 4, 2: 4, 3: 6}
"""Level -> actions after the first before a configuration is given up."""


def shape_cloth(handling: Handling, level: int, band: tuple[float, float]) -> bool:
    """Bring a cloth into a configuration of a level.

    Args:
        handling: A cloth that lies flat.
        level: 1, 2 or 3.
        band: Accepted silhouette coverage.

    Returns:
        Whether its coverage, quickly counted, is in the band.
    """
    begin, more = _LEVELS[level]
    begin(handling)
    for _ in range(MOST_ACTIONS[level]):
        if handling.coverage() <= band[1]:
            break
        more(handling)
    return band[0] <= handling.coverage() <= band[1]


def _pull_rim(cloth: Handling) -> None:
    """Pull a corner or a stretch of the rim inwards, or pinch the sheet."""
    rng, (rows, columns) = cloth.rng, cloth.grid
    kind = rng.choice(["fold", "pull", "pinch"], p=[0.4, 0.3, 0.3])
    if kind == "fold":
        corner = cloth.corner()
        row, column = divmod(corner, columns)
        row = abs(row - int(rng.integers(0, max(1, rows // 6))))
        column = abs(column - int(rng.integers(0, max(1, columns // 6))))
        vertex = row * columns + column
        carry = cloth.inwards(vertex, 0.5) * rng.uniform(0.22, 0.55)
        cloth.act("fold", vertex, carry, rng.uniform(0.1, 0.2))
    elif kind == "pull":
        at_column = int(rng.integers(columns // 5, columns - columns // 5))
        at_row = at_column * (rows - 1) // (columns - 1)
        rim = ((0, at_column), (rows - 1, at_column), (at_row, 0), (at_row, columns - 1))
        row, column = rim[int(rng.integers(4))]
        vertex = row * columns + column
        carry = cloth.inwards(vertex, 0.5) * rng.uniform(0.15, 0.4)
        cloth.act("pull", vertex, carry, rng.uniform(0.06, 0.16))
    else:
        xy = cloth.middle() + rng.uniform(-0.25, 0.25, 2) * cloth.lengths_m
        carry = cloth.anywhere() * rng.uniform(0.1, 0.25)
        cloth.act("pinch", cloth.top_vertex(xy), carry, rng.uniform(0.1, 0.2), lower_share=0.3)


def _begin_wrinkled(cloth: Handling) -> None:
    """Let a standing cloth fall and pull a corner of it in; or drag it by an inner point."""
    rng = cloth.rng
    if rng.random() < 0.4:
        xy = cloth.middle() + rng.uniform(-0.3, 0.3, 2) * cloth.lengths_m
        carry = cloth.anywhere() * rng.uniform(0.25, 0.5)
        cloth.act("drag", cloth.top_vertex(xy), carry, rng.uniform(0.15, 0.3), 0.3)
        return
    upper = cloth.stand_up()
    cloth.settle(1.0)
    corners = corner_vertices(cloth.grid)
    ends = corners[list(((0, 2), (1, 3), (0, 1), (2, 3))[upper])]
    vertex = int(rng.choice(ends))
    carry = cloth.inwards(vertex, 0.8) * rng.uniform(0.25, 0.5)
    cloth.act("pull", vertex, carry, rng.uniform(0.1, 0.2))


def _cover(cloth: Handling) -> None:
    """Take a point of the outer cloth over the middle."""
    vertex = _outer_vertex(cloth)
    carry = cloth.inwards(vertex, 0.6) * cloth.rng.uniform(0.25, 0.5)
    cloth.act("cover", vertex, carry, cloth.rng.uniform(0.12, 0.24))


def _begin_scrunched(cloth: Handling) -> None:
    """Lift the cloth near its middle, move it and let it drop in a heap."""
    rng = cloth.rng
    xy = rng.uniform(-0.2, 0.2, 2) * cloth.lengths_m
    carry = rng.uniform(0.10, 0.25, 2) * rng.choice([-1.0, 1.0], 2)
    lift = rng.uniform(0.3, 0.5)
    cloth.act("drop", cloth.top_vertex(xy), carry, lift, rng.uniform(0.0, 0.4), settle_s=1.0)


def _scrunch(cloth: Handling) -> None:
    """Push an outer part over the heap, or drop the heap again."""
    rng = cloth.rng
    if rng.random() < 0.3:
        xy = cloth.middle() + rng.normal(0.0, 0.06, 2) * cloth.scale_m
        carry = cloth.anywhere() * rng.uniform(0.05, 0.2)
        lift = rng.uniform(0.3, 0.5)
        cloth.act("drop", cloth.top_vertex(xy), carry, lift, rng.uniform(0.0, 0.4), settle_s=0.8)
        return
    vertex = _outer_vertex(cloth)
    gap = portable.norm(cloth.middle() - cloth.simulator.positions[vertex, :2])
    carry = cloth.inwards(vertex, 0.4) * (gap / cloth.scale_m) * rng.uniform(0.6, 1.2)
    cloth.act("scrunch", vertex, carry, rng.uniform(0.15, 0.3), lower_share=0.4)


def _outer_vertex(cloth: Handling) -> int:
    """Return the farthest mass from the middle, give or take some."""
    offsets = cloth.simulator.positions[:, :2] - cloth.middle()
    far = np.linalg.norm(offsets, axis=1)
    far += cloth.rng.uniform(0.0, 0.15 * cloth.scale_m, len(far))
    return int(far.argmax())


_LEVELS: Final[dict[int, tuple[Callable[[Handling], None], Callable[[Handling], None]]]] = {
    1: (_pull_rim, _pull_rim),
    2: (_begin_wrinkled, _cover),
    3: (_begin_scrunched, _scrunch),
}
