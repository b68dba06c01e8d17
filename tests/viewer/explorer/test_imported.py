"""The explorer's page on imported pictures, which have no surface images, points or cameras."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

from pliant.spec.dataset import Dataset
from pliant.viewer.explorer.app import Explorer
from pliant.viewer.explorer.frames import FrameCache
from pliant.viewer.explorer.live import LiveMethod
from pliant.viewer.explorer.recorded import RecordedQueries
from tests.browser import Browser
from tests.converters.importing import imported, marked
from tests.viewer.explorer.conftest import Shifted
from tests.viewer.serving import served

SHOWN = "document.querySelector('#picture-a .layer')"
LOADED = "[...document.querySelectorAll('img.layer')].every(e => e.naturalWidth === 80)"
STATES = "Object.fromEntries([...document.querySelectorAll('#layers button')].map(e => [e.textContent, e.disabled && e.title]))"  # noqa: E501


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    return marked(tmp_path / "source", {"a.png": {"end": (20, 30)}, "b.png": {"end": (50, 40)}})


@contextmanager
def explored(dataset: Dataset, browser: Browser, link: str = "") -> Iterator[Browser]:
    explorer = Explorer(FrameCache(dataset), RecordedQueries(dataset), [LiveMethod(Shifted())])
    with served(explorer.application) as address:
        browser.open("about:blank")
        browser.size(1200, 800)
        browser.open(address + link)
        browser.wait("document.body.dataset.ready")
        yield browser
        browser.open("about:blank")


def test_what_the_set_does_not_have_is_disabled_with_a_reason(
    folder: Path, browser: Browser
) -> None:
    dataset = imported(folder, folder.with_name("plain"))
    with explored(dataset, browser, "#layer=depth") as page:
        page.wait("document.getElementById('tab-scene').disabled")
        states = page.run(f"return {STATES}")
        assert not states["Colour"]
        for name in ("Depth", "Index colours", "Mask", "Error map"):
            assert "does not have" in states[name], name
        assert "does not have" in page.run("return document.getElementById('tab-scene').title")
        page.wait(LOADED)
        assert page.run(f"return {SHOWN}.alt").startswith("Colour of ")
        assert page.run("return document.querySelector('[aria-pressed=true]').textContent") == (
            "Colour"
        )
        page.keys("v")
        assert page.run("return !document.getElementById('compare').hidden")
    browser.errors()
    with explored(dataset, browser, "#tab=scene") as page:
        page.wait("document.getElementById('tab-scene').disabled")
        page.wait("!document.getElementById('compare').hidden")
        assert page.errors() == []


def test_upright_pictures_fit_the_window(folder: Path, browser: Browser) -> None:
    dataset = imported(folder, folder.with_name("upright"), "--size", "60x100")
    with explored(dataset, browser) as page:
        answers = "document.getElementById('answers').getBoundingClientRect()"
        assert page.run(f"return {answers}.top") < 800
        assert page.run("return document.querySelector('#pairs small').textContent") == (
            "test 0 · 1 query"
        )


def test_masks_and_depth_of_a_camera_are_shown(folder: Path, browser: Browser) -> None:
    with_both = ("--masks", str(folder / "masks"), "--depth", str(folder / "depth"))
    dataset = imported(folder, folder.with_name("full"), *with_both)
    with explored(dataset, browser, "#layer=depth") as page:
        page.wait(f"{LOADED} && {SHOWN}.src.includes('layer=depth')")
        states = page.run(f"return {STATES}")
        assert [name for name, reason in states.items() if not reason][:3] == [
            *("Colour", "Depth", "Mask")
        ]


def test_a_damaged_picture_is_named(folder: Path, browser: Browser) -> None:
    dataset = imported(folder, folder.with_name("damaged"))
    picture = next(dataset.root.rglob("000000.png"))
    picture.write_bytes(picture.read_bytes()[:60])
    with explored(dataset, browser) as page:
        page.wait(f"{SHOWN}.alt.includes('000000.png')")
        assert "cannot be shown" in page.run(f"return {SHOWN}.alt")
        page.wait("document.getElementById('status').textContent.includes('000000.png')")
