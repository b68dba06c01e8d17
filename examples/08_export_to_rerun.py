"""Open a dataset in Rerun: pictures, depth, cameras, points and the mesh, frame by frame."""

import sys
from pathlib import Path

import pliant
from pliant.converters.convert import TARGETS, chosen_sequences, convert
from pliant.converters.targets.recording import Options

out = Path(sys.argv[1] if len(sys.argv) > 1 else "out")

sequences = chosen_sequences(pliant.load("sample"), split="val")
target = TARGETS["rerun"]  # or lerobot, coco, tapvid, webdataset, glb
folder = out / "recordings"
convert(sequences, target, folder, Options())
print(f"{len(sequences)} recordings in {folder}; it cannot store: {', '.join(target.lost)}")
print(f"rerun {folder}/*.rrd")
