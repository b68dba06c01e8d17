"""What a dataset's own description tells the rules of its sequences."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from pliant.spec.model import Tier
from pliant.spec.storage.files import Files, LocalFiles


@dataclass(frozen=True)
class Context:
    """The facts of dataset.json that every sequence is checked against.

    Attributes:
        root: The dataset.
        files: Where the files of its sequences come from.
        quick: True leaves images and geometry alone.
        size: (width, height) of every image, px.
        tiers: Tier name -> tier.
        splits: The splits declared.
        held_out: Those of them published without their truth.
        identity: `id` and `version` of the dataset.
        seeded: Whether it states its seed; otherwise no sequence does.
    """

    root: Path
    files: Files
    quick: bool
    size: tuple[int, int]
    tiers: dict[str, Tier]
    splits: tuple[str, ...]
    held_out: frozenset[str]
    identity: dict[str, str]
    seeded: bool

    @classmethod
    def of(cls, root: Path, info: dict[str, Any], tiers: Iterable[Tier], quick: bool) -> Context:
        """Take the facts from a dataset.json that satisfies its schema, and its tiers."""
        return cls(
            root=root,
            files=LocalFiles(root),
            quick=quick,
            size=(info["image_size"]["width"], info["image_size"]["height"]),
            tiers={tier.name: tier for tier in tiers},
            splits=tuple(info["splits"]),
            held_out=frozenset(info.get("held_out", ())),
            identity={name: info[name] for name in ("id", "version")},
            seeded=info["provenance"]["seed"] is not None,
        )
