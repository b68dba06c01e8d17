"""The reference data of a competition: the hidden answers, as a dataset that can be scored on."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np

from pliant.evaluator.competition.scoring import COMPETITION_JSON
from pliant.evaluator.submission.queries import read_queries
from pliant.publishing.competition.archive import Members
from pliant.publishing.competition.facts import Competition
from pliant.spec.dataset import Dataset
from pliant.spec.errors import SpecError
from pliant.spec.storage import layout


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
