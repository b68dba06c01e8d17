from __future__ import annotations

import json
import shutil
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from click.testing import CliRunner
from PIL import Image, ImageDraw

from pliant.cli.view import command
from pliant.evaluator.report.colours import depth_image, index_image, material_colours
from pliant.evaluator.report.contact_sheet import contact_sheet
from pliant.spec.dataset import Dataset
from pliant.spec.errors import CallError
from pliant.spec.sequence import SequenceRecord
from pliant.viewer.figures import FIGURES, draw_figure
from tests.conftest import Called
from tests.converters.importing import marked


def test_one_material_point_has_one_colour_and_others_have_others(tiny_dataset: Path) -> None:
    dataset = Dataset.open(tiny_dataset)
    m = np.random.default_rng(0).uniform(0, 1, (50, 2))
    for tier in dataset.tiers.values():
        colours = material_colours(m[:, 0], m[:, 1], tier)
        np.testing.assert_array_equal(colours[7:9], material_colours(m[7:9, 0], m[7:9, 1], tier))
        assert colours.min() >= 0
        assert colours.max() <= 1
        apart = np.abs(colours[:, None] - colours[None]).sum(-1) + np.eye(50)
        assert apart.min() > 0


def test_index_and_depth_show_the_object_and_nothing_else(tiny_dataset: Path) -> None:
    sequence = Dataset.open(tiny_dataset).sequences[0]
    tier = Dataset.open(tiny_dataset).tiers[sequence.tier]
    surface = sequence.surface(0)
    for image in (index_image(surface, tier), depth_image(surface.depth_m)):
        np.testing.assert_array_equal((image != 18).any(axis=2), surface.object_id > 0)
    nearest = np.unravel_index(np.argmin(surface.depth_m), surface.depth_m.shape)
    shown = depth_image(surface.depth_m).astype(int).sum(axis=2)
    assert shown[nearest] == shown.max()


def test_a_sheet_shows_as_many_frames_as_asked_from_all_sequences(tiny_dataset: Path) -> None:
    dataset = Dataset.open(tiny_dataset)
    for count, tiles in ((4, 4), (20, 20), (10_000, sum(s.frames for s in dataset.sequences))):
        sheet = contact_sheet(dataset, list(dataset.sequences), "index", count)
        # A tile is 240 x 180 under a line of text, a gap of white around it.
        rows, columns = sheet.shape[0] // (180 + 16 + 6), sheet.shape[1] // (240 + 6)
        starts = [(6 + r * 202 + 60, 6 + c * 246 + 60) for r in range(rows) for c in range(columns)]
        assert sum((sheet[at] != 255).any() for at in starts) == tiles


def test_the_name_of_a_tile_keeps_its_end_and_its_frame(
    tmp_path: Path, called: Called, monkeypatch: pytest.MonkeyPatch
) -> None:
    points = {"ball": (9.0, 9.0), "end": (60.0, 40.0)}
    marked(tmp_path / "photos", {"a.png": points, "b.png": points})
    data = tmp_path / "photographs-of-the-blue-rope-on-the-wooden-table"
    assert called("import", tmp_path / "photos", "--out", data)[0] == 0
    drawn: list[tuple[str, float]] = []
    write = ImageDraw.ImageDraw.text

    def kept(draw: ImageDraw.ImageDraw, at: Any, text: str, **options: Any) -> None:
        drawn.append((text, draw.textlength(text, options["font"])))
        write(draw, at, text, **options)

    monkeypatch.setattr(ImageDraw.ImageDraw, "text", kept)
    dataset = Dataset.open(data)
    contact_sheet(dataset, list(dataset.sequences), "rgb")
    assert [text[-14:] for text, _ in drawn] == ["test-000000 #0", "test-000000 #1"]
    assert all(200 < wide < 240 for _, wide in drawn)


@pytest.mark.parametrize("figure", FIGURES)
@pytest.mark.parametrize("tier", ["rope", "cloth-1"])
def test_every_figure_is_drawn_for_every_kind(
    figure: str, tier: str, tiny_dataset: Path, tmp_path: Path
) -> None:
    dataset = Dataset.open(tiny_dataset)
    sequence = next(s for s in dataset.sequences if s.tier == tier)
    out = tmp_path / "new" / "figure.png"
    what = ["--figure", figure, "--sequence", sequence.id, "--count", "2", "--json"]
    done = CliRunner().invoke(command, [str(tiny_dataset), "--out", str(out), *what])
    assert done.exit_code == 0, done.output
    assert json.loads(done.stdout)["bytes"] == out.stat().st_size
    with Image.open(out) as image:
        pixels = np.asarray(image.convert("RGB"))
    assert min(pixels.shape[:2]) > 150
    assert len(np.unique(pixels.reshape(-1, 3), axis=0)) > 100


def test_an_episode_is_drawn_with_its_tracks(tiny_episode: Path, tmp_path: Path) -> None:
    out = draw_figure(tiny_episode, tmp_path / "tracks.jpg", figure="tracks", count=4)
    with Image.open(out) as image:
        assert image.width > 1000


@pytest.mark.parametrize(
    ("name", "count", "message"), [("figure.png", 0, "count"), ("sheet.pdf", 24, "format")]
)
def test_a_wrong_call_says_what_is_wrong(
    name: str, count: int, message: str, tiny_dataset: Path, tmp_path: Path
) -> None:
    with pytest.raises(CallError, match=message):
        draw_figure(tiny_dataset, tmp_path / name, count=count)
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("figure", ["index", "depth", "tracks"])
def test_sequences_without_what_a_figure_shows_are_left_out(
    figure: str, tiny_dataset: Path, tmp_path: Path
) -> None:
    """Withheld sequences of a published dataset, and imported ones, are pictures alone."""
    root, out = tmp_path / "dataset", tmp_path / "figure.png"
    shutil.copytree(tiny_dataset, root)
    first, *others = Dataset.open(root).sequences

    def withhold(sequence: SequenceRecord) -> None:
        shutil.rmtree(sequence.dir / "depth")
        (sequence.dir / "points.parquet").unlink()

    withhold(first)
    draw_figure(root, out, figure=figure, count=2)
    with pytest.raises(CallError, match="does not contain what the figure shows"):
        draw_figure(root, out, figure=figure, sequence=first.id)
    for each in others:
        withhold(each)
    with pytest.raises(CallError, match=f"--figure {figure}.*--figure sheet"):
        draw_figure(root, out, figure=figure)
