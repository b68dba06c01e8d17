"""The web application: routes, errors as JSON or as a page, and what protects them."""

from __future__ import annotations

import errno
import logging
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager, suppress
from importlib.metadata import version
from urllib.parse import urlsplit

from anyio import to_thread
from fastapi import FastAPI, Request
from fastapi.exceptions import RequestValidationError
from fastapi.responses import HTMLResponse, JSONResponse, PlainTextResponse
from sqlalchemy import text
from sqlalchemy.exc import DBAPIError, SQLAlchemyError, TimeoutError
from starlette.exceptions import HTTPException
from starlette.requests import ClientDisconnect
from starlette.responses import Response

from pliant.service.challenge import Challenge
from pliant.service.database import cause, is_full
from pliant.service.submissions import NotAcceptedError
from pliant.service.web import admin, api, pages
from pliant.service.web.observe import Observation
from pliant.service.web.security import Protection, optional_identity
from pliant.service.web.state import Site, static_file
from pliant.service.web.uploads import remove_abandoned
from pliant.spec.errors import CallError, PliantError

log = logging.getLogger(__name__)

_UPLOADS = frozenset({"/submit", "/api/v1/submissions"})
_RETRY_AFTER_S = {"TOO_MANY_REQUESTS": "60", "DATABASE_UNREACHABLE": "5"}
_THREADS = 12
"""Requests that are worked on at a time: more would only add memory and wait for each other."""


@asynccontextmanager
async def _lifespan(app: FastAPI) -> AsyncIterator[None]:
    del app
    to_thread.current_default_thread_limiter().total_tokens = _THREADS
    yield


def make_app(challenge: Challenge, base_url: str = "") -> FastAPI:
    """Return the application of a challenge.

    Args:
        challenge: The challenge.
        base_url: Address that others reach it by, such as `https://challenge.example.org`.

    Raises:
        CallError: The address has a path, which the pages' links lack.
    """
    if urlsplit(base_url).path.strip("/"):
        raise CallError(
            "the service needs a host name of its own",
            where="--base-url",
            found=base_url,
            required="an address without a path, such as https://challenge.example.org",
        )
    remove_abandoned(challenge.incoming)
    site = Site(challenge, base_url.rstrip("/"))
    app = FastAPI(
        title=site.title,
        version=version("pliant"),
        lifespan=_lifespan,
        openapi_url="/api/v1/openapi.json",
        docs_url=None,
        redoc_url=None,
        redirect_slashes=False,  # to the host name that a reverse proxy passes on
    )
    app.state.site = site
    app.include_router(api.router)
    app.include_router(pages.router)
    app.include_router(admin.router)
    _add_operations(app, site)
    _add_errors(app, site)
    app.add_middleware(Protection, site=site, upload_paths=_UPLOADS)
    app.add_middleware(Observation)
    return app


def _add_operations(app: FastAPI, site: Site) -> None:
    def healthz() -> PlainTextResponse:
        """Return `ok` when the database answers."""
        with site.database.read() as session:
            session.execute(text("SELECT 1"))
        return PlainTextResponse("ok")

    def static(name: str) -> Response:
        """Return the pages' script or style sheet."""
        kind = {"service.js": "text/javascript", "service.css": "text/css"}.get(name)
        if kind is None:
            raise NotAcceptedError("NOT_FOUND", 404, "no such file")
        return Response(static_file(name), media_type=kind)

    methods = ["GET", "HEAD"]
    app.add_api_route("/healthz", healthz, methods=methods, include_in_schema=False)
    app.add_api_route("/static/{name}", static, methods=methods, include_in_schema=False)


def _add_errors(app: FastAPI, site: Site) -> None:
    def answer(request: Request, status: int, code: str, message: str, **headers: str) -> Response:
        headers |= {"Retry-After": _RETRY_AFTER_S[code]} if code in _RETRY_AFTER_S else {}
        if status == 401:
            headers["WWW-Authenticate"] = "Bearer"
        headers |= site.headers if status == 500 else {}
        if request.url.path.startswith("/api/"):
            return JSONResponse({"code": code, "message": message}, status, headers)
        if status == 404 and not hasattr(request.state, "who"):  # no route asked who it is
            with suppress(SQLAlchemyError):
                optional_identity(request)
        who = getattr(request.state, "who", None)
        page = site.render(
            "error.html.j2", code=code, message=message, status=status, who=who, plain=False
        )
        return HTMLResponse(page, status, headers)

    @app.exception_handler(NotAcceptedError)
    def not_accepted(request: Request, error: NotAcceptedError) -> Response:
        return answer(request, error.status, error.code, str(error))

    @app.exception_handler(PliantError)
    def refused(request: Request, error: PliantError) -> Response:
        return answer(request, 400, "REFUSED", str(error))

    @app.exception_handler(RequestValidationError)
    def impossible(request: Request, error: RequestValidationError) -> Response:
        found = "; ".join(
            f"{'.'.join(map(str, each['loc']))}: {each['msg']}" for each in error.errors()
        )
        return answer(request, 422, "PARAMETER_INVALID", found)

    @app.exception_handler(HTTPException)
    def http(request: Request, error: HTTPException) -> Response:
        if error.status_code == 404:
            return answer(request, 404, "NOT_FOUND", "no such page")
        allowed = dict(error.headers or {})
        text = f"this request is not possible: {error.detail}"
        return answer(request, error.status_code, "NOT_POSSIBLE", text, **allowed)

    @app.exception_handler(ClientDisconnect)
    def gone(request: Request, error: ClientDisconnect) -> Response:
        del error  # nobody receives the answer, but the log has its status
        return answer(request, 400, "FILE_INCOMPLETE", "the connection ended before the file did")

    @app.exception_handler(DBAPIError)
    @app.exception_handler(TimeoutError)
    def no_database(request: Request, error: DBAPIError | TimeoutError) -> Response:
        log.warning("the database cannot be used", extra=cause(error))
        if is_full(error):
            return full(request, error)
        return answer(
            request, 503, "DATABASE_UNREACHABLE", "the database cannot be reached; try again"
        )

    @app.exception_handler(OSError)
    def no_space(request: Request, error: OSError) -> Response:
        if error.errno not in (errno.ENOSPC, errno.EDQUOT, errno.EFBIG):
            raise error
        return full(request, error)

    def full(request: Request, error: Exception) -> Response:
        del error
        return answer(request, 507, "DISK_FULL", "the service's disk is full; nothing was charged")

    @app.exception_handler(Exception)
    def crashed(request: Request, error: Exception) -> Response:
        del error
        return answer(request, 500, "INTERNAL", "the service has a fault; the host can see it")
