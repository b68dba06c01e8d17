"""The texts of a competition: its pages in Markdown or HTML, configurations and programs."""

from __future__ import annotations

from importlib import resources
from typing import Any, Final

import jinja2
import yaml
from markdown_it import MarkdownIt

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


def render_pages(competition: Competition, platform: str) -> dict[str, str]:
    """Return the pages in Markdown by name.

    Args:
        competition: What they are about.
        platform: `codabench`, which wants the Parquet file in a zip archive, or `evalai`.
    """
    return {
        name: _render(f"{name}.md.j2", competition, platform=platform) for name in [*PAGES, "kit"]
    }


def render_yaml(template: str, competition: Competition, **facts: object) -> bytes:
    """Return a platform's configuration file.

    Args:
        template: Name of its template in `files/`.
        competition: The competition.
        **facts: What else the template shows.
    """
    return dump_yaml(parse_yaml(_render(template, competition, pages=PAGES, **facts)))


def dump_yaml(document: object) -> bytes:
    """Return JSON values as a YAML file."""
    return yaml.safe_dump(document, sort_keys=False, allow_unicode=True, width=100).encode()


def as_html(markdown: str) -> str:
    """Return a page in HTML; HTML in the text is shown as text."""
    html: str = MarkdownIt("commonmark", {"html": False}).enable("table").render(markdown)
    return html


def file_bytes(name: str) -> bytes:
    """Return a file of this folder, such as `files/logo.png` or a program to be copied."""
    return (_FOLDER / name).read_bytes()


def _render(template: str, competition: Competition, **facts: Any) -> str:
    environment = jinja2.Environment(
        loader=jinja2.PackageLoader("pliant.publishing.competition", "files"),
        autoescape=False,  # Markdown; as HTML it is escaped below
        undefined=jinja2.StrictUndefined,
        finalize=shown,
        trim_blocks=True,
        lstrip_blocks=True,
        keep_trailing_newline=True,
    )
    return environment.get_template(template).render(c=competition, d=competition.dataset, **facts)
