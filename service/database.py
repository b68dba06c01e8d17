"""The database: SQLite by default, PostgreSQL by URL; reading and writing transactions."""

from __future__ import annotations

import time
import weakref
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, Final

from alembic import command
from alembic.config import Config
from alembic.runtime.migration import MigrationContext
from alembic.script import ScriptDirectory
from sqlalchemy import Connection, Engine, create_engine, event, inspect, text
from sqlalchemy.engine import make_url
from sqlalchemy.exc import (
    ArgumentError,
    DBAPIError,
    NoSuchModuleError,
    OperationalError,
    SQLAlchemyError,
)
from sqlalchemy.orm import Session

from pliant.spec.errors import CallError

BUSY_S: Final = 5.0
"""How long a transaction waits for another one, or for the database to answer."""

_DRIVERS: Final = ("sqlite", "postgresql", "postgresql+psycopg")
_READ_ONLY: Final = "25006"
"""SQLSTATE of a write to PostgreSQL where a standby, or the host, allows none."""

_DISK_FULL: Final = "53100"
_WRITE_LOCK: Final = 0x506C69616E74
"""Number of PostgreSQL's advisory lock: transactions that write the audit log take turns."""


class Database:
    """The challenge's database.

    Args:
        url: SQLAlchemy URL, such as `sqlite:////srv/challenge/challenge.sqlite` or
            `postgresql://user@host/name`.
    """

    def __init__(self, url: str) -> None:
        self.engine = _engine(url)
        # SQLite writes its log into the file when the last connection is closed.
        weakref.finalize(self, self.engine.dispose)

    @property
    def is_sqlite(self) -> bool:
        """Whether it is one file on this machine."""
        return self.engine.dialect.name == "sqlite"

    @contextmanager
    def read(self) -> Iterator[Session]:
        """Give a session whose statements all see one state of the database."""
        with Session(self.engine) as session:
            if not self.is_sqlite:
                session.connection(execution_options={"isolation_level": "REPEATABLE READ"})
            yield session

    @contextmanager
    def write(self, *, take_turns: bool = True) -> Iterator[Session]:
        """Give a session whose changes are stored together at the end, or not at all.

        Args:
            take_turns: Whether no other such transaction runs at the same time. SQLite allows one
                in any case.
        """
        with Session(self.engine, expire_on_commit=False) as session, session.begin():
            if self.is_sqlite:
                session.connection(execution_options={"pliant_begin": "IMMEDIATE"})
            elif take_turns:
                session.execute(text("SELECT pg_advisory_xact_lock(:key)"), {"key": _WRITE_LOCK})
            yield session

    @contextmanager
    def new(self) -> Iterator[Session]:
        """Create the tables; give a session that fills them. All is stored together, or nothing.

        Raises:
            CallError: There are tables already.
        """
        try:
            with self.write() as session:
                if inspect(session.connection()).get_table_names():
                    raise CallError(
                        "the database is not empty",
                        path=self.engine.url.render_as_string(hide_password=True),
                        fix="Name a new one with --database.",
                    )
                command.upgrade(_alembic(session.connection()), "head")
                yield session
        finally:
            self.engine.dispose()

    def upgrade(self) -> None:
        """Bring the tables to this version.

        Raises:
            CallError: There are none, or they are newer.
        """
        with self.engine.begin() as connection:
            self._refuse_newer(self._revision(connection))
            command.upgrade(_alembic(connection), "head")

    def check(self) -> None:
        """Refuse a database whose tables are not those of this version.

        Raises:
            CallError: It cannot be reached, or has other tables or none.
        """
        try:
            with self.engine.connect() as connection:
                found = self._revision(connection)
        except DBAPIError as error:
            raise CallError(
                "the database cannot be reached",
                path=self.engine.url.render_as_string(hide_password=True),
                found=" ".join(str(error.orig).split())[:200],
                fix="Free some space, and check who may write its folder; or restore a backup."
                if self.is_sqlite
                else "Start it, check user and password, or name another one with --database.",
            ) from error
        self._refuse_newer(found)
        expected = _scripts().get_current_head()
        if found != expected:
            raise CallError(
                "the database has the tables of another version of Pliant",
                path=self.engine.url.render_as_string(hide_password=True),
                found=f"revision {found}",
                required=f"revision {expected}",
                fix="Make a backup, then run: pliant challenge upgrade CHALLENGE",
            )

    def _revision(self, connection: Connection) -> str:
        found = MigrationContext.configure(connection).get_current_revision()
        if found is None:
            raise CallError(
                "this is not the database of a challenge",
                path=self.engine.url.render_as_string(hide_password=True),
                found="no tables of Pliant",
                fix="Name the challenge's own with --database, or restore a backup.",
            )
        return found

    def _refuse_newer(self, found: str) -> None:
        if found not in {each.revision for each in _scripts().walk_revisions()}:
            raise CallError(
                "the database has the tables of a newer version of Pliant",
                path=self.engine.url.render_as_string(hide_password=True),
                found=f"revision {found}",
                fix="Install that version again; or restore a backup of before the upgrade.",
            )


def sqlite_url(path: Path) -> str:
    """Return the URL of a SQLite file."""
    return f"sqlite:///{path.resolve()}"


def is_unreachable(error: BaseException) -> bool:
    """Return whether an error says that the database is down, locked or read-only for now."""
    return isinstance(error, OperationalError) or (
        isinstance(error, DBAPIError)
        and (error.connection_invalidated or _sqlstate(error) == _READ_ONLY)
    )


def is_full(error: BaseException) -> bool:
    """Return whether an error says that the database's disk is full."""
    return _sqlstate(error) == _DISK_FULL or "is full" in str(error)  # PostgreSQL, SQLite


def cause(error: SQLAlchemyError) -> dict[str, str]:
    """Return what a log contains of an error: the statement and its values stay out."""
    return {"error": str(getattr(error, "orig", error))}


def _sqlstate(error: BaseException) -> str | None:
    return getattr(getattr(error, "orig", None), "sqlstate", None)


def now_ms() -> int:
    """Return the time, milliseconds since 1970 (UTC)."""
    return time.time_ns() // 1_000_000


def _engine(url: str) -> Engine:
    try:
        parsed = make_url(url)
        if parsed.drivername not in _DRIVERS:
            raise NoSuchModuleError(f"driver {parsed.drivername}")
        if parsed.drivername == "postgresql":
            parsed = parsed.set(drivername="postgresql+psycopg")
        sqlite = parsed.get_backend_name() == "sqlite"
        arguments: dict[str, Any] = (
            {"timeout": BUSY_S, "check_same_thread": False}
            if sqlite
            else {"connect_timeout": int(BUSY_S), "options": f"-c lock_timeout={BUSY_S:g}s"}
        )
        engine = create_engine(
            parsed,
            connect_args=arguments,
            pool_pre_ping=not sqlite,
            pool_size=8,
            max_overflow=24,
            pool_timeout=BUSY_S,
        )
    except (ArgumentError, NoSuchModuleError, ValueError) as error:
        raise CallError(
            "the database's URL cannot be used",
            found=str(error).partition("\n")[0],
            required="sqlite:///PATH or postgresql://USER@HOST/NAME",
        ) from error
    if sqlite:
        event.listen(engine, "connect", _configure_sqlite)
        event.listen(engine, "begin", _begin_sqlite)
    return engine


def _configure_sqlite(connection: Any, record: Any) -> None:
    del record
    connection.isolation_level = None  # `_begin_sqlite` begins the transactions
    for setting in ("journal_mode=WAL", "foreign_keys=ON", "synchronous=FULL"):
        connection.execute(f"PRAGMA {setting}")


def _begin_sqlite(connection: Any) -> None:
    kind = connection.get_execution_options().get("pliant_begin", "DEFERRED")
    connection.exec_driver_sql(f"BEGIN {kind}")


def _scripts() -> ScriptDirectory:
    return ScriptDirectory.from_config(_alembic())


def _alembic(connection: Any = None) -> Config:
    config = Config()
    config.set_main_option("script_location", "pliant.service:migrations")
    config.attributes["connection"] = connection
    return config
