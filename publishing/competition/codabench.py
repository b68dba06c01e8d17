"""The Codabench bundle of a competition."""

from __future__ import annotations

from pathlib import Path
from typing import Any, Final

import yaml

from pliant.publishing.competition import wheel
from pliant.publishing.competition.archive import Members, archive_bytes
from pliant.publishing.competition.facts import Competition
from pliant.publishing.competition.pages import PAGES, logo, module_source, render_pages
from pliant.publishing.competition.starting_kit import kit_members

DOCKER_IMAGE: Final = "python:3.11-slim-bookworm"
"""A public image with a Python that Pliant runs on (Codabench's own has 3.7). The scoring
program installs the pinned libraries into it; an image made by the Dockerfile has them."""

OPENS: Final = "2020-01-01 00:00:00"
"""Without an end the phase stays open; organisers set dates in Codabench's editor."""

_SCORE: Final = b'''"""Scores as `pliant evaluate` does, with the wheel beside this file."""

import sys
from pathlib import Path

from bootstrap import load_pliant

load_pliant(Path(__file__).resolve().parent)

from pliant.evaluator.competition.codabench_program import main  # noqa: E402

sys.exit(main(sys.argv[1:]))
'''


def bundle_members(competition: Competition, public: Path, reference: Path) -> Members:
    """Return the files of the bundle by name.

    Args:
        competition: The competition.
        public: The public half.
        reference: The zipped reference data.
    """
    pages = render_pages(competition, "codabench")
    members: dict[str, bytes | Path] = {
        "competition.yaml": _yaml(competition_document(competition)),
        "logo.png": logo(),
        "scoring_program.zip": archive_bytes(scoring_program()),
        "reference_data.zip": reference,
        "starting_kit.zip": archive_bytes(kit_members(competition, public, pages["kit"])),
    }
    return members | {f"pages/{name}.md": pages[name].encode() for name in PAGES}


def scoring_program() -> dict[str, bytes]:
    """Return the files of the scoring program by name."""
    return {
        "metadata.yaml": _yaml({"command": "python3 score.py /app/input /app/output"}),
        "score.py": _SCORE,
        "bootstrap.py": module_source("bootstrap"),
        "requirements.txt": wheel.requirement_pins().encode(),
        wheel.wheel_name(): wheel.build_wheel(),
    }


def dockerfile() -> bytes:
    """Return the recipe of an image in which scoring starts at once."""
    pins = " ".join(wheel.requirement_pins().split())
    return (
        f"# docker build -t NAME/pliant-scoring . && docker push NAME/pliant-scoring\n"
        f"# then set docker_image to NAME/pliant-scoring in competition.yaml.\n"
        f"FROM {DOCKER_IMAGE}\n"
        f"RUN pip install --no-cache-dir {pins}\n"
    ).encode()


def competition_document(competition: Competition) -> dict[str, Any]:
    """Return `competition.yaml`, version 2."""
    dataset, split = competition.dataset, competition.split
    return {
        "version": 2,
        "title": f"{dataset['title']}: {split}",
        "description": (
            f"Dense pixel correspondence on deformable objects: {competition.queries:,} queries "
            f"in {competition.pairs:,} image pairs, with hidden answers."
        ),
        "image": "logo.png",
        "terms": "pages/terms.md",
        "docker_image": DOCKER_IMAGE,
        "registration_auto_approve": True,
        "enable_detailed_results": True,
        "show_detailed_results_in_submission_panel": True,
        "show_detailed_results_in_leaderboard": True,
        "make_programs_available": True,
        "make_input_data_available": False,
        "pages": [
            {"title": title, "file": f"pages/{name}.md"}
            for name, title in PAGES.items()
            if name != "terms"  # shown by the platform itself
        ],
        "tasks": [
            {
                "index": 0,
                "name": f"{dataset['id']} {dataset['version']}, {split}",
                "description": f"Protocol {competition.protocol.name} "
                f"{competition.protocol.version}.",
                "scoring_program": "scoring_program.zip",
                "reference_data": "reference_data.zip",
            }
        ],
        "phases": [
            {
                "index": 0,
                "name": split,
                "description": f"Answer the queries of split {split}.",
                "start": OPENS,
                "max_submissions_per_day": 5,
                "max_submissions": 100,
                "execution_time_limit": 600,
                "accepts_only_result_submissions": True,
                "starting_kit": "starting_kit.zip",
                "tasks": [0],
            }
        ],
        "leaderboards": [
            {
                "title": "Results",
                "key": "main",
                "submission_rule": "Force_Best",
                "columns": [
                    {
                        "title": column.title,
                        "key": column.key,
                        "index": index,
                        "sorting": "asc" if column.ascending else "desc",
                        "precision": column.precision,
                        "hidden": False,
                    }
                    for index, column in enumerate(competition.columns)
                ],
            }
        ],
    }


def _yaml(document: object) -> bytes:
    return yaml.safe_dump(document, sort_keys=False, allow_unicode=True, width=100).encode()
