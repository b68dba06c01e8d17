"""The texts of a competition: its pages in Markdown or HTML, configurations and programs."""

from __future__ import annotations

from importlib import resources
from typing import Any, Final

import jinja2
import yaml

from pliant.publishing.competition.facts import Competition
from pliant.spec.io.yamlfiles import parse_yaml
from pliant.spec.text import shown

PAGES: Final = {
    "overview": "Overview",
    "data": "Data",
    "evaluation": "Evaluation",
    "submit": "How to submit",
    "terms": "Terms",
}
"""Name of a page -> its title, in the order of the tabs."""

_FOLDER: Final = resources.files("pliant.publishing.competition")


def render_pages(competition: Competition) -> dict[str, str]:
    """Return the pages in Markdown by name, and `kit`, the README of the starting kit."""
    return {name: _render(f"{name}.md.j2", competition) for name in [*PAGES, "kit"]}


def competition_yaml(competition: Competition) -> bytes:
    """Return Codabench's configuration file."""
    document = parse_yaml(_render("competition.yaml.j2", competition, pages=PAGES))
    return yaml.safe_dump(document, sort_keys=False, allow_unicode=True, width=100).encode()


def file_bytes(name: str) -> bytes:
    """Return a file of this folder, such as `files/logo.png` or a program to be copied."""
    return (_FOLDER / name).read_bytes()


def _render(template: str, competition: Competition, **facts: Any) -> str:
    environment = jinja2.Environment(
        loader=jinja2.PackageLoader("pliant.publishing.competition", "files"),
        autoescape=False,  # Markdown
        undefined=jinja2.StrictUndefined,
        finalize=shown,
        trim_blocks=True,
        lstrip_blocks=True,
        keep_trailing_newline=True,
    )
    return environment.get_template(template).render(c=competition, d=competition.dataset, **facts)
