"""The bundles of the two platforms: the same parts under the names that each of them wants.

One part is the starting kit: the queries, a template to fill in, and a program that fills it.
"""

from __future__ import annotations

import tempfile
from pathlib import Path
from typing import Final

import numpy as np
import pyarrow as pa

from pliant.publishing.competition import wheel
from pliant.publishing.competition.archive import Members, archive_bytes
from pliant.publishing.competition.facts import Competition
from pliant.publishing.competition.pages import (
    PAGES,
    as_html,
    dump_yaml,
    file_bytes,
    render_pages,
    render_yaml,
)
from pliant.spec.io.parquet import read_table, write_table
from pliant.spec.storage import layout

DOCKER_IMAGE: Final = "python:3.11-slim-bookworm"
"""A public image with a Python that Pliant runs on (Codabench's own has 3.7). The scoring
program installs the pinned libraries into it; an image made by the Dockerfile has them."""

EXAMPLE_PROGRAM: Final = "submit_without_pliant.py"

_EVALAI_PAGES: Final = {
    "description": "overview",
    "evaluation_details": "evaluation",
    "submission_guidelines": "submit",
    "terms_and_conditions": "terms",
    "phase": "data",
}
"""EvalAI's page -> the page of ours that it shows."""

_EVALAI_INIT: Final = b'"""EvalAI imports `evaluate` from here."""\n\nfrom .main import evaluate\n'


def codabench_members(competition: Competition, public: Path, reference: Path) -> Members:
    """Return the files of the Codabench bundle by name.

    Args:
        competition: The competition.
        public: The public half.
        reference: The zipped reference data.
    """
    pages = render_pages(competition, "codabench")
    program = {
        "metadata.yaml": dump_yaml({"command": "python3 score.py /app/input /app/output"}),
        "score.py": file_bytes("files/score.py.j2"),
        **_scorer(wheel.requirement_pins()),
    }
    return {
        "competition.yaml": render_yaml(
            "competition.yaml.j2", competition, docker_image=DOCKER_IMAGE
        ),
        "logo.png": file_bytes("files/logo.png"),
        "scoring_program.zip": archive_bytes(program),
        "reference_data.zip": reference,
        "starting_kit.zip": archive_bytes(kit_members(competition, public, pages["kit"])),
        **{f"pages/{name}.md": pages[name].encode() for name in PAGES},
    }


def evalai_members(competition: Competition, reference: Path) -> Members:
    """Return the files of the EvalAI challenge by name.

    EvalAI's worker has numpy and others already and keeps their versions, so the requirements
    of its evaluation script are ranges.

    Args:
        competition: The competition.
        reference: The zipped reference data, which is EvalAI's annotation file.
    """
    pages = render_pages(competition, "evalai")
    program = {
        "__init__.py": _EVALAI_INIT,
        "main.py": file_bytes("files/main.py.j2"),
        **_scorer("".join(f"{line}\n" for line in wheel.requirement_ranges())),
    }
    return {
        "challenge_config.yaml": render_yaml("challenge_config.yaml.j2", competition),
        "logo.png": file_bytes("files/logo.png"),
        "evaluation_script.zip": archive_bytes(program),
        f"annotations/{competition.split}.zip": reference,
        EXAMPLE_PROGRAM: file_bytes(f"examples/{EXAMPLE_PROGRAM}"),
        **{
            f"templates/{name}.html": as_html(pages[page]).encode()
            for name, page in _EVALAI_PAGES.items()
        },
    }


def _scorer(requirements: str) -> dict[str, bytes]:
    """Return what every platform's program scores with: the wheel, and how it is loaded."""
    return {
        "bootstrap.py": file_bytes("bootstrap.py"),
        "requirements.txt": requirements.encode(),
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


def kit_members(competition: Competition, public: Path, readme: str) -> Members:
    """Return the files of the starting kit by name.

    Args:
        competition: The competition.
        public: The public half.
        readme: Text of its README.md.
    """
    queries = layout.queries_path(public, competition.split)
    return {
        "README.md": readme.encode(),
        EXAMPLE_PROGRAM: file_bytes(f"examples/{EXAMPLE_PROGRAM}"),
        "template.parquet": _template(competition, queries),
        "data/dataset.json": public / layout.DATASET_JSON,
        f"data/queries/{competition.split}.parquet": queries,
    }


def _template(competition: Competition, queries: Path) -> bytes:
    """Return a submission whose every u and v is NaN, which no check passes."""
    keys = read_table(queries, "queries", ["pair_id", "query_id"])
    empty = pa.array(np.full(len(keys), np.nan, np.float32))
    footer = {
        "dataset": {key: competition.dataset[key] for key in ("id", "version")},
        "split": competition.split,
        "queries_sha256": competition.queries_sha256,
        "method": {"name": "template"},
    }
    table = keys.append_column("u", empty).append_column("v", empty)
    with tempfile.TemporaryDirectory(prefix="pliant-") as folder:
        path = Path(folder) / "template.parquet"
        write_table(path, table, "answers", footer)
        return path.read_bytes()
