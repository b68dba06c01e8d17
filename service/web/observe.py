"""Structured logs without secrets, and metrics for Prometheus."""

from __future__ import annotations

import json
import logging
import sys
import time
from collections.abc import Iterable

from prometheus_client import CollectorRegistry, Counter, Histogram, generate_latest
from prometheus_client.core import GaugeMetricFamily
from prometheus_client.registry import Collector
from sqlalchemy import func, select
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from pliant.service import queue
from pliant.service.database import Database
from pliant.service.models import Submission

log = logging.getLogger("pliant.service.web")

_PLAIN = set(vars(logging.makeLogRecord({}))) | {
    "message", "asctime", "taskName", "color_message",
}  # fmt: skip


class JsonFormatter(logging.Formatter):
    """One JSON object per line: time, level, logger, message, and what `extra` names."""

    def format(self, record: logging.LogRecord) -> str:
        """Return a record as one line."""
        document = {
            "time": time.strftime("%Y-%m-%dT%H:%M:%SZ", time.gmtime(record.created)),
            "level": record.levelname.lower(),
            "logger": record.name,
            "message": record.getMessage(),
            **{key: value for key, value in vars(record).items() if key not in _PLAIN},
        }
        if record.exc_info:
            document["exception"] = self.formatException(record.exc_info)
        return json.dumps(document, default=str)


def configure_logging() -> None:
    """Write the logs of the service to standard error."""
    handler = logging.StreamHandler(sys.stderr)
    handler.setFormatter(JsonFormatter())
    logging.basicConfig(level=logging.INFO, handlers=[handler], force=True)
    logging.getLogger("alembic").setLevel(logging.WARNING)


class Metrics(Collector):
    """Counts requests, and reads the queue when it is asked.

    Args:
        database: The challenge's database.
    """

    def __init__(self, database: Database) -> None:
        self._database = database
        self.registry = CollectorRegistry()
        self.requests = Counter(
            "pliant_http_requests", "Requests.", ("method", "route", "status"),
            registry=self.registry,
        )  # fmt: skip
        self.seconds = Histogram(
            "pliant_http_seconds", "Duration of requests.", ("route",), registry=self.registry
        )
        self.registry.register(self)

    def describe(self) -> Iterable[GaugeMetricFamily]:
        """Return no metrics: the database is not read at the start."""
        return ()

    def collect(self) -> Iterable[GaugeMetricFamily]:
        """Yield the number of jobs and submissions in each state."""
        jobs = GaugeMetricFamily("pliant_jobs", "Jobs by state.", labels=["state"])
        files = GaugeMetricFamily("pliant_submissions", "Submissions by state.", labels=["state"])
        with self._database.read() as session:
            for state, count in queue.counts(session).items():
                jobs.add_metric([state], count)
            query = select(Submission.state, func.count()).group_by(Submission.state)
            for state, count in session.execute(query):
                files.add_metric([state], count)
        yield jobs
        yield files

    def text(self) -> bytes:
        """Return all metrics in Prometheus' text format."""
        return generate_latest(self.registry)


class Observation:
    """Logs and counts requests: method, route, status, time; no query, header, body or token.

    Args:
        app: The application.
        metrics: Receives the counts.
    """

    def __init__(self, app: ASGIApp, metrics: Metrics) -> None:
        self._app, self._metrics = app, metrics

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Serve one request."""
        if scope["type"] != "http":
            await self._app(scope, receive, send)
            return
        status = 500
        started = time.monotonic()

        async def watched(message: Message) -> None:
            nonlocal status
            if message["type"] == "http.response.start":
                status = message["status"]
            await send(message)

        try:
            await self._app(scope, receive, watched)
        finally:
            seconds = time.monotonic() - started
            route = getattr(scope.get("route"), "path", "unmatched")
            method = scope["method"] if scope["method"] in _METHODS else "other"
            self._metrics.requests.labels(method, route, status).inc()
            self._metrics.seconds.labels(route).observe(seconds)
            client = (scope.get("client") or ("unknown",))[0]
            facts = {"method": method, "route": route, "status": status, "client": client}
            log.info("request", extra={**facts, "ms": round(seconds * 1000, 1)})


_METHODS = {"GET", "HEAD", "POST", "PUT", "DELETE", "PATCH", "OPTIONS"}
