"""Every `pliant …` that a document shows exists: the command, its options, their choices."""

from __future__ import annotations

import re
import shlex
from collections.abc import Iterator
from pathlib import Path

import click
import pytest
import yaml

from pliant.cli.main import cli

ROOT = Path(__file__).resolve().parents[2]
PAGES = sorted(
    page
    for page in (*ROOT.glob("*.md"), *ROOT.glob("docs/*.md"), *ROOT.glob("spec/**/*.md"))
    if "node_modules" not in page.parts and "pliant " in page.read_text()
)
STOPS = {"|", ";", "&&", ">", ">>", "<", "2>"}
PLACEHOLDERS = ("…", "...")
COMMAND = re.compile(r"^(?:[A-Z_]+=\S+ +)*(?:torchrun .*? )?(pliant .*)$")


def shown_commands(text: str) -> Iterator[tuple[str, bool]]:
    """Yield every command line of a page and whether it is whole (a line of a block).

    A line of a fenced or indented block that begins with `pliant`, with the lines that a `\\`
    joins to it; and text in backticks that does. Comments, what follows a pipe, and
    `$(…)` are taken out.
    """
    fenced = re.findall(r"^```(.*?)\n(.*?)^```", text, re.DOTALL | re.MULTILINE)
    blocks = [block for kind, block in fenced if kind in ("", "sh")]
    prose = re.sub(r"^```.*?^```", "", text, flags=re.DOTALL | re.MULTILINE)
    blocks += re.findall(r"(?:^    .*\n)+", prose, re.MULTILINE)
    for block in blocks:
        for line in re.sub(r"\\\n\s*", " ", block).splitlines():
            if command := COMMAND.match(line.strip()):
                yield command[1], True
    for inline in re.findall(r"`(pliant [^`]+)`", prose):
        yield " ".join(inline.split()), False


def words_of(line: str) -> list[str]:
    words = shlex.split(re.sub(r"\$\(.*\)", "VALUE", line), comments=True)
    stop = next((n for n, word in enumerate(words) if word in STOPS), len(words))
    return [word for word in words[1:stop] if word not in PLACEHOLDERS]


def problem(line: str, whole: bool) -> str | None:
    """Return what is wrong with a command line, or None."""
    words = words_of(line)
    abridged = any(mark in line for mark in PLACEHOLDERS)
    command: click.Command = cli
    context = click.Context(cli, info_name="pliant")
    while isinstance(command, click.Group) and words and not words[0].startswith("-"):
        found = command.get_command(context, words[0])
        if found is None:
            return f"there is no command {words[0]!r}"
        context = click.Context(found, info_name=words.pop(0), parent=context)
        command = found
    if not whole and isinstance(command, click.Group):
        return None
    try:
        values, _, _ = command.make_parser(context).parse_args(list(words))
    except click.BadOptionUsage as error:  # `pliant evaluate --out` in a sentence, `--config …`
        return error.format_message() if whole and not abridged else None
    except click.UsageError as error:
        return error.format_message()
    known = {parameter.name: parameter for parameter in command.params}
    for name, value in values.items():
        kind = known[name].type if name in known else None  # `--help` is in no list
        if isinstance(kind, click.Choice) and isinstance(value, str) and value not in kind.choices:
            return f"--{name}: {value!r} is none of {', '.join(map(str, kind.choices))}"
    if whole and not abridged:
        missing = [p.opts[0] for p in command.params if p.required and not values.get(p.name or "")]
        if missing:
            return f"{', '.join(missing)} is required"
    return None


@pytest.mark.parametrize("page", PAGES, ids=lambda page: str(page.relative_to(ROOT)))
def test_every_command_of_a_page_parses(page: Path) -> None:
    found = {line: problem(line, whole) for line, whole in shown_commands(page.read_text())}
    assert {line: wrong for line, wrong in found.items() if wrong} == {}


def test_services_of_systemd_and_containers() -> None:
    page = (ROOT / "docs/service.md").read_text()
    (units,) = re.findall(r"^```ini\n(.*?)^```", page, re.DOTALL | re.MULTILINE)
    (compose,) = re.findall(r"^```yaml\n# compose(.*?)^```", page, re.DOTALL | re.MULTILINE)
    services = yaml.safe_load(f"#{compose}")["services"]
    run = re.findall(r"`docker compose run --rm work (.*?)`", page)
    lines = [line.partition("/bin/")[2] for line in re.findall(r"^ExecStart=(.*)", units, re.M)]
    lines += [
        f"pliant {each}" for each in (*run, *(services[n]["command"] for n in ("web", "work")))
    ]
    assert len(lines) == 5
    assert [problem(line, True) for line in lines] == [None] * 5
    # Each file is scored in a temporary folder, which `strict` makes unwritable.
    assert units.count("ProtectSystem=strict") == units.count("PrivateTmp=yes") == 2
    # `create` renames a folder to the challenge's: it cannot be where a volume is mounted.
    mounted = services["work"]["volumes"][0].partition(":")[2]
    assert all(f" {mounted}/challenge" in line for line in lines[2:])


def test_the_pages_are_read() -> None:
    lines = [line for page in PAGES for line, whole in shown_commands(page.read_text()) if whole]
    assert len(lines) > 50
    assert any("--engine ray" in line for line in lines)  # an indented block, three lines, env
    assert {words_of(line)[0] for line in lines} > {"generate", "evaluate", "publish", "match"}


def test_stale_commands_are_seen() -> None:
    page = (
        "```\npliant evaluate A.parquet \\\n  --data D --otu R   # score\n"
        "pliant evaluate A.parquet\n```\n`pliant grade X` and `pliant predict sift --kind dense`"
        "\n```\npliant generate rope --out D --seed $(date +%s) | head\n```"
    )
    found = [problem(line, whole) for line, whole in shown_commands(page)]
    assert len(found) == 5
    assert "--otu" in str(found[0])
    assert found[1] == "--data is required"
    assert found[2] is None
    assert found[3] == "there is no command 'grade'"
    assert "dense" in str(found[4])
