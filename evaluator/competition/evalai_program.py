"""The evaluation script of an EvalAI challenge."""

from __future__ import annotations

import tempfile
import zipfile
from pathlib import Path
from typing import Any

from pliant.evaluator.competition.scoring import COMPETITION_JSON, flat_scores, score
from pliant.spec.io.jsonfiles import read_json


def evaluate(
    test_annotation_file: str, user_annotation_file: str, phase_codename: str, **kwargs: Any
) -> dict[str, Any]:
    """Score one submission, as EvalAI's worker calls it.

    Args:
        test_annotation_file: The phase's annotation file: the zipped reference data.
        user_annotation_file: The participant's Parquet file.
        phase_codename: The phase; there is one for each split, and its file says which.
        **kwargs: What the worker tells of the submission; not used.

    Returns:
        `{"result": [{split: {metric: value}}], "submission_result": {metric: value}}`; a metric
        of the leaderboard that this submission has no value for is None.

    Raises:
        SubmissionError: The submission cannot be scored; EvalAI shows the message.
        CallError: It is of another kind than the challenge asks for.
    """
    with tempfile.TemporaryDirectory(prefix="pliant-") as folder:
        reference = Path(folder)
        with zipfile.ZipFile(test_annotation_file) as archive:
            archive.extractall(reference)
        rules = read_json(reference / COMPETITION_JSON)
        flat = flat_scores(score(Path(user_annotation_file), reference).document)
    # The leaderboard reads every label of its schema from every result.
    result: dict[str, float | None] = {**dict.fromkeys(rules["columns"]), **flat}
    return {"result": [{rules["split"]: result}], "submission_result": result}
