"""The first tables, and the triggers that make three of them append-only."""

from __future__ import annotations

from typing import Any, Final

import sqlalchemy as sa
from alembic import op

revision = "0001"
down_revision = None

_APPEND_ONLY: Final = ("audit", "ledger", "score")
_NUMBER: Final = sa.BigInteger().with_variant(sa.Integer(), "sqlite")
_JSON: Final = sa.JSON(none_as_null=True)


def upgrade() -> None:
    """Create everything."""
    op.create_table("team", _key(), *_text("name"), *_of(sa.Boolean(), "is_host"),
                    *_int("created_ms"), sa.UniqueConstraint("name"))  # fmt: skip
    op.create_table("token", *_text("id", "secret_sha256"), _reference("team"),
                    *_int("created_ms"), *_int("revoked_ms", null=True),
                    sa.PrimaryKeyConstraint("id"))  # fmt: skip
    op.create_table("session", *_text("cookie_sha256", "csrf"), *_int("expires_ms"),
                    sa.Column("token_id", sa.Text(), sa.ForeignKey("token.id"), nullable=False),
                    sa.PrimaryKeyConstraint("cookie_sha256"))  # fmt: skip
    op.create_table("version", _key(),
                    *_text("phase", "protocol", "protocol_version", "protocol_sha256"),
                    *_text("truth_sha256", "reason"), *_int("truth", "created_ms"),
                    *_of(_JSON, "figures"),
                    sa.UniqueConstraint("phase", "protocol_sha256", "truth_sha256"))  # fmt: skip
    op.create_table("submission", _key(), _reference("team"),
                    *_text("phase", "file_sha256", "file_name", "state"),
                    *_text("method", "failure", null=True), *_int("file_bytes", "created_ms"),
                    *_int("finished_ms", "withdrawn_ms", null=True),
                    *_of(sa.Boolean(), "check_only"),
                    *_of(_JSON, "problems", null=True))  # fmt: skip
    op.create_table("job", _key(), _reference("submission"), *_of(_JSON, "versions"),
                    *_int("priority", "tries", "created_ms"), *_int("lease_until_ms", null=True),
                    *_text("state"), *_text("worker", "lease", "error", null=True))  # fmt: skip
    op.create_table("ledger", _key(), _reference("team"), _reference("submission", null=True),
                    *_text("phase", "kind", "day"), *_int("amount", "created_ms"),
                    sa.UniqueConstraint("submission_id", "kind"))  # fmt: skip
    op.create_table("score", _key(), _reference("submission"), _reference("version"),
                    *_of(_JSON, "figures", "receipt"), *_of(sa.Float(), "main", null=True),
                    *_of(sa.Float(), "coverage"), *_int("scored_ms"),
                    sa.UniqueConstraint("submission_id", "version_id"))  # fmt: skip
    op.create_table("audit", *_of(_NUMBER, "seq"), *_int("time_ms"),
                    *_text("actor", "action", "subject", "detail", "previous", "hash"),
                    sa.PrimaryKeyConstraint("seq"))  # fmt: skip
    for table, *columns in (
        ("token", "team_id"),
        ("session", "token_id"),
        ("submission", "team_id", "created_ms"),
        ("submission", "team_id", "phase", "file_sha256"),
        ("job", "submission_id"),
        ("job", "state", "priority", "id"),
        ("ledger", "team_id", "phase"),
        ("score", "version_id"),
    ):
        op.create_index(op.f(f"ix_{table}_{'_'.join(columns)}"), table, columns)
    for table in _APPEND_ONLY:
        _refuse_changes(table)


def _key() -> sa.Column[Any]:
    return sa.Column("id", _NUMBER, primary_key=True)


def _reference(table: str, *, null: bool = False) -> sa.Column[Any]:
    return sa.Column(f"{table}_id", _NUMBER, sa.ForeignKey(f"{table}.id"), nullable=null)


def _of(kind: Any, *names: str, null: bool = False) -> list[sa.Column[Any]]:
    return [sa.Column(name, kind, nullable=null) for name in names]


def _text(*names: str, null: bool = False) -> list[sa.Column[Any]]:
    return _of(sa.Text(), *names, null=null)


def _int(*names: str, null: bool = False) -> list[sa.Column[Any]]:
    return _of(sa.BigInteger(), *names, null=null)


def _refuse_changes(table: str) -> None:
    """Let the database itself refuse to change or delete a table's rows."""
    if op.get_bind().dialect.name == "sqlite":
        for event in ("UPDATE", "DELETE"):
            op.execute(
                f"CREATE TRIGGER {table}_no_{event.lower()} BEFORE {event} ON {table} "
                f"BEGIN SELECT RAISE(ABORT, '{table} is append-only'); END"
            )
        return
    op.execute(
        f"CREATE FUNCTION {table}_append_only() RETURNS trigger LANGUAGE plpgsql AS "
        f"$$ BEGIN RAISE EXCEPTION '{table} is append-only'; END $$"
    )
    op.execute(
        f"CREATE TRIGGER {table}_append_only BEFORE UPDATE OR DELETE ON {table} "
        f"FOR EACH ROW EXECUTE FUNCTION {table}_append_only()"
    )
