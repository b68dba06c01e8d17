"""What a competition's pages, leaderboards and reference data say about a held-out split."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from pliant.evaluator.protocols.protocol import Protocol, read_protocol
from pliant.evaluator.report.cells import heading
from pliant.evaluator.submission.queries import read_queries
from pliant.publishing.held_out import PROTOCOL
from pliant.spec.dataset import Dataset


@dataclass(frozen=True)
class Column:
    """A column of the leaderboard.

    Attributes:
        key: The metric's name in the flat scores.
        title: Its heading, with the unit.
        about: What it is, in words.
        ascending: True where smaller is better.
        precision: Decimals shown.
    """

    key: str
    title: str
    about: str
    ascending: bool
    precision: int


@dataclass(frozen=True)
class Competition:
    """One held-out split of a dataset, as a competition.

    Attributes:
        dataset: `dataset.json` of the public half.
        split: The split.
        queries_sha256: Checksum of its queries, which submissions name.
        pairs: Image pairs.
        queries: Queries.
        sequences: Sequences that its pairs come from.
        protocol: The protocol that scores it.
        columns: The leaderboard, the ranking column first.
    """

    dataset: Mapping[str, Any]
    split: str
    queries_sha256: str
    pairs: int
    queries: int
    sequences: int
    protocol: Protocol
    columns: tuple[Column, ...]

    @property
    def rules(self) -> dict[str, Any]:
        """Return what the reference data's `competition.json` says."""
        return {
            "dataset": self.dataset["id"],
            "version": self.dataset["version"],
            "split": self.split,
            "protocol": self.protocol.name,
            "protocol_sha256": self.protocol.sha256,
        }


def describe(public: Path, split: str) -> Competition:
    """Read from a public half what a competition on one of its splits is.

    Args:
        public: The public half: `dataset.json`, `sequences.parquet` and the split's queries.
        split: The held-out split.

    Raises:
        SpecError: A file of it is missing or damaged.
    """
    dataset = Dataset.open(public)
    queries = read_queries(dataset, split)
    protocol = read_protocol(PROTOCOL)
    tiers = [tier for tier in dataset.tiers if tier in queries.tiers]
    main = protocol.headline[0]
    columns = [_column(metric, "", protocol) for metric in protocol.headline]
    if len(tiers) > 1:
        columns += [_column(main, tier, protocol) for tier in tiers]
    return Competition(
        dataset=dataset.info,
        split=split,
        queries_sha256=dataset.queries_sha256(split),
        pairs=queries.pairs,
        queries=queries.rows,
        sequences=len(queries.sequences),
        protocol=protocol,
        columns=tuple(columns),
    )


def _column(metric: str, tier: str, protocol: Protocol) -> Column:
    shown = heading(metric, protocol.name)
    return Column(
        key=f"{tier}.{metric}" if tier else metric,
        title=f"{tier}: {shown.text}" if tier else shown.text,
        about=f"{shown.about}, over tier {tier}" if tier else shown.about,
        ascending=shown.better != "higher",
        precision=2 if shown.unit == "px" else 3,
    )
