from __future__ import annotations

import stat
from pathlib import Path

import pytest

from pliant.spec.errors import CallError
from pliant.spec.secrets import (
    SECRET_SEED_FILE,
    draw_secret_seed,
    read_secret_seed,
    seed_weakness,
    write_secret_seed,
)


def test_drawn_seeds_have_128_bits_and_differ() -> None:
    seeds = {draw_secret_seed() for _ in range(100)}
    assert len(seeds) == 100
    assert all(2**64 <= seed < 2**128 for seed in seeds)
    assert max(seeds) > 2**120


def test_a_secret_seed_is_read_as_written_and_its_owner_alone_can_read_it(tmp_path: Path) -> None:
    assert read_secret_seed(tmp_path) is None
    for seed in (0, 2**128 - 1, 2**100 + 3):
        write_secret_seed(tmp_path, seed)
        assert read_secret_seed(tmp_path) == seed
    path = tmp_path / SECRET_SEED_FILE
    assert stat.S_IMODE(path.stat().st_mode) == 0o600
    assert stat.S_IMODE(path.parent.stat().st_mode) == 0o700
    assert [each.name for each in path.parent.iterdir()] == ["seed.json"]


@pytest.mark.parametrize("text", ["", "[]", '{"seed": 3}', '{"seed": "xyz"}', '{"seed": "-1"}'])
def test_a_damaged_file_is_an_error_that_does_not_quote_it(tmp_path: Path, text: str) -> None:
    write_secret_seed(tmp_path, 1)
    (tmp_path / SECRET_SEED_FILE).write_text(text)
    with pytest.raises(CallError, match="the secret seed") as caught:
        read_secret_seed(tmp_path)
    assert "xyz" not in str(caught.value)


def test_weak_is_a_seed_in_public_files_or_below_64_bits(tmp_path: Path) -> None:
    public, withheld = ({"provenance": {"seed": seed}} for seed in (0, None))
    assert "dataset.json" in (seed_weakness(public, tmp_path) or "")
    assert seed_weakness(withheld, tmp_path) is None  # recorded data, or a published half
    write_secret_seed(tmp_path, 2**64 - 1)
    assert "64 bits" in (seed_weakness(withheld, tmp_path) or "")
    write_secret_seed(tmp_path, draw_secret_seed())
    assert seed_weakness(withheld, tmp_path) is None
