from __future__ import annotations

import json
import shutil
from dataclasses import replace

import pytest

from pliant.generator.config import GenerateConfig
from pliant.generator.runner.run import generate
from pliant.generator.seeding import RandomStreams, SequenceTask, Stream
from pliant.spec.errors import CallError
from pliant.spec.secrets import SECRET_SEED_FILE, read_secret_seed, seed_weakness
from pliant.spec.validation.validate import validate
from tests.generator.runner.standin import InProcess, digests
from tests.generator.world import small
from tests.known import known


@pytest.fixture
def config() -> GenerateConfig:
    return small(size=(32, 24), splits={"train": 1, "test": 1}, secret_seed=True)


def test_a_secret_seed_is_in_no_file_but_its_own(config, tmp_path, capfd):
    out = tmp_path / "set"
    generate(config, out)
    seed = known(read_secret_seed(out))
    forms = [str(seed).encode(), f"{seed:x}".encode(), f"{seed:X}".encode()]
    forms += [seed.to_bytes(16, order) for order in ("big", "little")]
    files = [path for path in out.rglob("*") if path.is_file()]
    containing = [path for path in files if any(form in path.read_bytes() for form in forms)]
    assert containing == [out / SECRET_SEED_FILE]
    assert any(path.suffix == ".log" and path.stat().st_size for path in files)
    assert not any(form.decode() in "".join(capfd.readouterr()) for form in forms[:3])
    info = json.loads((out / "dataset.json").read_text())
    assert info["provenance"]["seed"] is None
    assert info["provenance"]["config"]["secret_seed"] is True
    assert "seed" not in info["provenance"]["config"]
    assert seed_weakness(info, out) is None
    assert validate(out).issues == []


def test_a_run_with_a_secret_seed_resumes_and_can_be_repeated(config, tmp_path):
    def public(root):
        return {name: sha for name, sha in digests(root).items() if name != SECRET_SEED_FILE}

    first, again, other = (tmp_path / name for name in ("first", "again", "other"))
    generate(config, first, engine=InProcess())
    made = public(first)
    shutil.rmtree(first / "sequences" / "rope" / "rope-test-000000")
    assert generate(config, first, engine=InProcess()).made == 1
    assert public(first) == made
    shutil.copytree(first / ".private", again / ".private")
    generate(config, again, engine=InProcess())
    assert public(again) == made
    generate(config, other, engine=InProcess())
    assert read_secret_seed(other) != read_secret_seed(first)
    assert not {v for n, v in public(other).items() if n.endswith("png")} & set(made.values())


def test_a_lost_or_damaged_seed_stops_the_run(config, tmp_path):
    out = tmp_path / "set"
    generate(config, out, engine=InProcess())
    shutil.rmtree(out / "sequences")
    with pytest.raises(CallError, match=r"secret_seed \(true there, false in this call\)"):
        generate(config.replace(secret_seed=False, seed=0), out)
    (out / SECRET_SEED_FILE).write_text("{}")
    with pytest.raises(CallError, match="cannot be read"):
        generate(config, out)
    (out / SECRET_SEED_FILE).unlink()
    with pytest.raises(CallError, match="secret seed of this dataset is missing"):
        generate(config, out)
    assert not (out / SECRET_SEED_FILE).exists()


def test_a_public_set_gets_no_secret(config, tmp_path):
    out = tmp_path / "set"
    public = config.replace(secret_seed=False)
    generate(public, out, engine=InProcess())
    with pytest.raises(CallError, match="secret_seed"):
        generate(config, out)
    assert not (out / SECRET_SEED_FILE).exists()


def test_every_bit_of_a_secret_seed_counts_and_streams_differ():
    task = SequenceTask("rope", "test", 0)
    seeds = [2**127, *(2**127 + 2**bit for bit in range(127))]
    drawn = {float(RandomStreams(seed, task).generator(Stream.CAMERA).random()) for seed in seeds}
    assert len(drawn) == 128
    streams = RandomStreams(2**127, task)
    others = [streams.generator(stream, frame) for stream in Stream for frame in (None, 0, 1)]
    for changed in ({"tier": "cloth-1"}, {"split": "val"}, {"index": 1}):
        others.append(RandomStreams(2**127, replace(task, **changed)).generator(Stream.CAMERA))
    assert len({float(rng.random()) for rng in others}) == len(others)
    assert "1701411834604692317316873037158841057" not in repr(streams)
