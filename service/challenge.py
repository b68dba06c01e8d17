"""A challenge: one folder with its rules, data, keys, submissions and database.

CHALLENGE/
  challenge.yaml          the rules
  public/                 the public half, which participants download
  private/N/              the answers, N = 1, 2 …; read by workers alone
  protocols/SHA256.json   the protocols, as they were when scores were computed
  submissions/            files under their sha256
  keys/                   the key that signs receipts, and its public half
  challenge.sqlite        the database, unless another one is named
"""

from __future__ import annotations

import os
import shutil
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from sqlalchemy import select
from sqlalchemy.orm import Session

from pliant.service.database import Database, sqlite_url
from pliant.service.models import Submission
from pliant.service.receipts import EARLIER, PRIVATE_KEY, PUBLIC_KEY
from pliant.service.settings import ChallengeSettings, read_challenge_settings
from pliant.spec.dataset import Dataset
from pliant.spec.errors import CallError
from pliant.spec.io.staging import staged
from pliant.spec.io.writing import synced

CHALLENGE_YAML: Final = "challenge.yaml"
SQLITE: Final = "challenge.sqlite"


class FolderStore:
    """Submission files under their sha256, in a folder that several machines may share.

    Each is written once and never changed.

    Args:
        root: The folder.
    """

    def __init__(self, root: Path) -> None:
        self._root = root

    def put(self, file: Path, sha256: str) -> None:
        """Store a copy of a file durably; one that is there already stays."""
        if not self.path(sha256).exists():
            with self.copied(file, sha256) as keep:
                keep()

    @contextmanager
    def copied(self, file: Path, sha256: str) -> Iterator[Callable[[], None]]:
        """Copy a file, and yield what puts the copy at its place; without that it is removed."""
        place = self.path(sha256)
        place.parent.mkdir(parents=True, exist_ok=True)
        partial = place.with_name(f".{place.name}.{os.getpid()}-{os.urandom(4).hex()}")

        def keep() -> None:
            partial.replace(place)
            synced(place.parent)

        try:
            shutil.copyfile(file, partial)
            synced(partial)
            yield keep
        finally:
            partial.unlink(missing_ok=True)

    def path(self, sha256: str) -> Path:
        """Return where a file is, or would be."""
        return self._root / sha256[:2] / f"{sha256}.parquet"


@dataclass(frozen=True)
class Challenge:
    """An open challenge.

    Attributes:
        root: Its folder.
        settings: Its rules.
        database: Its database.
    """

    root: Path
    settings: ChallengeSettings
    database: Database

    @classmethod
    def open(
        cls, root: Path, database_url: str | None = None, *, upgrade: bool = False
    ) -> Challenge:
        """Open a challenge.

        Args:
            root: Its folder.
            database_url: The database; None takes the SQLite file in the folder.
            upgrade: Bring the database's tables to this version.

        Raises:
            CallError: It is not a challenge, its database is missing or of another version, another
                one is named, or `challenge.yaml` lacks a phase that has submissions.
        """
        root = root.resolve()
        if not is_challenge(root):
            raise CallError(
                "this is not a challenge",
                path=root,
                required=f"a folder with {CHALLENGE_YAML}",
                fix="Make one with: pliant challenge create",
            )
        own = root / SQLITE
        if database_url not in (None, sqlite_url(own)) and own.is_file():
            raise CallError(
                "the challenge has its own database, and another one is named",
                path=own,
                fix="Leave --database out, and unset PLIANT_DATABASE.",
            )
        if database_url is None and not own.is_file():
            raise CallError(
                "the challenge's database is missing",
                path=own,
                fix="Name the PostgreSQL database with --database, or restore a backup.",
            )
        challenge = cls.of(root, database_url)
        if upgrade:
            challenge.database.upgrade()
        challenge.database.check()
        with challenge.database.read() as session:
            used = set(session.scalars(select(Submission.phase).distinct()))
        if lost := used - {phase.name for phase in challenge.settings.phases}:
            raise CallError(
                f"a phase that has submissions is missing: {', '.join(sorted(lost))}",
                path=root / CHALLENGE_YAML,
                where="phases",
                fix="Restore its name; to end a phase, set `closes`.",
            )
        return challenge

    @classmethod
    def of(cls, root: Path, database_url: str | None) -> Challenge:
        """Return the challenge of a folder, whatever the state of its database."""
        settings = read_challenge_settings(root / CHALLENGE_YAML)
        return cls(root, settings, database_of(root, database_url))

    @property
    def store(self) -> FolderStore:
        """Its submissions' files."""
        return FolderStore(self.root / "submissions")

    @property
    def public(self) -> Path:
        """The public half."""
        return self.root / "public"

    @property
    def incoming(self) -> Path:
        """Folder of files that are being uploaded."""
        return self.root / "incoming"

    @property
    def private_key(self) -> Path:
        """The key that signs receipts."""
        return self.root / "keys" / PRIVATE_KEY

    @property
    def public_key(self) -> Path:
        """The key that verifies receipts."""
        return self.root / "keys" / PUBLIC_KEY

    @property
    def earlier_keys(self) -> list[Path]:
        """The keys that verify receipts of before a restore without the private key."""
        return sorted(self.public_key.parent.glob(f"{EARLIER}*.pem"))

    @property
    def title(self) -> str:
        """Its name on pages."""
        return self.settings.title or str(Dataset.open(self.public).info["title"])

    def private(self, number: int) -> Path:
        """Return the folder of a truth."""
        return self.root / "private" / str(number)

    def protocol_path(self, sha256: str) -> Path:
        """Return the file of a protocol that scores are computed by."""
        return self.root / "protocols" / f"{sha256}.json"


@contextmanager
def new_challenge(root: Path, database_url: str | None) -> Iterator[tuple[Path, Session]]:
    """Make a challenge: its folder and its database both appear at the end, or neither.

    Args:
        root: The challenge's folder; new or empty.
        database_url: An empty database; None makes a SQLite file in the folder.

    Yields:
        The folder and a session of the new tables, to fill both.

    Raises:
        CallError: The folder or the database is in use, or cannot be written.
    """
    with ExitStack() as stack:
        # A server's tables are stored after the folder has its name, a file's before.
        server = stack.enter_context(Database(database_url).new()) if database_url else None
        place = stack.enter_context(staged(root, new=True))
        os.chmod(place, 0o750)
        yield place, server or stack.enter_context(database_of(place, None).new())


def is_challenge(root: Path) -> bool:
    """Return whether a folder is a challenge."""
    return (root / CHALLENGE_YAML).is_file()


def database_of(root: Path, database_url: str | None) -> Database:
    """Return the database of a challenge: the one that is named, or its SQLite file."""
    return Database(database_url or sqlite_url(root / SQLITE))
