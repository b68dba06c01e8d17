"""The Arrow schema of every Parquet table: declared here once, rendered into SPEC.md.

Each field carries its unit and its meaning in its metadata (`unit`, `doc`, and `range`
where one is bounded).
"""

from __future__ import annotations

from typing import Final

import pyarrow as pa


def _field(
    name: str,
    kind: pa.DataType,
    doc: str,
    *,
    unit: str = "",
    within: str = "",
    nullable: bool = False,
) -> pa.Field:
    metadata = {"doc": doc}
    if unit:
        metadata["unit"] = unit
    if within:
        metadata["range"] = within
    return pa.field(name, kind, nullable=nullable, metadata=metadata)


_VISIBILITY = "visible | self_occluded | occluded | out_of_frame"

SEQUENCES: Final = pa.schema(
    [
        _field("id", pa.string(), "sequence id, unique in the dataset; its folder's name"),
        _field("tier", pa.string(), "name of a tier of dataset.json"),
        _field(
            "split", pa.string(), "split the whole sequence belongs to", within="train | val | test"
        ),
        _field(
            "shape",
            pa.string(),
            "named shape of the object, null where a tier has none",
            nullable=True,
        ),
        _field("frames", pa.int32(), "number of frames", within=">= 1"),
        _field(
            "temporal",
            pa.bool_(),
            "true: an episode, frames in time; false: independent configurations",
        ),
        _field(
            "seed",
            pa.int64(),
            "seed of the whole dataset this sequence was drawn from",
            within=">= 0",
        ),
        _field(
            "style",
            pa.string(),
            "what made the colour images",
            within="photo | fast | raster | real-depth | external",
        ),
        _field(
            "coverage",
            pa.float32(),
            "cloth: mean over frames of silhouette area over flat area; null elsewhere",
            nullable=True,
        ),
        _field(
            "self_occluded",
            pa.float32(),
            "mean over frames of the share of surface points in state self_occluded",
            within="0 to 1",
        ),
    ]
)

POINTS: Final = pa.schema(
    [
        _field("point", pa.int32(), "point id: 0, 1, 2 … in row order", within=">= 0"),
        _field("object", pa.int32(), "id of the object the point belongs to", within=">= 1"),
        _field("kind", pa.string(), "where the point lies", within="surface | centreline"),
        _field("m0", pa.float32(), "first material coordinate (rope: s; cloth: u)"),
        _field("m1", pa.float32(), "second material coordinate (rope: theta, rad; cloth: v)"),
        _field(
            "partners",
            pa.list_(pa.field("item", pa.int32(), nullable=False)),
            "per symmetry of the tier, in order: the point this one is mapped to",
        ),
    ]
)

CORRESPONDENCES: Final = pa.schema(
    [
        _field("frame", pa.int32(), "frame of the sequence", within=">= 0"),
        _field("point", pa.int32(), "point id of points.parquet"),
        _field(
            "u_px", pa.float32(), "horizontal image coordinate of the projected point", unit="px"
        ),
        _field("v_px", pa.float32(), "vertical image coordinate of the projected point", unit="px"),
        _field("depth_m", pa.float32(), "planar camera-space z of the point", unit="m"),
        _field("visibility", pa.string(), "state of the point in this frame", within=_VISIBILITY),
        _field("x_m", pa.float32(), "world position of the point", unit="m"),
        _field("y_m", pa.float32(), "world position of the point", unit="m"),
        _field("z_m", pa.float32(), "world position of the point", unit="m"),
    ]
)

QUERIES: Final = pa.schema(
    [
        _field(
            "pair_id",
            pa.int32(),
            "image pair; consecutive from 0, ascending in the file",
            within=">= 0",
        ),
        _field(
            "query_id",
            pa.int32(),
            "query within its pair; consecutive from 0, ascending in the pair",
            within=">= 0",
        ),
        _field("tier", pa.string(), "tier of both frames"),
        _field("sequence_a", pa.string(), "sequence of the source frame"),
        _field("frame_a", pa.int32(), "source frame"),
        _field("sequence_b", pa.string(), "sequence of the target frame"),
        _field("frame_b", pa.int32(), "target frame"),
        _field(
            "u_a", pa.float32(), "query pixel in the source frame, on visible surface", unit="px"
        ),
        _field(
            "v_a", pa.float32(), "query pixel in the source frame, on visible surface", unit="px"
        ),
    ]
)

_ALTERNATIVE = pa.struct(
    [
        pa.field("u", pa.float32(), nullable=False),
        pa.field("v", pa.float32(), nullable=False),
        pa.field("visibility", pa.string(), nullable=False),
    ]
)

TRUTH: Final = pa.schema(
    [
        _field(
            "pair_id",
            pa.int32(),
            "as in the queries; row i of the truth answers row i of the queries",
        ),
        _field("query_id", pa.int32(), "as in the queries"),
        _field("tier", pa.string(), "as in the queries"),
        _field("point", pa.int32(), "the material point under the query"),
        _field("u_b", pa.float32(), "where the point projects to in the target frame", unit="px"),
        _field("v_b", pa.float32(), "where the point projects to in the target frame", unit="px"),
        _field(
            "visibility_b",
            pa.string(),
            "state of the point in the target frame",
            within=_VISIBILITY,
        ),
        _field(
            "box_px",
            pa.float32(),
            "longer side of the queried object's visible box in the target frame",
            unit="px",
            within="> 0",
        ),
        _field(
            "alternatives",
            pa.list_(pa.field("item", _ALTERNATIVE, nullable=False)),
            "per symmetry of the tier, in order: where the partner is in the target frame",
        ),
    ]
)

_MODE = pa.struct(
    [
        pa.field("u", pa.float32(), nullable=False),
        pa.field("v", pa.float32(), nullable=False),
        pa.field("sigma", pa.float32(), nullable=False),
        pa.field("weight", pa.float32(), nullable=False),
    ]
)

ANSWERS: Final = pa.schema(
    [
        _field("pair_id", pa.int32(), "as in the queries"),
        _field("query_id", pa.int32(), "as in the queries"),
        _field("u", pa.float32(), "predicted position in the target frame", unit="px"),
        _field("v", pa.float32(), "predicted position in the target frame", unit="px"),
    ]
)
"""The required columns of a submission of kind `answers`; any order, extra columns allowed."""

ANSWERS_OPTIONAL: Final = pa.schema(
    [
        _field(
            "visible",
            pa.float32(),
            "predicted probability that the point is visible in the target frame",
            within="0 to 1",
        ),
        _field(
            "sigma",
            pa.float32(),
            "standard deviation of an isotropic Gaussian around (u, v)",
            unit="px",
            within="> 0",
        ),
        _field(
            "modes",
            pa.list_(pa.field("item", _MODE, nullable=False)),
            "mixture of isotropic Gaussians; weights sum to 1 within 1e-3",
        ),
    ]
)
"""Columns a submission of kind `answers` may add (`sigma` or `modes`, not both)."""

MATCHES: Final = pa.schema(
    [
        _field("pair_id", pa.int32(), "as in the queries"),
        _field("u_a", pa.float32(), "keypoint in the source frame", unit="px"),
        _field("v_a", pa.float32(), "keypoint in the source frame", unit="px"),
        _field("u", pa.float32(), "its match in the target frame", unit="px"),
        _field("v", pa.float32(), "its match in the target frame", unit="px"),
        _field("score", pa.float32(), "confidence, higher is better"),
    ]
)
"""The columns of a submission of kind `matches`: a sparse method's own keypoint matches."""

INDEX: Final = pa.schema(
    [
        _field("id", pa.string(), "sequence id; row i is that of row i of sequences.parquet"),
        _field(
            "files",
            pa.list_(
                pa.field(
                    "item",
                    pa.struct(
                        [
                            pa.field("path", pa.string(), nullable=False),
                            pa.field("shard", pa.string(), nullable=False),
                            pa.field("offset", pa.int64(), nullable=False),
                            pa.field("bytes", pa.int64(), nullable=False),
                        ]
                    ),
                    nullable=False,
                )
            ),
            "every file of the sequence's folder: its path there, the shard that holds it, and "
            "the range of that shard's bytes which is the file",
        ),
    ]
)
"""The index of a packed dataset."""

TABLES: Final[dict[str, pa.Schema]] = {
    "sequences": SEQUENCES,
    "points": POINTS,
    "correspondences": CORRESPONDENCES,
    "index": INDEX,
    "queries": QUERIES,
    "truth": TRUTH,
    "answers": ANSWERS,
    "matches": MATCHES,
}
"""Every table by its name, as the footer's `table` names it."""
