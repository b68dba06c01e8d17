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
from pliant.service.submissions import (
    NotAcceptedError,
    Upload,
    accept,
    check_allowed,
    has_file_of_size,
    sent_before,
)
from pliant.service.teams import Identity
from pliant.service.web.security import too_large
from pliant.service.web.state import Site
from pliant.service.web.views import SubmissionView, submission_view
from pliant.spec.text import unsafe_character

_ABANDONED_S: Final = 24 * 3600
_LONGEST_NAME: Final = 120


async def receive_file(
    site: Site,
    who: Identity,
    phase: Phase,
    chunks: AsyncIterator[bytes],
    *,
    size: int | None,
    name: str,
    check_only: bool,
) -> tuple[SubmissionView, bool]:
    """Store a file and accept it as a submission.

    Args:
        site: What all requests share.
        who: The team.
        phase: The phase.
        chunks: The file's content.
        size: The file's size in bytes as the request declares it, None where it does not.
        name: The file's name on the participant's machine.
        check_only: Whether it is only checked.

    Returns:
        The submission, and whether it is new.

    Raises:
        NotAcceptedError: The rules do not allow it, or it is too large or empty.
    """
    settings = site.challenge.settings
    refusal = await to_thread.run_sync(_refusal, site, who, phase, size, check_only)
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
            raise NotAcceptedError("FILE_EMPTY", 400, "the file is empty")
        upload = Upload(digest.hexdigest(), _plain_name(name), count, check_only)
        return await to_thread.run_sync(_accept, site, who, phase, partial, upload, refusal)
    finally:
        partial.unlink(missing_ok=True)


def remove_abandoned(incoming: Path) -> None:
    """Remove files whose transfer ended with a process that was killed."""
    for path in incoming.glob("*.parquet"):
        if time.time() - path.stat().st_mtime > _ABANDONED_S:
            path.unlink(missing_ok=True)


def _refusal(
    site: Site, who: Identity, phase: Phase, size: int | None, check_only: bool
) -> NotAcceptedError | None:
    """Refuse before the transfer what would be refused after it.

    Returns:
        Why the file is refused unless it was sent before; None: it is accepted as it is.
    """
    with site.database.read() as session:
        try:
            check_allowed(session, site.challenge.settings, phase, who, check_only=check_only)
        except NotAcceptedError as error:
            if error.code == "TOO_MANY_REQUESTS" or not has_file_of_size(session, phase, who, size):
                raise
            return error
    return None


def _accept(
    site: Site,
    who: Identity,
    phase: Phase,
    file: Path,
    upload: Upload,
    refusal: NotAcceptedError | None,
) -> tuple[SubmissionView, bool]:
    if refusal is not None:
        with site.database.read() as session:
            earlier = sent_before(session, phase, who, upload)
            if earlier is None:
                raise refusal
            return submission_view(session, site.challenge.settings, earlier, who), False
    copied = site.challenge.store.copied(file, upload.sha256)
    with copied as keep, site.database.write() as session:
        submission, new = accept(session, site.challenge, phase, who, upload)
        keep()
        return submission_view(session, site.challenge.settings, submission, who), new


def _plain_name(name: str) -> str:
    """Return a file's name without folders and without characters that cannot be shown."""
    last = name.replace("\\", "/").rpartition("/")[2]
    plain = "".join(c for c in last if unsafe_character(c) is None).strip()
    if len(plain) > _LONGEST_NAME:  # the end is what tells files apart
        plain = f"{plain[: _LONGEST_NAME // 2 - 1]}…{plain[-_LONGEST_NAME // 2 :]}"
    return plain or "submission.parquet"
