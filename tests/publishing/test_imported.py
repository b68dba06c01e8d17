"""Imported pictures with their answers held out, published and scored."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import yaml

from pliant.cli.main import run
from pliant.service.challenge import Challenge
from pliant.service.versions import versions_of
from pliant.spec.dataset import Dataset
from pliant.spec.validation.validate import validate
from tests.conftest import Refused
from tests.converters.importing import marked

PLACES = {"a": (10.5, 12.5), "b": (40.5, 20.5), "c": (30.5, 33.5)}


@pytest.fixture(scope="module")
def imported(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Three pictures of which each has the same three points, one pixel further right."""
    root = tmp_path_factory.mktemp("marked")
    marks = {
        f"{number}.png": {point: (u + number, v) for point, (u, v) in PLACES.items()}
        for number in range(3)
    }
    pictures = marked(root / "pictures", marks)
    options = ["--kind", "cloth", "--masks", str(pictures / "masks")]
    assert run(["import", str(pictures), "--out", str(root / "marked"), *options]) == 0
    return root / "marked"


@pytest.fixture(scope="module")
def published(imported: Path) -> Path:
    out = imported.with_name("public")
    truth = imported.with_name("marked-truth") / "test.parquet"  # or its folder, the default
    options = ["--hold-out", "test", "--truth", str(truth)]
    assert run(["publish", str(imported), "--out", str(out), *options]) == 0
    return out


def test_public_half_has_no_name_of_the_hosts_files(published: Path) -> None:
    config = Dataset.open(published).info["provenance"]["config"]
    assert config["points"] == ["a", "b", "c"]
    assert not {"source", "sources", "pictures"} & set(config)


def test_private_half_is_refused_as_a_dataset_in_one_sentence(published: Path) -> None:
    (issue,) = validate(published.with_name("public-private")).issues
    assert "private half" in issue.message


def test_public_half_has_pictures_and_masks_and_no_answer(imported: Path, published: Path) -> None:
    assert not validate(published).issues
    public, own = Dataset.open(published), Dataset.open(imported)
    for frame, before in zip(public.frames(), own.frames(), strict=True):
        np.testing.assert_array_equal(frame.rgb, before.rgb)
        assert frame.mask is not None
        np.testing.assert_array_equal(frame.mask, np.asarray(before.mask))
    assert not public.has("truth/test.parquet")


def test_both_halves_make_a_challenge(published: Path, tmp_path: Path) -> None:
    private = published.with_name("public-private")
    arguments = ["--data", str(published), "--private", str(private)]
    assert run(["challenge", "create", str(tmp_path / "challenge"), *arguments]) == 0
    challenge = Challenge.open(tmp_path / "challenge")
    assert [phase.split for phase in challenge.settings.phases] == ["test"]
    with challenge.database.read() as session:
        (version,) = versions_of(session, "test")
    assert {figure["group"] for figure in version.figures} == {"overall"}  # it has one tier


def test_scores_by_the_private_half_are_those_by_the_imported_answers(
    imported: Path, published: Path, tmp_path: Path
) -> None:
    answers = tmp_path / "identity.parquet"
    assert run(["predict", "identity", "--data", str(published), "--out", str(answers)]) == 0
    scores = []
    for data, truth in (
        (published, published.with_name("public-private")),
        (imported, imported.with_name("marked-truth") / "test.parquet"),
    ):
        out = tmp_path / data.name
        arguments = ["--data", str(data), "--truth", str(truth), "--out", str(out)]
        assert run(["evaluate", str(answers), *arguments]) == 0
        assert "1 sequence.</p>" in (out / "report.html").read_text()
        scores.append((out / "per_pair.parquet").read_bytes())
    assert scores[0] == scores[1]


def test_the_papers_say_what_is_known(published: Path) -> None:
    card = (published / "README.md").read_text()
    assert "`queries/ (1 file)`" in card
    front = yaml.safe_load(card.split("---\n")[1])
    assert (front["license"], front["license_name"]) == ("other", "licenseref-unknown")
    assert "its points are annotations" in card
    assert "rope" not in front["tags"]
    croissant = (published / "croissant.json").read_text()
    said = [
        word for word in ("imulated", "generator", "no human", "no people") if word in croissant
    ]
    assert not said
    private = published.with_name("public-private") / "README.md"
    about, warnings = private.read_text().split("## Warnings")
    assert "cameras" not in about
    assert "--pair-list" in warnings
    assert "spdx.org" not in card + (published / "LICENSE").read_text()
    assert "license" not in yaml.safe_load((published / "CITATION.cff").read_text())


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ([], "required: --hold-out test"),
        (["--hold-out", "test", "--truth", "elsewhere"], "--truth PATH"),
    ],
)
def test_refusals(
    imported: Path, tmp_path: Path, options: list[str], words: str, refused: Refused
) -> None:
    assert words in refused(2, "publish", imported, "--out", tmp_path / "out", *options)
    assert not list(tmp_path.iterdir())
