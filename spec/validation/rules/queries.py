"""Rules of queries and ground truth: keys, visibility in the source, agreement with the tables."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise
from typing import Any

import numpy as np
import numpy.typing as npt
import pyarrow as pa

from pliant.spec.conventions import VISIBLE
from pliant.spec.io import limits
from pliant.spec.io.parquet_columns import stacked
from pliant.spec.io.reading import sha256_file
from pliant.spec.lru_cache import LRUCache
from pliant.spec.storage import layout
from pliant.spec.validation.findings import FileProblems, Findings
from pliant.spec.validation.rules.answers import (
    Tracks,
    answer_columns,
    compare_answers,
    has_few_alternatives,
    read_tracks,
)
from pliant.spec.validation.rules.context import Context
from pliant.spec.validation.rules.listing import check_identity
from pliant.spec.validation.rules.result import SequenceResult
from pliant.spec.validation.rules.tables import check_table, numbers

_BYTES_OF_TABLES = 2**28


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
    path = context.root / layout.queries_name(split)
    truth_path = context.root / layout.truth_name(split)
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
    queries = table.read()
    if queries is not None:
        answers = truth.read() if truth is not None and truth.whole else None
        _SplitCheck(context, split, sequences, of_queries, of_truth).run(queries, answers)
    return findings


@dataclass(frozen=True)
class _SplitCheck:
    """One pass over the queries of a split and, next to them, their truth."""

    context: Context
    split: str
    sequences: Mapping[str, SequenceResult]
    of_queries: FileProblems
    of_truth: FileProblems

    @cached_property
    def _kept(self) -> LRUCache[Tracks | None]:
        return LRUCache(_BYTES_OF_TABLES, lambda tracks: tracks.nbytes if tracks else 0, least=2)

    def _tracks_of(self, name: str) -> Tracks | None:
        return self._kept.get(name, lambda: read_tracks(self.context, self.sequences[name]))

    def run(self, queries: pa.Table, truth: pa.Table | None) -> None:
        """Check the rows, pair by pair."""
        if truth is not None and len(truth) != len(queries):
            self.of_truth.add(
                "ROW_MISSING" if len(truth) < len(queries) else "ROW_UNKNOWN",
                "",
                f"{len(truth)} answers to {len(queries)} queries; required: one each, in order",
            )
            truth = None
        if truth is not None and not has_few_alternatives(truth, self.of_truth):
            truth = None
        pair_ids = numbers(queries, "pair_id")
        edges = [0, *(np.flatnonzero(np.diff(pair_ids)) + 1).tolist(), len(queries)]
        for low, high in pairwise(edges if len(queries) else []):
            follows = pair_ids[low] == (pair_ids[low - 1] + 1 if low else 0)
            answers = None if truth is None else truth.slice(low, high - low)
            self._check_pair(low, queries.slice(low, high - low), answers, follows)

    def _check_pair(
        self, start: int, rows: pa.Table, truth: pa.Table | None, follows: np.bool_
    ) -> None:
        pair_id, query_ids = rows["pair_id"][0].as_py(), numbers(rows, "query_id")
        if not follows or not np.array_equal(query_ids, np.arange(len(rows))):
            self.of_queries.add(
                "ROW_ORDER",
                f"row {start}",
                f"pair_id {pair_id} with query_id {query_ids[:3].tolist()} …; required: pairs "
                "from 0 and queries of a pair from 0, consecutive and ascending",
            )
        frames = rows.select(["tier", "sequence_a", "frame_a", "sequence_b", "frame_b"])
        pair = frames.slice(0, 1).to_pylist()[0]
        if any(len(column.unique()) > 1 for column in frames.columns):
            text = "its rows name different frames"
            self.of_queries.add("QUERY_INVALID", f"pair {pair_id}", text)
            return
        if not self._check_frames(pair_id, pair):
            return
        uv_a = stacked(rows, "u_a", "v_a")
        answers = None if truth is None else answer_columns(truth)
        point = self._check_sources(pair_id, query_ids, pair, uv_a, answers)
        if answers is not None:
            self._check_answers(pair_id, query_ids, pair, answers, point)

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
            self.of_queries.add_rows(
                "VALUE_OUT_OF_RANGE",
                ~bad_value & np.any((uv_a < 0) | (uv_a >= self.context.size), axis=1),
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
        pair_id: int,
        query_ids: npt.NDArray[np.int32],
        pair: dict[str, Any],
        answers: dict[str, Any],
        point: npt.NDArray[np.int64] | None,
    ) -> None:
        wrong_key = (answers["pair_id"] != pair_id) | (answers["query_id"] != query_ids)
        where = [f"pair {pair_id}, query {query_id}" for query_id in query_ids]
        self.of_truth.add_rows(
            "ROW_ORDER",
            wrong_key,
            lambda i: (
                where[i],
                f"found pair {answers['pair_id'][i]}, query {answers['query_id'][i]}",
            ),
        )
        problems: list[list[str]] = [[] for _ in query_ids]
        for index, tier in enumerate(answers["tier"]):
            if tier != pair["tier"]:
                problems[index].append(f"tier is {tier[:40]!r}; required: {pair['tier']}")
        boxes = answers["box_px"]
        finite, positive = np.isfinite(boxes), np.isfinite(boxes) & (boxes > 0)
        for code, bad in (
            ("VALUE_NOT_FINITE", ~finite),
            ("VALUE_OUT_OF_RANGE", finite & ~positive),
        ):
            self.of_truth.add_rows(
                code, bad, lambda i: (f"{where[i]}, box_px", f"found {boxes[i]}; required: > 0")
            )
        box = self.sequences[pair["sequence_b"]].boxes_px[int(pair["frame_b"])]
        if np.isfinite(box):
            for index in np.flatnonzero((boxes != box) & positive):
                problems[index].append(f"box_px is {boxes[index]}; the depth image gives {box}")
        tracks = self._tracks_of(pair["sequence_b"])
        if tracks is not None and point is not None:
            frame = int(pair["frame_b"])
            compare_answers(tracks, frame, answers, point, problems)
        self.of_truth.add_rows(
            "TRUTH_DISAGREES",
            ~wrong_key & np.array([bool(problem) for problem in problems]),
            lambda i: (where[i], "; ".join(problems[i])),
        )
