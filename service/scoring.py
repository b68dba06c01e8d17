"""Checks and scores one file, in a process of its own: the only code that reads the answers."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Literal

from pliant.evaluator import evaluate, inspect
from pliant.evaluator.protocols.protocol import parse_protocol
from pliant.evaluator.scores import public_scores
from pliant.service.settings import Scoring
from pliant.spec.errors import CallError, Issue, SubmissionError
from pliant.spec.io.parquet import read_footer
from pliant.spec.limits import Limits, run_limited

_MOST_ISSUES = 200
Figures = Mapping[str, Mapping[str, float | None]]
"""Group (`overall` or a tier) -> metric -> value."""


@dataclass(frozen=True)
class Task:
    """What is to be done with one file.

    Attributes:
        file: The file on this machine.
        name: Its name on the participant's machine, for messages.
        public: The public half.
        phase: The phase that it was sent to.
        split: The split it must answer.
        kind: Kind of submission that the phase scores: `answers` or `matches`.
        versions: (id of the version, text of the protocol, folder of the truth); none for a check.
        others: (name, split, kind) of the challenge's other phases that are open.
    """

    file: Path
    name: str
    public: Path
    phase: str
    split: str
    kind: Literal["answers", "matches"]
    versions: tuple[tuple[int, bytes, Path], ...]
    others: tuple[tuple[str, str, str], ...] = ()


@dataclass(frozen=True)
class Result:
    """What participants may see of a file.

    Attributes:
        method: Name of the method in the file's footer.
        figures: Version -> group -> metric -> value, four digits.
        coverage: Share of the queries that have an answer.
        queries_sha256: The queries that it answers.
        tools: Versions of what computed the figures.
        issues: What is wrong with it; then there are no figures.
        counts: Issue code -> number of problems.
    """

    method: str | None = None
    figures: Mapping[int, Figures] | None = None
    coverage: float = 1.0
    queries_sha256: str = ""
    tools: dict[str, str] | None = None
    issues: tuple[dict[str, str], ...] = ()
    counts: dict[str, int] | None = None


def score_in_child(task: Task, limits: Scoring) -> Result:
    """Do a task in a child process with limits, without a network where the kernel allows it.

    Raises:
        LimitError: It needs more than is allowed, or it crashed.
        SpecError: The challenge's data is at fault.
    """
    allowed = Limits(
        memory_bytes=int(limits.memory_gib * 2**30),
        cpu_s=limits.cpu_s,
        wall_s=limits.wall_s,
        network=False,
    )
    return run_limited(partial(score, task), limits=allowed, path=task.name)


def score(task: Task) -> Result:
    """Check a file and score it by each version.

    Raises:
        SpecError: The challenge's data is at fault.
    """
    try:
        if not task.versions:
            return _checked(task)
        documents = {
            version: public_scores(
                evaluate(
                    task.file,
                    task.public,
                    truth=truth,
                    protocol=parse_protocol(text),
                    hide_truth=True,
                )
            ).document
            for version, text, truth in task.versions
        }
    except SubmissionError as error:
        return _refused(task, error.issues)
    except CallError:
        if not (issues := _not_of_phase(task)):
            raise
        return _refused(task, issues)
    if issues := _not_of_phase(task):
        return _refused(task, issues)
    first = next(iter(documents.values()))
    return Result(
        method=str(first["submission"]["method"]["name"]),
        figures={
            version: {"overall": document["overall"], **document["tiers"]}
            for version, document in documents.items()
        },
        coverage=round(float(first["coverage"]), 4),
        queries_sha256=str(first["dataset"]["queries_sha256"]),
        tools=dict(first["tools"]),
    )


def _checked(task: Task) -> Result:
    problems = inspect(task.file, task.public)
    issues = problems.issues() or _not_of_phase(task)
    if issues:
        return _refused(task, issues)
    return Result(method=str(read_footer(task.file)["method"]["name"]))


def _not_of_phase(task: Task) -> list[Issue]:
    """Return what a sound submission has that its phase does not accept."""
    footer = read_footer(task.file)
    given = footer["split"], footer["table"]
    fitting = [name for name, *accepted in task.others if tuple(accepted) == given]
    fix = f". Send it to phase {' or '.join(fitting)}" if fitting else ""
    wanted = (
        ("KIND_NOT_ACCEPTED", "table", task.kind),
        ("SPLIT_NOT_OF_PHASE", "split", task.split),
    )
    return [
        Issue(
            code,
            "error",
            task.name,
            f"footer.{name}",
            f"found {name} {footer[name]}; required: {own}, which phase {task.phase} accepts{fix}",
        )
        for code, name, own in wanted
        if footer[name] != own
    ]


def _refused(task: Task, issues: Sequence[Issue]) -> Result:
    """Return the issues without any path of this machine."""
    file, data = str(task.file), str(task.public)
    shown = tuple(
        {k: v.replace(file, task.name).replace(data, "/data") for k, v in issue.as_dict().items()}
        for issue in issues[:_MOST_ISSUES]
    )
    return Result(issues=shown, counts=dict(Counter(issue.code for issue in issues)))
