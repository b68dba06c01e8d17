"""What the whole suite shares: one tiny dataset and one tiny episode, made once and really."""

from __future__ import annotations

import os
import shutil
from collections.abc import Callable
from dataclasses import replace
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pytest

from pliant.cli.main import run
from pliant.converters import tapvid
from pliant.evaluator.submission import loading
from pliant.spec.limits import run_limited

if TYPE_CHECKING:
    from collections.abc import Iterator

    from tests.browser import Browser

Called = Callable[..., tuple[int, str, str]]
Refused = Callable[..., str]
# One thread a process: the suite runs beside itself (pytest -n), and results must not depend
# on how many threads a library takes.
for _name in ("NUMBA_NUM_THREADS", "OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS"):
    os.environ.setdefault(_name, "1")

if find_spec("hypothesis"):
    from hypothesis import settings

    settings.register_profile("pliant", deadline=None)  # this machine's speed is not under test
    settings.load_profile("pliant")


@pytest.fixture(scope="session")
def tiny_dataset(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A dataset of `rope`, `cloth-1` and `cloth-3`: its folder, to be read only.

    160x120 px, per tier 2 training, 1 validation and 2 test sequences of 2 independent
    configurations, with queries for validation and test. Rendered in style `fast` by Blender
    where it is installed, else by our own rasteriser. Cloths are coarser than by default.
    """
    return _made_once(
        "tiny",
        tmp_path_factory,
        tiers=("rope", "cloth-1", "cloth-3"),
        splits={"train": 2, "val": 1, "test": 2},
        frames=2,
        style="fast" if find_spec("bpy") else "raster",
        queries={"pairs_per_sequence": 2, "queries_per_pair": 24},
    )


@pytest.fixture(scope="session")
def tiny_episode(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A dataset of two rope episodes of 24 frames (`train`, `test`): to be read only.

    160x120 px, style `raster`, with queries for test.
    """
    return _made_once(
        "tiny-episode",
        tmp_path_factory,
        tiers=("rope",),
        splits={"train": 1, "test": 1},
        frames=24,
        episodes=True,
        queries={"pairs_per_sequence": 4, "queries_per_pair": 24},
    )


@pytest.fixture(scope="session")
def rendered_dataset(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A dataset of `rope` and `cloth-1`, 320x240 px, style `raster`: to be read only.

    Large enough for places between pixels to be measured; per tier 2 training and 1 test
    sequences of 3 configurations.
    """
    return _made_once(
        "rendered",
        tmp_path_factory,
        tiers=("rope", "cloth-1"),
        splits={"train": 2, "test": 1},
        frames=3,
        width=320,
        height=240,
        rope={},
    )


@pytest.fixture(scope="session")
def quick_run(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The run of `don-rope`, which comes with the package: without tracing, on small pictures."""
    pytest.importorskip("torch")
    from pliant.models.shipped import FOLDER

    run = tmp_path_factory.mktemp("quick") / "don-rope"
    shutil.copytree(FOLDER / "don-rope", run)
    config = run / "config.yaml"
    text = config.read_text()
    for slow, quick in (
        ("decode: trace", "decode: median"),
        ("crossings: true", "crossings: false"),
        ("rectify: true", "rectify: false"),
        ("width: 320", "width: 160"),
        ("height: 240", "height: 120"),
    ):
        assert slow in text
        text = text.replace(slow, quick)
    config.write_text(text)
    (run / "familiarity.json").unlink()  # what it is computed from is traced
    return run


@pytest.fixture
def quick_tracing(monkeypatch: pytest.MonkeyPatch) -> None:
    """Take every step of reading a rope, with fewer and shorter paths: small, poor, quick."""
    pytest.importorskip("scipy")
    from pliant.baselines.tracing import hypotheses, walk
    from pliant.baselines.tracing.settings import TRACING

    few = replace(
        TRACING,
        walk_most_steps=80,
        walk_straightness=(0.3, 1.3),
        walk_inertia=(0.55,),
        chain_samples=6,
    )
    for module in (walk, hypotheses):
        monkeypatch.setattr(module, "TRACING", few)


@pytest.fixture(scope="session", autouse=True)
def _no_child_process() -> Iterator[None]:
    """Read submissions and tracks in this process, which saves each command half a second.

    A test that asks for `child_process` keeps the child.
    """
    with pytest.MonkeyPatch.context() as patch:
        for module in (loading, tapvid):
            patch.setattr(module, "run_limited", lambda read, **_: read())
        yield


@pytest.fixture
def child_process(monkeypatch: pytest.MonkeyPatch) -> None:
    """For tests of what reads strangers' files in a child process, as users do."""
    for module in (loading, tapvid):
        monkeypatch.setattr(module, "run_limited", run_limited)


@pytest.fixture
def called(capsys: pytest.CaptureFixture[str]) -> Called:
    """Call `pliant` in this process; return its exit code, its output and its messages."""

    def call(*arguments: object) -> tuple[int, str, str]:
        capsys.readouterr()
        code = run([str(argument) for argument in arguments])
        captured = capsys.readouterr()
        return code, captured.out, captured.err

    return call


@pytest.fixture
def refused(called: Called) -> Refused:
    """Call `pliant` in this process: exit code that it must have, arguments -> what it says."""

    def call(code: int, *arguments: object) -> str:
        found, _, said = called(*arguments)
        assert found == code
        return said

    return call


@pytest.fixture(scope="session")
def browser() -> Iterator[Browser]:
    """One headless browser for the pages of all rooms."""
    pytest.importorskip("selenium")
    from tests.browser import CHROMIUM, DRIVER, chromium

    if CHROMIUM is None or DRIVER is None:
        pytest.skip("chromium and chromedriver are not installed")
    with chromium() as window:
        yield window


def _made_once(name: str, tmp_path_factory: pytest.TempPathFactory, **changes: Any) -> Path:
    """Make a dataset of small pictures once for all workers of pytest-xdist."""
    for module in ("numba", "scipy", "psutil"):
        pytest.importorskip(module, reason="making the dataset needs the extra 'generate'")
    from filelock import FileLock

    from pliant.generator.config import GenerateConfig
    from pliant.generator.runner.run import generate
    from pliant.spec.configuration import settings_from
    from tests.generator.runner.standin import InProcess

    values = {
        "id": name,
        "width": 160,
        "height": 120,
        "style": "raster",
        "rope": {"knots": {"overhand": 1.0}},
        "cloth": {"points_a_side": 33, "tracked_a_side": 17},
    }
    config = settings_from(GenerateConfig, {**values, **changes})
    base = tmp_path_factory.getbasetemp()
    if "PYTEST_XDIST_WORKER" in os.environ:
        base = base.parent
    out = base / name
    with FileLock(base / f"{name}.lock"):
        summary = generate(config, out, engine=InProcess() if config.style == "raster" else "local")
    assert not summary.failed, summary.failed[0].error
    return out
