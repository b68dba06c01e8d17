"""Writes a competition for each held-out split of a published dataset, with its hidden answers."""

from __future__ import annotations

import json
import tempfile
import zipfile
from pathlib import Path
from typing import Final

import numpy as np

from pliant.evaluator.competition import COMPETITION_JSON
from pliant.evaluator.submission.queries import read_queries
from pliant.publishing.competition.archive import Members, archive_bytes, write_archive
from pliant.publishing.competition.facts import Competition, describe
from pliant.publishing.competition.pages import PAGES, competition_yaml, file_bytes, render_pages
from pliant.spec.conventions import SPLITS
from pliant.spec.dataset import Dataset
from pliant.spec.errors import CallError, SpecError
from pliant.spec.storage import layout

EXAMPLE_PROGRAM: Final = "submit_without_pliant.py"


def write_bundle(public: Path, private: Path, wheel: Path, out: Path) -> list[Path]:
    """Write `codabench-SPLIT.zip` for every split that the private half answers.

    They contain the hidden answers: give them to the platform and to nobody else. Equal halves and
    wheels give equal bytes.

    Args:
        public: The public half: `dataset.json`, `sequences.parquet`, the queries.
        private: The private half: the truth and what geodesic scores need.
        wheel: The wheel of Pliant that scores.
        out: The folder to write into; made if it is not there.

    Returns:
        The files written.

    Raises:
        CallError: The file is not a wheel of Pliant.
        SpecError: A half lacks what a competition needs.
    """
    splits = [split for split in SPLITS if layout.truth_path(private, split).is_file()]
    if not splits:
        raise SpecError("the private half has no truth", path=private / layout.TRUTH_DIR)
    out.mkdir(parents=True, exist_ok=True)
    written = []
    for split in splits:
        competition = describe(public, split)
        written.append(out / f"codabench-{split}.zip")
        with tempfile.TemporaryDirectory(prefix=".pliant-", dir=out) as folder:
            reference = Path(folder) / "reference_data.zip"
            write_archive(reference, reference_members(competition, public, private))
            write_archive(written[-1], _codabench(competition, public, reference, wheel))
    (out / "README.md").write_bytes(file_bytes("files/README.md"))
    return [*written, out / "README.md"]


def check_wheel(wheel: Path) -> None:
    """Refuse a file that is not a wheel of Pliant.

    Raises:
        CallError: It is something else, or not there.
    """
    good = wheel.name.startswith("pliant-") and wheel.suffix == ".whl"
    if not good or not wheel.is_file() or not zipfile.is_zipfile(wheel):
        raise CallError(
            "this is not a wheel of Pliant",
            path=wheel,
            required="pliant-VERSION-py3-none-any.whl",
            fix="Build it in a checkout with: pip wheel --no-deps .",
        )


def _codabench(
    competition: Competition, public: Path, reference: Path, wheel: Path
) -> dict[str, bytes | Path]:
    """Return the files of the Codabench bundle by name."""
    pages = render_pages(competition)
    program: Members = {
        "metadata.yaml": b"command: python3 score.py /app/input /app/output\n",
        "score.py": file_bytes("examples/score.py"),
        wheel.name: wheel,
    }
    queries = layout.queries_path(public, competition.split)
    kit: Members = {
        "README.md": pages["kit"].encode(),
        EXAMPLE_PROGRAM: file_bytes(f"examples/{EXAMPLE_PROGRAM}"),
        "data/dataset.json": public / layout.DATASET_JSON,
        f"data/queries/{competition.split}.parquet": queries,
    }
    return {
        "competition.yaml": competition_yaml(competition),
        "logo.png": file_bytes("files/logo.png"),
        "scoring_program.zip": archive_bytes(program),
        "reference_data.zip": reference,
        "starting_kit.zip": archive_bytes(kit),
        **{f"pages/{name}.md": pages[name].encode() for name in PAGES},
    }


def reference_members(competition: Competition, public: Path, private: Path) -> Members:
    """Return the files that a platform scores with, by their names in the archive.

    They are laid out as a dataset: its description and its sequences from the private half
    (whose rows say how much of a cloth is seen), the queries, the truth, and for geodesic
    scores the surface images of the target frames with the point tables.

    Args:
        competition: The competition.
        public: The public half.
        private: The private half.
    """
    split = competition.split
    members: dict[str, bytes | Path] = {
        COMPETITION_JSON: json.dumps(competition.rules, indent=1, sort_keys=True).encode(),
        layout.DATASET_JSON: private / layout.DATASET_JSON,
        layout.SEQUENCES_TABLE: private / layout.SEQUENCES_TABLE,
        layout.queries_name(split): layout.queries_path(public, split),
        layout.truth_name(split): layout.truth_path(private, split),
    }
    dataset = Dataset.open(private)
    queries = read_queries(Dataset.open(public), split)
    targets = np.unique(np.stack([queries.sequence_b, queries.frame_b], axis=1), axis=0)
    for code, frame in targets.tolist():
        folder = dataset.sequence(queries.sequences[code]).dir
        for path in (folder / layout.depth_name(frame), folder / layout.POINTS_TABLE):
            if path.is_file():
                members[path.relative_to(private).as_posix()] = path
    return members
