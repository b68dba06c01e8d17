"""How the shipped `don-towel` sees a picture: from straight above, with a mask to the edge."""

from __future__ import annotations

from pathlib import Path

import pytest

from pliant.baselines.predict import predict
from pliant.evaluator import evaluate
from pliant.generator.config import GenerateConfig
from pliant.generator.runner.run import generate
from pliant.models import shipped
from pliant.models.don.matcher import DonMatcher
from pliant.models.shipped import load_shipped
from pliant.spec.configuration import read_settings
from pliant.spec.dataset import Dataset
from pliant.spec.frame import Frame
from pliant.spec.io.resizing import resize_nearest
from tests.evaluator.figures import figure
from tests.generator.runner.standin import InProcess
from tests.models.don.test_segmentation import overlap


def towels(folder: Path, number: int, *, oblique: float) -> Dataset:
    """Return towels with the looks of training."""
    trained_on = read_settings(GenerateConfig, shipped.FOLDER / "don-towel" / "data.yaml")
    config = trained_on.replace(
        splits={"test": number},
        sequences=None,
        seed=77,
        camera=trained_on.camera.replace(top=1 - oblique, oblique=oblique),
    )
    generate(config, folder, engine=InProcess())
    return Dataset.open(folder)


def towel_matcher(*, rectify: bool) -> DonMatcher:
    matcher = load_shipped("don-towel", rectify=rectify)
    assert isinstance(matcher, DonMatcher)
    return matcher


def rmse_px(dataset: Dataset, matcher: DonMatcher, file: Path) -> float:
    predict(dataset, "test", matcher, file)
    return figure(evaluate(file, dataset), "rmse_px")


def test_towels_seen_obliquely_are_answered_as_from_above(tmp_path: Path) -> None:
    """On eight of them; the card says how much it brings on 40."""
    dataset = towels(tmp_path / "oblique", 8, oblique=1.0)
    as_it_is = rmse_px(dataset, towel_matcher(rectify=False), tmp_path / "as_it_is.parquet")
    above = rmse_px(dataset, towel_matcher(rectify=True), tmp_path / "above.parquet")
    assert above < 0.85 * as_it_is


@pytest.fixture(scope="module")
def from_above(tmp_path_factory: pytest.TempPathFactory) -> list[Frame]:
    dataset = towels(tmp_path_factory.mktemp("above") / "set", 4, oblique=0.0)
    return [pair.seen().source for pair in dataset.pairs("test")][:4]


def test_towels_seen_from_above_stay_as_they_are(from_above: list[Frame]) -> None:
    reader = towel_matcher(rectify=True).reader
    assert not any(reader.seen(frame).tilted for frame in from_above)


def test_towels_are_found_to_their_edge_in_pictures_without_masks(from_above: list[Frame]) -> None:
    matcher = towel_matcher(rectify=False)
    for frame in from_above:
        bare = frame.without_masks()
        found, said = matcher.object_mask(bare), matcher.working_mask(bare)
        assert found is not None
        assert said is not None
        assert frame.mask is not None
        assert overlap(found, frame.mask) > 0.97
        assert overlap(resize_nearest(said, frame.size), frame.mask) < 0.97
        assert matcher.segmented(frame) is frame
