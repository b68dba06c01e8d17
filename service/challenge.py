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

from dataclasses import dataclass
from pathlib import Path
from typing import Final

from pliant.service.database import Database, sqlite_url
from pliant.service.receipts import PRIVATE_KEY, PUBLIC_KEY
from pliant.service.settings import ChallengeSettings, read_challenge_settings
from pliant.service.store import FolderStore
from pliant.spec.dataset import Dataset
from pliant.spec.errors import CallError

CHALLENGE_YAML: Final = "challenge.yaml"
SQLITE: Final = "challenge.sqlite"


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
    def open(cls, root: Path, database_url: str | None = None) -> Challenge:
        """Open a challenge.

        Args:
            root: Its folder.
            database_url: The database; None takes the SQLite file in the folder.

        Raises:
            CallError: It is not a challenge, or its database is missing or of another version.
        """
        root = root.resolve()
        if not is_challenge(root):
            raise CallError(
                "this is not a challenge",
                path=root,
                required=f"a folder with {CHALLENGE_YAML}",
                fix="Make one with: pliant challenge create",
            )
        if database_url is None and not (root / SQLITE).is_file():
            raise CallError(
                "the challenge's database is missing",
                path=root / SQLITE,
                fix="Name the PostgreSQL database with --database, or restore a backup.",
            )
        challenge = cls.of(root, database_url)
        challenge.database.check()
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
    def title(self) -> str:
        """Its name on pages."""
        return self.settings.title or str(Dataset.open(self.public).info["title"])

    def private(self, number: int) -> Path:
        """Return the folder of a truth."""
        return self.root / "private" / str(number)

    def protocol_path(self, sha256: str) -> Path:
        """Return the file of a protocol that scores are computed by."""
        return self.root / "protocols" / f"{sha256}.json"


def is_challenge(root: Path) -> bool:
    """Return whether a folder is a challenge."""
    return (root / CHALLENGE_YAML).is_file()


def database_of(root: Path, database_url: str | None) -> Database:
    """Return the database of a challenge: the one that is named, or its SQLite file."""
    return Database(database_url or sqlite_url(root / SQLITE))
