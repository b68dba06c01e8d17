"""What tests of single rules share: the facts of a dataset, rows, frames and problems."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from pliant.spec.arrays import FloatArray
from pliant.spec.camera import Camera
from pliant.spec.conventions import VISIBLE
from pliant.spec.io.exr import Surface
from pliant.spec.model import Tier
from pliant.spec.storage.files import LocalFiles
from pliant.spec.validation.findings import Findings
from pliant.spec.validation.rules.context import Context
from pliant.spec.validation.rules.correspondences import FrameRows
from pliant.spec.validation.rules.points import PointSet
from pliant.spec.validation.rules.surfaces import ShownSurface
from pliant.spec.validation.rules.windows import SoundFrame
from tests.dataset_files import coordinate, tier

SIZE = (64, 48)

TUBE = [coordinate("s", 0, 2, 0.1), coordinate("theta", -2, 2, 0.1, 4)]
BOX = [coordinate("u", 1, 3, 0.1), coordinate("v", 0, 1, 0.1)]
SYMMETRIES = [
    ("turn", [[1, 0], [0, 1]], [0, 2]),
    ("reverse", [[-1, 0], [0, -1]], [2, 0]),
    ("both", [[-1, 0], [0, -1]], [2, 2]),
]
DOCUMENT = tier("t", "rope", {"tube": TUBE, "box": BOX}, SYMMETRIES)

Found = list[tuple[str, str, str]]


def found(findings: Findings) -> Found:
    """Return (code, path, where) of every problem; all of them are listed."""
    listed = findings.listed()
    assert findings.total == len(listed)
    return [(issue.code, issue.path, issue.where) for issue in listed]


def places(findings: Findings) -> list[tuple[str, str]]:
    """Return (code, where) of every problem; all of them are listed."""
    return [(code, where) for code, _, where in found(findings)]


def words(findings: Findings) -> list[tuple[str, str, str, str]]:
    """Return (code, path, where, message) of the problems that are listed."""
    return [(each.code, each.path, each.where, each.message) for each in findings.listed()]


def context(root: Path = Path(), **changes: Any) -> Context:
    """Return the facts of a dataset `d` of two tiers."""
    facts: dict[str, Any] = {
        "root": root, "files": LocalFiles(root), "quick": False, "size": SIZE,
        "tiers": {"rope": None, "rope-bare": None}, "splits": ("train", "test"),
        "held_out": frozenset(), "identity": {"id": "d", "version": "1.0.0"},
        "seeded": True,
    }  # fmt: skip
    return Context(**facts | changes)


def make(root: Path, *entries: str) -> Path:
    """Make empty files, folders (`name/`), and links (`name -> target`)."""
    for entry in entries:
        name, _, target = entry.partition(" -> ")
        path = root / name
        path.parent.mkdir(parents=True, exist_ok=True)
        if target:
            path.symlink_to(target)
        elif name.endswith("/"):
            path.mkdir(exist_ok=True)
        else:
            path.touch()
    return root


def rows_at(
    frame: int,
    uvz: FloatArray,
    xyz_m: FloatArray,
    state: npt.NDArray[np.int32] | None = None,
    point: npt.NDArray[np.int32] | None = None,
) -> FrameRows:
    """Return rows of a frame, (N, 3) each, of visible points 0 to N - 1 if not said otherwise."""
    point = np.arange(len(uvz), dtype=np.int32) if point is None else point
    state = np.full(len(uvz), VISIBLE, np.int32) if state is None else state
    return FrameRows(frame, point, uvz[:, :2], uvz[:, 2], state, xyz_m)


def view(
    tier: Tier, camera: Camera, shown: Surface, points: list[dict[str, Any]], frame: int = 3
) -> SoundFrame:
    """Return a frame of visible surface points of object 1, 1 m away, where not said otherwise.

    Each needs `at`, (u, v), which is its material as well. The last point has the first row.
    """
    usual = {"depth": 1.0, "state": VISIBLE, "object": 1, "line": False, "good": True}
    full = [usual | {"material": each["at"]} | each for each in points]
    values = {name: np.array([each[name] for each in full]) for name in full[0]}
    count = len(full)
    known = PointSet(
        values["object"][::-1].astype(np.int32), values["line"][::-1],
        values["material"][::-1].astype(float), np.zeros((count, 0), np.int32), b"",
    )  # fmt: skip
    uvz = np.column_stack([values["at"], values["depth"]]).astype(float)
    order = np.arange(count, dtype=np.int32)[::-1].copy()
    rows = rows_at(frame, uvz, np.zeros((count, 3)), values["state"].astype(np.int32), order)
    return SoundFrame(tier, camera, known, rows, values["good"].copy(), ShownSurface(shown))


def shown(object_id: npt.NDArray[Any]) -> ShownSurface:
    """Return a picture of 10 x 20 pixels that shows these objects."""
    empty = np.zeros((10, 20), np.float32)
    return ShownSurface(Surface(empty, empty, empty, object_id.reshape(10, 20).astype(np.uint32)))
