"""The API: JSON and CSV, described by OpenAPI at `/api/v1/openapi.json`."""

from __future__ import annotations

import json
from datetime import datetime
from typing import Annotated, Any, Final, Literal, NamedTuple

from fastapi import APIRouter, Depends, Path, Query, Request
from fastapi.responses import FileResponse, PlainTextResponse
from pydantic import BaseModel, ConfigDict, Field
from sqlalchemy import select
from sqlalchemy.orm import Session
from starlette.responses import Response

from pliant.service.audit import log_time
from pliant.service.database import now_ms
from pliant.service.leaderboard import Board, leaderboard
from pliant.service.ledger import attempts
from pliant.service.models import Score, Submission, Version
from pliant.service.settings import ChallengeSettings, Phase, moment_text
from pliant.service.submissions import NotAcceptedError
from pliant.service.teams import Identity
from pliant.service.versions import default_version
from pliant.service.web.security import Member, TheSite, Visitor, by_token
from pliant.service.web.state import Site, default_phase
from pliant.service.web.uploads import receive_file
from pliant.service.web.views import (
    BoardView,
    SubmissionView,
    board_csv,
    board_view,
    csv_text,
    find_submission,
    hidden_until,
    submission_view,
)
from pliant.spec.errors import CallError

_PAGE: Final = 100
_BINARY: Final = "application/octet-stream"

Show = Literal["best", "last"]
Number = Annotated[int, Path(ge=1, lt=2**53)]
MaybeNumber = Annotated[int | None, Query(ge=1, lt=2**53)]


class ErrorView(BaseModel):
    """What went wrong, with a stable code."""

    code: str
    message: str


class PhaseView(BaseModel):
    """A phase and, for a team, the attempts that it has left."""

    name: str
    split: str
    status: str
    protocols: list[str]
    attempts_per_day: int
    attempts_total: int
    hidden_until_close: bool
    left_today: int | None
    left_total: int | None


class ChallengeView(BaseModel):
    """The challenge."""

    title: str
    phases: list[PhaseView]
    max_file_mb: float
    team: str | None


class Sending(BaseModel):
    """Query parameters of an upload; unknown ones are refused.

    With a misspelt `check_only`, an attempt would be charged.
    """

    model_config = ConfigDict(extra="forbid")

    phase: str | None = None
    check_only: bool = False
    file_name: Annotated[str, Field(max_length=300)] = "submission.parquet"


_ERRORS: Final[dict[int | str, dict[str, Any]]] = {
    status: {"model": ErrorView, "description": text}
    for status, text in (
        (400, "The request is wrong."),
        (401, "The token is missing or not valid."),
        (403, "Not allowed now."),
        (404, "Nothing here, or not for this team."),
        (413, "The file is too large."),
        (422, "A parameter is not possible."),
        (429, "No attempt is left, or too many requests."),
        (503, "The database cannot be reached, or the service stops; try again."),
        (507, "The disk is full."),
    )
}
router = APIRouter(prefix="/api/v1", responses=_ERRORS)


def phase_of(site: Site, name: str | None) -> Phase:
    """Return a phase by its name, or the first one that is open."""
    settings = site.challenge.settings
    if name is None:
        return default_phase(settings.phases, now_ms())
    try:
        return settings.phase(name)
    except CallError as error:
        raise NotAcceptedError("NOT_FOUND", 404, str(error)) from error


def version_of(session: Session, site: Site, phase: str | None, number: int | None) -> Version:
    """Return a version by its number, or the one that a phase's leaderboard opens with.

    So it is where the number is that of another phase: the page's form has the former one.
    """
    found = None if number is None else session.get(Version, number)
    if number is None or (found and phase and found.phase != phase):
        found = default_version(session, site.challenge, phase_of(site, phase))
    if found is None:
        raise NotAcceptedError("NOT_FOUND", 404, "no such version of scoring")
    return found


class RequestedBoard(NamedTuple):
    """The leaderboard that a request asks for; empty while its scores are hidden."""

    board: Board
    version: Version
    show: str
    hidden_until: datetime | None


def requested_board(
    site: TheSite,
    who: Visitor,
    phase: str | None = None,
    version: MaybeNumber = None,
    show: Show | None = None,
) -> RequestedBoard:
    """Return a leaderboard, computed once until something happens.

    Without `show` it is as the phase's rules say.
    """
    with site.database.read() as session:
        found = version_of(session, site, phase, version)
        settings = site.challenge.settings
        shown = show or settings.phase(found.phase).show
        if hidden := hidden_until(session, settings, found.phase, who):
            return RequestedBoard(Board((), ()), found, shown, hidden)
        key = f"{found.id} {shown}"
        board = site.cached(session, key, lambda: leaderboard(session, found, shown))
        return RequestedBoard(board, found, shown, None)


TheBoard = Annotated[RequestedBoard, Depends(requested_board)]


@router.get("/challenge")
def get_challenge(site: TheSite, who: Visitor) -> ChallengeView:
    """Return the phases, and for a team the attempts it has left."""
    with site.database.read() as session:
        time_ms = log_time(session)
        phases = []
        for phase in site.challenge.settings.phases:
            left = None if who is None else attempts(session, who.team_id, phase, time_ms)
            values = phase.model_dump() | {"status": phase.status(time_ms)}
            values |= {"left_today": left and left.today, "left_total": left and left.total}
            phases.append(PhaseView.model_validate(values))
    return ChallengeView(
        title=site.title,
        phases=phases,
        max_file_mb=site.challenge.settings.max_file_mb,
        team=None if who is None else who.name,
    )


@router.get("/leaderboard")
def get_leaderboard(asked: TheBoard) -> BoardView:
    """Return the leaderboard of a phase; without `show` as the phase's rules say."""
    return board_view(*asked)


@router.get("/leaderboard.csv", response_class=PlainTextResponse)
def get_leaderboard_csv(asked: TheBoard) -> PlainTextResponse:
    """Return the leaderboard of a phase as CSV."""
    return PlainTextResponse(board_csv(asked.board, asked.version), media_type="text/csv")


@router.post(
    "/submissions",
    status_code=201,
    responses={200: {"model": SubmissionView, "description": "This file was sent before."}},
    openapi_extra={
        "requestBody": {
            "required": True,
            "content": {_BINARY: {"schema": {"type": "string", "format": "binary"}}},
        }
    },
)
async def post_submission(
    request: Request,
    response: Response,
    site: TheSite,
    who: Annotated[Identity, Depends(by_token)],
    sending: Annotated[Sending, Query()],
) -> SubmissionView:
    """Submit a Parquet file, the request's body.

    The same file sent again is one submission, unless it was refused.
    """
    if request.headers.get("content-type", "").startswith("multipart/"):
        found = "a form with the file in it"
        required = "the file alone as the body, as `curl -T` sends it"
        raise NotAcceptedError("FILE_IN_FORM", 415, "wrong body", found=found, required=required)
    view, new = await receive_file(
        site,
        who,
        phase_of(site, sending.phase),
        request.stream(),
        size=int(request.headers.get("content-length", 0)) or None,
        name=sending.file_name,
        check_only=sending.check_only,
    )
    if not new:
        response.status_code = 200
    return view


def own_views(
    session: Session, settings: ChallengeSettings, who: Identity, before: int | None
) -> tuple[list[SubmissionView], bool]:
    """Return a page of the submissions of a team, of all for the host, and whether more follow."""
    query = select(Submission).order_by(Submission.id.desc()).limit(_PAGE + 1)
    if not who.is_host:
        query = query.where(Submission.team_id == who.team_id)
    if before is not None:
        query = query.where(Submission.id < before)
    found = session.scalars(query).all()
    views = [submission_view(session, settings, each, who) for each in found[:_PAGE]]
    return views, len(found) > _PAGE


@router.get("/submissions")
def get_submissions(site: TheSite, who: Member, before: MaybeNumber = None) -> list[SubmissionView]:
    """Return the last 100 submissions, or those before one; a team sees its own."""
    with site.database.read() as session:
        return own_views(session, site.challenge.settings, who, before)[0]


@router.get("/submissions.csv", response_class=PlainTextResponse)
def get_submissions_csv(
    site: TheSite, who: Member, before: MaybeNumber = None
) -> PlainTextResponse:
    """Return the same as CSV, with every score."""
    fields = ("id", "team", "phase", "state", "method", "file_name", "file_sha256", "submitted_ms")
    rows = []
    with site.database.read() as session:
        for view in own_views(session, site.challenge.settings, who, before)[0]:
            scores = {each.version: each.figures["overall"] for each in view.scores}
            values = view.model_dump() | ({"state": "withdrawn"} if view.withdrawn else {})
            rows.append([*(values[name] for name in fields), json.dumps(scores)])
    return PlainTextResponse(csv_text([*fields, "scores"], rows), media_type="text/csv")


@router.get("/submissions/{number}")
def get_submission(site: TheSite, who: Visitor, number: Number) -> SubmissionView:
    """Return a submission: its state, place in the queue, problems and scores."""
    with site.database.read() as session:
        settings = site.challenge.settings
        found = find_submission(session, settings, number, who)
        return submission_view(session, settings, found, who)


@router.get("/submissions/{number}/file", response_class=FileResponse)
def get_file(site: TheSite, who: Member, number: Number) -> FileResponse:
    """Return the file of one's own submission."""
    with site.database.read() as session:
        found = find_submission(session, site.challenge.settings, number, who, public=False)
        sha256 = found.file_sha256
    path, name = site.challenge.store.path(sha256), f"submission-{number}.parquet"
    return FileResponse(path, media_type=_BINARY, filename=name)


@router.get("/submissions/{number}/receipt")
def get_receipt(
    site: TheSite,
    who: Visitor,
    number: Number,
    version: MaybeNumber = None,
) -> dict[str, Any]:
    """Return the signed receipt of a score; without `version` of the newest."""
    with site.database.read() as session:
        found = find_submission(session, site.challenge.settings, number, who)
        if hidden := hidden_until(session, site.challenge.settings, found.phase, who):
            raise NotAcceptedError(
                "SCORES_HIDDEN", 403, f"scores are hidden until {moment_text(hidden)}"
            )
        query = select(Score.receipt).where(Score.submission_id == number)
        if version is not None:
            query = query.where(Score.version_id == version)
        receipt = session.scalar(query.order_by(Score.version_id.desc()).limit(1))
    if receipt is None:
        raise NotAcceptedError("NOT_FOUND", 404, "there is no score, so there is no receipt")
    return receipt


@router.get("/protocols/{sha256}", response_class=FileResponse)
def get_protocol(
    site: TheSite, sha256: Annotated[str, Path(pattern="^[0-9a-f]{64}$")]
) -> FileResponse:
    """Return a protocol that scores, as the JSON file that `pliant evaluate --protocol` reads."""
    path = site.challenge.protocol_path(sha256)
    if not path.is_file():
        raise NotAcceptedError("NOT_FOUND", 404, "no such protocol")
    return FileResponse(path, media_type="application/json", filename=f"protocol-{sha256[:8]}.json")


@router.get("/key", response_class=PlainTextResponse)
def get_key(site: TheSite) -> PlainTextResponse:
    """Return the public key that verifies receipts (PEM)."""
    return PlainTextResponse(site.challenge.public_key.read_text())
