"""`pliant info`: what is in a dataset."""

from __future__ import annotations

from collections.abc import Container
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from pliant.cli.options import PATH, json_option
from pliant.cli.terminal import echo_json
from pliant.spec.text import plural

if TYPE_CHECKING:
    from pliant.spec.dataset import Dataset


@click.command("info")
@click.argument("folder", metavar="DIR", type=PATH)
@json_option
def command(folder: Path, as_json: bool) -> None:
    """Show a summary of the dataset DIR: tiers, splits, sequences, queries, provenance.

    It reads the top-level tables only; `pliant validate` reads everything.
    """
    from pliant.spec.dataset import Dataset

    document = describe(Dataset.open(folder))
    if as_json:
        echo_json(document)
    else:
        _print(document)


def describe(dataset: Dataset) -> dict[str, Any]:
    """Return the content of a dataset as one JSON object.

    Args:
        dataset: An open dataset.
    """
    import pyarrow.compute as pc

    from pliant.spec.io.parquet import read_table
    from pliant.spec.storage.layout import SEQUENCES_TABLE, queries_name, truth_name

    table = read_table(dataset.local(SEQUENCES_TABLE), "sequences")
    tiers = []
    for name, tier in dataset.tiers.items():
        rows = _without(table, "tier", dataset.tiers.keys() - {name})
        # Held-out sequences have a 0 in the place of what is occluded.
        measured = _without(rows, "split", dataset.held_out)
        tiers.append(
            {
                "name": name,
                "kind": tier.kind,
                "variant": tier.variant,
                "symmetries": [symmetry.name for symmetry in tier.symmetries],
                "sequences": _counted(rows["split"]),
                "frames": pc.sum(rows["frames"]).as_py() or 0,
                "episodes": pc.sum(rows["temporal"]).as_py() or 0,
                "shapes": _counted(rows["shape"]),
                "styles": sorted(_counted(rows["style"])),
                "coverage": _spread(rows["coverage"]),
                "self_occluded": _spread(measured["self_occluded"]),
            }
        )
    queries = {}
    for split in dataset.splits_with_queries():
        path = dataset.local(queries_name(split))
        pairs = read_table(path, "queries", ["pair_id"])["pair_id"]
        queries[split] = {
            "pairs": pc.count_distinct(pairs).as_py(),
            "queries": len(pairs),
            "sha256": dataset.queries_sha256(split),
            "truth": dataset.has(truth_name(split)),
        }
    info = dataset.info
    return {
        **{name: info[name] for name in ("id", "version", "spec_version", "title")},
        **{name: info[name] for name in ("description", "licence", "image_size")},
        "sequences": len(table),
        "frames": pc.sum(table["frames"]).as_py() or 0,
        "tiers": tiers,
        "queries": queries,
        **{name: info["provenance"][name] for name in ("generator", "seed", "tools")},
    }


def _without(table: Any, column: str, values: Container[str]) -> Any:
    """Return the rows in which a column has none of some values."""
    import pyarrow.compute as pc

    # Each value is Arrow's own: for a Python string, pyarrow imports pandas, which takes 0.2 s.
    for value in table[column].unique():
        if value.as_py() in values:
            table = table.filter(pc.not_equal(table[column], value))
    return table


def _counted(column: Any) -> dict[str, int]:
    """Return how many rows have each value, without the empty ones, in order of appearance."""
    return {
        each["values"]: each["counts"]
        for each in column.value_counts().to_pylist()
        if each["values"]
    }


def _spread(column: Any) -> dict[str, float] | None:
    import pyarrow.compute as pc

    if column.null_count == len(column):
        return None
    bounds = pc.min_max(column).as_py()
    mean = pc.mean(column).as_py()
    return {key: round(value, 4) for key, value in (*bounds.items(), ("mean", mean))}


def _print(document: dict[str, Any]) -> None:
    from rich.console import Console
    from rich.table import Table

    console = Console(highlight=False, soft_wrap=True, markup=False)
    size = document["image_size"]
    console.print(document["title"], style="bold")
    console.print(
        f"{document['id']} {document['version']}, specification {document['spec_version']}, "
        f"{document['licence']}, {size['width']}x{size['height']} px\n"
        f"{plural(document['sequences'], 'sequence')}, {plural(document['frames'], 'frame')}; "
        f"made by {document['generator']}, "
        f"{'no seed given' if document['seed'] is None else 'seed ' + str(document['seed'])}"
    )
    table = Table()
    heads = ("tier", "sequences", "frames", "shapes", "coverage", "self-\noccluded", "symmetries")
    for name in heads:  # their words stay whole on 80 columns
        width = max(map(len, name.splitlines()))
        table.add_column(name, justify="right" if name == "frames" else "left", min_width=width)
    for tier in document["tiers"]:
        episodes = f"\n({plural(tier['episodes'], 'episode')})" if tier["episodes"] else ""
        table.add_row(
            tier["name"],
            _counts(tier["sequences"]) + episodes,
            f"{tier['frames']:,}",
            _counts(tier["shapes"]) or "-",
            _mean(tier["coverage"]),
            _mean(tier["self_occluded"]),
            str(len(tier["symmetries"])),
        )
    console.print(table)
    for split, asked in document["queries"].items():
        truth = "" if asked["truth"] else ", truth held out"
        console.print(
            f"queries {split}: {asked['queries']:,} in {asked['pairs']:,} pairs{truth}, "
            f"sha256 {asked['sha256'][:16]}…"
        )


def _counts(counts: dict[str, int]) -> str:
    from pliant.spec.text import escaped

    return "\n".join(f"{escaped(name)} {count}" for name, count in counts.items())


def _mean(values: dict[str, float] | None) -> str:
    return "-" if values is None else f"{values['mean']:.2f}"
