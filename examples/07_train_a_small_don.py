"""Train a small Dense Object Net on the sample. In a minute it learns little."""

import sys
from pathlib import Path

import pliant
from pliant.models.don.settings import DonSettings
from pliant.models.don.trainer import train_don
from pliant.spec.configuration import settings_from

out = Path(sys.argv[1] if len(sys.argv) > 1 else "out")
steps = int(sys.argv[2]) if len(sys.argv) > 2 else 60

ds = pliant.load("sample")
settings = settings_from(
    DonSettings,
    {
        "tier": "rope",
        "width": 128,
        "height": 96,
        "steps": steps,
        "batch": 2,
        "threads": 1,
        "network": {"widths": [16, 32, 64], "global_blocks": 1, "patch": 2},
        "pairs": {"input": "grey", "masks": True},
        "validation": {"every": steps, "pairs": 4, "queries": 64, "calibration_pairs": 2},
    },
)
train_don(ds, out / "run", settings)  # report.html shows curves and descriptors
scores = pliant.evaluate(ds, pliant.predict(ds, str(out / "run")))
print(f"after {steps} steps: {scores.overall['rmse_px']:.1f} px")
scores = pliant.evaluate(ds, pliant.predict(ds, "don-rope"))
print(f"don-rope, as shipped: {scores.overall['rmse_px']:.1f} px")
