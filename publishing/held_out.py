"""Which data of held-out splits a published copy contains, and which it withholds."""

from __future__ import annotations

import hashlib
import math
from collections.abc import Collection, Mapping
from typing import Any, Final

import numpy as np
import numpy.typing as npt
import pyarrow as pa
import pyarrow.compute as pc

from pliant.evaluator.protocols.protocol import read_protocol
from pliant.evaluator.scores import BITS_PER_FIGURE
from pliant.spec.dataset import Dataset
from pliant.spec.errors import SpecError
from pliant.spec.io.png import PNG_SIGNATURE, png_chunks
from pliant.spec.tables import SEQUENCES

PROTOCOL: Final = "standard"
"""The protocol that challenges score by unless they name another one."""

MAX_SUBMISSIONS: Final = 100
"""Submissions that a challenge allows a team unless it says otherwise."""

_PICTURE_CHUNKS: Final = frozenset({b"IHDR", b"sRGB", b"gAMA", b"cHRM", b"IDAT", b"IEND"})


_NAMES_OF_FILES: Final = frozenset({"source", "sources", "pictures"})
"""Settings of `pliant import` with names of the host's files, by which the answers of known
pictures could be looked up."""


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
    again. So do the names of imported files. What the settings say in addition is how, not what.

    Args:
        info: The dataset's own.
        hold_out: The splits.
    """
    provenance = info["provenance"]
    config = without_seeds(provenance["config"])
    config = {key: value for key, value in config.items() if key not in _NAMES_OF_FILES}
    return {
        **info,
        "held_out": [split for split in info["splits"] if split in hold_out],
        "provenance": {**provenance, "seed": None, "config": config},
    }


def public_sequences(table: pa.Table, hold_out: Collection[str]) -> pa.Table:
    """Return `sequences.parquet` as published with splits held out.

    Args:
        table: The dataset's own.
        hold_out: The splits; their sequences lose shape, coverage and self-occlusion, which say
            where the object is, and no sequence keeps its seed.
    """
    rows = table.to_pylist()
    for row in rows:
        row["seed"] = 0
        if row["split"] in hold_out:
            row["shape"], row["coverage"], row["self_occluded"] = None, None, 0.0
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
    public = {**without_seeds(dict(document)), "seed": 0}
    if held_out:
        public |= {
            "shape": None,
            "parameters": {},
            "frame_info": [{} for _ in document["frame_info"]],
            "files": [],
        }
    return public


def picture_alone(data: bytes, name: str) -> bytes:
    """Return a PNG without any chunk or byte that is not the picture.

    Args:
        data: The file.
        name: The file, for messages.

    Raises:
        SpecError: It is not a PNG, or ends in the middle.
    """
    if not data.startswith(PNG_SIGNATURE):
        raise SpecError("this is not a PNG file", path=name)
    parts = [(kind, data[start:end]) for kind, start, end in png_chunks(data)]
    if not parts or parts[-1][0] != b"IEND":
        raise SpecError("the PNG ends in the middle", path=name)
    return PNG_SIGNATURE + b"".join(part for kind, part in parts if kind in _PICTURE_CHUNKS)


def listed(files: Mapping[str, bytes]) -> list[dict[str, Any]]:
    """Return the `files` of a `sequence.json`."""
    return [
        {"path": name, "sha256": hashlib.sha256(data).hexdigest(), "bytes": len(data)}
        for name, data in sorted(files.items())
    ]


def scores_reveal(dataset: Dataset, split: str, visible: int) -> str | None:
    """Return a warning if the scores of a competition may reveal a split's answers, None if not.

    A figure of four digits carries at most log2(9,000) bits, a position to one pixel as many as the
    image has pixels (docs/competitions.md, "What scores reveal"). What a participant learns from
    the submissions of a challenge is compared with the mean positions of the image pairs,
    which are found before single answers are.

    Args:
        dataset: The dataset.
        split: The held-out split.
        visible: Its visible answers.
    """
    queries = dataset.queries(split)
    tiers = pc.count_distinct(queries["tier"]).as_py()
    figures = len(read_protocol(PROTOCOL).headline) + (tiers if tiers > 1 else 0)
    bits = figures * BITS_PER_FIGURE
    of_position = math.log2(dataset.size[0] * dataset.size[1])
    positions = int(MAX_SUBMISSIONS * bits / of_position)
    pairs = pc.count_distinct(queries["pair_id"]).as_py()
    if pairs > positions:
        return None
    safe = int(pairs * of_position / bits)
    return (
        f"the scores of a competition may reveal answers of split {split}: {MAX_SUBMISSIONS} "
        f"submissions of {figures} figures reveal up to {positions:,} positions, and the split has "
        f"{pairs:,} image pairs with {visible:,} visible answers. Hold out more image pairs"
        + (f", or allow at most {safe:,} of these submissions" if safe else "")
    )


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
    names = [chunk for side in "ab" for chunk in queries[f"sequence_{side}"].chunks]
    codes = pa.chunked_array(names, pa.string()).combine_chunks().dictionary_encode().indices
    code_a, code_b = codes.to_numpy().reshape(2, len(queries))
    asked = _places(code_a, queries["frame_a"], queries["u_a"], queries["v_a"])
    answers = _places(code_b, queries["frame_b"], truth["u_b"], truth["v_b"])
    return int((np.isin(answers, asked) & visible).sum()), int(visible.sum())


def _places(sequence: npt.NDArray[np.int32], *columns: pa.ChunkedArray) -> npt.NDArray[np.void]:
    """Return per row the bits of its sequence, frame, u and v as one value, void16 (N,)."""
    bits = [column.to_numpy().view(np.int32) for column in columns]
    return np.stack([sequence, *bits], axis=1).view("V16").ravel()
