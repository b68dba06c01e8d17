"""Fill a template with pixels of the nearest colour: python nearest_colour.py DATASET TEMPLATE."""

import functools
import json
import sys
from pathlib import Path

import numpy as np
import pyarrow.parquet as pq
from PIL import Image, ImageFilter

root, path = Path(sys.argv[1]), sys.argv[2]
table = pq.read_table(path)
split = json.loads(table.schema.metadata[b"pliant"])["split"]
queries = pq.read_table(root / "queries" / f"{split}.parquet").to_pylist()  # in the table's order


@functools.lru_cache(maxsize=4)
def describe(tier, sequence, frame):
    """Return the colour of every pixel and of ever larger squares about it, (H, W, 12)."""
    image = Image.open(root / "sequences" / tier / sequence / "rgb" / f"{frame:06d}.png")
    blurred = [image.filter(ImageFilter.BoxBlur(radius)) for radius in (1, 4, 12, 36)]
    return np.concatenate([np.asarray(each, np.float32) for each in blurred], axis=2)


found = np.empty((2, len(queries)), np.float32)
for row, query in enumerate(queries):
    source = describe(query["tier"], query["sequence_a"], query["frame_a"])
    target = describe(query["tier"], query["sequence_b"], query["frame_b"])
    look = source[int(query["v_a"]), int(query["u_a"])]  # pixel row floor(v), column floor(u)
    error = np.square(target - look).sum(axis=2)
    v, u = np.unravel_index(error.argmin(), error.shape)
    found[:, row] = u + 0.5, v + 0.5  # the centre of that pixel

for name, values in zip("uv", found, strict=True):
    table = table.set_column(table.column_names.index(name), name, [values])
pq.write_table(table, path)
