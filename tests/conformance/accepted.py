"""Changes that leave a dataset valid: what other writers do, and what a publisher leaves out."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from PIL import Image

from tests.conformance.base import (
    NamedPoints,
    Shot,
    cloth_points,
    cloth_shot,
    rope_points,
    rope_shot,
    write_dataset,
    write_sequence,
)
from tests.conformance.edits import (
    ROPE_TRAIN,
    Edit,
    both,
    change_exr,
    change_json,
    change_rows,
    listed,
    remove,
    write,
)

_EXR = f"{ROPE_TRAIN}/depth/000001.exr"


def _other_png(root: Path) -> None:
    """Write the images again with every filter and the highest compression."""
    for path in sorted(root.rglob("*.png")):
        with Image.open(path) as image:
            image.load()
            image.save(path, "PNG", optimize=True)


CORNERS = [(2.4, 2.2, 0.15), (-1.7, -1.9, 0.2), (1.9, 1.8, 0.12)]
GRAZING = [(1.3, 0.2, 0.08), (0.3, -0.9, 0.05), (1.2, 0.3, 0.021)]
FAR_AWAY = [(3.0, -5.0, 7.0), (0.5, 8.0, 12.0), (-9.0, 1.0, 14.0)]
"""Where the camera is, metres."""


def held_out(root: Path) -> None:
    """Hold the test split out: take away all that tells its truth."""
    change_json("dataset.json", lambda document: document.update(held_out=["test"]))(root)
    remove("truth")(root)
    names = []
    for path in sorted(root.glob("sequences/*/*-test-*")):
        for name in ("points.parquet", "correspondences.parquet", "depth"):
            remove(f"{path.relative_to(root)}/{name}")(root)
        relative = f"{path.relative_to(root)}/sequence.json"
        change_json(relative, lambda document: document.update(seed=0, parameters={}))(root)
        names.append(path.name)

    def unseed(rows: list[dict[str, Any]]) -> None:
        for row in rows:
            row["seed"] = 0 if row["id"] in names else row["seed"]

    listed(change_rows("sequences.parquet", unseed))(root)


def _reshot(tier: str, points: NamedPoints, *shots: Shot) -> Any:
    """Return an edit that replaces the dataset by one sequence of other frames."""

    def edit(root: Path) -> None:
        remove("sequences")(root)
        row = write_sequence(root, tier, "train", 0, points, list(shots))
        write_dataset(root, "conformance-minimal", [row], [tier])

    return edit


def _nothing(_: Any) -> None:
    return None


EDITS: dict[str, Edit] = {
    "unchanged-full": _nothing,
    "unchanged-minimal": _nothing,
    "truth-left-out": remove("truth"),
    "held-out": held_out,
    "no-queries": both(remove("truth"), remove("queries")),
    "papers": both(
        *[
            write(name, b"text\n")
            for name in ("README.md", "LICENSE", "CITATION.cff", "croissant.json")
        ]
    ),
    "workshop": write(".pliant/logs/run.log", b"text\n"),
    "other-png-writer": listed(_other_png),
    "exr-zips": listed(change_exr(_EXR, _nothing, "ZIPS_COMPRESSION")),
    "exr-uncompressed": listed(change_exr(_EXR, _nothing, "NO_COMPRESSION")),
    "sharp-corner": _reshot(
        "cloth-1", cloth_points(), *[cloth_shot(eye, flat=True) for eye in CORNERS]
    ),
    "grazing-sheet": _reshot(
        "cloth-1", cloth_points(), *[cloth_shot(eye, flat=True) for eye in GRAZING]
    ),
    "thin-tube": _reshot(
        "rope-bare", rope_points(ball=False), *[rope_shot(eye, ball=False) for eye in FAR_AWAY]
    ),
    "minor-version": change_json(
        "dataset.json", lambda document: document.update(spec_version="1.9.0", funding="none")
    ),
}
"""Every change that leaves a dataset valid; the last gives a warning."""
