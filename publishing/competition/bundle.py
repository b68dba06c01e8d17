"""Writes a competition for each held-out split of a published dataset."""

from __future__ import annotations

import tempfile
from pathlib import Path

from pliant.publishing.competition.archive import write_archive
from pliant.publishing.competition.facts import describe
from pliant.publishing.competition.pages import file_bytes
from pliant.publishing.competition.platforms import (
    codabench_members,
    dockerfile,
    evalai_members,
)
from pliant.publishing.competition.reference import reference_members
from pliant.spec.conventions import SPLITS
from pliant.spec.errors import SpecError
from pliant.spec.storage import layout


def write_bundle(public: Path, private: Path, out: Path) -> list[Path]:
    """Write `codabench-SPLIT.zip` and `evalai-SPLIT.zip` for every split the private half answers.

    They hold the hidden answers: give them to the platform and to nobody else. Equal halves,
    code and library versions give equal bytes.

    Args:
        public: The public half: `dataset.json`, `sequences.parquet`, the queries.
        private: The private half: the truth and what geodesic scores need.
        out: The folder to write into; made if it is not there.

    Returns:
        The files written.

    Raises:
        SpecError: A half lacks what a competition needs.
    """
    splits = [split for split in SPLITS if layout.truth_path(private, split).is_file()]
    if not splits:
        raise SpecError("the private half has no truth", path=private / layout.TRUTH_DIR)
    out.mkdir(parents=True, exist_ok=True)
    written = []
    for split in splits:
        competition = describe(public, split)
        with tempfile.TemporaryDirectory(prefix=".pliant-", dir=out) as folder:
            reference = Path(folder) / "reference_data.zip"
            write_archive(reference, reference_members(competition, public, private))
            for name, members in {
                f"codabench-{split}.zip": codabench_members(competition, public, reference),
                f"evalai-{split}.zip": evalai_members(competition, reference),
            }.items():
                write_archive(out / name, members)
                written.append(out / name)
    notes = {"README.md": file_bytes("files/README.md"), "Dockerfile": dockerfile()}
    for name, content in notes.items():
        (out / name).write_bytes(content)
        written.append(out / name)
    return written
