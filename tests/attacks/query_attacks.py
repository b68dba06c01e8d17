"""Attacks on published queries: what do they say about the answers, without any image?

`python -m tests.attacks.query_attacks PUBLIC WHOLE` attacks the public half of a
dataset and scores the attacks with the dataset that it was published of. An attack reads the public
queries alone.

Each score is compared with a null distribution, under which the queries contain no information:

- `permuted`: the answers of every pair are permuted. This is the right null for attacks that use
  the order of rows or the ids.
- `redrawn`: the query pixels of every target frame are drawn again, uniformly among the surface
  points that it shows. This is the right null for attacks that use pixel positions: positions alone
  say something about the answers (in an episode, a point is close to where it was), and a
  permutation of the answers would count that as a leak.

An attack has found something where its score is many standard deviations better than the null.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

import click
import numpy as np
import numpy.typing as npt
from scipy.optimize import linear_sum_assignment
from scipy.spatial.distance import cdist
from scipy.stats import rankdata

from pliant.spec.arrays import FloatArray
from tests.attacks.attacked_queries import (
    Answers,
    Ints,
    Queries,
    read_answers,
    read_queries,
)

NULL_DRAWS = 40
LEAK_Z = 4.0
"""Standard deviations better than the null from which an attack counts as successful."""


@dataclass(frozen=True)
class Outcome:
    """How an attack did.

    Attributes:
        attack: Its name, with the null distribution.
        score: Its score.
        mean: Mean score under the null.
        z: Standard deviations by which the score is better than the mean of the null.
    """

    attack: str
    score: float
    mean: float
    z: float

    @property
    def leaks(self) -> bool:
        """True if the attack did clearly better than under the null."""
        return self.z > LEAK_Z


# Attacks return float64 (N, 2), predicted answers, NaN where they have none.


def rank_on_one_axis(queries: Queries) -> FloatArray:
    """Match row i of n to the same relative row among the target's own query pixels."""
    found = np.full_like(queries.uv_px, np.nan)
    for rows in queries.rows:
        shown = queries.shown_to(rows)
        if len(shown):
            rank, known = _relative(len(rows)), _relative(len(shown))
            found[rows] = np.stack([np.interp(rank, known, shown[:, k]) for k in (0, 1)], axis=1)
    return found


def rank_on_two_axes(queries: Queries) -> FloatArray:
    """Lay the rows out as a square and match each to the closest place in the target's square."""
    found = np.full_like(queries.uv_px, np.nan)
    for rows in queries.rows:
        shown = queries.shown_to(rows)
        if len(shown):
            nearest = cdist(_square(len(rows)), _square(len(shown))).argmin(axis=1)
            found[rows] = shown[nearest]
    return found


def assignment(queries: Queries) -> FloatArray:
    """Assign the query pixels of two frames to each other, after a similarity fit."""
    found = np.full_like(queries.uv_px, np.nan)
    for rows in queries.rows:
        shown = queries.shown_to(rows)
        if min(len(rows), len(shown)) > 2:
            mine, theirs = _best_assignment(queries.uv_px[rows], shown)
            found[rows[mine]] = shown[theirs]
    return found


def _relative(count: int) -> FloatArray:
    return (np.arange(count) + 0.5) / count


def _square(count: int) -> FloatArray:
    width = max(1, round(count**0.5))
    line, place = np.divmod(np.arange(count), width)
    return np.stack([(line + 0.5) / np.ceil(count / width), (place + 0.5) / width], axis=1)


def _best_assignment(a_px: FloatArray, b_px: FloatArray) -> tuple[Ints, Ints]:
    """Return the matched rows of both; four starting rotations, each refined in three steps."""
    a, b = a_px @ [1, 1j], b_px @ [1, 1j]  # a similarity is b = scale * a + shift
    best: tuple[float, Ints, Ints] | None = None
    for turn in range(4):
        scale = np.std(b) / max(np.std(a), 1e-9) * 1j**turn
        shift = b.mean() - scale * a.mean()
        for _ in range(3):
            cost = np.abs(scale * a[:, None] + shift - b[None, :]) ** 2
            mine, theirs = linear_sum_assignment(cost)
            centred = a[mine] - a[mine].mean()
            spread = max(float(np.sum(np.abs(centred) ** 2)), 1e-9)
            scale = np.sum(np.conj(centred) * b[theirs]) / spread
            shift = b[theirs].mean() - scale * a[mine].mean()
        total = float(cost[mine, theirs].sum())
        if best is None or total < best[0]:
            best = total, mine, theirs
    assert best is not None
    return best[1], best[2]


def attack_everything(
    queries: Queries, answers: Answers, *, seed: int = 0, draws: int = NULL_DRAWS
) -> list[Outcome]:
    """Run every attack on the queries of one tier.

    Args:
        queries: The public queries.
        answers: Their answers.
        seed: Random seed of the null distributions.
        draws: Draws of each null distribution.
    """
    rng = np.random.default_rng(seed)
    outcomes = []
    order_attacks = {"rank, one axis": rank_on_one_axis, "rank, two axes": rank_on_two_axes}
    for name, attack in order_attacks.items():
        found = attack(queries)
        score = _rmse_px(found, answers)
        null = [_rmse_px(found, _permuted(rng, queries, answers)) for _ in range(draws)]
        outcomes.append(_outcome(f"{name} (RMSE px, permuted)", -score, [-each for each in null]))
    redrawn = [_redrawn(rng, queries, answers) for _ in range(draws)]
    for name, measure in (
        ("assignment (RMSE px, redrawn)", _negative_assignment_rmse),
        ("answers among query pixels (share, redrawn)", shown_share),
    ):
        null = [measure(each, answers) for each in redrawn]
        outcomes.append(_outcome(name, measure(queries, answers), null))
    outcomes += missing_points(rng, queries, answers, draws)
    outcomes.append(row_correlation(rng, queries, answers, draws))
    if queries.single:
        outcomes.append(frame_correlation(rng, queries, answers, draws))
    return outcomes


def _outcome(name: str, score: float, null: list[float]) -> Outcome:
    """Return the outcome of a score of which more is better; NaN means nothing to attack."""
    mean, spread = float(np.mean(null)), float(np.std(null))
    z = 0.0 if np.isnan(score) else (score - mean) / max(spread, 1e-9)
    return Outcome(name, abs(score), abs(mean), z)


def _rmse_px(found: FloatArray, answers: Answers) -> float:
    use = np.isfinite(found).all(axis=1) & answers.visible
    if not use.any():
        return float("nan")
    return float(np.sqrt(((found - answers.uv_px)[use] ** 2).sum(axis=1).mean()))


def _negative_assignment_rmse(queries: Queries, answers: Answers) -> float:
    return -_rmse_px(assignment(queries), answers)


def _permuted(rng: np.random.Generator, queries: Queries, answers: Answers) -> Answers:
    order = np.concatenate([rng.permutation(rows) for rows in queries.rows])
    return replace(answers, uv_px=answers.uv_px[order], visible=answers.visible[order])


def _redrawn(rng: np.random.Generator, queries: Queries, answers: Answers) -> Queries:
    shown = {
        frame: rng.permutation(answers.places_px[frame][answers.seen[frame]])[: len(pixels)]
        for frame, pixels in queries.shown.items()
        if frame in answers.seen
    }
    return replace(queries, shown=shown)


def shown_share(queries: Queries, answers: Answers) -> float:
    """Return the share of visible answers that are, to 0.01 px, query pixels of their frame."""
    hits = np.zeros(len(answers.uv_px), np.bool_)
    for rows in queries.rows:
        shown = queries.shown_to(rows)
        if len(shown):
            hits[rows] = cdist(answers.uv_px[rows], shown).min(axis=1) < 0.01
    return float(hits[answers.visible].mean())


def missing_points(
    rng: np.random.Generator, queries: Queries, answers: Answers, draws: int
) -> list[Outcome]:
    """Infer from the points that a pair leaves out, though its source asks them in another pair.

    Returns:
        Two outcomes: the share of these points whose place in the target frame is one of its query
        pixels, and how far the share of them that the target shows is from the null.
    """
    pool: dict[int, Ints] = {}
    for frame in np.unique(queries.source):
        pool[int(frame)] = np.unique(answers.point[queries.source == frame])
    cases: list[tuple[Ints, npt.NDArray[np.bool_], FloatArray]] = []
    for rows in queries.rows:
        a, b = int(queries.source[rows[0]]), int(queries.target[rows[0]])
        missing = ~np.isin(pool[a], answers.point[rows])
        places, shown = answers.places_px[b][pool[a]], queries.shown_to(rows)
        hit = np.zeros(len(places))
        if len(shown):
            hit = (cdist(places, shown).min(axis=1) < 0.01).astype(np.float64)
        if missing.any():
            cases.append((pool[a], missing, np.stack([hit, answers.seen[b][pool[a]]], axis=1)))
    names = ("missing points at query pixels (share)", "missing points visible (share)")
    if not cases:
        return [Outcome(name, float("nan"), float("nan"), 0.0) for name in names]

    def shares(permute: bool) -> FloatArray:
        picked = [
            facts[rng.permutation(missing) if permute else missing] for _, missing, facts in cases
        ]
        means: FloatArray = np.concatenate(picked).mean(axis=0)
        return means

    score, null = shares(False), np.array([shares(True) for _ in range(draws)])
    located = _outcome(names[0], float(score[0]), null[:, 0].tolist())
    visible = _outcome(names[1], float(score[1]), null[:, 1].tolist())
    return [located, replace(visible, z=abs(visible.z))]


def row_correlation(
    rng: np.random.Generator, queries: Queries, answers: Answers, draws: int
) -> Outcome:
    """Correlate the columns of a row with its answer, in the largest pair of every source frame.

    Pairs of one source ask the same points, so they are not independent.

    The columns are the row order (the ids) and the fractions of the query pixel. Whole pixel
    positions are left out: that the picture of an object says where its points are is not a leak.
    """
    columns = np.column_stack([np.arange(len(queries.pair)), queries.uv_px % 1])
    told = np.column_stack([answers.uv_px, answers.visible, answers.point])
    largest: dict[int, Ints] = {}
    for rows in queries.rows:
        source = int(queries.source[rows[0]])
        if len(rows) > max(2, len(largest.get(source, ()))):
            largest[source] = rows
    groups = [(_ranks(columns[rows]), _ranks(told[rows])) for rows in largest.values()]
    return _strongest(rng, "columns of a row and its answer", groups, draws)


def frame_correlation(
    rng: np.random.Generator, queries: Queries, answers: Answers, draws: int
) -> Outcome:
    """Correlate what the files say of a target frame with its answers, over frames.

    Only for sets of single frames: the frames of an episode follow each other, so that their
    numbers may say something about the answers.
    """
    columns, told = [], []
    for frame in np.unique(queries.target):
        rows = np.flatnonzero(queries.target == frame)
        columns.append([frame, rows.mean(), len(rows), len(queries.shown.get(int(frame), ()))])
        told.append([*answers.uv_px[rows].mean(axis=0), answers.visible[rows].mean()])
    group = (_ranks(np.array(columns, float)), _ranks(np.array(told, float)))
    return _strongest(rng, "columns of a frame and its answers", [group], draws)


def _ranks(values: FloatArray) -> FloatArray:
    """Return ranks by column, centred and of unit length; 0 where all are equal."""
    ranks = rankdata(values, axis=0) - (len(values) + 1) / 2
    return np.asarray(ranks / np.maximum(np.linalg.norm(ranks, axis=0), 1e-9))


def _strongest(
    rng: np.random.Generator, name: str, groups: list[tuple[FloatArray, FloatArray]], draws: int
) -> Outcome:
    """Return the strongest rank correlation, each pooled over the groups, against permutations."""
    weight = np.array([len(x) - 1 for x, _ in groups])

    def strength(permute: bool) -> float:
        pooled = sum(
            w * (x.T @ (rng.permutation(y) if permute else y))
            for w, (x, y) in zip(weight, groups, strict=True)
        )
        return float(np.abs(pooled / weight.sum()).max())

    return _outcome(
        f"{name} (correlation)", strength(False), [strength(True) for _ in range(draws)]
    )


@click.command(help=__doc__)
@click.argument("public", type=click.Path(exists=True, file_okay=False, path_type=Path))
@click.argument("whole", type=click.Path(exists=True, file_okay=False, path_type=Path))
@click.option("--split", default="test", show_default=True)
@click.option("--seed", default=0, show_default=True, help="Random seed of the null.")
def main(public: Path, whole: Path, split: str, seed: int) -> None:
    """Print every attack's score; exit with 1 if one of them succeeds."""
    leaks = False
    for tier, queries in read_queries(public, split).items():
        answers = read_answers(whole, split, tier)
        for outcome in attack_everything(queries, answers, seed=seed):
            leaks |= outcome.leaks
            click.echo(
                f"{tier:10} {outcome.attack:48} {outcome.score:9.3f}  null {outcome.mean:9.3f}"
                f"  z {outcome.z:7.1f}{'  LEAK' if outcome.leaks else ''}"
            )
    raise SystemExit(1 if leaks else 0)


if __name__ == "__main__":
    main()
