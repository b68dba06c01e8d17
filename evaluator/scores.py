"""The result of an evaluation: figures with their provenance, and the table of pairs."""

from __future__ import annotations

import functools
import html
import json
import math
from collections.abc import Mapping
from dataclasses import dataclass
from importlib import resources
from pathlib import Path
from typing import Any, Final

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
from jsonschema import Draft202012Validator
from jsonschema.exceptions import ValidationError, best_match

from pliant.evaluator.submission.queries import Queries
from pliant.spec.arrays import FloatArray
from pliant.spec.errors import CallError, SubmissionError
from pliant.spec.io.jsonfiles import parse_json, write_json
from pliant.spec.io.reading import FileRefusedError, sha256_file

SCORES_VERSION: Final = "1.0"
SCORES_JSON: Final = "scores.json"
PER_PAIR_TABLE: Final = "per_pair.parquet"
REPORT_HTML: Final = "report.html"
PAIR_COLUMNS: Final = ("pair_id", "tier", "sequence_a", "frame_a", "sequence_b", "frame_b")
"""Columns that the table of pairs always has."""
SIGNIFICANT_DIGITS: Final = 4
"""Digits of `public_scores`."""
BITS_PER_FIGURE: Final = math.log2(9 * 10 ** (SIGNIFICANT_DIGITS - 1))
"""A figure of so many digits has at most so many bits beyond its order of magnitude."""


@dataclass(frozen=True, repr=False)
class Scores:
    """Everything an evaluation found.

    Attributes:
        document: What `scores.json` contains; see `schemas/scores.schema.json`.
        per_pair: One row an image pair: ids, frames, and the sums every metric is made of.
        examples: Worst and median pairs with their queries, truth and answers, for pictures;
            empty for scores that were read back from files.
        hints: Sentences about likely mistakes in the coordinates. They are found with the truth,
            so they are in no file and on no page.

    Examples:
        >>> scores = pliant.evaluate("sample", pliant.predict("sample", "centroid"))
        >>> list(scores.tiers), round(scores.overall["rmse_px"], 2)
        (['rope'], 48.01)
        >>> scores.to_arrow().column_names[:3]
        ['group', 'metric', 'value']
    """

    document: dict[str, Any]
    per_pair: pa.Table
    examples: tuple[Any, ...] = ()
    hints: tuple[str, ...] = ()

    @property
    def overall(self) -> dict[str, float | None]:
        """The metrics over the whole split."""
        values: dict[str, float | None] = self.document["overall"]
        return values

    @property
    def tiers(self) -> dict[str, dict[str, float | None]]:
        """The metrics of each tier."""
        values: dict[str, dict[str, float | None]] = self.document["tiers"]
        return values

    @property
    def method(self) -> str:
        """Name of the method."""
        return str(self.document["submission"]["method"]["name"])

    def __repr__(self) -> str:
        document = self.document
        values = ", ".join(
            f"{name} {value:.4g}"
            for name in document["headline"]
            if (value := self.overall.get(name)) is not None
        )
        return (
            f"<Scores of {self.method}, {document['dataset']['id']} {document['split']}, "
            f"protocol {document['protocol']}: {values}>"
        )

    def to_arrow(self) -> pa.Table:
        """Return the metrics as a table: group, metric, value, and its interval (low, high).

        The groups are `overall` and the tiers. What is not defined is null.
        """
        intervals = self.document["intervals"]
        groups = {"overall": (self.overall, intervals["overall"])}
        groups |= {name: (self.tiers[name], intervals["tiers"][name]) for name in self.tiers}
        rows = [
            (group, metric, value, *found.get(metric, (None, None)))
            for group, (values, found) in groups.items()
            for metric, value in values.items()
        ]
        names = ("group", "metric", "value", "low", "high")
        types = (pa.string(), pa.string(), pa.float64(), pa.float64(), pa.float64())
        schema = pa.schema(list(zip(names, types, strict=True)))
        return pa.table([list(column) for column in zip(*rows, strict=True)], schema=schema)

    def to_pandas(self) -> Any:
        """Return `to_arrow` as a `pandas.DataFrame`.

        Raises:
            CallError: pandas is not installed.
        """
        try:
            return self.to_arrow().to_pandas()
        except ModuleNotFoundError as error:
            fix = "Install it with: pip install pandas, or use to_arrow()"
            raise CallError("to_pandas needs pandas", fix=fix) from error

    def _repr_html_(self) -> str:
        """Return the headline as an HTML table, a column for each group, for notebooks."""
        groups = {"overall": self.overall, **(self.tiers if len(self.tiers) > 1 else {})}
        lines = [["metric", *groups]]
        for name in self.document["headline"]:
            values = (group.get(name) for group in groups.values())
            lines.append([name, *("–" if v is None else f"{v:.4g}" for v in values)])
        rows = [
            "".join(f"<td>{html.escape(cell)}</td>" for cell in cells).join(("<tr>", "</tr>"))
            for cells in lines
        ]
        return f"<table><caption>{html.escape(self.method)}</caption>{''.join(rows)}</table>"

    def write(self, folder: Path, page: str) -> None:
        """Write the files of a report into an existing folder.

        `scores.json` comes last and lists the sha256 of the others, so that `read_scores` refuses
        files of different evaluations.

        Args:
            folder: The folder.
            page: The report as HTML.
        """
        pq.write_table(self.per_pair, folder / PER_PAIR_TABLE, compression="zstd")
        (folder / REPORT_HTML).write_text(page, encoding="utf-8")
        files = {name: sha256_file(folder / name) for name in (PER_PAIR_TABLE, REPORT_HTML)}
        write_json(folder / SCORES_JSON, {**self.document, "files": files})


def public_scores(scores: Scores) -> Scores:
    """Return the part of scores that participants of a competition see.

    A score in full precision is an equation for the answers: one answer moved by a known amount
    changes the RMSE by an amount that depends on its truth alone. See docs/competitions.md.

    Args:
        scores: From `evaluate` with `hide_truth`.

    Returns:
        The headline metrics over the split, and the first of them for each tier, rounded to
        `SIGNIFICANT_DIGITS`; no intervals, curves, slices, pairs or examples, and no number of
        visible points.

    Raises:
        CallError: The errors are not capped.
    """
    document = scores.document
    if not document.get("hide_truth"):
        raise CallError(
            f"the scores of {scores.method} reveal single answers of a held-out split",
            found="errors that are not capped at the image diagonal",
            fix="Score the submission with: pliant evaluate --hide-truth",
        )
    headline = document["headline"]
    # The figures of a single tier are those of the split.
    of_tier = headline if len(scores.tiers) == 1 else headline[:1]
    public = {
        **document,
        "rounded": True,
        "counts": {name: n for name, n in document["counts"].items() if name != "counted"},
        "overall": _rounded(scores.overall, headline),
        "tiers": {tier: _rounded(values, of_tier) for tier, values in scores.tiers.items()},
        "intervals": {
            "level": document["intervals"]["level"],
            "overall": {},
            "tiers": {tier: {} for tier in scores.tiers},
        },
        "curves": {},
        "slices": {},
    }
    return Scores(public, scores.per_pair.slice(0, 0))


def _rounded(values: dict[str, float | None], names: list[str]) -> dict[str, float | None]:
    chosen = {name: values[name] for name in names if name in values}
    return {
        name: None if value is None else float(f"{value:.{SIGNIFICANT_DIGITS}g}")
        for name, value in chosen.items()
    }


def pair_table(queries: Queries, columns: Mapping[str, FloatArray]) -> pa.Table:
    """Return the pair table as Arrow, ids and frames first, sums after."""

    def texts(codes: Any, names: list[str]) -> pa.Array:
        return pa.DictionaryArray.from_arrays(pa.array(codes, pa.int32()), names).cast(pa.string())

    data: dict[str, Any] = {
        "pair_id": np.arange(queries.pairs, dtype=np.int32),
        "tier": texts(queries.tier, queries.tiers),
        "sequence_a": texts(queries.sequence_a, queries.sequences),
        "frame_a": queries.frame_a,
        "sequence_b": texts(queries.sequence_b, queries.sequences),
        "frame_b": queries.frame_b,
    }
    data |= {name: values for name, values in sorted(columns.items()) if name != "one"}
    return pa.table(data)


def read_scores(folder: Path) -> Scores:
    """Read a report's figures back.

    Args:
        folder: A folder that `write_report` wrote.

    Raises:
        SubmissionError: It is not a report, a file of it is damaged, or its files do not belong
            together.

    Examples:
        >>> scores = pliant.evaluate("sample", pliant.predict("sample", "centroid"))
        >>> pliant.evaluator.write_report(scores, "read-report", data="sample")
        >>> pliant.evaluator.read_scores(Path("read-report")).overall == scores.overall
        True
    """
    path = folder / SCORES_JSON
    try:
        document = parse_json(path.read_bytes(), path)
        check_document(document)
        if "files" not in document:
            raise _no_report(path, "no field `files`: it was written by an earlier version")
        files = document.pop("files")
        for name, listed in files.items():
            if (folder / name).is_file() and sha256_file(folder / name) != listed:
                raise SubmissionError(
                    "this file of a report is not the one that its scores.json lists",
                    path=folder / name,
                    found="another sha256",
                    fix="Write the report again: "
                    "pliant evaluate SUBMISSION --data DATASET --out REPORT",
                )
        with open(folder / PER_PAIR_TABLE, "rb") as stream:  # given a folder, Arrow reads all in it
            table = pq.ParquetFile(stream).read()
    except FileRefusedError as error:
        raise _no_report(folder, f"{error.where or SCORES_JSON}: {error.message}") from error
    except (OSError, ValueError, pa.ArrowException) as error:
        raise _no_report(folder, error) from error
    except ValidationError as error:
        raise _no_report(path, error.message) from error
    missing = [name for name in PAIR_COLUMNS if name not in table.column_names]
    if missing:
        raise _no_report(folder / PER_PAIR_TABLE, f"no column {', '.join(missing)}")
    return Scores(document, table)


def _no_report(path: Path, reason: object) -> SubmissionError:
    return SubmissionError(
        "this is not a report of pliant evaluate",
        path=path,
        found=" ".join(str(reason).split())[:200],
        fix=f"Give a folder that contains {SCORES_JSON} and {PER_PAIR_TABLE}.",
    )


def check_document(document: Mapping[str, Any]) -> None:
    """Compare the content of scores.json with its schema.

    Args:
        document: The content.

    Raises:
        ValidationError: The first and most telling difference.
    """
    error = best_match(_validator().iter_errors(document))
    if error is not None:
        raise error


@functools.cache
def _validator() -> Draft202012Validator:
    path = resources.files("pliant.evaluator") / "schemas" / "scores.schema.json"
    return Draft202012Validator(json.loads(path.read_bytes()))
