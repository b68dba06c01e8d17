"""The pages of a competition: Markdown for Codabench, the same as HTML for EvalAI."""

from __future__ import annotations

from importlib import resources

import jinja2
from markdown_it import MarkdownIt

from pliant.publishing.competition.facts import Competition
from pliant.spec.text import shown

PAGES = {
    "overview": "Overview",
    "data": "Data",
    "evaluation": "Evaluation",
    "submit": "How to submit",
    "terms": "Terms",
}
"""Name of a page -> its title, in the order of the tabs."""


def render_pages(competition: Competition, platform: str) -> dict[str, str]:
    """Return the pages in Markdown by name.

    Args:
        competition: What they are about.
        platform: `codabench`, which wants the Parquet file in a zip archive, or `evalai`.
    """
    environment = jinja2.Environment(
        loader=jinja2.PackageLoader("pliant.publishing.competition", "files"),
        autoescape=False,  # Markdown; as HTML it is escaped below
        undefined=jinja2.StrictUndefined,
        finalize=shown,
        trim_blocks=True,
        lstrip_blocks=True,
        keep_trailing_newline=True,
    )
    return {
        name: environment.get_template(f"{name}.md.j2").render(
            c=competition, d=competition.dataset, platform=platform
        )
        for name in [*PAGES, "kit"]
    }


def as_html(markdown: str) -> str:
    """Return a page in HTML; HTML that stands in the text is shown, not obeyed."""
    html: str = MarkdownIt("commonmark", {"html": False}).enable("table").render(markdown)
    return html


def logo() -> bytes:
    """Return the logo, PNG."""
    return _file("logo.png")


def example_program() -> bytes:
    """Return the program of the starting kit, which needs nothing of ours."""
    folder = resources.files("pliant.publishing.competition")
    return (folder / "examples" / "submit_without_pliant.py").read_bytes()


def module_source(name: str) -> bytes:
    """Return the source of a module of this folder, for programs that carry it along."""
    return (resources.files("pliant.publishing.competition") / f"{name}.py").read_bytes()


def _file(name: str) -> bytes:
    return (resources.files("pliant.publishing.competition") / "files" / name).read_bytes()
