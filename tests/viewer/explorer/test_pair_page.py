"""The explorer of one pair inside a page of a file: it answers without a server."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pytest

from pliant.viewer.explorer.app import Explorer
from pliant.viewer.explorer.pair_page import pair_section
from tests.browser import Browser
from tests.known import known
from tests.viewer.explorer.test_page import CELLS, LOADED, PLACES


def test_a_file_shows_truth_and_recorded_answers_at_the_pointer(
    explorer: Explorer,
    submit: Callable[[Path, float], Path],
    tiny_dataset: Path,
    tmp_path: Path,
    browser: Browser,
) -> None:
    dataset = explorer.dataset
    pair = explorer.queries.splits["test"].pairs[0]
    section = pair_section(dataset, pair, {"mine <5 px off>": submit(tiny_dataset, 5.0)})
    page = tmp_path / "page.html"
    page.write_text(f"<!doctype html><body>{section}")
    browser.errors()
    browser.requests()
    browser.size(1200, 900)
    browser.open(page.as_uri())
    browser.wait(f"document.body.dataset.ready && {LOADED}")
    u, v = pair.uv_a_px[3].tolist()
    left, top, zoom = browser.run(PLACES, dataset.size[0])
    browser.hover(left + (u + 1) * zoom, top + v * zoom)  # near the query: its answer
    browser.wait(f"{CELLS}[1].children[3].textContent === '5.0'")
    assert "<5 px off>" in browser.run(f"return {CELLS}[1].textContent")
    true_px = known(explorer.queries.splits["test"].uv_b_px)
    x, y = true_px[3].tolist()
    shown = browser.run(f"return {CELLS}[0].children[2].textContent").split(", ")
    assert [float(each) for each in shown] == pytest.approx([x, y], abs=1.5)
    browser.hover(left + 1, top + 1)
    browser.wait("document.getElementById('status').textContent.includes('No object here')")
    assert browser.run(f"return {CELLS}[0].children[2].textContent") == "–"
    assert browser.errors() == []
    assert not [each for each in browser.requests() if not each.startswith(("file:", "data:"))]
