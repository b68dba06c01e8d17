"""What Codabench runs: `pliant evaluate --hide-truth` by the competition's protocol.

The bundle around it is written by `pliant.publishing.competition`.
"""

from __future__ import annotations

import json
import sys
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, Final

from pliant.evaluator.evaluate import evaluate
from pliant.evaluator.hidden_truth import public_scores
from pliant.evaluator.report.report import render_report
from pliant.evaluator.scores import Scores
from pliant.spec.errors import PliantError, SubmissionError
from pliant.spec.io.jsonfiles import read_json
from pliant.spec.limits import Limits

COMPETITION_JSON: Final = "competition.json"
"""In the reference data: the split and the protocol."""


def score(submission: Path, reference: Path) -> Scores:
    """Score a submission against a competition's reference data.

    Args:
        submission: The participant's file.
        reference: The unpacked reference data.

    Returns:
        What participants see of the scores of `pliant evaluate --hide-truth`: the rounded
        headline metrics.

    Raises:
        SubmissionError: Something is wrong with the submission; `issues` has every cause.
        CallError: It is of another kind than the competition asks for.
        SpecError: The reference data is at fault.
    """
    rules = read_json(reference / COMPETITION_JSON)
    scores = evaluate(
        submission, reference, protocol=rules["protocol"], hide_truth=True, limits=Limits()
    )
    return replace(public_scores(scores), hints=())


def flat_scores(document: Mapping[str, Any]) -> dict[str, float]:
    """Return the metrics of scores.json by one name each.

    Args:
        document: The content of scores.json.

    Returns:
        `rmse_px` over the split, `rope.rmse_px` over a tier, and so on; a metric without a value
        (no answer gave a distribution, say) is left out.
    """
    groups = {"": document["overall"]}
    groups |= {f"{tier}.": values for tier, values in document["tiers"].items()}
    return {
        f"{prefix}{metric}": value
        for prefix, values in groups.items()
        for metric, value in values.items()
        if value is not None
    }


def codabench(arguments: Sequence[str]) -> int:
    """Score the submission in INPUT/res against INPUT/ref and write into OUTPUT.

    Standard error gets one line that says what is wrong; standard output, which participants
    can read too, the causes one by one.

    Args:
        arguments: The folders INPUT and OUTPUT (on Codabench /app/input and /app/output).

    Returns:
        0, or 1 for a submission that cannot be scored: then nothing is written.
    """
    given, output = Path(arguments[0]), Path(arguments[1])
    try:
        scores = score(find_submission(given / "res"), given / "ref")
        page = render_report(scores)  # of rounded scores: nothing that tells single answers
    except PliantError as error:
        if isinstance(error, SubmissionError):
            sys.stdout.writelines(f"{issue}\n" for issue in error.issues)
        sys.stderr.write(f"Error: {error}\n")
        return 1
    output.mkdir(parents=True, exist_ok=True)
    flat = flat_scores(scores.document)
    (output / "detailed_results.html").write_text(page, encoding="utf-8")
    (output / "scores.json").write_text(json.dumps(flat, indent=1), encoding="utf-8")
    headline = scores.document["headline"][0]
    sys.stdout.write(f"{scores.method}: {headline} {flat.get(headline)}\n")
    return 0


def find_submission(folder: Path) -> Path:
    """Return the one Parquet file of an unpacked submission.

    Raises:
        SubmissionError: There is none, or more than one.
    """
    paths = sorted(folder.rglob("*.parquet"))
    found = [p for p in paths if not p.name.startswith(".") and "__MACOSX" not in p.parts]
    if len(found) != 1:
        names = ", ".join(str(path.relative_to(folder)) for path in found[:5])
        raise SubmissionError(
            "the submission must be a zip archive with one Parquet file in it",
            found=f"{len(found)} files{f' ({names})' if names else ''} named *.parquet",
            required="one",
            fix="Zip the file that pliant check accepts, alone",
        )
    return found[0]
