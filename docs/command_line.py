"""The site's reference of commands, written from the commands themselves (mkdocs hook)."""

from __future__ import annotations

import inspect
from collections.abc import Iterator
from typing import Any, Final

import click
from mkdocs.config.defaults import MkDocsConfig
from mkdocs.structure.files import File, Files

from pliant.cli.main import SECTIONS, cli

PAGE: Final = "reference/cli.md"

_INTRODUCTION: Final = """# Command line

Exit codes: 0 success, 1 invalid data, 2 invalid command line. `pliant COMMAND --help` prints the
text of this page.

Tab completion of commands and options: add one line to the shell's start-up file.

| shell | file | line |
|---|---|---|
| bash | `~/.bashrc` | `eval "$(_PLIANT_COMPLETE=bash_source pliant)"` |
| zsh | `~/.zshrc` | `eval "$(_PLIANT_COMPLETE=zsh_source pliant)"` |
| fish | `~/.config/fish/config.fish` | `_PLIANT_COMPLETE=fish_source pliant | source` |
"""


def on_files(files: Files, config: MkDocsConfig) -> Files:
    """Add the page."""
    files.append(File.generated(config, PAGE, content=command_line()))
    return files


def command_line() -> str:
    """Return the page as Markdown: a heading per command, in the sections of `pliant --help`."""
    root = click.Context(cli, info_name="pliant")
    parts = [_INTRODUCTION]
    for section, names in SECTIONS.items():
        parts.append(f"## {section}\n")
        for name in names:
            command = cli.get_command(root, name)
            if command is not None:
                parts += _command(command, root, 3)
    return "\n".join(parts)


def _command(command: click.Command, parent: click.Context, level: int) -> Iterator[str]:
    """Yield the blocks of a command and of its subcommands."""
    context = click.Context(command, info_name=command.name, parent=parent)
    yield f"{'#' * level} {context.command_path}\n"
    yield inspect.cleandoc(command.help or "").replace("\b\n", "") + "\n"
    usage = " ".join([context.command_path, *command.collect_usage_pieces(context)])
    yield f"```text\n{usage}\n```\n"
    options = [
        each for each in command.params if isinstance(each, click.Option) and not each.hidden
    ]
    if options:
        yield "| option | meaning | default |\n|---|---|---|"
        yield "\n".join(_option(option, context) for option in options) + "\n"
    if isinstance(command, click.Group):
        for name in command.list_commands(context):
            found = command.get_command(context, name)
            if found is not None:
                yield from _command(found, context, level + 1)


def _option(option: click.Option, context: click.Context) -> str:
    *others, last = option.opts
    value = "" if option.is_flag else " " + option.make_metavar(context).replace("|", " | ")
    names = ", ".join(f"`{name}`" for name in (*others, f"{last}{value}"))
    if option.secondary_opts:
        names += f" / `{option.secondary_opts[0]}`"
    text = " ".join((option.help or "").split()).replace("|", "\\|").replace("<", "&lt;")
    return f"| {names} | {text} | {_default(option, context)} |"


def _default(option: click.Option, context: click.Context) -> str:
    if option.required:
        return "required"
    value: Any = option.get_default(context, call=False)
    if option.is_flag:
        return "on" if value is True else "off"
    if isinstance(value, list | tuple):
        value = " ".join(map(str, value))
    return f"`{value}`" if isinstance(value, str | int | float) and value != "" else ""
