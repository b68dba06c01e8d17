"""The tables of the database: what is in a row, and what never changes once it is written.

Times are milliseconds since 1970 (UTC). Rows of `AuditEntry`, `LedgerEntry` and `Score` are only
added: the database itself refuses to change or delete them (`migrations/`).
"""

from __future__ import annotations

from enum import StrEnum
from typing import Any, Final

from sqlalchemy import (
    JSON,
    BigInteger,
    Boolean,
    Float,
    ForeignKey,
    Index,
    Integer,
    MetaData,
    Text,
    UniqueConstraint,
)
from sqlalchemy.orm import DeclarativeBase, Mapped, mapped_column

APPEND_ONLY: Final = ("audit", "ledger", "score")
"""Tables whose rows are never changed."""

# SQLite numbers rows automatically only in a column of type INTEGER.
_NUMBER: Final = BigInteger().with_variant(Integer(), "sqlite")


class State(StrEnum):
    """State of a submission."""

    QUEUED = "queued"
    RUNNING = "running"
    SCORED = "scored"
    CHECKED = "checked"
    REFUSED = "refused"
    FAILED = "failed"


FINAL: Final = (State.SCORED, State.CHECKED, State.REFUSED, State.FAILED)
"""States that a submission does not leave."""


class Base(DeclarativeBase):
    """The base of all tables; constraints have names, so that migrations can change them."""

    metadata = MetaData(
        naming_convention={
            "ix": "ix_%(table_name)s_%(column_0_N_name)s",
            "uq": "uq_%(table_name)s_%(column_0_N_name)s",
            "fk": "fk_%(table_name)s_%(column_0_name)s_%(referred_table_name)s",
            "pk": "pk_%(table_name)s",
        }
    )
    type_annotation_map = {  # noqa: RUF012 - SQLAlchemy's own name
        str: Text(),
        int: BigInteger(),
        float: Float(),
        bool: Boolean(),
        dict[str, Any]: JSON(none_as_null=True),
        list[Any]: JSON(none_as_null=True),
    }


class Team(Base):
    """A participant, or the host, whose submissions are controls and who sees the admin page."""

    __tablename__ = "team"

    id: Mapped[int] = mapped_column(_NUMBER, primary_key=True)
    name: Mapped[str] = mapped_column(unique=True)
    is_host: Mapped[bool]
    created_ms: Mapped[int]


class Token(Base):
    """A token of a team: `id` is its public part, of the secret part only the sha256 is stored."""

    __tablename__ = "token"

    id: Mapped[str] = mapped_column(primary_key=True)
    team_id: Mapped[int] = mapped_column(ForeignKey("team.id"), index=True)
    secret_sha256: Mapped[str]
    created_ms: Mapped[int]
    revoked_ms: Mapped[int | None]


class WebSession(Base):
    """A signed-in browser; of its cookie only the sha256 is stored."""

    __tablename__ = "session"

    cookie_sha256: Mapped[str] = mapped_column(primary_key=True)
    token_id: Mapped[str] = mapped_column(ForeignKey("token.id"), index=True)
    csrf: Mapped[str]
    expires_ms: Mapped[int]


class Version(Base):
    """One way to score a phase: a protocol and a truth, each by its sha256.

    Attributes:
        truth: Number of the folder `private/N`.
        figures: The figures shown, in order: group, metric, label, unit, better, about.
    """

    __tablename__ = "version"

    id: Mapped[int] = mapped_column(_NUMBER, primary_key=True)
    phase: Mapped[str]
    protocol: Mapped[str]
    protocol_version: Mapped[str]
    protocol_sha256: Mapped[str]
    truth: Mapped[int]
    truth_sha256: Mapped[str]
    figures: Mapped[list[Any]]
    reason: Mapped[str]
    created_ms: Mapped[int]

    __table_args__ = (UniqueConstraint("phase", "protocol_sha256", "truth_sha256"),)


class Submission(Base):
    """A file that a team sent, and what became of it.

    Attributes:
        check_only: The file is only checked: it costs no attempt and gets no score.
        problems: The issues of a refused file, `{"issues": [...], "counts": {...}}`.
        failure: Why scoring failed, in words for the participant.
        withdrawn_ms: When the host took it off the leaderboard.
    """

    __tablename__ = "submission"

    id: Mapped[int] = mapped_column(_NUMBER, primary_key=True)
    team_id: Mapped[int] = mapped_column(ForeignKey("team.id"))
    phase: Mapped[str]
    file_sha256: Mapped[str]
    file_name: Mapped[str]
    file_bytes: Mapped[int]
    check_only: Mapped[bool]
    state: Mapped[str]
    method: Mapped[str | None]
    problems: Mapped[dict[str, Any] | None]
    failure: Mapped[str | None]
    created_ms: Mapped[int]
    finished_ms: Mapped[int | None]
    withdrawn_ms: Mapped[int | None]

    __table_args__ = (
        Index(None, "team_id", "phase", "file_sha256"),
        Index(None, "team_id", "created_ms"),
    )


class LedgerEntry(Base):
    """A change of a team's attempts in a phase: submit -1, refund +1, credit +N.

    Attributes:
        day: UTC day that it counts for, `YYYY-MM-DD`; a refund has the day of its charge.
    """

    __tablename__ = "ledger"

    id: Mapped[int] = mapped_column(_NUMBER, primary_key=True)
    team_id: Mapped[int] = mapped_column(ForeignKey("team.id"))
    phase: Mapped[str]
    submission_id: Mapped[int | None] = mapped_column(ForeignKey("submission.id"))
    kind: Mapped[str]
    amount: Mapped[int]
    day: Mapped[str]
    created_ms: Mapped[int]

    __table_args__ = (UniqueConstraint("submission_id", "kind"), Index(None, "team_id", "phase"))


class Job(Base):
    """Work for a worker: check a submission, or score it by some versions.

    Attributes:
        versions: Ids of the versions to score by; empty for a check.
        priority: Smaller numbers go first: 0 for submissions, 1 for rescoring.
        state: `queued`, `leased`, `done` or `failed`.
        tries: How often it was leased.
        lease: Random text of the present lease; a worker with another one cannot finish it.
        lease_until_ms: When another worker may take it over.
        error: Why the last try failed, for the host.
    """

    __tablename__ = "job"

    id: Mapped[int] = mapped_column(_NUMBER, primary_key=True)
    submission_id: Mapped[int] = mapped_column(ForeignKey("submission.id"), index=True)
    versions: Mapped[list[Any]]
    priority: Mapped[int]
    state: Mapped[str] = mapped_column(default="queued")
    tries: Mapped[int] = mapped_column(default=0)
    worker: Mapped[str | None]
    lease: Mapped[str | None]
    lease_until_ms: Mapped[int | None]
    error: Mapped[str | None]
    created_ms: Mapped[int]

    __table_args__ = (Index(None, "state", "priority", "id"),)


class Score(Base):
    """The public figures of a submission by one version, with the signed receipt.

    Attributes:
        figures: Group (`overall` or a tier) -> metric -> value, four digits.
        main: The first headline figure over the split, which the leaderboard sorts by.
    """

    __tablename__ = "score"

    id: Mapped[int] = mapped_column(_NUMBER, primary_key=True)
    submission_id: Mapped[int] = mapped_column(ForeignKey("submission.id"))
    version_id: Mapped[int] = mapped_column(ForeignKey("version.id"), index=True)
    figures: Mapped[dict[str, Any]]
    main: Mapped[float | None]
    coverage: Mapped[float]
    receipt: Mapped[dict[str, Any]]
    scored_ms: Mapped[int]

    __table_args__ = (UniqueConstraint("submission_id", "version_id"),)


class AuditEntry(Base):
    """One event of the log; `hash` covers it and the hash of the event before."""

    __tablename__ = "audit"

    seq: Mapped[int] = mapped_column(_NUMBER, primary_key=True, autoincrement=False)
    time_ms: Mapped[int]
    actor: Mapped[str]
    action: Mapped[str]
    subject: Mapped[str]
    detail: Mapped[str]
    previous: Mapped[str]
    hash: Mapped[str]
