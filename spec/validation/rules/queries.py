"""Rules of queries and ground truth: keys, visibility in the source, agreement with the tables."""

from __future__ import annotations

from collections.abc import Mapping
from functools import lru_cache
from typing import Any

import numpy as np
import numpy.typing as npt
import pyarrow as pa

from pliant.spec.io import limits
from pliant.spec.io.reading import sha256_file
from pliant.spec.storage import layout
from pliant.spec.tables import QUERIES
from pliant.spec.validation.findings import FileProblems, Findings
from pliant.spec.validation.rules.answers import Aligned, compare_answers, read_tracks
from pliant.spec.validation.rules.context import Context
from pliant.spec.validation.rules.correspondences import VISIBLE
from pliant.spec.validation.rules.listing import check_identity
from pliant.spec.validation.rules.result import SequenceResult
from pliant.spec.validation.rules.tables import CheckedTable, check_table, numbers

_TABLES_IN_MEMORY = 16


def check_split_queries(
    context: Context, split: str, sequences: Mapping[str, SequenceResult]
) -> Findings:
    """Check the queries of a split, and their truth where it is there.

    Args:
        context: The dataset.
        split: The split.
        sequences: Every sequence whose sequence.json could be read.

    Returns:
        The problems.
    """
    findings = Findings()
    path = layout.queries_path(context.root, split)
    truth_path = layout.truth_path(context.root, split)
    of_queries = findings.at(layout.queries_name(split))
    of_truth = findings.at(layout.truth_name(split))
    if split not in context.splits:
        of_queries.add("SPLIT_UNKNOWN", "", f"dataset.json declares {list(context.splits)}")
    table = None
    if path.is_file() and not path.is_symlink():
        table = check_table(path, "queries", of_queries, max_rows=limits.MAX_TABLE_ROWS)
    elif not path.is_symlink():
        text = f"{of_truth.path} answers queries that are not there"
        of_queries.add("FILE_MISSING", "", text)
    truth = None
    if split in context.held_out and truth_path.is_file():
        of_truth.add("HELD_OUT_LEAKS", "", f"the split {split} is held out")
    elif truth_path.is_file() and not truth_path.is_symlink():
        truth = check_table(truth_path, "truth", of_truth, max_rows=limits.MAX_TABLE_ROWS)
    for part in (table, truth):
        if part is not None:
            check_identity(context, part)
            named = part.footer.get("split", split)
            if named != split:
                text = f"found {named}; the file's name says {split}"
                part.problems.add("IDENTITY_DIFFERS", "footer split", text)
    if table is None or not table.whole:
        return findings
    if truth is not None and "queries_sha256" in truth.footer:
        found = sha256_file(path)
        if truth.footer["queries_sha256"] != found:
            of_truth.add(
                "QUERIES_MISMATCH",
                "footer queries_sha256",
                f"found {truth.footer['queries_sha256']}; the queries file has {found}",
            )
    _SplitCheck(context, split, sequences, of_queries, of_truth).run(
        table, truth if truth is not None and truth.whole else None
    )
    return findings


class _SplitCheck:
    """One pass over the queries of a split and, next to them, their truth."""

    def __init__(
        self,
        context: Context,
        split: str,
        sequences: Mapping[str, SequenceResult],
        of_queries: FileProblems,
        of_truth: FileProblems,
    ) -> None:
        self.context = context
        self.split = split
        self.sequences = sequences
        self.of_queries, self.of_truth = of_queries, of_truth
        self._tracks_of = lru_cache(_TABLES_IN_MEMORY)(
            lambda name: read_tracks(context, sequences[name])
        )
        self._last_key = (-1, 0)
        self._last_pair: dict[str, Any] = {}

    def run(self, table: CheckedTable, truth: CheckedTable | None) -> None:
        """Check the rows, pair by pair."""
        answers = Aligned(truth) if truth is not None else None
        if truth is not None and truth.rows != table.rows:
            code = "ROW_MISSING" if truth.rows < table.rows else "ROW_UNKNOWN"
            self.of_truth.add(
                code,
                "",
                f"{truth.rows} answers to {table.rows} queries; required: one each, in order",
            )
            answers = None
        for start, batch in table.batches(QUERIES.names):
            rows = {
                name: batch.column(name).to_pylist()
                if pa.types.is_string(QUERIES.field(name).type)
                else numbers(batch, name)
                for name in QUERIES.names
            }
            beside = answers.take(batch.num_rows) if answers is not None else None
            if answers is not None and beside is None:
                answers = None
            edges = np.flatnonzero(np.diff(rows["pair_id"])) + 1
            for low, high in zip([0, *edges], [*edges, batch.num_rows], strict=True):
                self._check_pair(start, rows, beside, int(low), int(high))

    def _check_pair(
        self,
        start: int,
        rows: dict[str, Any],
        beside: dict[str, Any] | None,
        low: int,
        high: int,
    ) -> None:
        if high <= low:
            return
        pair_id = int(rows["pair_id"][low])
        query_ids = rows["query_id"][low:high]
        last_pair, next_query = self._last_key
        first = 0 if pair_id == last_pair + 1 else next_query if pair_id == last_pair else None
        expected = None if first is None else np.arange(first, first + high - low)
        if expected is None or not np.array_equal(query_ids, expected):
            self.of_queries.add(
                "ROW_ORDER",
                f"row {start + low}",
                f"pair_id {pair_id} with query_id {query_ids[:3].tolist()} …; required: pairs "
                "from 0 and queries of a pair from 0, consecutive and ascending",
            )
        again = pair_id == last_pair
        self._last_key = (pair_id, int(query_ids[-1]) + 1)
        names = ("tier", "sequence_a", "frame_a", "sequence_b", "frame_b")
        pair = {name: rows[name][low] for name in names}
        mixed = any(value != pair[name] for name in names for value in rows[name][low:high])
        if mixed or (again and pair != self._last_pair):
            text = "its rows name different frames"
            self.of_queries.add("QUERY_INVALID", f"pair {pair_id}", text)
            return
        self._last_pair = pair
        if not self._check_frames(pair_id, pair):
            return
        uv_a = np.stack([rows["u_a"][low:high], rows["v_a"][low:high]], axis=1)
        answers = None if beside is None else {k: v[low:high] for k, v in beside.items()}
        point = self._check_sources(pair_id, query_ids, pair, uv_a, answers)
        if answers is not None:
            keys = {"pair_id": np.full(high - low, pair_id), "query_id": query_ids}
            self._check_answers(pair, keys, answers, point)

    def _check_frames(self, pair_id: int, pair: dict[str, Any]) -> bool:
        problems = []
        for side in ("a", "b"):
            name, frame = pair[f"sequence_{side}"], int(pair[f"frame_{side}"])
            known = self.sequences.get(name)
            if known is None:
                problems.append(f"sequence_{side} {name[:80]!r} is not in the dataset")
            elif (known.tier, known.split) != (pair["tier"], self.split):
                problems.append(
                    f"sequence_{side} is of {known.tier}, {known.split}; required: "
                    f"{pair['tier'][:80]}, {self.split}"
                )
            elif not 0 <= frame < known.frames:
                problems.append(f"frame_{side} is {frame}; {name} has {known.frames} frames")
        if not problems and (pair["sequence_a"], pair["frame_a"]) == (
            pair["sequence_b"],
            pair["frame_b"],
        ):
            problems.append("source and target are one frame")
        for problem in problems:
            self.of_queries.add("QUERY_INVALID", f"pair {pair_id}", problem)
        return not problems

    def _check_sources(
        self,
        pair_id: int,
        query_ids: npt.NDArray[np.int32],
        pair: dict[str, Any],
        uv_a: npt.NDArray[np.float32],
        answers: dict[str, Any] | None,
    ) -> npt.NDArray[np.int64] | None:
        """Check that each query is a visible point; return which, -1 where it is none."""
        bad_value = ~np.isfinite(uv_a).all(axis=1)
        self.of_queries.add_rows(
            "VALUE_NOT_FINITE",
            bad_value,
            lambda i: (f"pair {pair_id}, query {query_ids[i]}", f"found {uv_a[i].tolist()}"),
        )
        tracks = self._tracks_of(pair["sequence_a"])
        if tracks is None:
            size = np.array([self.context.width, self.context.height])
            self.of_queries.add_rows(
                "VALUE_OUT_OF_RANGE",
                ~bad_value & np.any((uv_a < 0) | (uv_a >= size), axis=1),
                lambda i: (
                    f"pair {pair_id}, query {query_ids[i]}",
                    f"found {uv_a[i].tolist()}, outside the image",
                ),
            )
            return None
        frame = int(pair["frame_a"])
        point = np.full(len(uv_a), -1, np.int64)
        if answers is not None:
            # Two points may project to one place: the truth says which of them is meant.
            named = answers["point"].astype(np.int64)
            inside = (named >= 0) & (named < len(tracks.askable))
            safe = np.where(inside, named, 0)
            fits = inside & tracks.askable[safe] & (tracks.state[frame, safe] == VISIBLE)
            fits &= np.all(tracks.uv_px[frame, safe] == uv_a, axis=1)
            point[fits] = named[fits]
        if np.any(point < 0):
            seen = np.flatnonzero(tracks.askable & (tracks.state[frame] == VISIBLE))
            places = map(tuple, tracks.uv_px[frame, seen].tolist())
            table = dict(zip(places, seen.tolist(), strict=True))
            for index in np.flatnonzero(point < 0):
                point[index] = table.get(tuple(uv_a[index].tolist()), -1)
        self.of_queries.add_rows(
            "QUERY_NOT_VISIBLE",
            (point < 0) & ~bad_value,
            lambda i: (
                f"pair {pair_id}, query {query_ids[i]}",
                f"no visible surface point of the queried object is at {uv_a[i].tolist()} in "
                f"{pair['sequence_a']}, frame {frame}",
            ),
        )
        return point

    def _check_answers(
        self,
        pair: dict[str, Any],
        keys: dict[str, Any],
        answers: dict[str, Any],
        point: npt.NDArray[np.int64] | None,
    ) -> None:
        count = len(keys["query_id"])
        wrong_key = (answers["pair_id"] != keys["pair_id"]) | (
            answers["query_id"] != keys["query_id"]
        )
        where = [f"pair {p}, query {q}" for p, q in zip(*keys.values(), strict=True)]
        self.of_truth.add_rows(
            "ROW_ORDER",
            wrong_key,
            lambda i: (
                where[i],
                f"found pair {answers['pair_id'][i]}, query {answers['query_id'][i]}",
            ),
        )
        problems: list[list[str]] = [[] for _ in range(count)]
        for index, tier in enumerate(answers["tier"]):
            if tier != pair["tier"]:
                problems[index].append(f"tier is {tier[:40]!r}; required: {pair['tier']}")
        box = self.sequences[pair["sequence_b"]].boxes_px[int(pair["frame_b"])]
        if np.isfinite(box):
            for index in np.flatnonzero(answers["box_px"] != box):
                problems[index].append(
                    f"box_px is {answers['box_px'][index]}; the depth image gives {box}"
                )
        tracks = self._tracks_of(pair["sequence_b"])
        if tracks is not None and point is not None:
            frame = int(pair["frame_b"])
            compare_answers(tracks, frame, answers, point, problems)
        self.of_truth.add_rows(
            "TRUTH_DISAGREES",
            ~wrong_key & np.array([bool(problem) for problem in problems]),
            lambda i: (where[i], "; ".join(problems[i])),
        )
