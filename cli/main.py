"""The `pliant` command: a lazy group over the commands, and the one place that exits."""

from __future__ import annotations

import importlib
import sys
from typing import Any

import click

from pliant.cli.terminal import echo

CALL_WRONG = 2

# name -> (module, one-line help). The module is imported only when the command is called,
# so that `pliant --help` needs none of them.
COMMANDS: dict[str, tuple[str, str]] = {
    "demo": ("pliant.cli.demo", "Generate and score a small benchmark, with a report."),
    "generate": ("pliant.cli.generate", "Render datasets; run again to resume."),
    "import": ("pliant.cli.import_data", "Import images and point annotations of other tools."),
    "validate": ("pliant.cli.validate", "Check a dataset against the specification."),
    "info": ("pliant.cli.info", "Show a summary of a dataset."),
    "view": ("pliant.cli.view", "Draw contact sheets, index colours, tracks and figures."),
    "publish": (
        "pliant.cli.publish",
        "Package a dataset for release, optionally without test labels.",
    ),
    "predict": ("pliant.cli.predict", "Run a method on the queries of a split."),
    "methods": ("pliant.cli.methods", "List the methods that are installed."),
    "train": ("pliant.cli.train", "Train a learned method."),
    "export": ("pliant.cli.export", "Export a trained model with its model card."),
    "submit-template": ("pliant.cli.submit_template", "Write an empty submission to fill in."),
    "check": ("pliant.cli.check", "List a submission's problems without scoring it."),
    "evaluate": ("pliant.cli.evaluate", "Score a submission by a named protocol."),
    "compare": ("pliant.cli.compare", "Paired differences between reports, with intervals."),
    "leaderboard": ("pliant.cli.leaderboard", "One page from many reports."),
    "site": ("pliant.cli.site", "Write the leaderboard and its reports as a static site."),
    "serve": ("pliant.cli.serve", "Serve a static site to this machine."),
    "benchmark": ("pliant.cli.benchmark", "Make a reference benchmark, from config to table."),
    "annotate": ("pliant.cli.annotate", "Click the same points in several pictures."),
    "explore": (
        "pliant.cli.explore",
        "Point at one picture; see truth, answers and heat maps in another.",
    ),
    "match": ("pliant.cli.match", "Match a pixel between any two pictures."),
    "spec": ("pliant.cli.spec", "Print or write the specification's schemas."),
    "migrate": ("pliant.cli.migrate", "Bring a dataset to the current specification version."),
}

FORMER_NAMES = {"ship": "export"}
"""Names that commands had before: they still work and are not listed."""


class LazyGroup(click.Group):
    """A group whose commands are imported when they are called."""

    def list_commands(self, ctx: click.Context) -> list[str]:
        """Return the command names in the order of the main job."""
        return list(COMMANDS)

    def get_command(self, ctx: click.Context, cmd_name: str) -> click.Command | None:
        """Import one command's module and return its `command`."""
        cmd_name = FORMER_NAMES.get(cmd_name, cmd_name)
        if cmd_name not in COMMANDS:
            return None
        command: click.Command = importlib.import_module(COMMANDS[cmd_name][0]).command
        return command

    def format_commands(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        """Write the command list from the table above, importing nothing."""
        with formatter.section("Commands"):
            formatter.write_dl([(name, text) for name, (_, text) in COMMANDS.items()])


@click.group(cls=LazyGroup, context_settings={"help_option_names": ["-h", "--help"]})
@click.version_option(package_name="pliant", prog_name="pliant")
def cli() -> None:
    """Pliant: dense pixel correspondence on deformable objects.

    Exit codes: 0 success, 1 invalid data, 2 invalid command line.
    """


def _operating_system(error: OSError) -> str:
    """Return what the operating system refused, in one line: no space, no permission, no file."""
    place = f"{error.filename}: " if error.filename else ""
    return f"{place}{error.strerror or ' '.join(str(error).split())}"


def main(argv: list[str] | None = None) -> None:
    """Run the command line and exit with its code.

    Args:
        argv: Arguments without the program's name; None takes `sys.argv`.
    """
    sys.exit(run(argv))


def run(argv: list[str] | None = None) -> int:
    """Run the command line and return its exit code.

    Args:
        argv: Arguments without the program's name; None takes `sys.argv`.
    """
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
    except Exception as error:
        from pliant.spec.errors import PliantError

        if isinstance(error, OSError) and (error.strerror or error.errno):
            echo(f"Error: {_operating_system(error)}", err=True)
            return CALL_WRONG
        if not isinstance(error, PliantError):
            raise
        echo(f"Error: {error}", err=True)
        return error.exit_code
    return result if isinstance(result, int) else 0
