"""Options that several commands have."""

from __future__ import annotations

import click

set_option = click.option(
    "--set",
    "overrides",
    multiple=True,
    metavar="KEY=VALUE",
    help="Change one setting: a dotted key and a value in YAML, such as rope.structure=braid or "
    "optimiser.learning_rate=1e-3. Wins over files and other options.",
)
"""`--set KEY=VALUE`, as `pliant.spec.configuration.with_overrides` takes it."""
