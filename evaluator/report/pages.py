"""Renders the pages: one environment, one base template and one style sheet for all of them."""

from __future__ import annotations

import base64
import functools
import json
import re
import textwrap
from collections.abc import Mapping
from importlib import resources
from typing import Any, Final

import jinja2
from markupsafe import Markup

from pliant.spec.text import shown

REPORT_PACKAGE: Final = "pliant.evaluator.report"
"""Owner of the base page, the style sheet and the macros that pages of other packages use too."""

CARD_WIDTH: Final = 100
"""Characters per line of prose in Markdown cards."""


def render_page(template: str, *, package: str = REPORT_PACKAGE, **values: Any) -> str:
    """Render a template of a package, over the base page and the style of the reports.

    Args:
        template: File name in the package's `templates`. In `.html.j2` templates every value is
            escaped unless marked safe; `.md.j2` templates are Markdown, where the filter `plain`
            escapes a free text.
        package: The package that owns the template.
        **values: What the template shows.

    Returns:
        The page; HTML pages load nothing from elsewhere.
    """
    return environment(package).get_template(template).render(**values)


@functools.cache
def environment(package: str) -> jinja2.Environment:
    """Return the templates of a package, over the base page and the style of the reports."""
    packages = dict.fromkeys((package, REPORT_PACKAGE))
    made = jinja2.Environment(
        loader=jinja2.ChoiceLoader([jinja2.PackageLoader(name, "templates") for name in packages]),
        autoescape=lambda name: name is not None and name.endswith(".html.j2"),
        undefined=jinja2.StrictUndefined,
        finalize=shown,
        trim_blocks=True,
        lstrip_blocks=True,
        keep_trailing_newline=True,
    )
    made.filters["data_uri"] = data_uri
    made.globals["chart_scripts"] = _chart_scripts
    made.filters["fill"] = _fill
    made.filters["plain"] = _plain
    made.filters["fact_text"] = fact_text
    return made


@functools.cache
def _chart_scripts() -> Markup:
    """Return the library that draws charts, and the script that calls it, as elements."""
    folder = resources.files(REPORT_PACKAGE)
    names = [f"vendor/{name}.min.js" for name in ("vega", "vega-lite", "vega-interpreter")]
    texts = [(folder / name).read_text("utf-8") for name in (*names, "templates/charts.js")]
    return Markup("\n".join(f"<script>{text}</script>" for text in texts))


def data_uri(content: bytes, media_type: str = "image/png") -> str:
    """Return a file as an address that contains it."""
    return f"data:{media_type};base64,{base64.b64encode(content).decode()}"


def fact_text(value: Any) -> Any:
    """Return a value of a footer as a reader expects it: JSON's words, mappings as key: value."""
    if isinstance(value, Mapping):
        return ", ".join(
            f"{key}: ({fact_text(each)})"
            if isinstance(each, Mapping)
            else f"{key}: {fact_text(each)}"
            for key, each in value.items()
        )
    return value if isinstance(value, str) else json.dumps(value, ensure_ascii=False)


def _plain(text: str) -> str:
    """Return text with the special characters of Markdown escaped."""
    return re.sub(r"([\\`*_{}\[\]()<>#+!|~&])", r"\\\1", " ".join(text.split()))


def _fill(text: str) -> str:
    """Wrap a paragraph or list item; the lines after a list item's first one are indented."""
    plain = " ".join(text.split())
    indent = "  " if plain.startswith("- ") else ""
    wrapped = textwrap.fill(
        plain,
        CARD_WIDTH,
        subsequent_indent=indent,
        break_long_words=False,
        break_on_hyphens=False,  # Markdown shows the end of a line as a space
    )
    return wrapped + "\n"
