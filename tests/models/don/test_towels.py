"""How the shipped `don-towel` sees a picture: from straight above, with a mask to the edge."""

from __future__ import annotations

from pathlib import Path

import pytest

from pliant.baselines.predict import predict
from pliant.evaluator import evaluate
from pliant.spec.dataset import Dataset
from pliant.spec.frame import Frame
from pliant.spec.io.resizing import resize_nearest
from tests.evaluator.figures import figure
from tests.known import known
from tests.models.don.test_segmentation import overlap
from tests.models.shipped_models import made_like_training_set, shipped_don


def towels(folder: Path, number: int, *, oblique: float) -> Dataset:
    camera = {"top": 1 - oblique, "oblique": oblique}
    return made_like_training_set("don-towel", folder, number, seed=77, camera=camera)


def rmse_px(dataset: Dataset, file: Path, *, rectify: bool) -> float:
    predict(dataset, "test", shipped_don("don-towel", rectify=rectify), file)
    return figure(evaluate(file, dataset), "rmse_px")


@pytest.mark.long  # half a minute
def test_towels_seen_obliquely_are_answered_as_from_above(tmp_path: Path) -> None:
    """On eight of them; the card says how much it brings on 40."""
    dataset = towels(tmp_path / "oblique", 8, oblique=1.0)
    as_it_is = rmse_px(dataset, tmp_path / "as_it_is.parquet", rectify=False)
    above = rmse_px(dataset, tmp_path / "above.parquet", rectify=True)
    assert above < 0.85 * as_it_is


@pytest.fixture(scope="module")
def from_above(tmp_path_factory: pytest.TempPathFactory) -> list[Frame]:
    dataset = towels(tmp_path_factory.mktemp("above") / "set", 4, oblique=0.0)
    return [pair.seen().source for pair in dataset.pairs("test")][:4]


def test_towels_seen_from_above_stay_as_they_are(from_above: list[Frame]) -> None:
    reader = shipped_don("don-towel", rectify=True).reader
    assert not any(reader.seen(frame).tilted for frame in from_above)


def test_towels_are_found_to_their_edge_in_pictures_without_masks(from_above: list[Frame]) -> None:
    matcher = shipped_don("don-towel", rectify=False)
    for frame in from_above:
        bare = frame.without_masks()
        found, said = known(matcher.object_mask(bare)), known(matcher.working_mask(bare))
        mask = known(frame.mask)
        own = overlap(resize_nearest(said, frame.size), mask)
        assert overlap(found, mask) > max(0.97, own + 0.005)
        assert matcher.reader.masked(frame) is frame
