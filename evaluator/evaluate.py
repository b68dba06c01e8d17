"""Scores a submission by a named protocol."""

from __future__ import annotations

from pathlib import Path

from pliant.evaluator.protocols.protocol import Protocol, find_protocol, read_protocol
from pliant.evaluator.scores import Scores
from pliant.evaluator.scoring import score
from pliant.evaluator.submission.loading import Given, Loaded, load, load_in_memory
from pliant.evaluator.submission.problems import Problems
from pliant.spec.calls import check_whole
from pliant.spec.dataset import Dataset
from pliant.spec.errors import CallError, SubmissionError
from pliant.spec.limits import Limits
from pliant.spec.opening import check_truth, foreign_truth
from pliant.spec.progress import Progress
from pliant.spec.storage import layout


def evaluate(
    submission: Path | str,
    data: Dataset | Path | str,
    *,
    truth: Path | str | None = None,
    protocol: str | Path | Protocol | None = None,
    allow_missing: bool = False,
    hide_truth: bool = False,
    limits: Limits | None = None,
    workers: int = 1,
    progress: Progress | None = None,
) -> Scores:
    """Score a submission.

    Args:
        submission: The submission's file.
        data: The dataset, or its folder.
        truth: The split's truth, its folder, or the private half of a published dataset, which
            also brings the surfaces; None takes the dataset's own.
        protocol: A protocol, its name or its file; None takes `standard` for answers, `matches`
            for matches.
        allow_missing: Score a query without an answer as the worst value instead of refusing.
        hide_truth: Cap every error at the image diagonal, for scores that participants of a
            competition see: uncapped errors reveal single answers. Hints that need the truth are
            left out too. See `public_scores`.
        limits: Read the submission in a child process with these limits, as the command does;
            None reads it in this process, which a hostile file can crash.
        workers: Number of processes that read surface images, >= 1; does not change the scores.
        progress: Called repeatedly with (number of scored pairs, total number of pairs).

    Returns:
        The scores.

    Raises:
        SubmissionError: Something is wrong with the submission; `issues` has every cause.
        SpecError: The dataset or the truth is at fault.
        CallError: No such protocol or truth, or a protocol for another kind of submission.

    Examples:
        >>> path = pliant.predict("sample", "centroid").write("answers.parquet")
        >>> scores = pliant.evaluator.evaluate("answers.parquet", "sample", protocol="paper")
        >>> round(scores.overall["rmse_px"], 2)
        48.01
    """
    check_whole("workers", workers, 1)
    dataset = _opened(data, truth)
    chosen = None if protocol is None else find_protocol(protocol)
    problems = Problems(submission)
    path = Path(submission)
    loaded = load(path, dataset, problems, allow_missing=allow_missing, limits=limits)
    return _scored(
        loaded, problems, dataset, truth, chosen, progress, hide_truth=hide_truth, workers=workers
    )


def evaluate_answers(
    data: Dataset | Path | str,
    split: str,
    answers: Given,
    *,
    method: str = "answers in memory",
    truth: Path | str | None = None,
    protocol: str | Path | Protocol | None = None,
    allow_missing: bool = False,
) -> Scores:
    """Score answers that are in memory, as `evaluate` scores the file that contains them.

    Args:
        data: The dataset, or its folder.
        split: The split that is answered.
        answers: The positions alone, float32 or float64 (R, 2), pixels, in the order of the
            split's queries; or a mapping or `pyarrow.Table` with the columns of a submission
            (`u`, `v`, and where given `visible`, `sigma`, `modes`). With the columns `pair_id`
            and `query_id` the rows may be in any order.
        method: Name of the method in the scores.
        truth: As for `evaluate`.
        protocol: As for `evaluate`.
        allow_missing: As for `evaluate`.

    Raises:
        SubmissionError: Something is wrong with the answers; `issues` has every cause.
        SpecError: The dataset or the truth is at fault.
        CallError: No such protocol or split, or the answers are not columns of one length.

    Examples:
        >>> queries = pliant.load("sample").queries("test")
        >>> unmoved = {"u": queries["u_a"], "v": queries["v_a"]}
        >>> scores = pliant.evaluator.evaluate_answers("sample", "test", unmoved)
        >>> scores.overall["off_object_rate"] > 0.5
        True
    """
    dataset = _opened(data, truth)
    chosen = None if protocol is None else find_protocol(protocol)
    problems = Problems(method)
    loaded = load_in_memory(answers, dataset, split, method, problems, allow_missing=allow_missing)
    return _scored(loaded, problems, dataset, truth, chosen)


def _opened(data: Dataset | Path | str, truth: Path | str | None) -> Dataset:
    dataset = data if isinstance(data, Dataset) else Dataset.open(data)
    return dataset if truth is None else dataset.with_truth(Path(truth))


def _scored(
    loaded: Loaded | None,
    problems: Problems,
    dataset: Dataset,
    truth: Path | str | None,
    chosen: Protocol | None,
    progress: Progress | None = None,
    *,
    hide_truth: bool = False,
    workers: int = 1,
) -> Scores:
    """Score a submission that was read; refuse one with problems."""
    if loaded is None:
        raise _refusal(problems)
    kind = loaded.submission.kind
    protocol = chosen or read_protocol("matches" if kind == "matches" else "standard")
    if kind != protocol.kind:
        raise CallError(
            f"protocol {protocol.name} scores submissions of kind {protocol.kind}",
            path=problems.path,
            found=f"kind {kind}",
            fix="Use --protocol matches for keypoint matches, another for answers.",
        )
    split = loaded.submission.split
    protocol.check_episodes(dataset, split, loaded.queries, allow_empty=True)
    name = layout.truth_name(split)
    path = dataset.local(name) if dataset.has(name) else dataset.root / name
    given = path if truth is None else Path(truth)
    # A private half has the truth of held-out splits, and the surfaces of all.
    if given not in (path, path.parent) and not (given / layout.MANIFEST_JSON).is_file():
        raise foreign_truth(given, "other splits", f"split {split!r}, which is answered")
    if protocol.kind == "answers":
        queries_sha256 = str(loaded.submission.footer["queries_sha256"])
        check_truth(path, dataset.id, dataset.version, split, queries_sha256)
    return score(
        loaded, dataset, path, protocol, hide_truth=hide_truth, progress=progress, workers=workers
    )


def _refusal(problems: Problems) -> SubmissionError:
    issues = problems.causes
    codes = ", ".join(f"{code} {total:,}" for code, total in problems.counts.items())
    return SubmissionError(
        "the submission cannot be scored",
        issues=issues,
        path=problems.path,
        found=f"{problems.total:,} problem{'s' if problems.total > 1 else ''} ({codes})",
        fix=f"The first: {issues[0].where + ': ' if issues[0].where else ''}{issues[0].message}",
    )
