"""Scenes in the JSON form of CS 184's cloth project: read, checked, ready to run.

A file contains a `cloth` (size, points, pinned masses, and the parameters that the course's
window sets) and any of `sphere` and `plane`. As there, y points up, a horizontal sheet starts
at y = 1 over the xz plane, and a vertical one is in the xy plane with a random offset of
up to a millimetre along z.
"""

from __future__ import annotations

import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final, Literal

import numpy as np
import numpy.typing as npt

from benchmarks.course_cloth import CellContact, Plane, Sphere
from pliant.generator.objects.cloth.contact_pbd import PairContact
from pliant.generator.objects.cloth.simulator import Collider, Sheet, Simulator
from pliant.spec.errors import CallError

FloatArray = npt.NDArray[np.float64]

Contact = Literal["none", "cs184", "pbd"]

SCENES: Final = Path(__file__).parent / "course_scenes"
COURSE_GRAVITY: Final = (0.0, -9.8, 0.0)
FRAMES_PER_SECOND: Final = 90
STEPS_PER_FRAME: Final = 30

HORIZONTAL, VERTICAL = 0, 1

_CLOTH_KEYS: Final = {
    "width",
    "height",
    "num_width_points",
    "num_height_points",
    "thickness",
    "orientation",
    "pinned",
    "enable_structural_constraints",
    "enable_shearing_constraints",
    "enable_bending_constraints",
    "damping",
    "density",
    "ks",
}
_REQUIRED: Final = ("width", "height", "num_width_points", "num_height_points")
_OBSTACLE_KEYS: Final = {
    "sphere": {"origin", "radius", "friction"},
    "plane": {"point", "normal", "friction"},
}


@dataclass(frozen=True)
class Scene:
    """A scene of the course.

    Attributes:
        sheet: The cloth's settings.
        thickness_m: The course's thickness: its contact keeps masses twice this apart.
        positions: float64 (N, 3), where the masses start, metres, y up.
        pinned: bool (N,), masses that never move.
        obstacles: Spheres and planes, in the file's order.
    """

    sheet: Sheet
    thickness_m: float
    positions: FloatArray
    pinned: npt.NDArray[np.bool_]
    obstacles: tuple[Collider, ...]

    def simulator(self, contact: Contact = "none") -> Simulator:
        """Return a simulator of the scene at rest.

        Args:
            contact: Self-collision: `none`, the course's `cs184`, or `pbd`.
        """
        distance_m = min(2.0 * self.thickness_m, self.sheet.spacing_m)
        own: dict[Contact, tuple[Collider, ...]] = {
            "none": (),
            "cs184": (CellContact(self.sheet, self.thickness_m),),
            "pbd": (PairContact.of(self.sheet, distance_m),),
        }
        return Simulator(
            self.sheet,
            self.positions,
            gravity=COURSE_GRAVITY,
            colliders=(*own[contact], *self.obstacles),
            pinned=self.pinned,
        )


def scene_names() -> tuple[str, ...]:
    """Return the course's own scenes."""
    return tuple(sorted(path.stem for path in SCENES.glob("*.json")))


def read_scene(source: str | Path, rng: np.random.Generator | None = None) -> Scene:
    """Read a scene file, or one of `scene_names()`.

    Args:
        source: A name, or a path to a JSON file.
        rng: Source of a vertical sheet's offsets; None takes a fixed one.

    Raises:
        CallError: The file cannot be read, or a value in it cannot be.
    """
    if str(source) in scene_names():
        text = (SCENES / f"{source}.json").read_text()
    else:
        try:
            text = Path(source).read_text()
        except (OSError, UnicodeDecodeError) as error:
            raise CallError(
                "the scene cannot be read",
                path=source,
                found=str(error),
                required="a JSON file, or one of " + ", ".join(scene_names()),
            ) from error
    try:
        document = json.loads(text)
    except (json.JSONDecodeError, RecursionError) as error:
        raise CallError("the scene is not JSON", path=source, found=str(error)) from error
    return parse_scene(document, str(source), rng)


def parse_scene(document: Any, path: str, rng: np.random.Generator | None = None) -> Scene:
    """Turn a scene document into a scene.

    Args:
        document: The parsed JSON.
        path: Its file, for messages.
        rng: Source of a vertical sheet's offsets; None takes a fixed one.

    Raises:
        CallError: A value cannot be; the message names the field.
    """
    reader = _Reader(path)
    reader.mapping("", document, {"cloth", *_OBSTACLE_KEYS})
    cloth = reader.mapping("cloth", document.get("cloth"), _CLOTH_KEYS)
    for key in _REQUIRED:
        if key not in cloth:
            raise CallError("a field is missing", path=path, where=f"cloth.{key}")
    defaults = Sheet()
    sheet = Sheet(
        columns=reader.whole("cloth.num_width_points", cloth["num_width_points"], 3, 1000),
        rows=reader.whole("cloth.num_height_points", cloth["num_height_points"], 3, 1000),
        width_m=reader.number("cloth.width", cloth["width"], 1e-3, 1e3),
        height_m=reader.number("cloth.height", cloth["height"], 1e-3, 1e3),
        density=reader.number("cloth.density", cloth.get("density", defaults.density), 1e-3, 1e6),
        ks=reader.number("cloth.ks", cloth.get("ks", defaults.ks), 0.0, 1e7),
        damping_percent=reader.number(
            "cloth.damping", cloth.get("damping", defaults.damping_percent), 0.0, 100.0
        ),
        steps_per_second=float(FRAMES_PER_SECOND * STEPS_PER_FRAME),
        steps_per_frame=STEPS_PER_FRAME,
        enabled=(
            reader.flag("cloth.enable_structural_constraints", cloth),
            reader.flag("cloth.enable_shearing_constraints", cloth),
            reader.flag("cloth.enable_bending_constraints", cloth),
        ),
    )
    orientation = reader.whole("cloth.orientation", cloth.get("orientation", HORIZONTAL), 0, 1)
    return Scene(
        sheet=sheet,
        thickness_m=reader.number("cloth.thickness", cloth.get("thickness", 0.0095), 0.0, 1.0),
        positions=_start(sheet, orientation, rng or np.random.default_rng(0)),
        pinned=_pinned(reader, sheet, cloth.get("pinned", [])),
        obstacles=tuple(
            _obstacle(reader, kind, document[kind]) for kind in document if kind in _OBSTACLE_KEYS
        ),
    )


def _start(sheet: Sheet, orientation: int, rng: np.random.Generator) -> FloatArray:
    down, along = np.meshgrid(
        np.linspace(0.0, sheet.height_m, sheet.rows),
        np.linspace(0.0, sheet.width_m, sheet.columns),
        indexing="ij",
    )
    positions = np.empty((sheet.rows * sheet.columns, 3))
    positions[:, 0] = along.ravel()
    if orientation == HORIZONTAL:
        positions[:, 1] = 1.0
        positions[:, 2] = down.ravel()
    else:
        positions[:, 1] = down.ravel()
        positions[:, 2] = rng.uniform(-1e-3, 1e-3, len(positions))
    return positions


def _pinned(reader: _Reader, sheet: Sheet, value: Any) -> npt.NDArray[np.bool_]:
    pinned = np.zeros(sheet.rows * sheet.columns, dtype=bool)
    for number, place in enumerate(reader.sequence("cloth.pinned", value)):
        where = f"cloth.pinned[{number}]"
        pair = reader.sequence(where, place)
        if len(pair) != 2:
            raise reader.refusal(where, place, "[column, row]")
        column = reader.whole(where, pair[0], 0, sheet.columns - 1)
        row = reader.whole(where, pair[1], 0, sheet.rows - 1)
        pinned[row * sheet.columns + column] = True
    return pinned


def _obstacle(reader: _Reader, kind: str, value: Any) -> Collider:
    fields = reader.mapping(kind, value, _OBSTACLE_KEYS[kind])
    friction = reader.number(f"{kind}.friction", fields.get("friction", 0.5), 0.0, 1.0)
    if kind == "sphere":
        return Sphere(
            origin_m=reader.vector("sphere.origin", fields.get("origin")),
            radius_m=reader.number("sphere.radius", fields.get("radius"), 1e-6, 1e3),
            friction=friction,
        )
    normal = reader.vector("plane.normal", fields.get("normal"))
    length = math.sqrt(sum(x * x for x in normal))
    if length == 0.0:
        raise reader.refusal("plane.normal", list(normal), "a direction")
    return Plane(
        point_m=reader.vector("plane.point", fields.get("point")),
        normal=(normal[0] / length, normal[1] / length, normal[2] / length),
        friction=friction,
    )


class _Reader:
    """Takes values out of a document and says where one cannot be."""

    def __init__(self, path: str) -> None:
        self._path = path

    def refusal(self, where: str, found: Any, required: str) -> CallError:
        return CallError(
            "the scene's value cannot be",
            path=self._path,
            where=where or None,
            found=found if found is not None else "nothing",
            required=required,
        )

    def mapping(self, where: str, value: Any, known: set[str]) -> Mapping[str, Any]:
        if not isinstance(value, dict):
            raise self.refusal(where, value, "an object")
        unknown = sorted(set(value) - known)
        if unknown:
            raise self.refusal(
                where, ", ".join(unknown), "only the fields " + ", ".join(sorted(known))
            )
        return value

    def sequence(self, where: str, value: Any) -> Sequence[Any]:
        if not isinstance(value, list):
            raise self.refusal(where, value, "a list")
        return value

    def number(self, where: str, value: Any, low: float, high: float) -> float:
        numeric = isinstance(value, int | float) and not isinstance(value, bool)
        if not numeric or not low <= value <= high:
            raise self.refusal(where, value, f"a number from {low:g} to {high:g}")
        return float(value)

    def whole(self, where: str, value: Any, low: int, high: int) -> int:
        if not isinstance(value, int) or isinstance(value, bool) or not low <= value <= high:
            raise self.refusal(where, value, f"a whole number from {low} to {high}")
        return value

    def flag(self, where: str, fields: Mapping[str, Any]) -> bool:
        value = fields.get(where.rpartition(".")[2], True)
        if not isinstance(value, bool):
            raise self.refusal(where, value, "true or false")
        return value

    def vector(self, where: str, value: Any) -> tuple[float, float, float]:
        parts = self.sequence(where, value)
        if len(parts) != 3:
            raise self.refusal(where, value, "three numbers")
        x, y, z = (self.number(where, part, -1e6, 1e6) for part in parts)
        return (x, y, z)
