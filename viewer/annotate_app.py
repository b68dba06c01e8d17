"""The page of `pliant annotate`: people click the same points in several pictures.

Every change is written to `annotations.csv` in the folder of the pictures at once.
"""

from __future__ import annotations

import json
from collections.abc import Callable
from functools import wraps
from pathlib import Path
from typing import Any, Final

from PIL import Image
from starlette.concurrency import run_in_threadpool
from starlette.requests import Request
from starlette.responses import JSONResponse, Response
from starlette.routing import Route
from starlette.types import ASGIApp

from pliant.spec.errors import PliantError
from pliant.spec.io.photo import encoded, read_photo
from pliant.viewer.annotation import Annotation, Suggester
from pliant.viewer.local_app import page_application

PAGE: Final = Path(__file__).parent / "annotate_page"

_JPEG_QUALITY: Final = 92


def annotate_application(
    annotation: Annotation, suggester: Suggester | None, token: str
) -> ASGIApp:
    """Return the application of the page.

    Args:
        annotation: The pictures and their marks.
        suggester: Finds suggestions, None for none.
        token: What nobody else knows.
    """
    pictures = {str(number): path for number, path in enumerate(annotation.pictures)}

    def state(request: Request) -> Response:
        del request
        return JSONResponse({**annotation.state(), "suggests": suggester is not None})

    def picture(request: Request) -> Response:
        path = pictures.get(request.path_params["number"])
        return Response(status_code=404) if path is None else _jpeg(path)

    def save(document: Any) -> Any:
        annotation.update(document)
        return {
            "saved": annotation.count(),
            "suggested": annotation.count("suggested"),
            "revision": annotation.revision,
        }

    def suggest(document: Any) -> Any:
        assert suggester is not None
        return suggester.suggest(int(document["source"]), int(document["target"]))

    routes = [
        Route("/state", state),
        Route("/picture/{number}", picture),
        Route("/marks", _posted(save), methods=["POST"]),
    ]
    if suggester is not None:
        routes.append(Route("/suggest", _posted(suggest), methods=["POST"]))
    return page_application(PAGE, routes, token)


def _posted(act: Callable[[Any], Any]) -> Callable[[Request], Any]:
    """Return an endpoint that takes a JSON document and reports what is wrong as JSON."""

    @wraps(act)
    async def endpoint(request: Request) -> Response:
        try:
            document = json.loads(await request.body())
            return JSONResponse(await run_in_threadpool(act, document))
        except (
            *(PliantError, KeyError, TypeError, ValueError),
            *(OverflowError, RecursionError, OSError),
        ) as error:
            return JSONResponse({"error": str(error)[:400]}, 400)

    return endpoint


def _jpeg(path: Path) -> Response:
    try:
        rgb = read_photo(path)
    except PliantError as error:  # it was removed or replaced meanwhile
        return JSONResponse({"error": str(error)}, 422)
    data = encoded(Image.fromarray(rgb), "JPEG", quality=_JPEG_QUALITY)
    return Response(data, media_type="image/jpeg")
