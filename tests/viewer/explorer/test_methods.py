"""Live and recorded methods, reports, and the layers that they make."""

from __future__ import annotations

import io
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from pliant.api import open_method
from pliant.baselines.matcher import UNFAMILIAR, Heat
from pliant.evaluator import evaluate, write_report
from pliant.spec.answers import Answers
from pliant.spec.dataset import Dataset
from pliant.spec.errors import CallError
from pliant.spec.frame import Pair
from pliant.spec.queries import QueryPair, RecordedPair
from pliant.viewer.explorer.app import Explorer, open_explorer
from pliant.viewer.explorer.documents import answer_document
from pliant.viewer.explorer.layers import error_colours, frame_layer, heat_png, method_layer
from pliant.viewer.explorer.live import LiveMethod
from tests.known import known
from tests.viewer.explorer.conftest import Shifted

Submit = Callable[[Path, float], Path]


def pair_of(explorer: Explorer, tier: str) -> QueryPair:
    """Return the first pair of a tier in the test split."""
    pairs = explorer.queries.splits["test"].pairs
    return next(pair for pair in pairs if pair.source.sequence.tier == tier)


def test_a_recorded_answer_is_that_of_the_nearest_query(explorer: Explorer) -> None:
    pair = explorer.queries.splits["test"].pairs[0]
    truth = explorer.dataset.truth("test")
    found = known(explorer.methods[1].answer(pair.at(pair.uv_a_px[4] + [0.02, -0.02])))
    np.testing.assert_allclose(found.point.uv_a_px, pair.uv_a_px[4], atol=1e-5)
    expected = [truth["u_b"][4].as_py() + 5, truth["v_b"][4].as_py()]
    np.testing.assert_allclose(found.point.uv_b_px, expected, atol=1e-3)
    assert explorer.methods[1].answer(pair.at([-90.0, 0.0])) is None


def test_pairs_have_the_error_of_their_answers(explorer: Explorer) -> None:
    """Every answer is 5 px off, and so is every pair."""
    for errors in explorer.methods[1].errors.values():
        assert {round(each, 3) for each in errors if each is not None} == {5.0}


def test_a_report_finds_its_submission(
    tiny_dataset: Path, submit: Submit, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    submission = submit(tiny_dataset, 2.0)
    write_report(evaluate(submission, tiny_dataset), tmp_path / "report")
    dataset, report = Dataset.open(tiny_dataset), [str(tmp_path / "report")]
    with pytest.raises(CallError, match="the submission of the report is not there"):
        open_explorer(dataset, report, open_method)
    (tmp_path / "answers.parquet").write_bytes(submission.read_bytes())
    (found,) = open_explorer(dataset, report, open_method).methods
    assert found.name == "moved 2 px"
    (tmp_path / "reports").mkdir()
    report = [str((tmp_path / "report").rename(tmp_path / "reports" / "moved"))]
    monkeypatch.chdir(tmp_path)  # `pliant evaluate answers.parquet --out reports/moved`
    both = open_explorer(dataset, ["answers.parquet", *report, "identity"], open_method).methods
    names = ["moved 2 px (answers.parquet)", f"moved 2 px ({report[0]})", "identity"]
    assert [each.name for each in both] == names
    (tmp_path / "answers.parquet").write_bytes(submit(tiny_dataset, 1.0).read_bytes())
    with pytest.raises(CallError, match="the submission of the report is not there"):
        open_explorer(dataset, report, open_method)  # another file of the same name


class Strange(Shifted):
    """Answers queries that are just below the limit of familiarity."""

    def answer(self, pair: Pair) -> Answers:
        known = np.full(len(pair.uv_a_px), UNFAMILIAR - 1e-5, np.float32)
        return replace(super().answer(pair), familiarity=known)


def test_a_familiarity_below_the_limit_is_not_shown_as_the_limit(explorer: Explorer) -> None:
    pair = explorer.queries.splits["test"].pairs[0]
    at = pair.at(pair.uv_a_px[4])
    found = known(answer_document(explorer.truth, LiveMethod(Strange()), at))
    assert found["familiarity"] == 0.01
    assert "familiarity below 0.02" in found["warnings"][0]


def test_the_error_map_has_the_colour_of_the_error(explorer: Explorer) -> None:
    """A frame against itself: the live method is 6 px off everywhere."""
    frame = explorer.dataset.frames("test", "cloth-1")[0]
    pair = RecordedPair(frame, frame, np.zeros((0, 2), np.float32))
    rgb = known(method_layer(explorer.truth, explorer.methods[0], pair, "error", of_target=False))
    colours, counts = np.unique(rgb[known(frame.mask)], axis=0, return_counts=True)
    np.testing.assert_array_equal(colours[counts.argmax()], error_colours(np.array([6.0]))[0])
    assert counts.max() > 0.98 * counts.sum()  # the rest is not found in its own frame: grey


def test_layers_show_the_object(explorer: Explorer) -> None:
    frame = explorer.dataset.frames("test", "rope")[0]
    for layer in ("depth", "index", "mask"):
        rgb = known(frame_layer(frame, layer))
        assert rgb.shape == (120, 160, 3)
        assert rgb[known(frame.mask)].mean() > 3 * rgb[frame.object_ids == 0].mean()
    rgb = known(frame_layer(frame, "rgb"))
    np.testing.assert_array_equal(rgb, frame.rgb)


def test_a_heat_map_is_opaque_at_its_peak_and_clear_elsewhere() -> None:
    values = np.full((60, 80), np.nan, np.float32)
    values[20:40, 20:60] = -30.0
    values[30, 33] = -0.5
    picture = Image.open(io.BytesIO(heat_png(Heat(values, "log probability", 1.0, ""))))
    alpha = np.asarray(picture.convert("RGBA"))[..., 3]
    assert alpha.argmax() == 30 * 80 + 33
    assert alpha[30, 33] > 230
    assert (alpha[np.isnan(values)] == 0).all()
    assert alpha[25, 25] < 100


@pytest.mark.long
@pytest.mark.usefixtures("quick_tracing")
def test_the_shipped_network_shows_all_it_has(tiny_dataset: Path) -> None:
    pytest.importorskip("torch")
    explorer = open_explorer(Dataset.open(tiny_dataset), ["don-rope"], open_method)
    pair = pair_of(explorer, "rope")
    answer = known(explorer.methods[0].answer(pair))
    assert known(answer.point.heat).values.shape == (120, 160)
    assert answer.material is not None
    assert list(answer.material) == ["s", "theta"]
    assert 0 <= answer.material["s"] <= 1
    for layer in ("descriptors", "canonical"):
        rgb = known(method_layer(explorer.truth, explorer.methods[0], pair, layer, of_target=True))
        mask = known(pair.target.mask)
        assert len(np.unique(rgb[mask], axis=0)) > 20
