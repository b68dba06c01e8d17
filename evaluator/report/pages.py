"""Renders the pages: one environment, one base template and one style sheet for all of them."""

from __future__ import annotations

import base64
import functools
import textwrap
from typing import Any, Final

import jinja2

from pliant.spec.text import shown

CARD_WIDTH: Final = 100
"""Characters per line of prose in Markdown cards."""


def render_page(template: str, **values: Any) -> str:
    """Render a template of `evaluator/report/templates`.

    Args:
        template: File name. In `.html.j2` templates every value is escaped unless marked safe;
            `.md.j2` templates are Markdown.
        **values: What the template shows.

    Returns:
        The page; HTML pages load nothing from elsewhere.
    """
    return _environment().get_template(template).render(**values)


@functools.cache
def _environment() -> jinja2.Environment:
    environment = jinja2.Environment(
        loader=jinja2.PackageLoader("pliant.evaluator.report", "templates"),
        autoescape=lambda name: name is not None and name.endswith(".html.j2"),
        undefined=jinja2.StrictUndefined,
        finalize=shown,
        trim_blocks=True,
        lstrip_blocks=True,
        keep_trailing_newline=True,
    )
    environment.filters["data_uri"] = _data_uri
    environment.filters["fill"] = _fill
    return environment


def _data_uri(png: bytes) -> str:
    return "data:image/png;base64," + base64.b64encode(png).decode()


def _fill(text: str) -> str:
    """Wrap a paragraph or list item; the lines after a list item's first one are indented."""
    plain = " ".join(text.split())
    indent = "  " if plain.startswith("- ") else ""
    return textwrap.fill(plain, CARD_WIDTH, subsequent_indent=indent) + "\n"
