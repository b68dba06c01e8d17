"""Protocols: frozen, named JSON files that say what is counted and how."""

from __future__ import annotations

import functools
import hashlib
import json
from collections.abc import Mapping
from dataclasses import dataclass
from importlib import resources
from typing import Any, Final

import jsonschema

from pliant.spec.errors import CallError

PROTOCOL_NAMES: Final = ("paper", "standard", "tapvid", "track", "matches")


@dataclass(frozen=True)
class Protocol:
    """One protocol, as its file says.

    Attributes:
        name: One of `PROTOCOL_NAMES`.
        version: `MAJOR.MINOR` of the protocol itself.
        kind: Kind of submission it scores, `answers` or `matches`.
        sha256: Of the protocol's file; two scores compare only where it is the same.
        headline: The metrics to show first.
        metrics: Family of metrics -> its settings; families not named are not computed.
        bootstrap: `replicates`, `seed` and `level` of the confidence intervals.
        document: The whole file.
    """

    name: str
    version: str
    kind: str
    sha256: str
    headline: tuple[str, ...]
    metrics: Mapping[str, Mapping[str, Any]]
    bootstrap: Mapping[str, Any]
    document: Mapping[str, Any]


@functools.cache
def read_protocol(name: str) -> Protocol:
    """Return a protocol by its name.

    Args:
        name: One of `PROTOCOL_NAMES`.

    Raises:
        CallError: There is no such protocol.
    """
    if name not in PROTOCOL_NAMES:
        raise CallError("no such protocol", found=repr(name), required=", ".join(PROTOCOL_NAMES))
    folder = resources.files("pliant.evaluator")
    text = (folder / "protocols" / f"{name}.json").read_bytes()
    document = json.loads(text)
    schema = json.loads((folder / "schemas" / "protocol.schema.json").read_bytes())
    jsonschema.validate(document, schema)
    return Protocol(
        name=document["name"],
        version=document["version"],
        kind=document["kind"],
        sha256=hashlib.sha256(text).hexdigest(),
        headline=tuple(document["headline"]),
        metrics=document["metrics"],
        bootstrap=document["bootstrap"],
        document=document,
    )
