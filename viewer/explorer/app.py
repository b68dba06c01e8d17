"""The explorer as a web application: addresses, parameters and answers; no state of its own.

`open_explorer` makes it of what the command line names: methods, reports, submissions.
"""

from __future__ import annotations

import logging
from collections import Counter
from collections.abc import Callable, Sequence
from functools import wraps
from pathlib import Path
from typing import Any, Final

import numpy as np
from starlette.requests import Request
from starlette.responses import JSONResponse, Response
from starlette.routing import Route
from starlette.types import ASGIApp

from pliant.baselines.matcher import Matcher, SplitMatcher
from pliant.evaluator.scores import SCORES_JSON
from pliant.models.shipped import shipped_names
from pliant.spec.dataset import Dataset
from pliant.spec.errors import CallError, PliantError
from pliant.spec.extras import EXTRAS, is_installed
from pliant.spec.queries import RecordedPair
from pliant.spec.sequence import RecordedFrame
from pliant.viewer.explorer.documents import answer_document, catalogue, missing, number
from pliant.viewer.explorer.frames import FrameCache
from pliant.viewer.explorer.layers import (
    FRAME_LAYERS,
    METHOD_LAYERS,
    frame_layer,
    method_layer,
    png,
)
from pliant.viewer.explorer.live import LiveMethod
from pliant.viewer.explorer.recorded import RecordedQueries
from pliant.viewer.explorer.scene import depth_bytes, pose_bytes, scene_document
from pliant.viewer.explorer.submissions import Method, read_report, read_submission
from pliant.viewer.explorer.truth import TruthFinder, rounded
from pliant.viewer.local_app import page_application

log = logging.getLogger(__name__)

STATIC: Final = Path(__file__).parent / "static"

Handler = Callable[["Explorer", Request], Response]
OpenMethod = Callable[[str], Matcher | SplitMatcher]


class Explorer:
    """Answers the page's requests.

    Args:
        frames: The dataset's frames.
        queries: Its queries.
        methods: The methods that are compared.
    """

    def __init__(
        self, frames: FrameCache, queries: RecordedQueries, methods: Sequence[Method]
    ) -> None:
        self.frames, self.queries, self.methods = frames, queries, list(methods)
        self.truth = TruthFinder(frames, queries)

    @property
    def dataset(self) -> Dataset:
        """The dataset."""
        return self.frames.dataset

    def application(self, token: str) -> ASGIApp:
        """Return the application, everything below `/TOKEN/`.

        Args:
            token: What nobody else knows.
        """
        calls = (
            *(_dataset, _missing, _layer, _truth, _answer, _warm, _start, _queries),
            *(_error, _scene, _pose, _depth),
        )
        routes = [Route(f"/api/{call.__name__[1:]}", self._bound(call)) for call in calls]
        return page_application(STATIC, routes, token)

    def _bound(self, handler: Handler) -> Callable[[Request], Response]:
        """Return an endpoint that reports what is wrong as JSON."""

        @wraps(handler)
        def endpoint(request: Request) -> Response:
            try:
                return handler(self, request)
            except CallError as error:
                return JSONResponse({"error": str(error)}, 400)
            except (PliantError, OSError) as error:
                return JSONResponse({"error": str(error)}, 422)
            except Exception as error:  # of a method of one's own
                log.exception("%s failed", request.url.path.rpartition("/")[2])
                return JSONResponse({"error": f"{type(error).__name__}: {error}"[:400]}, 500)

        return endpoint

    def frame(self, request: Request, name: str = "frame") -> RecordedFrame:
        """Return the frame that a parameter of a request names."""
        return self.frames.frame(request.query_params.get(name, ""))

    def pair(self, request: Request, *, place: bool = False) -> RecordedPair:
        """Return the frames that a request names as `a` and `b`.

        Args:
            request: The request.
            place: Whether it also names a pixel of the source, as `u` and `v`.
        """
        source, target = (self.frame(request, name) for name in "ab")
        if source.sequence.tier != target.sequence.tier:
            raise CallError("the two frames show objects of different tiers", where="a, b")
        pair = RecordedPair(source, target, np.zeros((0, 2), np.float32))
        return pair.at(_place(request)) if place else pair

    def method(self, request: Request) -> Method:
        """Return the method that a request names by its number."""
        given = request.query_params.get("method", "")
        numbered = {str(number): method for number, method in enumerate(self.methods)}
        if given not in numbered:
            raise CallError("unknown method", where="method", found=repr(given)[:40])
        return numbered[given]


def _dataset(explorer: Explorer, request: Request) -> Response:
    del request
    return JSONResponse(catalogue(explorer.dataset, explorer.queries, explorer.methods))


def _missing(explorer: Explorer, request: Request) -> Response:
    return JSONResponse(missing(explorer.pair(request)))


def _layer(explorer: Explorer, request: Request) -> Response:
    layer = request.query_params.get("layer", "")
    if layer in FRAME_LAYERS:
        found = frame_layer(explorer.frame(request), layer)
    elif layer in METHOD_LAYERS:
        pair, of_target = explorer.pair(request), request.query_params.get("of") == "b"
        method = explorer.method(request)
        found = method_layer(explorer.truth, method, pair, layer, of_target=of_target)
    else:
        raise CallError("unknown layer", where="layer", found=repr(layer)[:40])
    if found is None:
        return Response(status_code=204)
    cached = {"Cache-Control": "private, max-age=86400"}
    return Response(png(found), media_type="image/png", headers=cached)


def _truth(explorer: Explorer, request: Request) -> Response:
    found = explorer.truth.find(explorer.pair(request, place=True))
    return JSONResponse(None if found is None else found.as_document())


def _answer(explorer: Explorer, request: Request) -> Response:
    pair, method = explorer.pair(request, place=True), explorer.method(request)
    return JSONResponse(answer_document(explorer.truth, method, pair))


def _warm(explorer: Explorer, request: Request) -> Response:
    """Let a live method see a pair before the pointer moves: its features are kept."""
    pair, method = explorer.pair(request), explorer.method(request)
    if method.kind == "live" and (place := _middle(pair.source)) is not None:
        method.answer(pair.at(place))
    return JSONResponse(True)


def _start(explorer: Explorer, request: Request) -> Response:
    """Return the place that two frames without queries open with."""
    place = _middle(explorer.frame(request))
    return JSONResponse(place and rounded(np.array(place)))


def _middle(frame: RecordedFrame) -> tuple[float, float] | None:
    """Return the centre of the object's pixel nearest to their mean; None without a mask."""
    if frame.mask is None or not frame.mask.any():
        return None
    places = np.argwhere(frame.mask)[:, ::-1] + 0.5
    u, v = places[np.linalg.norm(places - places.mean(axis=0), axis=1).argmin()]
    return float(u), float(v)


def _queries(explorer: Explorer, request: Request) -> Response:
    known = explorer.queries.rows(explorer.pair(request))
    if known is None:
        return JSONResponse([])
    queries, rows = known
    return JSONResponse([rounded(each) for each in queries.uv_a_px[rows]])


def _error(explorer: Explorer, request: Request) -> Response:
    """Measure a live method on the queries of one pair."""
    pair, method = explorer.pair(request), explorer.method(request)
    if not isinstance(method, LiveMethod):
        raise CallError("a recorded method has its errors already", where="method")
    known = explorer.queries.rows(pair)
    if known is None:
        raise CallError("the dataset has no queries for this pair", where="a, b")
    queries, rows = known
    answers = np.full(queries.uv_a_px.shape, np.nan)
    answers[rows] = method.answers(pair.at(queries.uv_a_px[rows]))
    values = (value for value in queries.rmse_px(answers) if value is not None)
    return JSONResponse(number(next(values, None)))


def _scene(explorer: Explorer, request: Request) -> Response:
    return JSONResponse(scene_document(explorer.frames, explorer.frame(request).sequence))


def _pose(explorer: Explorer, request: Request) -> Response:
    return _binary(pose_bytes(explorer.frames, explorer.frame(request)))


def _depth(explorer: Explorer, request: Request) -> Response:
    return _binary(depth_bytes(explorer.frames, explorer.frame(request)))


def _binary(data: bytes | None) -> Response:
    if data is None:
        return Response(status_code=204)
    return Response(data, media_type="application/octet-stream")


def _place(request: Request) -> Any:
    """Return the place that a request names as `u` and `v`, float64 (2,)."""
    try:
        uv = np.array([float(request.query_params.get(name, "")) for name in "uv"])
    except ValueError:
        uv = np.full(2, np.nan)
    if not np.isfinite(uv).all():
        raise CallError("a place is two numbers", where="u, v", required="pixels of the source")
    return uv


def open_explorer(dataset: Dataset, answers: Sequence[str], open_method: OpenMethod) -> Explorer:
    """Return the explorer of a dataset.

    Args:
        dataset: The dataset.
        answers: Report folders, submissions and names of methods; none takes the shipped models
            for the dataset's objects, and SIFT next to them, where their extras are installed.
        open_method: Opens a method by its name.

    Raises:
        CallError: The method is unknown, or only answers whole splits.
        SubmissionError: A report or a submission is damaged.
    """
    frames, queries = FrameCache(dataset), RecordedQueries(dataset)
    methods: list[Method] = []
    given = answers or _default_methods(dataset)
    for name in given:
        path = Path(name)
        if (path / SCORES_JSON).is_file():
            methods.append(read_report(path, dataset, queries))
        elif path.suffix == ".parquet":
            methods.append(read_submission(path, dataset, queries))
        else:
            matcher = open_method(name)
            if isinstance(matcher, SplitMatcher):
                raise CallError(
                    f"the method {name!r} answers the queries of a dataset, not single pixels",
                    fix=f"Write its answers with: pliant predict {name} --data DATA --out "
                    "SUB.parquet; then give SUB.parquet.",
                )
            methods.append(LiveMethod(matcher))
    several = Counter(method.name for method in methods)
    for method, name in zip(methods, given, strict=True):
        if several[method.name] > 1 and method.name != name:
            method.name += f" ({name})"
    return Explorer(frames, queries, methods)


def _default_methods(dataset: Dataset) -> list[str]:
    """Return the shipped models that are for the dataset's objects by their names, then SIFT."""
    kinds = {tier.kind for tier in dataset.tiers.values()}
    learned = [name for name in shipped_names() if any(name.endswith(f"-{kind}") for kind in kinds)]
    usable = all(map(is_installed, EXTRAS["train"]))
    return [*(learned if usable else ()), *(["sift"] if is_installed("cv2") else ())]
