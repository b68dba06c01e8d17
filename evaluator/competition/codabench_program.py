"""The scoring program of a Codabench competition."""

from __future__ import annotations

import json
import sys
from collections.abc import Sequence
from pathlib import Path

from pliant.evaluator.competition.scoring import flat_scores, score
from pliant.evaluator.report.report import render_report
from pliant.spec.errors import PliantError, SubmissionError


def main(arguments: Sequence[str]) -> int:
    """Score the submission in INPUT/res against INPUT/ref and write into OUTPUT.

    Standard error gets one line that says what is wrong; standard output, which participants
    can read too, the problems one by one.

    Args:
        arguments: The folders INPUT and OUTPUT (on Codabench /app/input and /app/output).

    Returns:
        0, or 1 for a submission that cannot be scored: then nothing is written.
    """
    given, output = Path(arguments[0]), Path(arguments[1])
    try:
        submission = find_submission(given / "res")
        scores = score(submission, given / "ref")
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

    Args:
        folder: What the participant's zip held.

    Raises:
        SubmissionError: There is none, or more than one.
    """
    found = sorted(
        path
        for path in folder.rglob("*.parquet")
        if not path.name.startswith(".") and "__MACOSX" not in path.parts
    )
    if len(found) != 1:
        names = ", ".join(str(path.relative_to(folder)) for path in found[:5])
        raise SubmissionError(
            "the submission must be a zip archive with one Parquet file in it",
            found=f"{len(found)} files{f' ({names})' if names else ''} named *.parquet",
            required="one",
            fix="Zip the file that pliant check accepts, alone",
        )
    return found[0]
