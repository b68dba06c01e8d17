"""The pages that participants see; they work without JavaScript."""

from __future__ import annotations

from collections.abc import AsyncIterator
from pathlib import Path
from typing import Annotated, Any, Final

from fastapi import APIRouter, Form, Request
from fastapi.responses import FileResponse, HTMLResponse, RedirectResponse
from fastapi.routing import APIRoute
from starlette.datastructures import UploadFile
from starlette.responses import Response
from starlette.staticfiles import NotModifiedResponse, StaticFiles

from pliant.service.audit import log_time
from pliant.service.leaderboard import history
from pliant.service.ledger import attempts
from pliant.service.submissions import NotAcceptedError
from pliant.service.teams import Identity, begin_session, end_session
from pliant.service.versions import versions_of
from pliant.service.web.api import (
    MaybeNumber,
    Number,
    TheBoard,
    own_views,
    phase_of,
    version_of,
)
from pliant.service.web.security import (
    COOKIE,
    Member,
    TheSite,
    Visitor,
    check_form,
    check_origin,
    token_identity,
)
from pliant.service.web.state import Site
from pliant.service.web.uploads import receive_file
from pliant.service.web.views import (
    find_submission,
    find_team,
    hidden_until,
    is_own,
    submission_view,
)
from pliant.spec.storage.manifest import read_checksums

_CHUNK: Final = 1 << 20


class PageRoute(APIRoute):
    """A route that answers HEAD where it answers GET; the server leaves the body out."""

    def __init__(self, *args: Any, **settings: Any) -> None:
        super().__init__(*args, **settings)
        if self.methods and "GET" in self.methods:
            self.methods.add("HEAD")


router = APIRouter(
    include_in_schema=False, default_response_class=HTMLResponse, route_class=PageRoute
)


def page(site: Site, template: str, who: Identity | None, **values: Any) -> HTMLResponse:
    """Return a page."""
    return HTMLResponse(site.render(template, who=who, plain=False, **values))


@router.get("/")
def board(site: TheSite, who: Visitor, asked: TheBoard) -> HTMLResponse:
    """Show the leaderboard."""
    phase = site.challenge.settings.phase(asked.version.phase)
    with site.database.read() as session:
        versions, time_ms = versions_of(session, phase.name), log_time(session)
    values = {**asked._asdict(), "phase": phase, "versions": versions, "time_ms": time_ms}
    return page(site, "board.html.j2", who, **values)


@router.get("/teams/{number}")
def team(
    site: TheSite,
    who: Visitor,
    number: Number,
    version: MaybeNumber = None,
) -> HTMLResponse:
    """Show the history of a team."""
    with site.database.read() as session:
        settings = site.challenge.settings
        found = find_team(session, settings, number, who)
        way = version_of(session, site, None, version)
        hidden = hidden_until(session, settings, way.phase, who)
        values = {"rows": [] if hidden else history(session, way, number), "hidden_until": hidden}
        return page(site, "team.html.j2", who, team=found, version=way, **values)


@router.get("/rules")
def rules(request: Request, site: TheSite, who: Visitor) -> HTMLResponse:
    """Show the rules, the API and the key."""
    with site.database.read() as session:
        time_ms = log_time(session)
        versions = {
            phase.name: versions_of(session, phase.name) for phase in site.challenge.settings.phases
        }
        challenge = site.challenge
        values = {
            "time_ms": time_ms,
            "versions": versions,
            "key": challenge.public_key.read_text(),
            "earlier_keys": [path.read_text() for path in challenge.earlier_keys],
            "rules_html": site.rules_html,
        }
        address = site.base_url or str(request.base_url).rstrip("/")
        return page(site, "rules.html.j2", who, base_url=address, **values)


@router.get("/data")
def data(site: TheSite, who: Visitor) -> HTMLResponse:
    """List the files of the public half."""
    return page(site, "data.html.j2", who, files=public_files(site.challenge.public))


def public_files(public: Path) -> list[tuple[str, int, str]]:
    """Return (name, bytes, sha256 or empty) of the files of a public half."""
    sums = public / "SHA256SUMS"
    checksums = read_checksums(sums) if sums.is_file() else {}
    names = sorted(path for path in public.rglob("*") if path.is_file())
    return [
        (name, path.stat().st_size, checksums.get(name, ""))
        for path in names
        for name in [path.relative_to(public).as_posix()]
    ]


@router.get("/data/{name:path}")
def download(request: Request, site: TheSite, name: str) -> Response:
    """Send a file of the public half, a range of it, or that it has not changed."""
    root = site.challenge.public.resolve()
    try:
        path = (root / name).resolve()
        found = path.is_file() and path.is_relative_to(root)
    except (OSError, ValueError):  # a name too long, or with a null character
        found = False
    if not found:
        raise NotAcceptedError("NOT_FOUND", 404, "no such file")
    kept = {"Cache-Control": "no-cache"}  # it may be kept, and is asked about before each use
    whole = FileResponse(path, 200, kept, "application/octet-stream", stat_result=path.stat())
    if StaticFiles(directory=root).is_not_modified(whole.headers, request.headers):
        return NotModifiedResponse(whole.headers)
    return whole


@router.get("/submit")
def submit_form(site: TheSite, who: Visitor) -> HTMLResponse:
    """Show the form that sends a file."""
    if who is None:
        return page(site, "login.html.j2", None, next="/submit")
    with site.database.read() as session:
        time_ms = log_time(session)
        phases = [
            (phase, phase.status(time_ms), attempts(session, who.team_id, phase, time_ms))
            for phase in site.challenge.settings.phases
        ]
        chosen = phase_of(site, None).name
    return page(site, "submit.html.j2", who, phases=phases, chosen=chosen)


@router.post("/submit")
async def submit(request: Request, site: TheSite, who: Member) -> RedirectResponse:
    """Accept a file of the form."""
    async with request.form(max_files=1, max_fields=8) as form:
        check_form(request, who, str(form.get("csrf", "")))
        file = form.get("file")
        if not isinstance(file, UploadFile) or not file.filename:
            raise NotAcceptedError("FILE_EMPTY", 400, "no file was chosen")
        view, new = await receive_file(
            site,
            who,
            phase_of(site, str(form.get("phase", ""))),
            _chunks(file),
            size=file.size,
            name=file.filename,
            check_only=form.get("check_only") == "yes",
        )
    return RedirectResponse(f"/submissions/{view.id}{'' if new else '?again=1'}", 303)


async def _chunks(file: UploadFile) -> AsyncIterator[bytes]:
    while chunk := await file.read(_CHUNK):
        yield chunk


@router.get("/submissions")
def submissions(site: TheSite, who: Visitor, before: MaybeNumber = None) -> HTMLResponse:
    """List one's own submissions."""
    if who is None:
        return page(site, "login.html.j2", None, next="/submissions")
    with site.database.read() as session:
        views, more = own_views(session, site.challenge.settings, who, before)
        return page(site, "submissions.html.j2", who, views=views, more=more, before=before)


@router.get("/submissions/{number}")
def submission(site: TheSite, who: Visitor, number: Number, again: bool = False) -> HTMLResponse:
    """Show a submission; `again` after its file was sent another time."""
    with site.database.read() as session:
        settings = site.challenge.settings
        found = find_submission(session, settings, number, who)
        view = submission_view(session, settings, found, who)
        ways = {each.id: each for each in versions_of(session, found.phase)}
        again = again and is_own(found.team_id, who)
        return page(site, "submission.html.j2", who, view=view, versions=ways, again=again)


@router.get("/login")
def login_form(site: TheSite, who: Visitor) -> HTMLResponse:
    """Show the form that takes a token."""
    return page(site, "login.html.j2", who, next="/submissions")


@router.post("/login")
def login(
    request: Request,
    site: TheSite,
    token: Annotated[str, Form(max_length=200)],
    next: Annotated[str, Form(max_length=40)] = "/submissions",
) -> RedirectResponse:
    """Sign a browser in."""
    check_origin(request)
    who = token_identity(request, token.strip())
    with site.database.write(take_turns=False) as session:
        cookie = begin_session(session, who)
    place = next if next in ("/submit", "/submissions") else "/submissions"
    response = RedirectResponse("/admin" if who.is_host else place, 303)
    response.set_cookie(
        COOKIE, cookie, max_age=12 * 3600, httponly=True, samesite="lax", secure=site.https
    )
    return response


@router.post("/logout")
def logout(
    request: Request, site: TheSite, who: Visitor, csrf: Annotated[str, Form()]
) -> RedirectResponse:
    """Sign a browser out, which another tab or the time may have done before."""
    if who is not None:
        check_form(request, who, csrf)
        with site.database.write(take_turns=False) as session:
            end_session(session, request.cookies.get(COOKIE, ""))
    response = RedirectResponse("/", 303)
    response.delete_cookie(COOKIE)
    return response
