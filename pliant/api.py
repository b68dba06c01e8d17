"""The functions of `import pliant`; heavy libraries are imported when one is called."""

from __future__ import annotations

import os
import re
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

from pliant.method_names import open_method
from pliant.spec.answers import Answers
from pliant.spec.calls import PATH, check_type, check_whole
from pliant.spec.dataset import Dataset
from pliant.spec.errors import CallError, MissingExtraError, SpecError
from pliant.spec.progress import Progress

if TYPE_CHECKING:
    import numpy as np
    import numpy.typing as npt
    import pyarrow as pa

    from pliant.baselines import Matcher, SplitMatcher
    from pliant.baselines.adapters import MatchFunction
    from pliant.baselines.predict import SplitAnswers
    from pliant.evaluator.scores import Scores
    from pliant.generator.config import GenerateConfig
    from pliant.loaders import AugmentSettings, PairSettings
    from pliant.spec.validation.validate import Report
    from pliant.streaming import PairStream

__all__ = ["evaluate", "load", "open_method", "predict", "stream", "validate"]

_ANSWERS: Final = (
    "what predict returns, the path of a submission, a table, or positions (N, 2) in pixels"
)
_HUB_ID = re.compile(r"[A-Za-z0-9][\w.-]*/[A-Za-z0-9][\w.-]*")


def load(source: Dataset | Path | str) -> Dataset:
    """Open a dataset.

    Args:
        source: An open dataset (returned as it is), its folder, a URL that fsspec knows (`s3://`,
            `https://`), or the id of a dataset on the Hugging Face Hub (`USER/NAME`) where no such
            folder exists. `sample` is a small dataset of ropes in the package. A YAML
            file of `pliant generate` is a dataset without files: its frames are simulated when they
            are read.

    Raises:
        CallError: The folder does not exist.
        SpecError: It is not a dataset, or its version cannot be read.
        MissingExtraError: A URL or Hub id, and the extra `publish` is not installed.

    Examples:
        >>> ds = pliant.load("sample")
        >>> len(ds), ds[0].frames
        (12, 2)
    """
    if isinstance(source, Dataset):
        return source
    check_type(
        "dataset", source, PATH, required="a folder, a URL, a Hub id (USER/NAME) or a Dataset"
    )
    text = str(source)
    if text.endswith((".yaml", ".yml")):
        from pliant.generator.simulated import SimulatedDataset

        return SimulatedDataset.of(Path(text))
    if "://" not in text and not os.path.exists(text) and _HUB_ID.fullmatch(text):
        return _from_hub(text)
    return Dataset.open(source)


def _from_hub(name: str) -> Dataset:
    """Open a dataset of the Hugging Face Hub; the name may also be a mistyped folder's."""
    try:
        return Dataset.open(f"hf://datasets/{name}")
    except MissingExtraError as error:
        feature = f"folder {name} not found, and opening a dataset of the Hugging Face Hub"
        raise MissingExtraError(feature, "publish") from error
    except SpecError as error:
        raise SpecError(
            "folder not found, and a dataset of this name on the Hugging Face Hub cannot be opened",
            path=name,
            found=error,
        ) from error


def stream(
    config: GenerateConfig | Mapping[str, Any] | Path | str,
    *,
    tier: str = "",
    split: str = "train",
    size: tuple[int, int] = (160, 120),
    pairs: PairSettings | None = None,
    augmentation: AugmentSettings | None = None,
    seed: int = 0,
    batch: int = 8,
    steps: int = 1000,
    start: int = 0,
    cache: Path | str | None = None,
) -> PairStream:
    """Simulate and render training batches without writing a dataset.

    The frames equal those that `pliant generate` writes for the config, and the batches those that
    training draws from the written dataset.

    Args:
        config: Settings of `pliant generate`: a YAML file, their values, or a `GenerateConfig`.
        tier: The tier; empty where the config has only one.
        split: The split.
        size: (width, height) of the network's input, pixels.
        pairs: What a sample contains (`PairDataset`).
        augmentation: Random changes, or None.
        seed: Random seed of the samples; that of the frames is in the config.
        batch: Samples per batch.
        steps: Number of batches of the whole stream.
        start: Number of the first batch, to continue an earlier stream: the `start` batches before
            it are left out.
        cache: A folder for the frames at `size`, which worker processes share: each sequence is
            then simulated once. None keeps the newest sequences in memory.

    Returns:
        A PyTorch `IterableDataset` of batches; see `PairStream`.

    Raises:
        CallError: The config has no such tier or split, or a secret seed.
        MissingExtraError: The extra `generate` or `train` is not installed.

    Examples:
        >>> rope = {"tiers": ["rope"], "splits": {"train": 2}, "style": "raster"}
        >>> stream = pliant.stream(rope, batch=4, steps=10)
        >>> next(iter(stream))["image"].shape  # batch, views, channels, height, width
        torch.Size([4, 2, 3, 120, 160])
    """
    from pliant.spec.extras import require_packages

    require_packages(["torch"], "streaming batches", "train")
    from pliant.generator.simulated import SimulatedDataset
    from pliant.loaders import FrameStore, PairDataset, StepOrder
    from pliant.streaming import PairStream

    check_whole("start", start)
    check_whole("steps", steps, start)
    dataset = SimulatedDataset.of(config)
    names = list(dataset.tiers)
    if not tier and len(names) > 1:
        raise CallError("the config has several tiers", where="tier", required=f"one of {names}")
    store = FrameStore(dataset, tier or names[0], split, size, cache=cache)
    samples = PairDataset(store, pairs, seed=seed, augmentation=augmentation)
    return PairStream(samples, StepOrder(batch, start, steps))


def predict(
    dataset: Dataset | Path | str,
    method: str | Matcher | SplitMatcher | MatchFunction,
    split: str = "test",
    *,
    workers: int = 1,
    progress: Progress | None = None,
) -> SplitAnswers:
    """Answer the queries of a split with a method, in memory.

    Args:
        dataset: A dataset, or an argument of `load`.
        method: An argument of `open_method`, a `Matcher`, an object with only `match`, or a
            function (source, target, queries (N, 2)) -> positions (N, 2) or `Answers`.
        split: A split with queries.
        workers: Number of processes; does not change the answers.
        progress: Called with the number of finished pairs and the total number of pairs.

    Returns:
        The answers; `write` saves them as a submission file.

    Raises:
        CallError: No such method or split.
        SubmissionError: The method did not return one finite position per query.

    Examples:
        >>> answers = pliant.predict("sample", "centroid")
        >>> answers.to_table().num_rows
        768
    """
    from pliant.baselines.predict import answer

    opened = load(dataset)
    check_type("split", split, str)
    check_whole("workers", workers, 1)
    if progress is not None and not callable(progress):
        raise CallError("the argument must be a function", where="progress", found=repr(progress))
    chosen: Any = open_method(str(method)) if isinstance(method, PATH) else method
    return answer(opened, split, chosen, workers=workers, progress=progress)


def evaluate(
    dataset: Dataset | Path | str,
    answers: SplitAnswers | Path | str | pa.Table | npt.NDArray[np.floating[Any]],
    split: str = "test",
    *,
    truth: Path | str | None = None,
    protocol: Path | str | None = None,
    allow_missing: bool = False,
) -> Scores:
    """Score answers.

    Args:
        dataset: A dataset, or an argument of `load`.
        answers: The result of `predict`, the path of a submission, a table with the columns of a
            submission, or only positions, float (N, 2), pixels, in the order of the queries.
        split: The split of a table or an array; the result of `predict` and a submission name it.
        truth: The ground truth of the split, if the dataset does not contain it: a file, or the
            private half of a published dataset.
        protocol: Name of a protocol (default: `standard`), or the JSON or YAML file of another.
        allow_missing: Score a query without an answer as the worst value.

    Raises:
        SubmissionError: The answers have problems; `issues` lists all of them.
        CallError: Unknown protocol or split, or the answers are of another dataset.

    Examples:
        >>> answers = pliant.predict("sample", "centroid")
        >>> round(pliant.evaluate("sample", answers).overall["rmse_px"], 2)
        48.01
    """
    from pliant.baselines.predict import SplitAnswers
    from pliant.evaluator import evaluate as evaluate_file
    from pliant.evaluator import evaluate_answers

    opened = load(dataset)
    check_type("split", split, str)
    check_type("truth", truth, (*PATH, type(None)), required="a file, a folder or None")
    check_type("protocol", protocol, (*PATH, type(None)), required="a name, a file or None")
    check_type("allow_missing", allow_missing, bool)
    if answers is None or isinstance(answers, Dataset | Answers | int | float | bool):
        check_type("answers", answers, SplitAnswers, required=_ANSWERS)
    if isinstance(answers, str | Path):
        return evaluate_file(
            answers, opened, truth=truth, protocol=protocol, allow_missing=allow_missing
        )
    if isinstance(answers, SplitAnswers):
        split, name, given = answers.split, str(answers.method["name"]), answers.to_table()
        if answers.dataset.queries_sha256(split) != opened.queries_sha256(split):
            raise CallError(
                "the answers belong to other queries",
                where="answers",
                found=repr(answers),
                required=f"answers to split {split} of {opened.root}",
                fix="Predict again with this dataset",
            )
    else:
        name, given = "answers in memory", answers
    return evaluate_answers(
        opened,
        split,
        given,
        method=name,
        truth=truth,
        protocol=protocol,
        allow_missing=allow_missing,
    )


def validate(dataset: Dataset | Path | str, *, workers: int = 1) -> Report:
    """Check a dataset against every rule of the specification.

    Args:
        dataset: The dataset, or its folder.
        workers: Number of processes; does not change the result.

    Returns:
        All problems, each with code, severity, file and place.

    Raises:
        CallError: The dataset is not a folder on this machine.

    Examples:
        >>> pliant.validate("sample").valid
        True
    """
    from pliant.spec.validation.validate import validate as validate_folder

    check_type("dataset", dataset, (Dataset, *PATH), required="a folder or a Dataset")
    check_whole("workers", workers, 1)
    return validate_folder(
        dataset.address if isinstance(dataset, Dataset) else dataset, workers=workers
    )
