"""`pliant annotate`: a local web page on which people click the same points in several pictures.

One self-contained page, served on 127.0.0.1 alone. Every change is written to `annotations.csv` in
the folder of the pictures at once. Requests must name this machine as their host and carry the
page's token, so that no other web page can read pictures or change marks.
"""

from __future__ import annotations

import csv
import io
import json
import math
import secrets
import threading
from collections.abc import Callable, Mapping, Sequence
from http import HTTPStatus
from http.server import ThreadingHTTPServer
from importlib.resources import files
from pathlib import Path
from typing import Any, Final

from PIL import Image

from pliant.baselines.matcher import Matcher
from pliant.baselines.views import read_frame
from pliant.converters.marks_csv import ANNOTATIONS_CSV, COLUMNS, collect_marks
from pliant.spec.errors import CallError, PliantError
from pliant.spec.io.photo import SUFFIXES, photo_size, read_photo
from pliant.spec.io.writing import replacing
from pliant.viewer.local_server import LocalHandler, open_local_server
from pliant.viewer.photo_match import match_photo

_MAX_BODY_BYTES: Final = 4 * 2**20
_JPEG_QUALITY: Final = 92
_MAX_SIDE_PX: Final = 1024  # of the pictures that suggestions are computed on

Mark = tuple[float | None, float | None, bool]
Marks = dict[str, dict[str, Mark]]
"""Picture -> point -> x and y in pixels of the picture from its corner, and whether it is seen."""


class Annotation:
    """The pictures of a folder and their marks, kept in its `annotations.csv`.

    Args:
        folder: The folder.
        points: Names of points to begin with; those of an earlier `annotations.csv` are kept.

    Raises:
        CallError: It is not a folder, or has fewer than two pictures.
        PliantError: A picture or an earlier `annotations.csv` cannot be read.
    """

    def __init__(self, folder: Path, points: Sequence[str] = ()) -> None:
        if not folder.is_dir():
            raise CallError("folder not found", path=folder)
        self.pictures = sorted(p for p in folder.iterdir() if p.suffix.lower() in SUFFIXES)
        if len(self.pictures) < 2:
            raise CallError(
                "points are marked in several pictures",
                path=folder,
                found=f"{len(self.pictures)} pictures",
                required="at least two of " + ", ".join(SUFFIXES),
            )
        self.sizes = [photo_size(picture) for picture in self.pictures]
        self.path = folder / ANNOTATIONS_CSV
        self.marks: Marks = {}
        names = list(points)
        if self.path.is_file():
            names += self._read()
        self.points = list(dict.fromkeys(names))
        self._lock = threading.Lock()

    def _read(self) -> list[str]:
        """Take the marks of an earlier file; return the names of its points."""
        earlier = collect_marks(self.path).marks
        for (picture, point), (u, v, seen) in earlier.items():
            mark: Mark = (u, v, seen) if math.isfinite(u + v) else (None, None, False)
            self.marks.setdefault(picture.name, {})[point] = mark
        return [point for _, point in earlier]

    def state(self) -> dict[str, Any]:
        """Return everything that the page shows, as JSON."""
        pictures = [
            {"name": picture.name, "width": width, "height": height}
            for picture, (width, height) in zip(self.pictures, self.sizes, strict=True)
        ]
        return {"pictures": pictures, "points": self.points, "marks": self.marks}

    def update(self, document: Any) -> None:
        """Replace points and marks by those of the page, and write them.

        Raises:
            CallError: They are not of the form of `state`.
        """
        sizes = dict(zip((p.name for p in self.pictures), self.sizes, strict=True))
        try:
            points = [str(point).strip() for point in document["points"]]
            marks = {
                picture: {
                    point: _checked(mark, sizes[picture], points, point)
                    for point, mark in own.items()
                }
                for picture, own in document["marks"].items()
            }
        except (KeyError, TypeError, ValueError, AttributeError) as error:
            raise CallError("the marks are not of this folder", found=str(error)[:80]) from error
        with self._lock:
            self.points, self.marks = points, marks
            self._write()

    def _write(self) -> None:
        text = io.StringIO(newline="")
        rows = csv.writer(text, lineterminator="\n")
        rows.writerow(COLUMNS)
        for picture in self.pictures:
            own = self.marks.get(picture.name, {})
            for point in self.points:
                if point in own:
                    x, y, visible = own[point]
                    shown = ["" if each is None else f"{each:.3f}" for each in (x, y)]
                    rows.writerow([picture.name, point, *shown, int(visible)])
        with replacing(self.path) as partial:
            partial.write_text(text.getvalue(), encoding="utf-8")

    def count(self) -> int:
        """Return the number of marks."""
        return sum(len(own) for own in self.marks.values())


def _checked(mark: Any, size: tuple[int, int], points: Sequence[str], point: str) -> Mark:
    x, y, visible = mark
    if point not in points or not point or not isinstance(visible, bool):
        raise ValueError(f"point {point!r}")
    if x is None and y is None and not visible:
        return None, None, False
    if not (0 <= float(x) <= size[0] and 0 <= float(y) <= size[1]):
        raise ValueError(f"{point!r} at {x}, {y}")
    return float(x), float(y), visible


class Suggester:
    """Finds the marks of one picture in another with a method.

    Args:
        annotation: The pictures.
        open_matcher: Returns the method; called at the first suggestion.
    """

    def __init__(self, annotation: Annotation, open_matcher: Callable[[], Matcher]) -> None:
        self._annotation, self._open = annotation, open_matcher
        self._matcher: Matcher | None = None
        self._lock = threading.Lock()

    def suggest(self, source: int, target: int) -> dict[str, Any]:
        """Return where the points of one picture are in another.

        Args:
            source: Number of the picture with the marks.
            target: Number of the other one.

        Returns:
            `marks`, point -> [x, y], of those marked visible in the source; `warnings`, sentences.
        """
        own = self._annotation.marks.get(self._annotation.pictures[source].name, {})
        asked = {name: (mark[0], mark[1]) for name, mark in own.items() if mark[2]}
        if not asked or source == target:
            return {"marks": {}, "warnings": ["The other picture has no visible marks."]}
        pictures = [self._annotation.pictures[each] for each in (source, target)]
        sizes = (self._annotation.sizes[source], self._annotation.sizes[target])
        # A mark on the right or lower border is on no pixel.
        at = [
            (min(float(x or 0), sizes[0][0] - 0.5), min(float(y or 0), sizes[0][1] - 0.5))
            for x, y in asked.values()
        ]
        with self._lock:
            self._matcher = self._matcher or self._open()
            views = [read_frame(picture, max_side=_MAX_SIDE_PX) for picture in pictures]
            found = match_photo(self._matcher, views[0], views[1], at, sizes=sizes)
        places = (point.uv_b_px * found.scale_b for point in found.points)
        marks = {
            name: [round(float(x), 3) for x in place]
            for name, place in zip(asked, places, strict=True)
        }
        return {"marks": marks, "warnings": found.warnings()}


def make_server(
    annotation: Annotation, suggester: Suggester | None = None, port: int = 0
) -> ThreadingHTTPServer:
    """Return a server of the page on 127.0.0.1; `serve_forever` runs it.

    Args:
        annotation: The pictures and their marks.
        suggester: Finds suggestions, None for none.
        port: Its port, 0 for any that is free.

    Raises:
        CallError: The port is taken.
    """
    token = secrets.token_urlsafe(16)

    class Handler(_Handler):
        pass

    Handler.annotation, Handler.suggester, Handler.token = annotation, suggester, token
    return open_local_server(Handler, port)


class _Handler(LocalHandler):
    annotation: Annotation
    suggester: Suggester | None
    token: str

    def do_GET(self) -> None:  # noqa: N802 - the name that http.server calls
        """Send the page, the state or a picture."""
        if not self.is_local():
            return
        if self.path == "/":
            page = files("pliant.viewer").joinpath("annotate.html").read_text(encoding="utf-8")
            facts = {"token": self.token, "suggests": self.suggester is not None}
            page = page.replace("/*FACTS*/", json.dumps(facts).replace("<", "\\u003c"))
            self._send(page.encode(), "text/html; charset=utf-8")
        elif self.path == "/state":
            self._send_json(self.annotation.state())
        elif self.path.startswith("/picture/") and self.path[9:].isdecimal():
            number = int(self.path[9:])
            if number < len(self.annotation.pictures):
                self._send(_jpeg(self.annotation.pictures[number]), "image/jpeg")
            else:
                self.send_error(HTTPStatus.NOT_FOUND)
        else:
            self.send_error(HTTPStatus.NOT_FOUND)

    def do_POST(self) -> None:  # noqa: N802
        """Take marks, or return suggestions."""
        if not self.is_local():
            return
        length = int(self.headers.get("Content-Length") or 0)
        if self.headers.get("X-Token") != self.token or not 0 < length <= _MAX_BODY_BYTES:
            self.send_error(HTTPStatus.FORBIDDEN)
            return
        try:
            document = json.loads(self.rfile.read(length))
            if self.path == "/marks":
                self.annotation.update(document)
                self._send_json({"saved": self.annotation.count()})
            elif self.path == "/suggest" and self.suggester is not None:
                last = len(self.annotation.pictures) - 1
                chosen = [min(max(int(document[key]), 0), last) for key in ("source", "target")]
                self._send_json(self.suggester.suggest(*chosen))
            else:
                self.send_error(HTTPStatus.NOT_FOUND)
        except (PliantError, KeyError, TypeError, ValueError, OSError) as error:
            self._send_json({"error": str(error)}, HTTPStatus.BAD_REQUEST)

    def _send_json(self, document: Mapping[str, Any], status: HTTPStatus = HTTPStatus.OK) -> None:
        self._send(json.dumps(document).encode(), "application/json", status)

    def _send(self, data: bytes, kind: str, status: HTTPStatus = HTTPStatus.OK) -> None:
        self.send_response(status)
        self.send_header("Content-Type", kind)
        self.send_header("Content-Length", str(len(data)))
        self.send_header("Cache-Control", "no-store")
        self.end_headers()
        self.wfile.write(data)


def _jpeg(picture: Path) -> bytes:
    buffer = io.BytesIO()
    Image.fromarray(read_photo(picture)).save(buffer, "JPEG", quality=_JPEG_QUALITY)
    return buffer.getvalue()
