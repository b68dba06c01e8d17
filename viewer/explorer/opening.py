"""Opens what the command line names: a dataset, and methods, reports or submissions."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Sequence
from pathlib import Path

from pliant.baselines.matcher import Matcher, SplitMatcher
from pliant.evaluator.scores import SCORES_JSON
from pliant.models.shipped import shipped_names
from pliant.spec.dataset import Dataset
from pliant.spec.errors import CallError
from pliant.spec.extras import EXTRAS, is_installed
from pliant.viewer.explorer.app import Explorer
from pliant.viewer.explorer.frames import FrameCache
from pliant.viewer.explorer.live import LiveMethod
from pliant.viewer.explorer.recorded import RecordedQueries
from pliant.viewer.explorer.submissions import Method, read_report, read_submission

OpenMethod = Callable[[str], Matcher | SplitMatcher]


def open_explorer(dataset: Dataset, answers: Sequence[str], open_method: OpenMethod) -> Explorer:
    """Return the explorer of a dataset.

    Args:
        dataset: The dataset.
        answers: Report folders, submissions and names of methods; none takes the shipped models
            for the dataset's objects, and SIFT next to them, where their extras are installed.
        open_method: Opens a method by its name.

    Raises:
        CallError: The method is unknown, or only answers whole splits.
        SubmissionError: A report or a submission is damaged.
    """
    frames, queries = FrameCache(dataset), RecordedQueries(dataset)
    methods: list[Method] = []
    given = answers or _default_methods(dataset)
    for name in given:
        path = Path(name)
        if (path / SCORES_JSON).is_file():
            methods.append(read_report(path, dataset, queries))
        elif path.suffix == ".parquet":
            methods.append(read_submission(path, dataset, queries))
        else:
            matcher = open_method(name)
            if isinstance(matcher, SplitMatcher):
                raise CallError(
                    f"the method {name!r} answers the queries of a dataset, not single pixels",
                    fix=f"Write its answers with: pliant predict {name} --data DATA --out "
                    "SUB.parquet; then give SUB.parquet.",
                )
            methods.append(LiveMethod(matcher))
    several = Counter(method.name for method in methods)
    for method, name in zip(methods, given, strict=True):
        if several[method.name] > 1 and method.name != name:
            method.name += f" ({name})"
    return Explorer(frames, queries, methods)


def _default_methods(dataset: Dataset) -> list[str]:
    """Return the shipped models that are for the dataset's objects by their names, then SIFT."""
    kinds = {tier.kind for tier in dataset.tiers.values()}
    learned = [name for name in shipped_names() if any(name.endswith(f"-{kind}") for kind in kinds)]
    usable = all(map(is_installed, EXTRAS["train"]))
    return [*(learned if usable else ()), *(["sift"] if is_installed("cv2") else ())]
