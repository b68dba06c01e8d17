"""What packing costs and gives: reading packed against loose, opening, publishing, size.

CPU time of this process, page cache warm, packed and loose taking turns over the same frames in
a shuffled order.

packed_to_loose_rgb       speed of reading and decoding a packed colour image over a loose one's
packed_to_loose_surface   the same for depth and surface images
packed_to_loose_pairs     the same for training pairs from `PairDataset` without its frame store
packed_to_loose_bytes     the same for the bare bytes of colour images, nothing decoded
open_ms                   opening a packed set of 200 sequences of 10 frames, and its first file
open_ms_100_times         the same with 100 times as many frames
open_ratio                the second over the first (1: constant in the number of frames)
publish_mb_per_s          loose megabytes published a CPU second (pack, hold out, checksums, papers)
packed_to_loose_size      bytes of the public half over the loose dataset's, nothing held out
"""

from __future__ import annotations

import random
import statistics
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

import pyarrow as pa
from record import Value, main

from pliant.generator.config import GenerateConfig
from pliant.generator.runner.run import generate
from pliant.loaders import FrameStore, PairDataset
from pliant.publishing import PublishSettings, publish
from pliant.spec.dataset import Dataset
from pliant.spec.io.jsonfiles import read_json, write_json
from pliant.spec.io.parquet import write_table
from pliant.spec.io.reading import read_bytes
from pliant.spec.storage import layout
from pliant.spec.storage.packing import FolderToPack, Packer
from pliant.spec.tables import SEQUENCES

LIMIT = 2**30


def cpu_s(work: Callable[[], object]) -> float:
    """Return the CPU seconds of a call, the system's for it among them."""
    started = time.process_time()
    work()
    return time.process_time() - started


def ratio(loose: Callable[[], object], packed: Callable[[], object], rounds: int) -> float:
    """Return the speed of the second over the first: the median of rounds that take turns."""
    loose(), packed()
    found = []
    for _ in range(rounds):
        one, two, three = cpu_s(loose), cpu_s(packed), cpu_s(loose)
        found.append((one + three) / 2 / two)
    return statistics.median(found)


def fake_packed_set(root: Path, like: Path, sequences: int, frames: int) -> None:
    """Write a packed set of many tiny files, to be opened."""
    document = read_json(like / layout.DATASET_JSON)
    root.mkdir()
    write_json(root / layout.DATASET_JSON, document)
    named = {"id": document["id"], "version": document["version"]}
    tier = document["tiers"][0]["name"]
    rows = [
        {
            "id": f"{tier}-train-{k:06d}",
            "tier": tier,
            "split": "train",
            "shape": None,
            "frames": frames,
            "temporal": True,
            "seed": 0,
            "style": "raster",
            "coverage": None,
            "self_occluded": 0.0,
        }
        for k in range(sequences)
    ]
    table = pa.Table.from_pylist(rows, schema=SEQUENCES)
    write_table(root / layout.SEQUENCES_TABLE, table, "sequences", {"dataset": named})
    with Packer(root, named) as packer:
        for row in rows:
            files = {layout.rgb_name(f): b"%06d" % f for f in range(frames)}
            packer.add(FolderToPack(row["id"], tier, "train", None, frames, files))


def open_ms(root: Path, rounds: int) -> float:
    """Return the median time to open a set and fetch one file, in milliseconds."""

    def work() -> None:
        sequence = Dataset.open(root).sequences[-1]
        read_bytes(sequence.file(layout.rgb_name(0)), LIMIT)

    work()
    return 1e3 * statistics.median(cpu_s(work) for _ in range(rounds))


def measure(quick: bool) -> dict[str, Value]:
    """Make a dataset, publish it, and measure."""
    sequences, rounds = (16, 3) if quick else (100, 7)
    with tempfile.TemporaryDirectory() as folder:
        root = Path(folder)
        config = GenerateConfig(
            tiers=("rope",),
            splits={"train": sequences, "test": 4},
            style="raster",
        )
        generate(config, root / "loose", workers=1)
        size = sum(
            path.stat().st_size
            for path in (root / "loose").rglob("*")
            if path.is_file() and ".pliant" not in path.parts
        )
        settings = PublishSettings(hold_out=("test",), answers_are_public=True)
        publish_s = cpu_s(lambda: publish(root / "loose", root / "held", settings))
        whole = publish(root / "loose", root / "packed")
        loose, packed = Dataset.open(root / "loose"), Dataset.open(root / "packed")
        order = [(k, f) for k, s in enumerate(loose.sequences) for f in range(s.frames)]
        random.Random(0).shuffle(order)

        def each(dataset: Dataset, read: Callable[..., object]) -> Callable[[], object]:
            return lambda: [read(dataset.sequences[k], frame) for k, frame in order]

        def bare(sequence: object, frame: int) -> object:
            return read_bytes(sequence.file(layout.rgb_name(frame)), LIMIT)  # type: ignore[attr-defined]

        readers: dict[str, Callable[..., object]] = {
            "rgb": lambda sequence, frame: sequence.rgb(frame),
            "surface": lambda sequence, frame: sequence.surface(frame),
            "bytes": bare,
        }
        ratios = {
            name: ratio(each(loose, read), each(packed, read), rounds)
            for name, read in readers.items()
        }
        pairs = [PairDataset(FrameStore(d, "rope", "train", (160, 120))) for d in (loose, packed)]
        count = sequences // 2

        def load(which: int) -> Callable[[], object]:
            return lambda: [pairs[which][k] for k in range(count)]

        ratios["pairs"] = ratio(load(0), load(1), max(3, rounds // 2))
        few, many = (200, 10), (200, 1000)
        fake_packed_set(root / "few", root / "loose", *few)
        fake_packed_set(root / "many", root / "loose", *many)
        times = [open_ms(root / name, 4 * rounds) for name in ("few", "many")]
    return {
        **{f"packed_to_loose_{name}": value for name, value in ratios.items()},
        "open_ms": times[0],
        "open_ms_100_times": times[1],
        "open_ratio": times[1] / times[0],
        "publish_mb_per_s": size / 1e6 / publish_s,
        "packed_to_loose_size": whole.bytes / size,
        "loose_mb": size / 1e6,
    }


if __name__ == "__main__":
    main("publishing", measure, __doc__)
