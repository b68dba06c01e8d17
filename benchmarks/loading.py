"""What loading costs: pairs from `PairDataset`, against decoding their PNGs and nothing else.

CPU time of one worker, in this process, loader and decoder taking turns over the same frames.

ratio_to_decoding  speed of the loader over that of decoding its two PNGs (1: equal)
pairs_per_s        pairs a CPU second, as in training: store, 160 x 120, augmentation
"""

from __future__ import annotations

import statistics
import tempfile
from pathlib import Path

from record import Value, cpu_s, main

from pliant.generator.config import GenerateConfig
from pliant.generator.runner.run import generate
from pliant.loaders import AugmentSettings, FrameStore, PairDataset
from pliant.spec.dataset import Dataset

TRAINING_SIZE = (160, 120)


def measure(quick: bool) -> dict[str, Value]:
    """Make a dataset and measure."""
    sequences, rounds = (24, 3) if quick else (100, 7)
    with tempfile.TemporaryDirectory() as folder:
        root = Path(folder)
        config = GenerateConfig(tiers=("rope",), splits={"train": sequences}, style="raster")
        generate(config, root / "set", workers=1)
        dataset = Dataset.open(root / "set")

        store = FrameStore(dataset, "rope", "train", TRAINING_SIZE, cache=root / "cache")
        samples = PairDataset(store, augmentation=AugmentSettings())

        def load(start: int) -> None:
            for number in range(start, start + sequences):
                samples[number]

        def decode(start: int) -> None:
            for number in range(2 * sequences):
                ref = store.frames[(start + number) % sequences]
                ref.sequence.rgb(ref.index)

        samples[0]  # what is only done once
        decode(0)
        for number in range(sequences):
            store.view(number)
        times: dict[str, list[float]] = {"decode": [], "load": []}
        for number in range(rounds):
            start = number * sequences
            times["decode"].append(cpu_s(lambda s=start: decode(s)))
            times["load"].append(cpu_s(lambda s=start: load(s)))
        pair_s = {name: statistics.median(values) / sequences for name, values in times.items()}
    return {
        "ratio_to_decoding": pair_s["decode"] / pair_s["load"],
        "pairs_per_s": 1 / pair_s["load"],
        "decode_ms_per_pair": 1e3 * pair_s["decode"],
        "load_ms_per_pair": 1e3 * pair_s["load"],
    }


if __name__ == "__main__":
    main("loading", measure, __doc__)
