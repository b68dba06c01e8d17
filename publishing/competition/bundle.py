"""Writes a competition for each held-out split of a published dataset, with its hidden answers."""

from __future__ import annotations

import json
import tempfile
from pathlib import Path

import numpy as np

from pliant.evaluator.competition.scoring import COMPETITION_JSON
from pliant.evaluator.submission.queries import read_queries
from pliant.publishing.competition.archive import Members, write_archive
from pliant.publishing.competition.facts import Competition, describe
from pliant.publishing.competition.pages import file_bytes
from pliant.publishing.competition.platforms import (
    codabench_members,
    dockerfile,
    evalai_members,
)
from pliant.spec.conventions import SPLITS
from pliant.spec.dataset import Dataset
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


def reference_members(competition: Competition, public: Path, private: Path) -> Members:
    """Return the files that a platform scores with, by their names in the archive.

    They are laid out as a dataset: its description and its sequences from the private half
    (whose rows say how much of a cloth is seen), the queries, the truth, and for geodesic
    scores the surface images of the target frames with the point tables.

    Args:
        competition: The competition.
        public: The public half.
        private: The private half.

    Raises:
        SpecError: The private half lacks the truth.
    """
    split = competition.split
    truth = layout.truth_path(private, split)
    if not truth.is_file():
        raise SpecError(f"the private half has no truth of split {split}", path=truth)
    members: dict[str, bytes | Path] = {
        COMPETITION_JSON: json.dumps(competition.rules, indent=1, sort_keys=True).encode(),
        layout.DATASET_JSON: private / layout.DATASET_JSON,
        layout.SEQUENCES_TABLE: private / layout.SEQUENCES_TABLE,
        _name(layout.queries_path(public, split), public): layout.queries_path(public, split),
        _name(truth, private): truth,
    }
    dataset = Dataset.open(private)
    queries = read_queries(Dataset.open(public), split)
    targets = np.unique(np.stack([queries.sequence_b, queries.frame_b], axis=1), axis=0)
    for code, frame in targets.tolist():
        folder = dataset.sequence(queries.sequences[code]).dir
        for path in (folder / layout.depth_name(frame), folder / layout.POINTS_TABLE):
            if path.is_file():
                members[_name(path, private)] = path
    return members


def _name(path: Path, root: Path) -> str:
    return path.relative_to(root).as_posix()
