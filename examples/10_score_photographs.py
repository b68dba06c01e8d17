"""Score methods on photographs with points that somebody has clicked."""

import csv
import sys
from pathlib import Path

import numpy as np
from PIL import Image

import pliant
from pliant.converters import ImportSettings, read_source, write_imported

out = Path(sys.argv[1] if len(sys.argv) > 1 else "out")
photos = out / "photos"
photos.mkdir(parents=True, exist_ok=True)

# Use your own photographs, and marks that `pliant annotate photos` writes. This example takes
# pictures of the sample, with six points along the rope.
sequence = pliant.load("sample").sequence("rope-val-000000")
rows = [["picture", "point", "x", "y", "visible"]]
points = np.linspace(0, sequence.points().num_rows - 102, 6).round().astype(int)
for frame in sequence:
    Image.fromarray(frame.rgb).save(photos / f"{frame.index}.png")
    table = frame.correspondences.to_pylist()
    for point in points:
        seen = table[point]["visibility"] == "visible"
        u, v = table[point]["u_px"], table[point]["v_px"]
        rows.append([f"{frame.index}.png", f"mark {point}", u, v, int(seen)])
with open(photos / "annotations.csv", "w", newline="") as file:
    csv.writer(file).writerows(rows)

source = read_source(photos)  # or COCO, LabelMe, TAP-Vid files
write_imported(source.clips, out / "imported", ImportSettings("photos"), source.facts)
truth = out / "imported-truth" / "test.parquet"
for name in ("identity", "sift"):
    answers = pliant.predict(out / "imported", name)
    scores = pliant.evaluate(out / "imported", answers, truth=truth)
    print(f"{name:9} {scores.overall['rmse_px']:.1f} px")
