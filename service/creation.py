"""Makes a challenge of the two halves of a published dataset."""

from __future__ import annotations

import os
import shutil
from collections.abc import Sequence
from collections.abc import Set as AbstractSet
from pathlib import Path
from typing import Final

from pliant.service.audit import HOST, record
from pliant.service.challenge import CHALLENGE_YAML, Challenge, new_challenge
from pliant.service.receipts import write_keys
from pliant.service.settings import ChallengeSettings, read_challenge_settings
from pliant.service.teams import invite
from pliant.service.versions import add_missing_versions, truth_file, with_own_protocols
from pliant.spec.configuration import settings_to_dict
from pliant.spec.dataset import Dataset
from pliant.spec.errors import SpecError
from pliant.spec.io.staging import refuse_existing
from pliant.spec.io.yamlfiles import yaml_text
from pliant.spec.storage import layout

HOST_NAME: Final = "Host"


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
        splits: Splits that become phases, where `config` names none; by default test.
        config: `challenge.yaml`, or None.
        database_url: The database; None makes a SQLite file in the folder.

    Returns:
        The host's token, which is stored nowhere.

    Raises:
        CallError: The folder is not empty, a setting is refused, or the database is in use.
        SpecError: The two halves do not belong together, a split has no queries or truth, or
            `data` contains the answers that `private` withholds.
    """
    refuse_existing(root)
    settings = read_challenge_settings(config, tuple(splits))
    settings, protocols = with_own_protocols(settings, config)
    _check_withheld(data, private, {phase.split for phase in settings.phases})
    with new_challenge(root, database_url) as (place, session):
        shutil.copytree(data, place / "public")
        write_settings(place, settings)
        copy_private(private, place / "private" / "1")
        for folder in ("protocols", "submissions", "incoming"):
            (place / folder).mkdir(mode=0o750)
        for name, text in protocols.items():
            (place / name).write_bytes(text)
        write_keys(place / "keys")
        challenge = Challenge.of(place, database_url)
        record(session, HOST, "created", "challenge", title=challenge.title)
        token = invite(session, HOST_NAME, actor=HOST, is_host=True)[1]
        add_missing_versions(session, challenge)
    return token


def _check_withheld(data: Path, private: Path, splits: AbstractSet[str]) -> None:
    """Refuse a public half that would give participants the answers of a split."""
    dataset = Dataset.open(data)
    if not (private / layout.MANIFEST_JSON).is_file():
        raise SpecError(
            "a challenge needs the private half of a published dataset",
            path=private,
            required=f"a folder with a {layout.MANIFEST_JSON}, as `pliant publish` writes it",
            fix="Publish the dataset with --hold-out.",
        )
    for split in sorted(splits):
        truth_file(dataset, private, split)
    for split in sorted(splits - set(dataset.held_out)):
        if (private / layout.truth_name(split)).is_file():
            raise SpecError(
                f"this is not the public half: it contains the answers of split {split}",
                path=data,
                fix="Name the folder that `pliant publish --out` wrote.",
            )


def write_settings(root: Path, settings: ChallengeSettings) -> None:
    """Write `challenge.yaml`, complete with its defaults."""
    text = yaml_text(settings_to_dict(settings))
    (root / CHALLENGE_YAML).write_text(text, encoding="utf-8")


def copy_private(private: Path, place: Path) -> None:
    """Copy a private half so that its owner alone can read it."""
    place.parent.mkdir(mode=0o700, exist_ok=True)
    shutil.copytree(private, place)
    for folder, _, files in os.walk(place):
        os.chmod(folder, 0o700)
        for name in files:
            os.chmod(Path(folder) / name, 0o600)
