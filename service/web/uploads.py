"""Receives a submission's file: from a request's body, or from a form."""

from __future__ import annotations

import hashlib
import os
import time
from collections.abc import AsyncIterator
from pathlib import Path
from typing import Final

from anyio import to_thread

from pliant.service.settings import Phase
from pliant.service.submissions import NotAcceptedError, Upload, accept, check_allowed
from pliant.service.teams import Identity
from pliant.service.web.security import too_large
from pliant.service.web.state import Site
from pliant.service.web.views import SubmissionView, submission_view
from pliant.spec.text import unsafe_character

_ABANDONED_S: Final = 24 * 3600


async def receive_file(
    site: Site,
    who: Identity,
    phase: Phase,
    chunks: AsyncIterator[bytes],
    *,
    name: str,
    check_only: bool,
) -> tuple[SubmissionView, bool]:
    """Store a file and accept it as a submission.

    Returns:
        The submission, and whether it is new.

    Raises:
        NotAcceptedError: The rules do not allow it, or it is too large or empty.
    """
    settings = site.challenge.settings
    await to_thread.run_sync(_allowed, site, who, phase, check_only)
    site.challenge.incoming.mkdir(exist_ok=True)
    partial = site.challenge.incoming / f"{os.getpid()}-{os.urandom(8).hex()}.parquet"
    digest, count = hashlib.sha256(), 0
    try:
        with open(partial, "xb") as stream:
            async for chunk in chunks:
                count += len(chunk)
                if count > settings.max_file_bytes:
                    raise too_large(settings.max_file_mb)
                digest.update(chunk)
                stream.write(chunk)
        if count == 0:
            raise NotAcceptedError("FILE_EMPTY", 400, "the request contains no file")
        upload = Upload(digest.hexdigest(), _plain_name(name), count, check_only)
        return await to_thread.run_sync(_accept, site, who, phase, partial, upload)
    finally:
        partial.unlink(missing_ok=True)


def remove_abandoned(incoming: Path) -> None:
    """Remove files whose transfer ended with a process that was killed."""
    for path in incoming.glob("*.parquet"):
        if time.time() - path.stat().st_mtime > _ABANDONED_S:
            path.unlink(missing_ok=True)


def _allowed(site: Site, who: Identity, phase: Phase, check_only: bool) -> None:
    """Refuse before the transfer what would be refused after it."""
    with site.database.read() as session:
        check_allowed(session, site.challenge.settings, phase, who, check_only=check_only)


def _accept(
    site: Site, who: Identity, phase: Phase, file: Path, upload: Upload
) -> tuple[SubmissionView, bool]:
    site.challenge.store.put(file, upload.sha256)
    with site.database.write() as session:
        submission, new = accept(session, site.challenge, phase, who, upload)
        return submission_view(session, submission, who), new


def _plain_name(name: str) -> str:
    """Return a file's name without folders and without characters that cannot be shown."""
    last = name.replace("\\", "/").rpartition("/")[2][:120]
    return "".join(c for c in last if unsafe_character(c) is None).strip() or "submission.parquet"
