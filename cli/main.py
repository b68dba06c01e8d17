"""The `pliant` command: a lazy group over the commands, and the one place that exits."""

from __future__ import annotations

import gc
import importlib
import os
import re
import sys
import traceback
from typing import Any, Final

import click

from pliant.cli.terminal import echo

CALL_WRONG: Final = 2

SECTIONS: Final[dict[str, dict[str, str]]] = {
    "Data": {
        "demo": "Generate and score a small benchmark, with a report.",
        "generate": "Render datasets; run again to resume.",
        "import": "Import images and point annotations of other tools.",
        "convert": "Write a dataset in the format of another tool.",
        "validate": "Check a dataset against the specification.",
        "info": "Show a summary of a dataset.",
    },
    "Methods": {
        "methods": "List the available methods and their missing requirements.",
        "predict": "Run a method on the queries of a split.",
        "train": "Train a learned method; export a trained one.",
        "benchmark": "Run a reference benchmark, from data generation to table.",
    },
    "Scoring": {
        "submission": "Make a submission from CSV, JSON lines or Parquet.",
        "check": "List a submission's problems without scoring it.",
        "evaluate": "Score a submission by a named protocol.",
        "compare": "Compare reports by paired differences with intervals.",
        "leaderboard": "Write a page or a static site from many reports.",
    },
    "Publishing": {
        "publish": "Package a dataset for release, optionally without test labels.",
        "hub-results": "Write a report or receipt as results of a model on the Hugging Face Hub.",
        "challenge": "Run an evaluation service: create, invite, back up.",
        "serve": "Serve a challenge, or a static site to this machine.",
        "submit": "Send a submission to an evaluation service.",
        "verify": "Verify a receipt of an evaluation service.",
    },
    "Viewing": {
        "view": "Draw contact sheets, index colours, tracks and figures.",
        "explore": "Explore a dataset: truth, answers and heat maps of any pixel.",
        "match": "Match a pixel between any two pictures.",
        "annotate": "Click the same points in several pictures.",
    },
}
"""Section of `pliant --help` -> command -> one-line help."""

COMMANDS: Final = {
    name: about for commands in SECTIONS.values() for name, about in commands.items()
}


def module_of(name: str) -> str:
    """Return the module of a command, which is imported only when the command is called."""
    return f"pliant.cli.{'import_data' if name == 'import' else name.replace('-', '_')}"


class LazyGroup(click.Group):
    """A group whose commands are imported when they are called."""

    def list_commands(self, ctx: click.Context) -> list[str]:
        """Return the command names in the order of the sections."""
        return list(COMMANDS)

    def get_command(self, ctx: click.Context, cmd_name: str) -> click.Command | None:
        """Import one command's module and return its `command`, called as the table says."""
        if cmd_name not in COMMANDS:
            return None
        command: click.Command = importlib.import_module(module_of(cmd_name)).command
        command.name = cmd_name
        return command

    def resolve_command(
        self, ctx: click.Context, args: list[str]
    ) -> tuple[str | None, click.Command | None, list[str]]:
        """Find the command of a call; for a misspelt name, suggest the nearest ones."""
        try:
            return super().resolve_command(ctx, args)
        except click.exceptions.NoSuchCommand as error:
            # click looks for suggestions among commands that are loaded.
            raise click.exceptions.NoSuchCommand(
                error.command_name, possibilities=COMMANDS, ctx=ctx
            ) from None

    def format_commands(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        """Write the sections from the table above, importing nothing."""
        width = max(map(len, COMMANDS))
        for section, commands in SECTIONS.items():
            with formatter.section(section):
                formatter.write_dl([(f"{name:{width}}", text) for name, text in commands.items()])


@click.group(cls=LazyGroup, context_settings={"help_option_names": ["-h", "--help"]})
@click.version_option(package_name="pliant", prog_name="pliant")
def cli() -> None:
    """Pliant: dense pixel correspondence on deformable objects.

    Exit codes: 0 success, 1 invalid data, 2 invalid command line.
    """


def main(argv: list[str] | None = None) -> None:
    """Run the command line and exit with its code.

    Args:
        argv: Arguments without the program's name; None takes `sys.argv`.
    """
    # Importing modules makes many objects but hardly any garbage: with the usual thresholds, the
    # garbage collector takes a tenth of the time of commands that import PyTorch.
    gc.set_threshold(50_000, 20, 50)
    code = run(argv)
    # The interpreter searches all objects for cycles when it ends: half a second with PyTorch.
    gc.freeze()
    sys.exit(code)


def run(argv: list[str] | None = None) -> int:
    """Run the command line and return its exit code.

    Args:
        argv: Arguments without the program's name; None takes `sys.argv`.
    """
    # Torch's threads wait for each other asleep: spinning takes a third of a busy machine's time.
    os.environ.setdefault("OMP_WAIT_POLICY", "PASSIVE")
    try:
        result: Any = cli.main(args=argv, prog_name="pliant", standalone_mode=False)
    except click.ClickException as error:
        error.show()
        return error.exit_code
    except (click.exceptions.Abort, KeyboardInterrupt):
        echo("Stopped.", err=True)
        return 130
    except BrokenPipeError:
        return 1
    except (Exception, SystemExit) as error:
        message, code = _explained(error)
        if message is None:
            raise
        if isinstance(error, SystemExit) and (
            isinstance(error.__context__, BrokenPipeError)
            or _origin(error).startswith(click.core.__file__)
        ):
            return 1  # rich and click end the program where the reader of its output went away
        echo(f"Error: {message}", err=True)
        return code
    return result if isinstance(result, int) else 0


def _explained(error: BaseException) -> tuple[str | None, int]:
    """Return the sentence and exit code of an error, or no sentence for a fault of the program."""
    from pliant.spec.errors import MissingExtraError, PliantError
    from pliant.spec.extras import extra_of

    if isinstance(error, PliantError):
        return str(error), error.exit_code
    if isinstance(error, SystemExit):
        if os.environ.get("_PLIANT_COMPLETE"):  # click ends a shell completion so
            return None, CALL_WRONG
        return (
            f"{_origin(error)}: this code ended the program before the command was finished; "
            f"found sys.exit({error.code!r}). Remove the call from it",
            CALL_WRONG,
        )
    if isinstance(error, ModuleNotFoundError) and (extra := extra_of(error.name or "")):
        return str(MissingExtraError(f"module {error.name}", extra)), CALL_WRONG
    database = sys.modules.get("sqlalchemy.exc")
    if database is not None and isinstance(error, database.DBAPIError):
        return f"the database cannot be used; found {error.orig}", CALL_WRONG
    if isinstance(error, OSError) and (error.strerror or error.errno):
        place = f"{error.filename}: " if error.filename else ""
        return f"{place}{error.strerror or ' '.join(str(error).split())}", CALL_WRONG
    return None, CALL_WRONG


def _origin(error: SystemExit) -> str:
    """Return file and line of the call of `sys.exit`: Pliant has none, so it is a plug-in's."""
    frames = traceback.extract_tb(error.__traceback__)
    places = [(frame.filename, frame.lineno) for frame in frames]
    # A worker process sends its traceback as text.
    places += re.findall(r'File "([^"]+)", line (\d+)', str(error.__cause__))
    path, line = [each for each in places if not each[0].startswith("<")][-1]
    return f"{path}, line {line}"
