"""Files and scores are the same under every Python that the base install supports.

`make pythons` makes the environments `.venv-3.12` and `.venv-3.13`; without them this is skipped.
Scores are compared to nine digits, because NumPy 1 and 2 differ in the last digits of `exp`; files,
tables and the list of problems are compared byte for byte.
"""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

ROOT = Path(__file__).parents[1]
PYTHONS = {name: ROOT / f".venv-{name}" / "bin" / "python" for name in ("3.12", "3.13")}

PROGRAM = """
import hashlib, json, sys, tempfile
from pathlib import Path

from pliant.evaluator import evaluate, write_report
from pliant.spec.dataset import Dataset
from pliant.spec.opening import SAMPLE
from pliant.spec.io.exr import write_surface
from pliant.spec.io.jsonfiles import write_json
from pliant.spec.io.parquet import read_footer, write_table
from pliant.spec.io.png import write_rgb
from pliant.spec.validation.validate import validate

conformance = Path("spec/conformance")
out = Path(sys.argv[1])
sample = Dataset.open(SAMPLE)
frame = sample.frame("rope-train-000000", 0)
write_rgb(out / "a.png", frame.rgb)
write_surface(out / "a.exr", frame.surface)
write_json(out / "a.json", sample.info)
write_table(out / "a.parquet", sample.queries("val"), "queries", read_footer(
    SAMPLE / "queries" / "val.parquet"))
for name in ("perfect", "with-modes", "outside-image", "matches"):
    file = conformance / "submissions" / f"{name}.parquet"
    write_report(evaluate(file, conformance / "datasets" / "full"), out / name)
    scores = out / name / "scores.json"
    document = json.loads(scores.read_text(), parse_float=lambda text: float(f"{float(text):.9g}"))
    del document["tools"], document["files"]["report.html"]  # they name the version of NumPy
    write_json(scores, document)
found = {
    str(path.relative_to(out)): hashlib.sha256(path.read_bytes()).hexdigest()
    for path in sorted(out.rglob("*")) if path.suffix in (".exr", ".json", ".parquet", ".png")
}
found["python"] = "%d.%d" % sys.version_info[:2]
found["issues"] = [
    str(issue) for name in ("full", "minimal")
    for issue in validate(conformance / "datasets" / name).issues
]
print(json.dumps(found))
"""


def written(python: Path, out: Path) -> dict[str, Any]:
    """Write files, scores and reports under a Python; return file -> sha256."""
    out.mkdir()
    command = [str(python), "-c", PROGRAM, str(out)]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=True)
    found: dict[str, Any] = json.loads(done.stdout)
    return found


@pytest.mark.parametrize("name", PYTHONS)
def test_another_python_writes_the_same_files(name: str, tmp_path: Path) -> None:
    if not PYTHONS[name].exists():
        pytest.skip(f"make pythons makes .venv-{name}")
    own = written(Path(sys.executable), tmp_path / "own")
    other = written(PYTHONS[name], tmp_path / "other")
    assert other.pop("python") == name
    assert own.pop("python") == f"{sys.version_info.major}.{sys.version_info.minor}"
    assert len(own) > 10
    assert other == own
