from __future__ import annotations

from pliant.generator.config import GenerateConfig, split_counts
from pliant.generator.runner.plan import plan_tasks


def test_splits_never_shrink_as_a_set_grows() -> None:
    before = {"train": 0, "val": 0, "test": 0}
    for count in range(1, 60):
        now = {**dict.fromkeys(before, 0), **split_counts(count)}
        assert sum(now.values()) == count
        assert all(now[split] >= before[split] for split in before)
        before = now
    assert split_counts(10) == {"train": 7, "val": 1, "test": 2}


def test_a_larger_plan_holds_the_smaller_one() -> None:
    small = plan_tasks(GenerateConfig(tiers=("rope",), sequences=13))
    large = plan_tasks(GenerateConfig(tiers=("rope", "cloth-3"), sequences=57))
    assert set(small) < set(large)
    assert len({task.id for task in large}) == len(large) == 2 * 57
