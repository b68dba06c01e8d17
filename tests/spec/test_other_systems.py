"""The base install needs nothing that Linux alone has: what macOS or Windows lack is taken away."""

from __future__ import annotations

import subprocess
import sys

CODE = """
import importlib, os, pathlib, pkgutil, sys

for name in ("resource", "fcntl", "pwd", "grp", "termios", "syslog"):
    sys.modules[name] = None  # an import of it fails
for name in ("sched_getaffinity", "posix_fallocate", "fork", "getuid", "geteuid", "statvfs"):
    delattr(os, name)

import pliant, pliant.evaluator, pliant.spec

for room in (pliant.spec, pliant.evaluator):
    for module in pkgutil.walk_packages(room.__path__, room.__name__ + "."):
        importlib.import_module(module.name)

from pliant.spec.limits import Limits

ds = pliant.load("sample")
table = pliant.evaluate(ds, pliant.predict(ds, "centroid")).overall
out = pathlib.Path(sys.argv[1])
pliant.predict(ds, "centroid").write(out / "answers.parquet")
assert pliant.evaluate(ds, out / "answers.parquet").overall == table
assert pliant.evaluator.evaluate(out / "answers.parquet", ds, limits=Limits()).overall == table
print(round(table["rmse_px"], 2))
"""


def test_spec_and_evaluator_work_without_what_linux_alone_has(tmp_path: object) -> None:
    done = subprocess.run(
        [sys.executable, "-c", CODE, str(tmp_path)], capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr[-3000:]
    assert float(done.stdout) == 48.01
