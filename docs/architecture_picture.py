"""Draws the rooms of the repository and the imports between them, from the source files.

`python docs/architecture_picture.py` writes `docs/pictures/architecture.svg`;
`tests/test_architecture.py` checks that the file is current.
"""

from __future__ import annotations

import ast
from graphlib import TopologicalSorter
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
PICTURE = ROOT / "docs" / "pictures" / "architecture.svg"
PURPOSE = {
    "spec": "file format, vocabulary, validation",
    "generator": "images with ground truth",
    "loaders": "PyTorch datasets",
    "evaluator": "protocols, metrics, reports",
    "baselines": "classical methods, rope tracing",
    "models": "networks, losses, training",
    "converters": "foreign formats",
    "benchmarks": "reference benchmark, timings",
    "publishing": "releases, cards, held-out splits",
    "service": "evaluation service",
    "viewer": "explorer, annotation, figures",
    "cli": "commands",
}
WIDTH, HEIGHT, GAP_X, GAP_Y, MARGIN = 196, 52, 24, 56, 16


def modules(room: str) -> list[Path]:
    """Return the modules of a room that are imported as `pliant.ROOM`.

    The programs in `spec/examples` and the scripts in `benchmarks/` itself import freely and are
    left out.
    """
    found = (ROOT / room).rglob("*.py")
    scripts = {ROOT / "benchmarks"} if room == "benchmarks" else set()
    return sorted(p for p in found if "examples" not in p.parts and p.parent not in scripts)


def imported(path: Path, *, members: bool = False) -> set[str]:
    """Return every dotted name that a module imports, at its top or inside a function.

    Args:
        path: The source file.
        members: Whether `from a.b import c` counts as `a.b.c` instead of `a.b`.
    """
    names: set[str] = set()
    for node in ast.walk(ast.parse(path.read_text())):
        if isinstance(node, ast.Import):
            names |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            if node.level:
                names.add("." * node.level)
            elif members or node.module == "pliant":
                names |= {f"{node.module}.{alias.name}" for alias in node.names}
            elif node.module:
                names.add(node.module)
    return names


def arrows() -> dict[str, set[str]]:
    """Return the rooms that each room imports."""
    rooms = [room for room in PURPOSE if (ROOT / room).is_dir()]
    found: dict[str, set[str]] = {}
    for room in rooms:
        names = {name for path in modules(room) for name in imported(path)}
        targets = {name.split(".")[1] for name in names if name.startswith("pliant.")}
        found[room] = targets & set(rooms) - {room}
    return found


def layers(graph: dict[str, set[str]]) -> list[list[str]]:
    """Return the rooms by their longest chain of imports, the lowest layer first."""
    level: dict[str, int] = {}
    for room in TopologicalSorter(graph).static_order():
        level[room] = 1 + max((level[low] for low in graph[room]), default=-1)
    return [[r for r in graph if level[r] == n] for n in range(max(level.values()) + 1)]


def direct(graph: dict[str, set[str]]) -> list[tuple[str, str]]:
    """Return the arrows that no chain of other arrows implies."""

    def below(room: str) -> set[str]:
        return graph[room].union(*(below(low) for low in graph[room]))

    return [
        (room, low)
        for room in graph
        for low in sorted(graph[room])
        if not any(low in below(other) for other in graph[room] - {low})
    ]


STYLE = (
    "text{font-family:system-ui,sans-serif;text-anchor:middle;fill:#1b2a2f}"
    "rect{fill:#e6f2f1;stroke:#00796b}path{stroke:#5b6b70;fill:none;marker-end:url(#tip)}"
    ".name{font-weight:600;font-size:15px}.purpose{font-size:11px}"
    "@media(prefers-color-scheme:dark){text{fill:#e4ecec}rect{fill:#17393a;stroke:#4db6ac}"
    "path{stroke:#9fb0b4}}"
)


def picture() -> str:
    """Return the picture as SVG text."""
    graph = arrows()
    rows = layers(graph)[::-1]
    width = max(len(row) for row in rows) * (WIDTH + GAP_X) - GAP_X + 2 * MARGIN
    height = len(rows) * (HEIGHT + GAP_Y) - GAP_Y + 2 * MARGIN
    place: dict[str, tuple[float, float]] = {}
    for number, row in enumerate(rows):
        left = (width - len(row) * (WIDTH + GAP_X) + GAP_X) / 2
        for column, room in enumerate(row):
            place[room] = (left + column * (WIDTH + GAP_X), MARGIN + number * (HEIGHT + GAP_Y))
    lines = []
    for room, low in direct(graph):
        (x, y), (to_x, to_y) = place[room], place[low]
        start, end = (x + WIDTH / 2, y + HEIGHT), (to_x + WIDTH / 2, to_y)
        bend = (end[1] - start[1]) / 2
        lines.append(
            f'<path d="M{start[0]:g} {start[1]:g}C{start[0]:g} {start[1] + bend:g} '
            f'{end[0]:g} {end[1] - bend:g} {end[0]:g} {end[1] - 2:g}"/>'
        )
    for room, (x, y) in place.items():
        lines.append(
            f'<rect x="{x:g}" y="{y:g}" width="{WIDTH}" height="{HEIGHT}" rx="6"/>'
            f'<text class="name" x="{x + WIDTH / 2:g}" y="{y + 22:g}">{room}/</text>'
            f'<text class="purpose" x="{x + WIDTH / 2:g}" y="{y + 40:g}">{PURPOSE[room]}</text>'
        )
    return (
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {width:g} {height:g}" '
        'role="img" aria-label="Rooms of the repository and the imports between them">'
        f"<style>{STYLE}</style>"
        '<defs><marker id="tip" viewBox="0 0 8 8" refX="7" refY="4" markerWidth="7" '
        'markerHeight="7" orient="auto"><path d="M0 0L8 4L0 8" '
        'style="marker-end:none"/></marker></defs>\n' + "\n".join(lines) + "\n</svg>\n"
    )


if __name__ == "__main__":
    PICTURE.write_text(picture())
