"""State shared by all requests: the challenge, its templates, headers and caches."""

from __future__ import annotations

import base64
import functools
import hashlib
import re
import time
from collections import OrderedDict, deque
from collections.abc import Callable
from datetime import UTC, datetime
from importlib.resources import files
from typing import Any, Final

import jinja2
from markdown_it import MarkdownIt
from rich.filesize import decimal
from sqlalchemy.orm import Session

from pliant.evaluator.report.cells import Heading
from pliant.evaluator.report.pages import environment
from pliant.service.audit import last_entry
from pliant.service.challenge import Challenge
from pliant.service.database import Database
from pliant.service.leaderboard import Board
from pliant.service.settings import Phase, moment_text
from pliant.service.submissions import NotAcceptedError
from pliant.spec.lru_cache import LRUCache

_MOST_CACHED: Final = 64
_FAILURES_PER_MINUTE: Final = 10
_MOST_CLIENTS: Final = 10_000


def _templates() -> jinja2.Environment:
    """Return the templates of the service."""
    made = environment("pliant.service")
    made.filters["utc"] = utc
    made.filters["moment"] = moment_text
    made.filters["bytes"] = decimal
    made.globals["heading"] = figure_heading
    return made


def static_file(name: str) -> bytes:
    """Return the pages' script or style sheet."""
    return (files("pliant.service") / "static" / name).read_bytes()


def utc(time_ms: int | None) -> str:
    """Return a time for people."""
    if time_ms is None:
        return "–"
    return f"{datetime.fromtimestamp(time_ms / 1000, UTC):%Y-%m-%d %H:%M} UTC"


def figure_heading(figure: dict[str, Any]) -> Heading:
    """Return the column heading of a figure of `Version.figures`."""
    label, about, unit, better = (figure[name] for name in ("label", "about", "unit", "better"))
    return Heading(label, about, unit, better, rounded=True)


class Throttle:
    """Counts wrong tokens per client, and says when there are too many."""

    def __init__(self) -> None:
        self._times: OrderedDict[str, deque[float]] = OrderedDict()

    def check(self, client: str) -> None:
        """Refuse a client with too many events in the last minute."""
        times = self._times.get(client, deque())
        while times and times[0] < time.monotonic() - 60:
            times.popleft()
        if len(times) >= _FAILURES_PER_MINUTE:
            raise NotAcceptedError(
                "TOO_MANY_REQUESTS", 429, "too many wrong tokens", fix="Wait a minute."
            )

    def add(self, client: str) -> None:
        """Count an event."""
        self._times.setdefault(client, deque()).append(time.monotonic())
        self._times.move_to_end(client)
        while len(self._times) > _MOST_CLIENTS:
            self._times.popitem(last=False)


class Site:
    """What all requests share.

    Args:
        challenge: The challenge.
        base_url: Address that others reach it by, or empty.

    Attributes:
        throttle: Counts wrong tokens.
        headers: Security headers of every answer.
    """

    def __init__(self, challenge: Challenge, base_url: str = "") -> None:
        self.challenge, self.base_url = challenge, base_url
        self.throttle, self._templates = Throttle(), _templates()
        self.headers = _security_headers(self._templates, self.https)
        self._boards = LRUCache[Board](_MOST_CACHED)

    @property
    def database(self) -> Database:
        """The challenge's database."""
        return self.challenge.database

    @property
    def https(self) -> bool:
        """Whether others reach it by TLS, which a reverse proxy ends."""
        return self.base_url.startswith("https://")

    @functools.cached_property
    def title(self) -> str:
        """The challenge's name."""
        return self.challenge.title

    @functools.cached_property
    def rules_html(self) -> str:
        """The host's own rules, which are Markdown without HTML."""
        return MarkdownIt("js-default").render(self.challenge.settings.rules)

    def render(self, template: str, **values: Any) -> str:
        """Return a page."""
        return self._templates.get_template(template).render(
            title=self.title, settings=self.challenge.settings, **values
        )

    def cached(self, session: Session, key: str, make: Callable[[], Board]) -> Board:
        """Return the leaderboard that `make` returned when the log had its present end."""
        last = last_entry(session)
        return self._boards.get(f"{key} {last.seq if last else 0}", make)


def default_phase(phases: tuple[Phase, ...], time_ms: int) -> Phase:
    """Return the first open phase, else the last that has closed, else the first to come."""
    by_status = {phase.status(time_ms): phase for phase in phases}  # the last of each
    opened = (phase for phase in phases if phase.status(time_ms) == "open")
    return next(opened, by_status.get("closed", phases[0]))


def _security_headers(templates: jinja2.Environment, https: bool) -> dict[str, str]:
    """Return headers that let a page run only its own scripts and styles."""
    page = templates.get_template("base.html.j2").render()
    hashes = {
        tag: " ".join(
            f"'sha256-{base64.b64encode(hashlib.sha256(text.encode()).digest()).decode()}'"
            for text in re.findall(rf"<{tag}>(.*?)</{tag}>", page, re.DOTALL)
        )
        for tag in ("script", "style")
    }
    policy = (
        f"default-src 'none'; script-src 'self' {hashes['script']}; "
        f"style-src 'self' {hashes['style']}; img-src 'self' data:; connect-src 'self'; "
        "form-action 'self'; base-uri 'none'; frame-ancestors 'none'"
    )
    headers = {
        "Content-Security-Policy": policy,
        "X-Content-Type-Options": "nosniff",
        "Referrer-Policy": "same-origin",
        "Cross-Origin-Opener-Policy": "same-origin",
        "Permissions-Policy": "camera=(), microphone=(), geolocation=()",
        "Cache-Control": "no-store",
    }
    if https:
        headers["Strict-Transport-Security"] = "max-age=31536000"
    return headers
