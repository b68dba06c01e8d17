"""Pages, templates, messages and docstrings avoid the words that docs/words.txt lists."""

from __future__ import annotations

import ast
import re
from collections.abc import Iterator
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
FOLDERS = "spec generator baselines loaders models evaluator publishing converters viewer cli"
PAGES = (
    *("*.md", "docs/**/*.md", "spec/*.md", "spec/annexes/*.md"),
    *("spec/conformance/*.md", "models/shipped/*/*.md"),
)
TEMPLATES = ("*/templates/*.j2", "*/*/templates/*.j2")
# Text of released files, and the page that `pliant benchmark` writes.
UNCHANGEABLE = {"conventions.py", "tables.py", "results.md"}

_GENERATED = re.compile(r"<!-- generated: .*?<!-- end -->", re.DOTALL)


def words() -> dict[str, str]:
    """Return pattern -> replacement."""
    lines = (ROOT / "docs" / "words.txt").read_text().splitlines()
    pairs = (line.split(" => ") for line in lines if line and not line.startswith("#"))
    return dict(pairs)


def texts() -> Iterator[tuple[str, int, str]]:
    """Yield (file, first line, text) of everything that a reader may see."""
    for pattern in (*PAGES, *TEMPLATES):
        for page in sorted(ROOT.glob(pattern)):
            if page.name in UNCHANGEABLE:
                continue
            text = _GENERATED.sub(lambda part: "\n" * part[0].count("\n"), page.read_text())
            yield str(page.relative_to(ROOT)), 1, text
    for folder in (*FOLDERS.split(), "pliant", "benchmarks"):
        for file in sorted((ROOT / folder).glob("*.py" if folder == "pliant" else "**/*.py")):
            if file.name in UNCHANGEABLE:
                continue
            for node in ast.walk(ast.parse(file.read_text())):
                if isinstance(node, ast.Constant) and isinstance(node.value, str):
                    yield str(file.relative_to(ROOT)), node.lineno, node.value


def hits(pattern: str, text: str) -> Iterator[tuple[int, str]]:
    """Yield (lines before, excerpt) of every place where a pattern fits."""
    for found in re.finditer(pattern.replace(" ", r"\s+"), text, re.IGNORECASE):
        excerpt = text[max(0, found.start() - 30) : found.end() + 30]
        yield text.count("\n", 0, found.start()), " ".join(excerpt.split())


@pytest.mark.parametrize(
    ("text", "count"),
    [
        ("the table is made anew", 1),
        ("this is no\nPNG file; there is no file", 1),
        ("one row a frame, the file\n  holds it, told beside", 4),
        ("it is no longer used", 0),
    ],
)
def test_the_list_finds_what_it_bans(text: str, count: int) -> None:
    assert sum(len(list(hits(pattern, text))) for pattern in words()) == count


def test_no_banned_word() -> None:
    listed = words()
    anyone = re.compile("|".join(listed).replace(" ", r"\s+"), re.IGNORECASE)
    problems = [
        f"{file}:{line + before}: {excerpt!r}; write: {replacement}"
        for file, line, text in texts()
        if anyone.search(text)
        for pattern, replacement in listed.items()
        for before, excerpt in hits(pattern, text)
    ]
    assert problems == [], "\n".join(problems)
