"""Backups of a running service, the archive of a challenge, and restoring both."""

from __future__ import annotations

import os
import shutil
import tarfile
from collections.abc import Callable
from contextlib import ExitStack
from datetime import UTC, datetime
from importlib.metadata import version
from pathlib import Path
from typing import Any, Final

from sqlalchemy import select

from pliant.service.audit import HOST, record, verify_log
from pliant.service.challenge import CHALLENGE_YAML, Challenge, FolderStore, new_challenge
from pliant.service.models import Submission
from pliant.service.receipts import (
    EARLIER,
    PRIVATE_KEY,
    PUBLIC_KEY,
    decrypted_key,
    encrypted_key,
    key_id,
    read_public_key,
    write_keys,
    write_secret,
)
from pliant.service.site import write_challenge_site
from pliant.service.snapshot import read_tables, write_tables
from pliant.spec.dataset import Dataset
from pliant.spec.errors import CallError, SpecError
from pliant.spec.io.jsonfiles import write_json
from pliant.spec.io.reading import sha256_file
from pliant.spec.io.staging import discard, staged
from pliant.spec.io.writing import abandoned, replacing
from pliant.spec.storage.manifest import read_checksums, write_checksums

_COPIED: Final = ("public", "private", "protocols", "keys")
_TABLES: Final = "database"
_SUMS: Final = "SHA256SUMS"
_ENCRYPTED: Final = "receipts.private.encrypted.pem"
Copy = Callable[[str, str], Any]


def write_backup(challenge: Challenge, out: Path) -> None:
    """Copy everything while the service runs; an earlier backup is brought up to date.

    The new backup takes the place of the earlier one when it is whole; files that did not change
    are not copied again. The database is read at one moment. Submission files are stored before
    the rows that name them and never change, so every row of the backup has its file.

    Args:
        challenge: The challenge.
        out: The backup's folder, which then contains the answers and the keys.

    Raises:
        CallError: The folder contains something else, or the backup of another challenge.
    """
    earlier = out.exists() and any(out.iterdir())
    if earlier:
        if not all((out / name).is_file() for name in (CHALLENGE_YAML, _SUMS)):
            raise CallError("the folder is not a backup", path=out, fix="Name a new folder.")
        keys = (out / "keys" / PUBLIC_KEY, challenge.public_key)
        if len({key_id(read_public_key(key)) for key in keys}) > 1:
            raise CallError(
                "the folder is the backup of another challenge", path=out, fix="Name a new folder."
            )
    with staged(out) as place:
        os.chmod(place, 0o700)
        if earlier:
            kept = shutil.ignore_patterns(_TABLES)  # written again below
            shutil.copytree(out, place, ignore=kept, copy_function=_link, dirs_exist_ok=True)
        _write(challenge, place, shutil.copy2)


def write_archive(challenge: Challenge, out: Path, passphrase: bytes | None) -> None:
    """Write one tar file with everything: data, answers, submissions, tables, a static site.

    Args:
        challenge: The challenge.
        out: The file.
        passphrase: Encrypts the key that signs receipts; None leaves the key out.

    Raises:
        CallError: The file exists.
    """
    scratch = out.resolve().with_name(f".{out.name}.{os.getpid()}.folder")
    for each in abandoned(scratch.parent, f".{out.name}.", ".folder"):
        discard(each)
    if out.exists():
        raise CallError("the file exists already", path=out)
    with ExitStack() as stack:
        stack.callback(discard, scratch)
        folder = scratch / "challenge"
        scratch.mkdir(0o700, parents=True)
        folder.mkdir()
        _write(challenge, folder, _link)
        secret = folder / "keys" / PRIVATE_KEY
        if passphrase is not None:
            write_secret(folder / "keys" / _ENCRYPTED, encrypted_key(secret, passphrase))
        secret.unlink()
        write_challenge_site(challenge, folder / "site")
        write_json(folder / ".zenodo.json", _metadata(challenge))
        write_checksums(folder)
        with replacing(out, durable=True) as partial:
            os.close(os.open(partial, os.O_WRONLY | os.O_CREAT, 0o600))
            with tarfile.open(partial, "w") as tar:
                for path in sorted(folder.rglob("*")):
                    tar.add(path, path.relative_to(folder).as_posix(), recursive=False)


def restore_challenge(
    source: Path, out: Path, passphrase: bytes | None, database_url: str | None
) -> bool:
    """Make a challenge of a backup or an archive; return whether its key for receipts is new.

    Args:
        source: The backup's folder or the archive's file.
        out: The challenge's folder; new.
        passphrase: Decrypts the archive's key. Without the key a new one is made, and the old
            public key stays in `keys/`, so that earlier receipts can be verified.
        database_url: An empty database; None makes a SQLite file in the folder.

    Raises:
        CallError: `source` is something else, `out` exists, the database is in use, or the
            passphrase is wrong.
        SpecError: A file is missing or was changed, or the audit log was.
    """
    with new_challenge(out, database_url) as (place, session):
        if source.is_file():
            _extract(source, place)
            _check_kind(place, source)
        else:
            _check_kind(source, source)
            shutil.copytree(source, place, dirs_exist_ok=True)
        for name, sha256 in read_checksums(place / _SUMS).items():
            if not (place / name).is_file() or sha256_file(place / name) != sha256:
                raise SpecError("a file is missing or was changed", path=name, required=sha256)
        for name in (_SUMS, ".zenodo.json"):
            (place / name).unlink(missing_ok=True)
        if (place / "site").is_dir():  # an archive has one, a backup has none
            shutil.rmtree(place / "site")
        (place / "incoming").mkdir(exist_ok=True)
        new_key = _restore_keys(place / "keys", passphrase)
        read_tables(session, place / _TABLES)
        verify_log(session)
        key = key_id(read_public_key(place / "keys" / PUBLIC_KEY))
        record(session, HOST, "restored", "challenge", source=source.name, key_id=key)
        shutil.rmtree(place / _TABLES)
    return new_key


def _write(challenge: Challenge, out: Path, copy: Copy) -> None:
    """Write everything of a challenge but its checksums' file, then that."""
    with staged(out / _TABLES) as tables, challenge.database.read() as session:
        write_tables(session, tables)
        sha256s = set(session.scalars(select(Submission.file_sha256)))
    for name in _COPIED:
        _update(challenge.root / name, out / name, copy)
    for name in (CHALLENGE_YAML, _SUMS):  # an earlier backup may have the same file
        (out / name).unlink(missing_ok=True)
    shutil.copy2(challenge.root / CHALLENGE_YAML, out / CHALLENGE_YAML)
    store = FolderStore(out / "submissions")
    for sha256 in sorted(sha256s):
        store.put(challenge.store.path(sha256), sha256)
    write_checksums(out)


def _update(source: Path, target: Path, copy: Copy) -> None:
    """Copy the files of a folder that are new or were changed."""
    target.mkdir(exist_ok=True, mode=0o700)
    shutil.copystat(source, target)
    for path in sorted(source.rglob("*")):
        place = target / path.relative_to(source)
        if path.is_dir():
            place.mkdir(exist_ok=True)
            shutil.copystat(path, place)
            continue
        found = place.stat() if place.exists() else None
        now = path.stat()
        if found is None or (found.st_size, found.st_mtime_ns) != (now.st_size, now.st_mtime_ns):
            place.unlink(missing_ok=True)
            copy(str(path), str(place))


def _link(source: str, target: str) -> None:
    """Give a file a second name instead of copying it, where the file system can."""
    try:
        os.link(source, target)
    except OSError:
        shutil.copy2(source, target)


def _extract(source: Path, place: Path) -> None:
    try:
        with tarfile.open(source) as tar:
            tar.extractall(place, filter="tar")
    except (tarfile.TarError, OSError) as error:
        found = str(error).partition(":\n")[0]  # then a line for each kind of compression
        raise SpecError("the archive cannot be read", path=source, found=found) from error


def _check_kind(folder: Path, source: Path) -> None:
    """Refuse what is neither a backup nor an unpacked archive."""
    for name in (CHALLENGE_YAML, _SUMS, _TABLES):
        if not (folder / name).exists():
            raise CallError(
                "this is not a backup or an archive of a challenge",
                path=source,
                found=f"no {name}" if source.exists() else "nothing there",
                required="what `pliant challenge backup` or `archive` wrote",
            )


def _restore_keys(folder: Path, passphrase: bytes | None) -> bool:
    """Decrypt the private key, or make a new one; return whether it is new."""
    private, encrypted = folder / PRIVATE_KEY, folder / _ENCRYPTED
    if encrypted.is_file() and passphrase is not None:
        write_secret(private, decrypted_key(encrypted.read_bytes(), passphrase))
    encrypted.unlink(missing_ok=True)
    if private.is_file():
        return False
    old = folder / PUBLIC_KEY
    old.rename(folder / f"{EARLIER}{key_id(read_public_key(old))}.public.pem")
    write_keys(folder)
    return True


def _metadata(challenge: Challenge) -> dict[str, Any]:
    """Return what Zenodo needs to give the archive a DOI."""
    info = Dataset.open(challenge.public).info
    authors = challenge.settings.authors or (f"The organisers of {challenge.title}",)
    return {
        "title": f"{challenge.title}: archive of the challenge",
        "upload_type": "dataset",
        "description": (
            f"Everything of the challenge {challenge.title}: the data, the held-out answers, all "
            "submissions, their scores with signed receipts, the audit log, and a static site. "
            "pliant challenge restore makes the same service of it."
        ),
        "creators": [{"name": name} for name in authors],
        "publication_date": datetime.now(UTC).date().isoformat(),
        "version": str(info["version"]),
        "keywords": ["dense correspondence", "deformable objects", "benchmark"],
        "notes": f"Written by Pliant {version('pliant')}.",
    }
