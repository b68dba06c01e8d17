from __future__ import annotations

import json
import subprocess
import sys

import pytest

from pliant.cli.generate import build_config
from pliant.cli.main import run
from pliant.generator.settings import NoiseSettings, RopeSettings
from pliant.spec.errors import CallError
from tests.generator.runner.standin import InProcess

SMALL = ["--size", "64x48", "--style", "raster", "--splits", "test=2", "--workers", "1"]
SMALL += ["--set", "rope.shapes={open: 1}"]


def flags(**given):
    names = ("sequences", "splits", "frames", "episodes", "size", "seed", "style")
    return {name: given.get(name) for name in names}


def test_flags_win_over_the_file_and_settings_over_flags(tmp_path):
    (tmp_path / "c.yaml").write_text(
        "tiers: [cloth-1]\nsequences: 9\nseed: 5\nrope: {length_m: 2.0}\n"
    )
    config = build_config(
        ("rope",),
        tmp_path / "c.yaml",
        ("rope.ball=false", "rope.turns=10", "queries.queries_per_pair=7", "noise={}"),
        flags(splits="train=2,test=1", seed=0, size="320x240"),
    )
    assert config.noise == NoiseSettings()
    assert config.tiers == ("rope",)
    assert config.counts == {"train": 2, "test": 1}
    assert (config.size, config.seed) == ((320, 240), 0)
    assert config.rope == RopeSettings(length_m=2.0, ball=False, turns=10)
    assert config.queries.queries_per_pair == 7


@pytest.mark.parametrize(
    ("settings", "given", "named"),
    [
        ((), {"size": "640"}, "--size"),
        ((), {"splits": "train"}, "--splits"),
        ((), {"splits": "train=1_0"}, "--splits"),
        ((), {"splits": "train=1", "sequences": 3}, "--sequences"),
        (("frames",), {}, "--set"),
        (("frames.more=1",), {"frames": 3}, "--set frames.more"),
        (("rope.length=[",), {}, "--set rope.length"),
    ],
)
def test_flags_that_cannot_be_read(settings, given, named):
    with pytest.raises(CallError, match=named):
        build_config(("rope",), None, settings, flags(**given))


def test_a_config_in_the_place_of_a_tier():
    with pytest.raises(CallError, match=r"a\.yaml: a config file is not a tier.*--config a\.yaml"):
        build_config(("a.yaml",), None, (), flags())


def test_without_blender_the_extra_is_named_and_nothing_is_written(tmp_path):
    code = (
        "import sys; sys.modules['bpy'] = None\n"
        "from pliant.cli.main import main; main(sys.argv[1:])"
    )
    done = subprocess.run(
        [sys.executable, "-c", code, "generate", "rope", "--out", str(tmp_path / "out")],
        capture_output=True, text=True, check=False,
    )  # fmt: skip
    assert done.returncode == 2
    assert "pip install 'pliant[generate]'" in done.stderr
    assert len(done.stderr.strip().splitlines()) == 1
    assert not (tmp_path / "out").exists()


def test_generate_resume_refuse_and_dry_run(tmp_path, capsys, monkeypatch):
    shown = []

    def engine(workers):
        shown.append(capsys.readouterr().out)
        return InProcess()  # the trial sequences of a plan are made in this process

    monkeypatch.setattr("pliant.generator.runner.estimate.LocalEngine", engine)
    out = str(tmp_path / "set")
    call = ["generate", "rope", "--out", out, *SMALL, "--json"]
    assert run([*call, "--dry-run"]) == 0
    plan = json.loads(capsys.readouterr().out)
    assert (plan["sequences"], plan["missing"], plan["frames"]) == (2, 2, 2)
    assert plan["estimated_bytes"] > 0
    assert plan["files"] == 12
    assert run([*call[:-1], "--dry-run"]) == 0
    plan_shown_first = shown[-1]
    assert "2 sequences (rope; per tier test 2) of 1 frame (configurations)" in plan_shown_first
    assert "Nothing was written." in capsys.readouterr().out
    assert not (tmp_path / "set").exists()

    assert run(call) == 0
    report = json.loads(capsys.readouterr().out)
    assert (report["made"], report["frames"], report["failed"]) == (2, 2, [])
    assert run(call) == 0
    assert json.loads(capsys.readouterr().out)["made"] == 0
    assert run(call[:-1]) == 0
    assert "finished: 2 sequences, none to make" in capsys.readouterr().out

    assert run([*call, "--seed", "1"]) == 2
    assert "seed (0 there, 1 in this call)" in capsys.readouterr().err
    assert run(["generate", "ropes", "--out", out]) == 2
    assert run(["generate", "--out", out]) == 2
    assert run([*call, "--workers", "0"]) == 2
