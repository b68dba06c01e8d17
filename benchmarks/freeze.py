"""Freeze a benchmark's test questions: make every test split, write the file of checksums.

`python benchmarks/freeze.py benchmarks/pliant-v2.yaml --out DIR` writes the file that the config
names under `checksums`. DIR may be one that was begun.
"""

from __future__ import annotations

from pathlib import Path

import click

from pliant.benchmarks.suite.config import read_config
from pliant.benchmarks.suite.freezing import frozen_questions
from pliant.spec.io.jsonfiles import write_json


@click.command(help=__doc__)
@click.argument("config", type=click.Path(exists=True, dir_okay=False, path_type=Path))
@click.option("--out", required=True, type=click.Path(file_okay=False, path_type=Path))
@click.option("--workers", default=1, show_default=True)
def main(config: Path, out: Path, workers: int) -> None:
    """Make the test splits and write the checksums."""
    benchmark = read_config(config)
    if benchmark.checksums is None:
        raise click.UsageError(f"{config} names no file of checksums")

    def tell(message: str) -> None:
        click.echo(message, err=True)

    document = frozen_questions(benchmark, out, workers=workers, tell=tell)
    write_json(benchmark.checksums, document)
    tell(f"Wrote {benchmark.checksums}")


if __name__ == "__main__":
    main()
