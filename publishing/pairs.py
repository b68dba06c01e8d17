"""`pairs/SPLIT.parquet`: a row per image pair, with both pictures, the queries and their answers.

The dataset viewer of the Hugging Face Hub shows them; Pliant itself does not read them.
"""

from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any, Final

import pyarrow as pa
import pyarrow.parquet as pq

from pliant.spec.dataset import Dataset
from pliant.spec.io import limits
from pliant.spec.io.reading import read_bytes
from pliant.spec.storage import layout
from pliant.spec.storage.packing import IMAGE, hub_features

_GROUP_PAIRS: Final = 16
_QUERIES: Final = ("u_a", "v_a")
_ANSWERS: Final = ("u_b", "v_b", "visibility_b")

SCHEMA: Final = pa.schema(
    [
        ("pair_id", pa.int32()),
        *[(name, pa.string()) for name in ("tier", "frame_a", "frame_b")],
        *[(name, IMAGE) for name in ("image_a", "image_b")],
        *[(name, pa.list_(pa.float32())) for name in (*_QUERIES, *_ANSWERS[:2])],
        ("visibility_b", pa.list_(pa.string())),
    ]
)


def write_pairs(dataset: Dataset, root: Path) -> None:
    """Write the pairs of every split whose answers are public.

    Args:
        dataset: The public half, packed.
        root: Its folder.
    """
    features = json.dumps({"info": {"features": hub_features(SCHEMA)}}, sort_keys=True)
    schema = SCHEMA.with_metadata({"huggingface": features})
    for split in dataset.splits_with_queries():
        if not dataset.has(layout.truth_name(split)):
            continue
        path = root / layout.pairs_name(split)
        path.parent.mkdir(exist_ok=True)
        with pq.ParquetWriter(path, schema, compression="none", use_dictionary=False) as writer:
            rows: list[dict[str, Any]] = []
            for row in _rows(dataset, split):
                rows.append(row)
                if len(rows) == _GROUP_PAIRS:
                    writer.write_table(pa.Table.from_pylist(rows, schema))
                    rows.clear()
            writer.write_table(pa.Table.from_pylist(rows, schema))


def _rows(dataset: Dataset, split: str) -> Iterator[dict[str, Any]]:
    queries, truth = dataset.queries(split), dataset.truth(split)
    start = 0
    for pair in dataset.pairs(split):
        stop = start + len(pair)
        asked, answered = queries.slice(start, stop - start), truth.slice(start, stop - start)
        pictures: dict[str, Any] = {}
        for side, frame in (("a", pair.source), ("b", pair.target)):
            name = layout.rgb_name(frame.index)
            file = frame.sequence.file(name)
            pictures[f"frame_{side}"] = frame.key
            pictures[f"image_{side}"] = {
                "bytes": read_bytes(file, limits.MAX_IMAGE_FILE_BYTES),
                "path": f"{frame.sequence.id}-{Path(name).name}",
            }
        yield {
            "pair_id": pair.pair_id,
            "tier": asked["tier"][0].as_py(),
            **pictures,
            **{name: asked[name].to_pylist() for name in _QUERIES},
            **{name: answered[name].to_pylist() for name in _ANSWERS},
        }
        start = stop
