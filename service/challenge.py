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
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import yaml

from pliant.service.audit import HOST, record
from pliant.service.database import Database, sqlite_url
from pliant.service.receipts import PRIVATE_KEY, PUBLIC_KEY, write_keys
from pliant.service.settings import ChallengeSettings, read_challenge_settings
from pliant.service.store import Store, open_store
from pliant.service.teams import invite
from pliant.service.versions import add_missing_versions
from pliant.spec.dataset import Dataset
from pliant.spec.errors import CallError
from pliant.spec.io.staging import staged

CHALLENGE_YAML: Final = "challenge.yaml"
SQLITE: Final = "challenge.sqlite"
HOST_NAME: Final = "Host"
_UNUSED: Final = ("codabench",)
"""Folders of the private half that the service has no use for."""


@dataclass(frozen=True)
class Challenge:
    """An open challenge.

    Attributes:
        root: Its folder.
        settings: Its rules.
        database: Its database.
        store: Its submissions' files.
    """

    root: Path
    settings: ChallengeSettings
    database: Database
    store: Store

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
        challenge = cls._of(root, database_url)
        challenge.database.check()
        return challenge

    @classmethod
    def _of(cls, root: Path, database_url: str | None) -> Challenge:
        settings = read_challenge_settings(root / CHALLENGE_YAML)
        store = open_store(settings.store, root / "submissions", root / "incoming")
        return cls(root, settings, database_of(root, database_url), store)

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


def create_challenge(
    root: Path,
    data: Path,
    private: Path,
    splits: Sequence[str],
    config: Path | None = None,
    database_url: str | None = None,
) -> str:
    """Make a challenge of a published dataset.

    Args:
        root: The challenge's folder; new or empty.
        data: The public half.
        private: The private half.
        splits: Splits that become phases, where `config` names none.
        config: `challenge.yaml`, or None.
        database_url: The database; None makes a SQLite file in the folder.

    Returns:
        The host's token, which is stored nowhere.

    Raises:
        CallError: The folder is not empty, a setting is refused, or the database is in use.
        SpecError: The two halves do not belong together, or a split has no queries or truth.
    """
    if root.exists() and (not root.is_dir() or any(root.iterdir())):
        raise CallError("the folder exists already", path=root, fix="Name a new folder.")
    settings = read_challenge_settings(config, tuple(splits))
    with staged(root) as place:
        os.chmod(place, 0o750)
        shutil.copytree(data, place / "public")
        write_settings(place, settings)
        copy_private(private, place / "private" / "1")
        for folder in ("protocols", "submissions", "incoming"):
            (place / folder).mkdir(mode=0o750)
        write_keys(place / "keys")
        challenge = Challenge._of(place, database_url)
        challenge.database.upgrade()
        try:
            with challenge.database.write() as session:
                record(session, HOST, "created", "challenge", title=challenge.title)
                token = invite(session, HOST_NAME, actor=HOST, is_host=True)[1]
                add_missing_versions(session, challenge)
        finally:
            challenge.database.engine.dispose()
    return token


def write_settings(root: Path, settings: ChallengeSettings) -> None:
    """Write `challenge.yaml`, complete with its defaults."""
    text = yaml.safe_dump(settings.model_dump(mode="json"), sort_keys=False, allow_unicode=True)
    (root / CHALLENGE_YAML).write_text(text, encoding="utf-8")


def copy_private(private: Path, place: Path) -> None:
    """Copy a private half so that its owner alone can read it."""
    place.parent.mkdir(mode=0o700, exist_ok=True)
    shutil.copytree(private, place, ignore=shutil.ignore_patterns(*_UNUSED))
    for folder, _, files in os.walk(place):
        os.chmod(folder, 0o700)
        for name in files:
            os.chmod(Path(folder) / name, 0o600)
