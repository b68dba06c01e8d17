"""What loading costs: pairs from `PairDataset`, against decoding their PNGs and nothing else.

CPU time of one worker, in this process, loader and decoder taking turns over the same frames.

ratio_to_decoding           speed of the loader over that of decoding its two PNGs (1: equal)
ratio_to_decoding_first     the same on first sight, when every frame is decoded and stored
ratio_to_decoding_no_cache  the same with the store switched off: PNG, EXR and table each time
pairs_per_s                 pairs a CPU second, as in training: store, 160 x 120, augmentation
pairs_per_s_full_size       the same at the dataset's own 640 x 480
"""

from __future__ import annotations

import statistics
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

from record import Value, main

from pliant.generator.config import GenerateConfig
from pliant.generator.runner.run import generate
from pliant.loaders import AugmentSettings, FrameStore, PairDataset
from pliant.spec.dataset import Dataset

TRAINING_SIZE = (160, 120)


def cpu_s(work: Callable[[], object]) -> float:
    """Return the CPU seconds of a call."""
    started = time.process_time()
    work()
    return time.process_time() - started


def measure(quick: bool) -> dict[str, Value]:
    """Make a dataset and measure."""
    sequences, rounds = (24, 3) if quick else (100, 7)
    with tempfile.TemporaryDirectory() as folder:
        root = Path(folder)
        config = GenerateConfig(tiers=("rope",), splits={"train": sequences}, style="raster")
        generate(config, root / "set", workers=1)
        dataset = Dataset.open(root / "set")

        def pairs(size: tuple[int, int], cache: Path | None) -> PairDataset:
            return PairDataset(
                FrameStore(dataset, "rope", "train", size, cache=cache),
                augmentation=AugmentSettings(),
            )

        stored = pairs(TRAINING_SIZE, root / "cache")
        full = pairs(dataset.size, root / "cache")
        bare = pairs(TRAINING_SIZE, None)

        def load(samples: PairDataset, start: int) -> None:
            for number in range(start, start + sequences):
                samples[number]

        def decode(start: int) -> None:
            for number in range(2 * sequences):
                ref = stored.store.frames[(start + number) % sequences]
                ref.sequence.rgb(ref.index)

        bare[0], stored[0]  # what is only done once
        decode(0)
        first = cpu_s(lambda: [stored.store.view(n) for n in range(sequences)]) / sequences
        [full.store.view(n) for n in range(sequences)]
        times: dict[str, list[float]] = {"decode": [], "stored": [], "full": [], "bare": []}
        for number in range(rounds):
            start = number * sequences
            times["decode"].append(cpu_s(lambda s=start: decode(s)))
            times["stored"].append(cpu_s(lambda s=start: load(stored, s)))
            times["full"].append(cpu_s(lambda s=start: load(full, s)))
            times["bare"].append(cpu_s(lambda s=start: load(bare, s)))
        pair_s = {name: statistics.median(values) / sequences for name, values in times.items()}
    return {
        "ratio_to_decoding": pair_s["decode"] / pair_s["stored"],
        "ratio_to_decoding_first": pair_s["decode"] / (2 * first),
        "ratio_to_decoding_no_cache": pair_s["decode"] / pair_s["bare"],
        "ratio_to_decoding_full_size": pair_s["decode"] / pair_s["full"],
        "pairs_per_s": 1 / pair_s["stored"],
        "pairs_per_s_full_size": 1 / pair_s["full"],
        "decode_ms_per_pair": 1e3 * pair_s["decode"],
        "load_ms_per_pair": 1e3 * pair_s["stored"],
    }


if __name__ == "__main__":
    main("loading", measure, __doc__)
