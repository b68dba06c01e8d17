"""The first tables, and the triggers that make three of them append-only."""

from __future__ import annotations

from alembic import op

from pliant.service.models import APPEND_ONLY, Base

revision = "0001"
down_revision = None


def upgrade() -> None:
    """Create everything.

    Before the first release the tables are those of the models. The migration that changes a model
    replaces `create_all` by the tables as they were.
    """
    Base.metadata.create_all(op.get_bind())
    for table in APPEND_ONLY:
        _refuse_changes(table)


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
