"""What a move of the pointer costs on the page of `pliant explore`, with a shipped network.

Renders a rope and a cloth (640x480, style `raster`), opens an explorer of them with `don-rope` and
`don-cloth`, lets the networks see a pair, and then asks the server's own functions for pixels
spread over the object: truth, answer, heat map as PNG. A move uses one thread, so on a free core
its wall time is its CPU time, which other work on the machine does not disturb.
"""

from __future__ import annotations

import tempfile
import time
from pathlib import Path

import numpy as np
import record

from pliant.api import load, open_method
from pliant.generator.config import GenerateConfig
from pliant.generator.runner.run import generate
from pliant.spec.queries import RecordedPair
from pliant.viewer.explorer.app import Explorer
from pliant.viewer.explorer.layers import heat_png
from pliant.viewer.explorer.opening import open_explorer

MODELS = {"don-rope": "rope", "don-cloth": "cloth-1"}
MOVES = {True: 20, False: 100}


def move(explorer: Explorer, pair: RecordedPair) -> None:
    """Do what the page asks for when the pointer moves."""
    explorer.truth.find(pair)
    answer = explorer.methods[0].answer(pair)
    assert answer is not None
    assert answer.heat is not None
    heat_png(answer.heat)


def measure(quick: bool) -> dict[str, record.Value]:
    found: dict[str, record.Value] = {}
    with tempfile.TemporaryDirectory() as folder:
        data = Path(folder) / "data"
        config = GenerateConfig(
            tiers=tuple(MODELS.values()), splits={"test": 1}, frames=2, style="raster"
        )
        generate(config, data, workers=2)
        dataset = load(data)
        for name, tier in MODELS.items():
            explorer = open_explorer(dataset, [name], open_method)
            source, target = dataset.frames("test", tier)
            mask = source.mask
            assert mask is not None
            rows, columns = np.nonzero(mask)
            chosen = np.linspace(0, len(rows) - 1, MOVES[quick]).astype(int)
            places = np.stack([columns[chosen], rows[chosen]], axis=1) + 0.5
            pair = RecordedPair(source, target, places.astype(np.float32))
            begun = time.perf_counter()
            move(explorer, pair)
            first_s = time.perf_counter() - begun
            wall, cpu = [], []
            for place in places:
                begun, begun_cpu = time.perf_counter(), time.process_time()
                move(explorer, pair.at(place))
                wall.append(time.perf_counter() - begun)
                cpu.append(time.process_time() - begun_cpu)
            key = name.replace("-", "_")
            found[f"{key}_first_s"] = first_s
            found[f"{key}_move_ms"] = 1000 * float(np.median(wall))
            found[f"{key}_move_cpu_ms"] = 1000 * float(np.median(cpu))
            found[f"{key}_move_cpu_p95_ms"] = 1000 * float(np.quantile(cpu, 0.95))
    return found


if __name__ == "__main__":
    record.main("exploring", measure, __doc__)
