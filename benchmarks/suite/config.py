"""What a reference benchmark is made of: its sets, its trainings, its tests, from one YAML file."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Callable, Collection, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, Final, Literal, NamedTuple

from pliant.baselines.conditions import Masks
from pliant.baselines.fused_tracker import PREFIX as FUSED
from pliant.evaluator.protocols.protocol import read_protocol
from pliant.generator.config import GenerateConfig
from pliant.models.timecycle import CARRIED
from pliant.spec.configuration import Settings
from pliant.spec.constraints import Count, Name, NotEmpty, Version, did_you_mean
from pliant.spec.errors import CallError


class Training(Settings):
    """One run of a trainer.

    Attributes:
        label: The method's name in the table.
        set: Set it is trained on.
        trainer: `don` or `timecycle`.
        recipe: Shipped file of settings under the run's own, or empty.
        settings: The trainer's settings, complete but for defaults.
        seeds: How many runs, with random seeds from that of the settings upwards. With several,
            a run is named `NAME-0`, `NAME-1` and so on, and NAME stands for all of them.
        learned: Whether its weights are learned; False for a control that stops after a step.
        arm: NAME, of a run that is one of several seeds; otherwise empty.
    """

    label: str
    set: str
    trainer: Literal["don", "timecycle"] = "don"
    recipe: str = ""
    settings: Mapping[str, Any] = dict()
    seeds: Count = 1
    learned: bool = True
    arm: str = ""


TRACKS: Final[dict[Masks, str]] = {
    "none": "image alone",
    "segmenter": "masks from a segmenter",
    "given": "perfect masks",
}
"""What methods are given, the headline first."""


@dataclass(frozen=True)
class Entry:
    """A method in a track.

    Attributes:
        method: A key of `pliant.baselines.METHODS`, a training or a shipped model.
        track: What it is given.
        is_blank: Whether it is the control that sees the same masks and a blank picture.
    """

    method: str
    track: Masks
    is_blank: bool = False

    @property
    def stored(self) -> str:
        """The name of its answers and scores."""
        method = self.method.replace(":", "-")  # no file name on Windows has a colon
        return f"{method}--{self.track}" + ("--blank" if self.is_blank else "")


class Test(Settings):
    """A part of the table: a tier's test queries, what answers them, what the paper found.

    Attributes:
        tier: The tier.
        title: Its heading.
        variants: Name of the variant (`clean`, `noisy` …) -> set whose test split is asked.
        methods: Methods without training, keys of `pliant.baselines.METHODS`.
        runs: Names of trainings.
        shipped: Names of models that come with the package: the whole recipes, trained once; and
            `fused:NAME`, optical flow that such a model corrects.
        answer: How the shipped models answer, instead of what their configs say: `answer.*` of a
            training, such as `blank_square: any`. Their rows name it.
        protocols: Protocols to score by, the table's first; `matches` applies to the methods
            with keypoint matches.
        tracks: What methods are given; each track is a block of its own. In tracks with masks, a
            blank control is added for every learned method.
        figures: Further metrics of the first protocol to show as columns.
        paper_rmse_px: Label of a method -> RMSE in the paper.
    """

    __test__ = False

    tier: str
    title: str
    variants: Mapping[str, str]
    methods: tuple[str, ...] = ()
    runs: tuple[str, ...] = ()
    shipped: tuple[str, ...] = ()
    answer: Mapping[str, Any] = dict()
    protocols: Annotated[tuple[str, ...], NotEmpty()] = ("standard", "matches")
    tracks: tuple[Masks, ...] = ("none", "segmenter", "given")
    figures: tuple[str, ...] = ()
    paper_rmse_px: Mapping[str, float] = dict()

    def heading(self, variant: str) -> str:
        """Return the heading of a variant's block."""
        return self.title if len(self.variants) == 1 else f"{self.title}: {variant}"

    @property
    def answering(self) -> tuple[str, ...]:
        """Everything that answers, in the table's order."""
        return (*self.methods, *self.runs, *self.shipped)

    @property
    def shown(self) -> tuple[str, ...]:
        """The metrics of the first protocol."""
        return tuple(read_protocol(self.protocols[0]).figures)

    @property
    def entries(self) -> list[Entry]:
        """Every method in every track, in the table's order."""
        learned = (*self.runs, *self.shipped)
        return [
            Entry(method, track, is_blank)
            for track in self.tracks
            for method in self.answering
            for is_blank in (False, True)
            if not is_blank or (method in learned and track != "none")
        ]


class PlannedAnswers(NamedTuple):
    """A method in a track, on a variant of a test.

    Attributes:
        key: Name of the test.
        test: The test.
        variant: Name of the variant.
        set: Set whose test split is asked.
        entry: The method and its track.
    """

    key: str
    test: Test
    variant: str
    set: str
    entry: Entry

    @property
    def stage(self) -> str:
        """The name of answering and scoring it."""
        return f"answer/{self.set}--{self.entry.stored}"


class Comparison(Settings):
    """A paired difference that the page reports.

    Attributes:
        question: What it answers.
        track: The track of both.
        set: Set whose test split both answered.
        method: The method judged.
        against: The method it is held against.
        metric: A metric of the block's first protocol.
    """

    question: str
    track: Masks = "none"
    set: str
    method: str
    against: str
    metric: str


PAPER_LOSSES: Final = ("contrastive", "distributional")
"""The paper's learned methods: a row of its table each, also where none is trained here."""

TEST_SPLIT: Final = "test"
"""The split of the queries."""


class BenchmarkConfig(Settings):
    """A named, frozen benchmark.

    Attributes:
        name: Its name.
        version: Its version; what changes a query changes it.
        sets: Name -> config of a dataset.
        common: What every set takes before its own values.
        runs: Name -> training.
        tests: Name -> block of the table.
        comparisons: Paired differences to report.
        checksums: File of the test queries' checksums, or None.
        validated: Validate every set after it is generated.
        part: Blocks that were chosen by `only`; otherwise empty.
    """

    name: str
    version: Version
    sets: Mapping[Name, GenerateConfig]
    common: Mapping[str, Any] = dict()
    runs: Mapping[Name, Training] = dict()
    tests: Mapping[str, Test] = dict()
    comparisons: tuple[Comparison, ...] = ()
    checksums: Path | None = None
    validated: bool = False
    part: tuple[str, ...] = ()

    @property
    def asked(self) -> dict[str, GenerateConfig]:
        """The sets with a test split, by name."""
        return {name: made for name, made in self.sets.items() if made.counts.get(TEST_SPLIT)}

    @property
    def answers(self) -> list[PlannedAnswers]:
        """Everything that is to be answered, in the table's order."""
        return [
            PlannedAnswers(key, test, variant, name, entry)
            for key, test in self.tests.items()
            for variant, name in test.variants.items()
            for entry in test.entries
        ]

    def only(self, tests: Collection[str]) -> BenchmarkConfig:
        """Return the benchmark with some blocks of its table, and the sets and runs they need.

        Args:
            tests: Names of blocks.

        Raises:
            CallError: A name is not the name of a block.
        """
        for name in tests:
            check_known(name, self.tests, None, "--test", "unknown block of the table")
        kept = {key: test for key, test in self.tests.items() if key in tests}
        trained = {name for test in kept.values() for name in test.runs}
        runs = {name: run for name, run in self.runs.items() if name in trained}
        asked = {name for test in kept.values() for name in test.variants.values()}
        needed = asked | {run.set for run in runs.values()}
        answering = {name for test in kept.values() for name in test.answering}
        return self.replace(
            sets={name: made for name, made in self.sets.items() if name in needed},
            runs=runs,
            tests=kept,
            part=tuple(kept),
            comparisons=tuple(
                each
                for each in self.comparisons
                if each.set in asked
                and {*self.members(each.method), *self.members(each.against)} <= answering
            ),
        )

    def members(self, name: str) -> tuple[str, ...]:
        """Return the runs that a name stands for, one per random seed; any other name alone."""
        return tuple(key for key, run in self.runs.items() if run.arm == name) or (name,)


def model_of(method: str) -> str:
    """Return the shipped model of a method: itself, or what a tracker puts its prefix before."""
    return method.removeprefix(FUSED).removeprefix(CARRIED)


def trainer_of(name: str) -> tuple[type[Settings], Callable[..., dict[str, Any]]]:
    """Return the class of a trainer's settings, and the trainer; it imports torch."""
    if name == "timecycle":
        from pliant.models.timecycle.settings import TimeCycleSettings
        from pliant.models.timecycle.trainer import train_timecycle

        return TimeCycleSettings, train_timecycle
    from pliant.models.don.settings import DonSettings
    from pliant.models.don.trainer import train_don

    return DonSettings, train_don


def digest(*parts: Any) -> str:
    """Return a SHA-256 of JSON values, the same for the same values."""
    text = json.dumps(parts, sort_keys=True, default=str)
    return hashlib.sha256(text.encode()).hexdigest()


def check_known(
    name: str, names: Collection[str], path: Path | None, where: str, problem: str = "unknown name"
) -> None:
    if name not in names:
        raise CallError(
            problem, path=path, where=where, found=name,
            required="one of " + ", ".join(names), fix=did_you_mean(name, names),
        )  # fmt: skip
