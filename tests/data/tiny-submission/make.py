"""Makes this folder anew: an analytic dataset without images, answers with known errors, a score.

    python tests/data/tiny-submission/make.py

The golden score changes only when a protocol does; the reason then stands below.

1.0  First protocols. Query q of a pair is off by (0, 0), (3, 4), (6, 8) or (0, 0) px for
     q mod 4 = 0, 1, 2, 3.
1.3  Intervals alone: both sequences of a pair are resampled.
1.4  Intervals of the whole split alone: tiers of equal size are resampled independently.
"""

from __future__ import annotations

import importlib.util
import json
import shutil
import sys
from pathlib import Path

import numpy as np

from pliant.evaluator import evaluate

HERE = Path(__file__).parent
OFFSETS = np.array([[0, 0], [3, 4], [6, 8], [0, 0]], float)
GOLDEN = (
    "protocol", "protocol_version", "protocol_sha256", "coverage", "counts", "overall",
    "tiers", "intervals", "slices",
)  # fmt: skip


def main() -> None:
    path = HERE.parents[1] / "evaluator" / "conftest.py"
    spec = importlib.util.spec_from_file_location("analytic_scenes", path)
    assert spec is not None
    assert spec.loader is not None
    scenes = importlib.util.module_from_spec(spec)
    sys.modules["analytic_scenes"] = scenes
    spec.loader.exec_module(scenes)
    shutil.rmtree(HERE / "dataset", ignore_errors=True)
    scene = scenes.make_scene(HERE / "dataset", queries=16, images=False)
    query = scene.queries["query_id"].to_numpy()
    table = scene.table(
        scene.true_px + OFFSETS[query % 4],
        visible=np.where(query % 5 == 0, 0.2, 0.9).astype(np.float32),
        sigma=(1 + query % 4 * 2).astype(np.float32),
    )
    scene.submit(HERE / "submission.parquet", table, method={"name": "known errors"})
    document = evaluate(HERE / "submission.parquet", HERE / "dataset").document
    golden = {name: document[name] for name in GOLDEN}
    (HERE / "golden.json").write_text(json.dumps(golden, indent=1) + "\n")


if __name__ == "__main__":
    main()
