r"""Whether familiarity warns of wrong answers on ropes, and of no others.

    python benchmarks/familiarity.py DATA... [--model don-rope] [--pairs N]

Each DATA is a dataset of ropes. The pairs of its split `test` are answered as they are, without
masks, and with faulty masks of three kinds. A row for each says the errors (to
the nearer of both ends' readings where a rope has no ball), and the share of the answers whose
familiarity is below 0.02, which `pliant match` warns of. The data of the shipped models:

    pliant generate --config models/shipped/don-rope/data.yaml --seed 501 \
        --splits train=2,val=70,test=60 --out ball
    pliant generate --config models/shipped/don-rope/data.yaml --seed 502 \
        --splits train=2,val=50,test=50 --set rope.ball=false --out bare
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path

import click
import numpy as np
import numpy.typing as npt

from pliant.baselines.matcher import UNFAMILIAR
from pliant.loaders.frame_store import FrameStore
from pliant.models.don.loading import load_matcher
from pliant.models.don.matcher import DonMatcher
from pliant.models.don.validation import ValidationPair, draw_validation_pairs
from pliant.models.shipped import FOLDER
from pliant.spec.dataset import Dataset
from pliant.spec.frame import Frame

_QUERIES = 32
_FAR_PX = 60.0


def as_it_is(own: Frame, other: Frame) -> Frame:
    """Return the frame itself."""
    return own


def without_masks(own: Frame, other: Frame) -> Frame:
    """Return the frame as a method sees it that is given no masks."""
    return own.replace(mask=None, objects=None, key=f"{own.key} without masks")


def ball_in_mask(own: Frame, other: Frame) -> Frame:
    """Return the frame with a mask that takes the ball for rope."""
    return own.replace(mask=own.objects, key=f"{own.key} ball in mask")


def two_ropes(own: Frame, other: Frame) -> Frame:
    """Return the frame with a mask that has the other frame's rope too, mirrored."""
    assert own.mask is not None
    assert own.objects is not None
    assert other.objects is not None
    further = other.objects[:, ::-1]
    key = f"{own.key} and {other.key}"
    return own.replace(mask=own.mask | further, objects=own.objects | further, key=key)


def half_a_rope(own: Frame, other: Frame) -> Frame:
    """Return the frame with a mask that ends halfway across the picture."""
    assert own.mask is not None
    assert own.objects is not None
    mask = own.mask.copy()
    mask[:, int(np.flatnonzero(mask.any(axis=0)).mean()) :] = False
    objects = mask | (own.objects & ~own.mask)
    return own.replace(mask=mask, objects=objects, key=f"{own.key} half")


SETS: dict[str, Callable[[Frame, Frame], Frame]] = {
    "as it is": as_it_is,
    "without masks": without_masks,
    "ball in the mask": ball_in_mask,
    "two ropes in the mask": two_ropes,
    "half of the mask": half_a_rope,
}


def drawn(data: Path, pairs: int) -> list[ValidationPair]:
    """Return pairs of the test split."""
    dataset = Dataset.open(data)
    store = FrameStore(dataset, "rope", "test", dataset.size)
    return draw_validation_pairs(store, pairs, _QUERIES, 5)


def changed(pair: ValidationPair, change: Callable[[Frame, Frame], Frame]) -> ValidationPair:
    """Return a pair with both frames changed."""
    source, target = change(pair.source, pair.target), change(pair.target, pair.source)
    return replace(pair, source=source, target=target)


def answered(
    matcher: DonMatcher, pairs: list[ValidationPair]
) -> Iterator[tuple[npt.NDArray[np.float64], npt.NDArray[np.bool_]]]:
    """Yield errors, px, and which answers are unfamiliar, for each pair."""
    for pair in pairs:
        answers = matcher.answer(pair)
        assert answers.familiarity is not None
        gaps = np.linalg.norm(answers.uv_px[:, None] - pair.uv_b_px, axis=2)  # (Q, 1 + S)
        way = int(np.square(gaps).mean(axis=0).argmin())
        yield gaps[:, way].astype(np.float64), answers.familiarity < UNFAMILIAR


@click.command(help=__doc__)
@click.argument("data", nargs=-1, required=True, type=click.Path(exists=True, path_type=Path))
@click.option("--model", default="don-rope", show_default=True, help="A shipped model.")
@click.option("--pairs", default=40, show_default=True, help="Pairs of each dataset.")
def main(data: tuple[Path, ...], model: str, pairs: int) -> None:
    """Print a row of a table for each dataset and kind of mask."""
    matcher = load_matcher(FOLDER / model)
    assert isinstance(matcher, DonMatcher)
    kinds = [name for name in SETS if matcher.reader.finds_masks or name != "without masks"]
    click.echo("| data, masks | RMSE | within 15 px | flagged | flagged of errors over 60 px |")
    click.echo("|---|---|---|---|---|")
    for root in data:
        asked = drawn(root, pairs)
        for name in kinds:
            found = list(answered(matcher, [changed(pair, SETS[name]) for pair in asked]))
            errors, flagged = (np.concatenate([each[k] for each in found]) for k in (0, 1))
            far = errors > _FAR_PX
            caught = f"{flagged[far].mean():.3f}" if far.any() else ""
            click.echo(
                f"| {root.name}, {name} | {np.sqrt(np.square(errors).mean()):.1f} "
                f"| {(errors < 15).mean():.3f} | {flagged.mean():.3f} | {caught} |"
            )


if __name__ == "__main__":
    main()
