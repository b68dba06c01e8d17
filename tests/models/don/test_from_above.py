"""A cloth seen by a tilted camera is answered as if it were seen from straight above."""

from __future__ import annotations

from pathlib import Path

from pliant.baselines.predict import predict
from pliant.evaluator import evaluate
from pliant.generator.config import GenerateConfig
from pliant.generator.runner.run import generate
from pliant.models import shipped
from pliant.models.don.matcher import DonMatcher
from pliant.models.shipped import load_shipped
from pliant.spec.configuration import read_settings
from pliant.spec.dataset import Dataset
from tests.evaluator.figures import figure
from tests.generator.runner.standin import InProcess


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


def test_towels_seen_from_above_stay_as_they_are(tmp_path: Path) -> None:
    dataset, matcher = towels(tmp_path / "above", 4, oblique=0.0), towel_matcher(rectify=True)
    seen = [matcher.reader.seen(pair.seen().source) for pair in dataset.pairs("test")]
    assert not any(each.tilted for each in seen)
