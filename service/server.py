"""`pliant serve`: the web server and its workers, stopped together."""

from __future__ import annotations

import logging
import multiprocessing
import signal
import sys
import threading
from dataclasses import dataclass
from multiprocessing.process import BaseProcess
from pathlib import Path
from typing import Final

import uvicorn

from pliant.service.challenge import Challenge
from pliant.service.versions import add_missing_versions
from pliant.service.web.app import make_app
from pliant.service.web.observe import configure_logging
from pliant.service.worker import run_worker
from pliant.spec.errors import CallError

log = logging.getLogger(__name__)

_CHECK_S: Final = 1.0
_STOP_S: Final = 5


@dataclass(frozen=True)
class ServeOptions:
    """How a challenge is served.

    Attributes:
        host: Address to listen on.
        port: Port; 0 takes any that is free.
        workers: Number of worker processes; 0 serves pages only.
        database_url: The database, or None for the SQLite file.
        base_url: Address that others reach it by, or empty.
        trusted_proxy: Addresses of reverse proxies whose `X-Forwarded-…` headers count, or empty.
    """

    host: str = "127.0.0.1"
    port: int = 8000
    workers: int = 2
    database_url: str | None = None
    base_url: str = ""
    trusted_proxy: str = ""


class Workers:
    """Worker processes, started again when one ends by itself.

    Args:
        root: The challenge's folder.
        options: How it is served.
    """

    def __init__(self, root: Path, options: ServeOptions) -> None:
        self._root, self._options = root, options
        self._ended = threading.Event()
        self._processes: list[BaseProcess] = []
        self._thread = threading.Thread(target=self._watch, daemon=True)

    def __enter__(self) -> Workers:
        self._processes = [self._start() for _ in range(self._options.workers)]
        self._thread.start()
        return self

    def __exit__(self, *exc: object) -> None:
        self._ended.set()
        self._thread.join()
        for process in self._processes:
            process.terminate()
        for process in self._processes:
            process.join()

    def _start(self) -> BaseProcess:
        process = multiprocessing.get_context("spawn").Process(
            target=work, args=(self._root, self._options.database_url), daemon=False
        )
        process.start()
        return process

    def _watch(self) -> None:
        while not self._ended.wait(_CHECK_S):
            for index, process in enumerate(self._processes):
                if not process.is_alive():
                    log.warning("a worker ended; starting another", extra={"pid": process.pid})
                    self._processes[index] = self._start()


def work(root: Path, database_url: str | None) -> None:
    """Run a worker until SIGTERM, or until the process that started it has ended."""
    configure_logging()
    challenge = Challenge.open(root, database_url)
    with challenge.database.write() as session:
        add_missing_versions(session, challenge)
    run_worker(challenge, multiprocessing.parent_process())


def serve(root: Path, options: ServeOptions) -> None:
    """Serve a challenge until SIGTERM or Ctrl-C; running jobs are finished.

    Raises:
        CallError: It is not a challenge, or the port is taken.
    """
    challenge = Challenge.open(root, options.database_url)
    configure_logging()
    config = uvicorn.Config(
        make_app(challenge, options.base_url),
        host=options.host,
        port=options.port,
        log_config=None,
        access_log=False,
        server_header=False,
        proxy_headers=bool(options.trusted_proxy),
        forwarded_allow_ips=options.trusted_proxy or None,
        timeout_graceful_shutdown=_STOP_S,
    )
    # uvicorn repeats the signal that stopped it: the workers are stopped first.
    signal.signal(signal.SIGTERM, lambda *_: sys.exit(0))
    with Workers(root, options):
        server = uvicorn.Server(config)
        try:
            server.run()
        except SystemExit as error:
            if not error.code:
                return
            raise CallError(
                "the server cannot start",
                where=f"{options.host}:{options.port}",
                fix="Choose another port with --port.",
            ) from error
