"""Alembic's entry: runs the migrations on the connection that `Database.upgrade` gives."""

from __future__ import annotations

from alembic import context

from pliant.service.models import Base

context.configure(
    connection=context.config.attributes["connection"],
    target_metadata=Base.metadata,
    transactional_ddl=True,
)
with context.begin_transaction():
    context.run_migrations()
