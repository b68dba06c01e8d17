"""The database as Parquet files, one per table, and back."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any, Final

import pyarrow as pa
import pyarrow.parquet as pq
from sqlalchemy import JSON, BigInteger, Boolean, Column, Float, insert, select, text
from sqlalchemy.orm import Session

from pliant.service.models import Base, WebSession
from pliant.spec.errors import SpecError

_TABLES: Final = [t for t in Base.metadata.sorted_tables if t.name != WebSession.__tablename__]
_ROWS: Final = 1000


def write_tables(session: Session, folder: Path) -> None:
    """Write every table but the browsers' sessions, as they are at one moment.

    Args:
        session: A reading session.
        folder: An empty folder.
    """
    for table in _TABLES:
        schema = pa.schema([(column.name, _arrow_type(column)) for column in table.columns])
        query = select(table).order_by(*table.primary_key.columns)
        with pq.ParquetWriter(folder / f"{table.name}.parquet", schema) as writer:
            for rows in session.execute(query).mappings().partitions(_ROWS):
                plain = [{key: _stored(value) for key, value in row.items()} for row in rows]
                writer.write_table(pa.Table.from_pylist(plain, schema=schema))


def read_tables(session: Session, folder: Path) -> None:
    """Fill empty tables with what `write_tables` wrote; jobs that were leased wait again.

    Their tries do not count: the backup ended them, not the file.

    Args:
        session: A writing session of a new database.
        folder: The folder.

    Raises:
        SpecError: A table's file is missing.
    """
    for table in _TABLES:
        path = folder / f"{table.name}.parquet"
        if not path.is_file():
            raise SpecError("a table is missing", path=path)
        documents = {column.name for column in table.columns if isinstance(column.type, JSON)}
        for batch in pq.ParquetFile(path).iter_batches(_ROWS):
            rows = [
                {key: _loaded(value) if key in documents else value for key, value in row.items()}
                for row in batch.to_pylist()
            ]
            if rows:
                session.execute(insert(table), rows)
        if session.get_bind().dialect.name == "postgresql" and "id" in table.columns:
            _continue_numbers(session, table.name)
    session.execute(
        text(
            "UPDATE job SET state = 'queued', lease = NULL, tries = tries - 1 "
            "WHERE state = 'leased'"
        )
    )
    session.execute(text("UPDATE submission SET state = 'queued' WHERE state = 'running'"))


def _continue_numbers(session: Session, table: str) -> None:
    """Let PostgreSQL number new rows after the ones that were filled in."""
    sequence = session.scalar(text("SELECT pg_get_serial_sequence(:name, 'id')"), {"name": table})
    if sequence is not None:
        query = f"SELECT setval(:name, (SELECT coalesce(max(id), 0) + 1 FROM {table}), false)"
        session.execute(text(query), {"name": sequence})


def _arrow_type(column: Column[Any]) -> pa.DataType:
    if isinstance(column.type, Boolean):
        return pa.bool_()
    if isinstance(column.type, BigInteger):
        return pa.int64()
    return pa.float64() if isinstance(column.type, Float) else pa.string()


def _stored(value: Any) -> Any:
    return json.dumps(value) if isinstance(value, dict | list) else value


def _loaded(value: str | None) -> Any:
    return None if value is None else json.loads(value)
