"""Two local Ray nodes of one core against two local workers: what the cluster itself costs.

Makes the same rope episodes (640x480, `raster`, everything written) with both engines in turns, and
then the files of the whole dataset. Each worker's first sequence is left out: it loads code.

cpu_s_per_image_*          CPU s of the workers per image
cpu_ratio_ray              its ratio, Ray over local
driver_ms_per_sequence_*   CPU ms of the process that hands out the sequences
finish_ms_per_sequence     CPU ms of the end of a run (tables, `dataset.json`): one process
"""

from __future__ import annotations

import os
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np
from record import Value, main

from pliant.generator.config import GenerateConfig
from pliant.generator.runner.dataset_files import write_dataset_files
from pliant.generator.runner.engine import Engine, Failed, Finished, SequenceResult
from pliant.generator.runner.engine_local import LocalEngine
from pliant.generator.runner.engine_ray import RayEngine
from pliant.generator.runner.plan import plan_tasks
from pliant.generator.runner.run import sequence_maker


def measure(quick: bool) -> dict[str, Value]:
    sequences, frames, rounds = (8, 10, 1) if quick else (12, 30, 3)
    config = GenerateConfig(
        tiers=("rope",), splits={"train": sequences}, frames=frames, episodes=True, style="raster"
    )
    engines: dict[str, Engine] = {"local": LocalEngine(2), "ray": RayEngine(2, 0.0)}
    found: dict[str, list[tuple[float, float, float]]] = {name: [] for name in engines}
    with two_nodes():
        for _ in range(rounds):
            for name, engine in engines.items():
                found[name].append(made(config, engine))
    record: dict[str, Value] = {"images": sequences * frames}
    medians = {name: np.median(each, axis=0) for name, each in found.items()}
    for name, (cpu_s, driver_ms, finish_ms) in medians.items():
        record |= {f"cpu_s_per_image_{name}": cpu_s, f"driver_ms_per_sequence_{name}": driver_ms}
        record["finish_ms_per_sequence"] = finish_ms
    return record | {"cpu_ratio_ray": medians["ray"][0] / medians["local"][0]}


@contextmanager
def two_nodes() -> Iterator[None]:
    """Connect this process to a cluster of two local nodes with a core each."""
    # Ray gives its workers niceness 15: other programs would stop them, and not the local ones.
    os.environ |= {
        "RAY_USAGE_STATS_ENABLED": "0",
        "RAY_ACCEL_ENV_VAR_OVERRIDE_ON_ZERO": "0",
        "RAY_worker_niceness": "0",
    }
    import ray
    from ray.cluster_utils import Cluster

    head = {"num_cpus": 1, "include_dashboard": False}
    cluster = Cluster(initialize_head=True, head_node_args=head)
    cluster.add_node(num_cpus=1)
    ray.init(address=cluster.address, log_to_driver=False)
    try:
        yield
    finally:
        ray.shutdown()
        cluster.shutdown()


def made(config: GenerateConfig, engine: Engine) -> tuple[float, float, float]:
    """Make a set; return CPU s per image, and the driver's and the final CPU ms per sequence."""
    results: list[SequenceResult] = []
    ends: list[float] = []
    tasks = plan_tasks(config)
    with tempfile.TemporaryDirectory(prefix="pliant-benchmark-") as folder:
        for event in engine.events(tasks, sequence_maker(config, Path(folder))):
            if isinstance(event, Failed):
                raise SystemExit(event.error)
            if isinstance(event, Finished):
                results.append(event.result)
                ends.append(time.process_time())
        started = time.process_time()
        write_dataset_files(config, tasks, Path(folder))
        finish_s = time.process_time() - started
    warm = [result for result in results if result.warm]
    return (
        sum(result.cpu_s for result in warm) / (len(warm) * config.frames),
        1e3 * (ends[-1] - ends[1]) / (len(ends) - 2),  # after the second end both are warm
        1e3 * finish_s / len(results),
    )


if __name__ == "__main__":
    main("cluster", measure, __doc__)
