"""The site's reference of commands: a heading for each, and the defaults that the commands have."""

from __future__ import annotations

import re
import runpy
from collections.abc import Iterator
from pathlib import Path

import click
import pytest

from pliant.cli.main import SECTIONS, cli
from tests.known import known

pytest.importorskip("mkdocs", reason="needs the extra 'docs'")
HOOK = Path(__file__).resolve().parents[2] / "docs" / "command_line.py"


def commands(command: click.Command, path: str) -> Iterator[tuple[str, click.Command]]:
    if path != "pliant":
        yield path, command
    if isinstance(command, click.Group):
        context = click.Context(command, info_name=path)
        for name in command.list_commands(context):
            found = known(command.get_command(context, name))
            yield from commands(found, f"{path} {name}")


ALL = dict(commands(cli, "pliant"))


@pytest.fixture(scope="module")
def parts() -> dict[str, str]:
    """Heading -> what follows it, up to the next one."""
    page = runpy.run_path(str(HOOK))["command_line"]()
    split = re.split(r"^#+ (.*)$", page, flags=re.MULTILINE)
    return dict(zip(split[1::2], split[2::2], strict=True))


def test_every_command_has_its_heading_and_no_other(parts: dict[str, str]) -> None:
    assert set(parts) == {"Command line", *SECTIONS, *ALL}
    assert "pliant train don" in parts


@pytest.mark.parametrize("path", ALL)
def test_every_option_has_its_real_default(path: str, parts: dict[str, str]) -> None:
    text = parts[path]
    assert not re.search("Sentinel|UNSET|None", text)
    rows = re.findall(r"^\| `(--[\w-]+)[ `].* \| ([^|]*) \|$", text, re.MULTILINE)
    params = ALL[path].params
    options = [each for each in params if isinstance(each, click.Option) and not each.hidden]
    assert [name for name, _ in rows] == [max(each.opts, key=len) for each in options]
    context = click.Context(ALL[path], info_name=path)
    for option, (name, shown) in zip(options, rows, strict=False):
        value = option.get_default(context)
        if option.required:
            assert shown == "required", name
        elif option.is_flag:
            assert shown == ("on" if value else "off"), name
        elif isinstance(value, int | float | str) and value != "":
            assert shown == f"`{value}`", name
        else:
            several = value if isinstance(value, list | tuple) else ()
            assert shown == ("`" + " ".join(map(str, several)) + "`" if several else ""), name
    assert ALL[path].help
