"""`pliant serve`: the web server and its workers, stopped together."""

from __future__ import annotations

import logging
import multiprocessing
import signal
import sys
import threading
from collections.abc import Callable
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


class Workers:
    """Worker processes, started again when one ends by itself.

    Args:
        root: The challenge's folder.
        database_url: The database, or None for the SQLite file.
        count: Number of processes.
    """

    def __init__(self, root: Path, database_url: str | None, count: int) -> None:
        self._work, self._count = (root, database_url), count
        self._ended = threading.Event()
        self._processes: list[BaseProcess] = []
        self._thread = threading.Thread(target=self._watch, daemon=True)

    def __enter__(self) -> Workers:
        self._processes = [self._start() for _ in range(self._count)]
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
            target=work, args=self._work, daemon=False
        )
        # While it still imports, Ctrl-C would end it with a traceback: it waits until it can stop.
        before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
        try:
            process.start()
        finally:
            signal.pthread_sigmask(signal.SIG_SETMASK, before)
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
    _add_versions(challenge)
    run_worker(challenge, multiprocessing.parent_process())


def _add_versions(challenge: Challenge) -> None:
    with challenge.database.write() as session:
        add_missing_versions(session, challenge)


def serve(
    root: Path,
    *,
    host: str,
    port: int,
    workers: int,
    database_url: str | None,
    base_url: str,
    trusted_proxy: str,
    listening: Callable[[int], None] = lambda port: None,
) -> None:
    """Serve a challenge until SIGTERM or Ctrl-C; running jobs are finished.

    Args:
        root: Its folder.
        host: Address to listen on.
        port: Port; 0 takes any that is free.
        workers: Number of worker processes; 0 serves pages only.
        database_url: The database, or None for the SQLite file.
        base_url: Address that others reach it by, or empty.
        trusted_proxy: Addresses of reverse proxies whose `X-Forwarded-…` headers count, or empty.
        listening: Called with the port once the server listens.

    Raises:
        CallError: It is not a challenge, a phase cannot be scored, or the port is taken.
    """
    challenge = Challenge.open(root, database_url)
    if workers:  # what they would refuse at their start, one after another
        _add_versions(challenge)
    configure_logging()
    config = uvicorn.Config(
        make_app(challenge, base_url),
        host=host,
        port=port,
        log_config=None,
        access_log=False,
        server_header=False,
        proxy_headers=bool(trusted_proxy),
        forwarded_allow_ips=trusted_proxy or None,
        timeout_graceful_shutdown=_STOP_S,
    )
    # uvicorn repeats the signal that stopped it: the workers are stopped first.
    signal.signal(signal.SIGTERM, lambda *_: sys.exit(0))
    with Workers(root, database_url, workers):
        try:
            own = config.bind_socket()
            own.listen()  # so that clients can connect once the port is known
            listening(own.getsockname()[1])
            uvicorn.Server(config).run(sockets=[own])
        except SystemExit as error:
            if not error.code:
                return
            raise CallError(
                "the server cannot start",
                where=f"{host}:{port}",
                fix="Choose another port with --port.",
            ) from error
