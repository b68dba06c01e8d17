"""How much of the product one job passes through: distinct functions and files called.

Runs `pliant evaluate` and the generation of one raster rope sequence in this process under a
profiler, and counts the distinct functions and files of `pliant` that were called. Module bodies,
class bodies, lambdas and comprehensions do not count as functions. Code compiled by numba calls
its callees without the interpreter, so that only its entry points are seen.
"""

from __future__ import annotations

import sys
import tempfile
import threading
from collections.abc import Callable
from pathlib import Path
from types import CodeType, FrameType
from typing import Any

import record

import pliant.spec

ROOT = Path(pliant.spec.__file__).resolve().parent.parent


def passed(job: Callable[[], object]) -> tuple[int, int]:
    """Return how many distinct functions and files of `pliant` a job calls."""
    codes: set[CodeType] = set()

    def profile(frame: FrameType, event: str, _: Any) -> None:
        if event == "call":
            codes.add(frame.f_code)

    threading.setprofile(profile)
    sys.setprofile(profile)
    try:
        job()
    finally:
        sys.setprofile(None)
        threading.setprofile(None)  # type: ignore[arg-type]
    own = {
        (Path(code.co_filename).resolve(), code.co_qualname)
        for code in codes
        if not code.co_name.startswith("<")
        and not code.co_filename.startswith("<")  # generated or frozen code has no file
        and code.co_flags & 0x2  # 0x2: not a class body
    }
    own = {key for key in own if key[0].is_relative_to(ROOT) and ".venv" not in key[0].parts}
    own = {key for key in own if key[0] != Path(__file__).resolve()}
    return len(own), len({path for path, _ in own})


def measure(quick: bool) -> dict[str, record.Value]:
    """Return the figures; `quick` changes nothing."""
    from pliant.cli.main import run

    with tempfile.TemporaryDirectory() as folder:
        data, submission = f"{folder}/data", f"{folder}/centroid.parquet"
        few = ["--size", "160x120", "--style", "raster", "--workers", "1", "--json"]
        run(["generate", "rope", "--splits", "test=2", "--out", data, *few])
        run(["predict", "centroid", "--data", data, "--split", "test", "--out", submission])
        evaluate = ["evaluate", submission, "--data", data, "--out", f"{folder}/report"]
        functions, files = passed(lambda: run(evaluate))
        sequence_functions, sequence_files = passed(lambda: _one_sequence(Path(folder) / "one"))
    return {
        "evaluate_functions": functions,
        "evaluate_files": files,
        "rope_sequence_functions": sequence_functions,
        "rope_sequence_files": sequence_files,
    }


def _one_sequence(root: Path) -> None:
    from pliant.generator.config import GenerateConfig
    from pliant.generator.runner.plan import plan_run
    from pliant.generator.runner.sequence import SequenceMaker

    config = GenerateConfig(
        tiers=("rope",), splits={"test": 1}, frames=2, width=160, height=120, style="raster"
    )
    maker = SequenceMaker(config, root)
    maker.make(plan_run(config, root).missing[0], lambda: None)


if __name__ == "__main__":
    record.main("walk", measure, __doc__)
