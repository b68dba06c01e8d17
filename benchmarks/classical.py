"""The classical methods: CPU time and error a tier, and what their fixed scale is worth.

    python benchmarks/classical.py [--quick] [--json FILE]

`rmse_px_METHOD_TIER`, `pck_10_METHOD_TIER`: over all queries whose point is visible in the target.
`cpu_s_a_pair_METHOD_TIER`: without reading the images. `sift_octave_N`, `surf_scale_N`: the method
at other scales than its own (octave 0; 3 px).

A set of its own is rendered in raster style, with a seed that no other benchmark uses, so that
no scale is chosen on the pairs that methods are reported on.
"""

from __future__ import annotations

import tempfile
import time
from collections import defaultdict
from collections.abc import Mapping
from pathlib import Path

import numpy as np
from record import Value, main

from pliant.baselines import METHODS, Matcher
from pliant.baselines.features.local_features import LocalFeatureMatcher
from pliant.baselines.features.opencv_features import OpencvFeatures
from pliant.baselines.features.surf import MahotasSurf
from pliant.generator.config import GenerateConfig
from pliant.generator.runner.run import generate
from pliant.spec.dataset import Dataset

SEED = 2005
TIERS = ("rope", "cloth-1", "cloth-3")


def measure(quick: bool) -> Mapping[str, Value]:
    """Return CPU seconds a pair, RMSE and PCK of every method on every tier."""
    figures: dict[str, Value] = {}
    with tempfile.TemporaryDirectory() as folder:
        root = Path(folder) / "set"
        config = GenerateConfig(
            tiers=TIERS, splits={"test": 4 if quick else 30}, seed=SEED, style="raster"
        )
        generate(config, root, workers=2)
        dataset = Dataset.open(root)
        figures["pairs"] = len(dataset.pairs("test"))
        for name in ("identity", "random", "centroid", "sift", "surf", "orb"):
            figures |= score(dataset, METHODS[name](), name)
        for octave in (1, 2):
            sift = LocalFeatureMatcher(OpencvFeatures("sift", octave=octave))
            figures |= score(dataset, sift, f"sift_octave_{octave}")
        for scale in (2, 4):
            surf = LocalFeatureMatcher(MahotasSurf(scale))
            figures |= score(dataset, surf, f"surf_scale_{scale}")
    return figures


def score(dataset: Dataset, matcher: Matcher, name: str) -> dict[str, Value]:
    """Answer every query, images read beforehand, and compare with the truth where visible."""
    truth = dataset.truth("test")
    true_px = np.stack([truth["u_b"].to_numpy(), truth["v_b"].to_numpy()], axis=1)
    visible = np.array(truth["visibility_b"].to_pylist()) == "visible"
    errors: dict[str, list[np.ndarray]] = defaultdict(list)
    cpu_s: dict[str, list[float]] = defaultdict(list)
    row = 0
    for pair in dataset.pairs("test"):
        seen = pair.seen()
        started = time.process_time()
        answers = matcher.answer(seen)
        tier = pair.source.sequence.tier
        cpu_s[tier].append(time.process_time() - started)
        rows = slice(row, row + len(pair.uv_a_px))
        error = np.hypot(*(answers.uv_px - true_px[rows]).T)
        errors[tier].append(error[visible[rows]])
        row = rows.stop
    figures: dict[str, Value] = {}
    for tier in TIERS:
        error, label = np.concatenate(errors[tier]), tier.replace("-", "_")
        figures[f"rmse_px_{name}_{label}"] = float(np.sqrt((error**2).mean()))
        figures[f"pck_10_{name}_{label}"] = float((error <= 10).mean())
        figures[f"cpu_s_a_pair_{name}_{label}"] = float(np.mean(cpu_s[tier]))
    return figures


if __name__ == "__main__":
    main("classical", measure, __doc__)
