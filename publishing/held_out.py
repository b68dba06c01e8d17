"""What a published copy tells, and what it keeps to itself, of splits that are held out."""

from __future__ import annotations

import hashlib
import json
import struct
from collections.abc import Collection, Mapping
from typing import Any, Final

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc

from pliant.spec.dataset import Dataset
from pliant.spec.errors import SpecError
from pliant.spec.storage import layout
from pliant.spec.tables import SEQUENCES

GUESSABLE_BELOW: Final = 2**48
"""A seed below this can be found by trying: a machine tries a million a second."""

_SIGNATURE: Final = b"\x89PNG\r\n\x1a\n"
_PICTURE_CHUNKS: Final = frozenset({b"IHDR", b"sRGB", b"gAMA", b"cHRM", b"IDAT", b"IEND"})


def without_seeds(value: Any) -> Any:
    """Return a JSON value without any field called `seed` or `…_seed`, however deep."""
    if isinstance(value, dict):
        return {
            key: without_seeds(item)
            for key, item in value.items()
            if not (key == "seed" or key.endswith("_seed"))
        }
    if isinstance(value, list):
        return [without_seeds(item) for item in value]
    return value


def public_info(info: Mapping[str, Any], hold_out: Collection[str]) -> dict[str, Any]:
    """Return `dataset.json` as published with splits held out.

    The seed goes, of the settings too: with it anybody could generate the held-out answers
    again. What the settings say besides is how, not what.

    Args:
        info: The dataset's own.
        hold_out: The splits.
    """
    public = json.loads(json.dumps(info))
    public["held_out"] = [split for split in info["splits"] if split in hold_out]
    provenance = public["provenance"]
    public["provenance"] = {
        **provenance,
        "seed": None,
        "config": without_seeds(provenance["config"]),
    }
    return dict(public)


def public_sequences(table: pa.Table, hold_out: Collection[str]) -> pa.Table:
    """Return `sequences.parquet` as published with splits held out.

    Args:
        table: The dataset's own.
        hold_out: The splits; their sequences lose coverage and self-occlusion, which are
            measured on the truth, and no sequence keeps its seed.
    """
    rows = table.to_pylist()
    for row in rows:
        row["seed"] = 0
        if row["split"] in hold_out:
            row["coverage"], row["self_occluded"] = None, 0.0
    return pa.Table.from_pylist(rows, schema=SEQUENCES)


def public_document(document: Mapping[str, Any], *, held_out: bool) -> dict[str, Any]:
    """Return a `sequence.json` as published where any split is held out.

    Args:
        document: The sequence's own.
        held_out: Whether its own split is.

    Returns:
        Without the seed; of a held-out sequence, without what was drawn or measured either. Its
        `files` are the caller's to list.
    """
    public = dict(without_seeds(json.loads(json.dumps(document))))
    public["seed"] = 0
    if held_out:
        public["parameters"] = {}
        public["frame_info"] = [{} for _ in document["frame_info"]]
        public["files"] = []
    return public


def picture_alone(data: bytes, name: str) -> bytes:
    """Return a PNG without any chunk or byte that is not the picture.

    Args:
        data: The file.
        name: The file, for messages.

    Raises:
        SpecError: It is no PNG, or ends in the middle.
    """
    if data[:8] != _SIGNATURE:
        raise SpecError("this is no PNG file", path=name)
    kept, at = [_SIGNATURE], 8
    while at + 12 <= len(data):
        (length,) = struct.unpack_from(">I", data, at)
        kind, end = data[at + 4 : at + 8], at + 12 + length
        if kind in _PICTURE_CHUNKS:
            kept.append(data[at:end])
        at = end
        if kind == b"IEND":
            return b"".join(kept)
    raise SpecError("the PNG ends in the middle", path=name)


def listed(files: Mapping[str, bytes]) -> list[dict[str, Any]]:
    """Return the `files` of a `sequence.json`."""
    return [
        {"path": name, "sha256": hashlib.sha256(data).hexdigest(), "bytes": len(data)}
        for name, data in sorted(files.items())
    ]


def guessable(dataset: Dataset, hold_out: Collection[str]) -> list[int]:
    """Return the seeds of held-out sequences that somebody could find by trying."""
    table = _table(dataset)
    held = table.filter(pc.is_in(table["split"], pa.array(sorted(hold_out), pa.string())))
    generated = {style for style in held["style"].to_pylist() if style != "external"}
    seeds = set(held["seed"].to_pylist()) if generated else set()
    if dataset.info["provenance"]["seed"] is None:
        return []
    return sorted(seed for seed in seeds if seed < GUESSABLE_BELOW)


def shown_answers(dataset: Dataset, split: str) -> tuple[int, int]:
    """Count the answers of a split that its own questions show.

    A query's pixel is the exact position of a point. Where a frame is the source of one pair and
    the target of another, and both ask the same point, the queries of the first hold the answer
    to the second (though not which one it is).

    Args:
        dataset: The dataset, with its truth.
        split: The split.

    Returns:
        How many visible answers stand among the query pixels of their frame; visible answers.
    """
    queries, truth = dataset.queries(split), dataset.truth(split)
    visible = pc.equal(truth["visibility_b"], "visible").to_numpy()
    asked = _places(queries, "a", queries["u_a"], queries["v_a"])
    answers = _places(queries, "b", truth["u_b"], truth["v_b"])
    seen = np.isin(answers, asked) & visible
    return int(seen.sum()), int(visible.sum())


def _places(queries: pa.Table, side: str, u: pa.ChunkedArray, v: pa.ChunkedArray) -> Any:
    """Return a record for each row: the frame's key and the bits of a position in it."""
    names = queries[f"sequence_{side}"].combine_chunks().dictionary_encode()
    known = {name: k for k, name in enumerate(sorted(_ids(queries)))}
    codes = np.array([known[name] for name in names.dictionary.to_pylist()], np.int32)
    record = np.zeros(
        len(u), [("sequence", np.int32), ("frame", np.int32), ("u", np.int32), ("v", np.int32)]
    )
    record["sequence"] = codes[names.indices.to_numpy()] if len(codes) else 0
    record["frame"] = queries[f"frame_{side}"].to_numpy()
    record["u"] = u.to_numpy().view(np.int32)
    record["v"] = v.to_numpy().view(np.int32)
    return record.view("V16")


def _ids(queries: pa.Table) -> set[str]:
    return {name for side in "ab" for name in pc.unique(queries[f"sequence_{side}"]).to_pylist()}


def _table(dataset: Dataset) -> pa.Table:
    from pliant.spec.io.parquet import read_table

    return read_table(dataset.local(layout.SEQUENCES_TABLE), "sequences")
