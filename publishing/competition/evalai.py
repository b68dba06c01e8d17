"""The EvalAI bundle of a competition."""

from __future__ import annotations

from pathlib import Path
from typing import Any, Final

import yaml

from pliant.publishing.competition import wheel
from pliant.publishing.competition.archive import Members, archive_bytes
from pliant.publishing.competition.facts import Competition
from pliant.publishing.competition.pages import (
    as_html,
    example_program,
    logo,
    module_source,
    render_pages,
)

OPENS: Final = "2020-01-01 00:00:00"
CLOSES: Final = "2099-12-31 23:59:59"

_TEMPLATES: Final = {
    "description": "overview",
    "evaluation_details": "evaluation",
    "submission_guidelines": "submit",
    "terms_and_conditions": "terms",
    "phase": "data",
}
"""EvalAI's page -> the page of ours that it shows."""

_INIT: Final = b'"""EvalAI imports `evaluate` from here."""\n\nfrom .main import evaluate\n'

_MAIN: Final = b'''"""Scores as `pliant evaluate` does, with the wheel beside this file."""

from pathlib import Path

from .bootstrap import load_pliant

load_pliant(Path(__file__).resolve().parent)


def evaluate(test_annotation_file, user_annotation_file, phase_codename, **kwargs):
    from pliant.evaluator.competition import evalai_program

    return evalai_program.evaluate(
        test_annotation_file, user_annotation_file, phase_codename, **kwargs
    )
'''


def challenge_members(competition: Competition, reference: Path) -> Members:
    """Return the files of the challenge by name.

    Args:
        competition: The competition.
        reference: The zipped reference data, which is EvalAI's annotation file.
    """
    pages = render_pages(competition, "evalai")
    members: dict[str, bytes | Path] = {
        "challenge_config.yaml": yaml.safe_dump(
            challenge_document(competition), sort_keys=False, allow_unicode=True, width=100
        ).encode(),
        "logo.png": logo(),
        "evaluation_script.zip": archive_bytes(evaluation_script()),
        f"annotations/{competition.split}.zip": reference,
        "submit_without_pliant.py": example_program(),
    }
    for template, page in _TEMPLATES.items():
        members[f"templates/{template}.html"] = as_html(pages[page]).encode()
    return members


def evaluation_script() -> dict[str, bytes]:
    """Return the files of the evaluation script by name.

    EvalAI's worker has numpy and others already and keeps their versions, so its
    requirements are ranges.
    """
    return {
        "__init__.py": _INIT,
        "main.py": _MAIN,
        "bootstrap.py": module_source("bootstrap"),
        "requirements.txt": "".join(f"{line}\n" for line in wheel.requirement_ranges()).encode(),
        wheel.wheel_name(): wheel.build_wheel(),
    }


def challenge_document(competition: Competition) -> dict[str, Any]:
    """Return `challenge_config.yaml`."""
    dataset, split, main = competition.dataset, competition.split, competition.columns[0]
    return {
        "title": f"{dataset['title']}: {split}",
        "short_description": "Dense pixel correspondence on deformable objects.",
        "description": "templates/description.html",
        "evaluation_details": "templates/evaluation_details.html",
        "terms_and_conditions": "templates/terms_and_conditions.html",
        "submission_guidelines": "templates/submission_guidelines.html",
        "leaderboard_description": (
            f"Protocol {competition.protocol.name} {competition.protocol.version} of Pliant; "
            f"ranked by {main.title}."
        ),
        "image": "logo.png",
        "evaluation_script": "evaluation_script.zip",
        "remote_evaluation": False,
        "is_docker_based": False,
        "start_date": OPENS,
        "end_date": CLOSES,
        "published": False,
        "leaderboard": [
            {
                "id": 1,
                "schema": {
                    "labels": [column.key for column in competition.columns],
                    "default_order_by": main.key,
                    "metadata": {
                        column.key: {
                            "sort_ascending": column.ascending,
                            "description": f"{column.title}: {column.about}",
                        }
                        for column in competition.columns
                    },
                },
            }
        ],
        "challenge_phases": [
            {
                "id": 1,
                "name": split,
                "description": "templates/phase.html",
                "codename": split,
                "test_annotation_file": f"annotations/{split}.zip",
                "allowed_submission_file_types": ".parquet",
                "leaderboard_public": True,
                "is_public": True,
                "is_submission_public": False,
                "start_date": OPENS,
                "end_date": CLOSES,
                "max_submissions_per_day": 5,
                "max_submissions_per_month": 50,
                "max_submissions": 100,
            }
        ],
        "dataset_splits": [{"id": 1, "name": split, "codename": split}],
        "challenge_phase_splits": [
            {
                "challenge_phase_id": 1,
                "leaderboard_id": 1,
                "dataset_split_id": 1,
                "visibility": 3,
                "leaderboard_decimal_precision": 3,
                "is_leaderboard_order_descending": not main.ascending,
            }
        ],
    }
