"""The annotation page: its server by hand, and the page in a real browser."""

from __future__ import annotations

import json
import threading
import urllib.error
import urllib.request
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image

from pliant.baselines.controls import Identity
from pliant.spec.errors import CallError, SpecError
from pliant.viewer.annotate import Annotation, Suggester, make_server
from tests.browser import Browser

SIZES = {"one.jpg": (400, 300), "two.png": (300, 400), "three.webp": (200, 150)}


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    rng = np.random.default_rng(0)
    for name, (width, height) in SIZES.items():
        rgb = rng.integers(60, 200, (height // 20, width // 20, 3)).astype(np.uint8)
        Image.fromarray(rgb).resize((width, height), Image.Resampling.NEAREST).save(tmp_path / name)
    return tmp_path


@contextmanager
def served(annotation: Annotation, suggester: Suggester | None = None) -> Iterator[str]:
    server = make_server(annotation, suggester)
    thread = threading.Thread(target=server.serve_forever, daemon=True)
    thread.start()
    try:
        yield f"http://127.0.0.1:{server.server_address[1]}"
    finally:
        server.shutdown()
        server.server_close()
        thread.join()


def get(address: str, **headers: str) -> bytes:
    with urllib.request.urlopen(urllib.request.Request(address, headers=headers)) as answer:
        data: bytes = answer.read()
        return data


def post(address: str, document: Any, token: str) -> Any:
    body = json.dumps(document).encode()
    request = urllib.request.Request(address, body, {"X-Token": token}, method="POST")
    with urllib.request.urlopen(request) as answer:
        return json.load(answer)


def token_of(address: str) -> str:
    facts = get(f"{address}/").decode().split("const FACTS = ")[1].split(";\n")[0]
    token: str = json.loads(facts)["token"]
    return token


def test_marks_are_written_and_read_again(folder: Path) -> None:
    annotation = Annotation(folder, ["ball", "end"])
    marks = {
        "one.jpg": {"ball": [10.25, 20.5, True], "end": [None, None, False]},
        "two.png": {"ball": [300, 0, False]},
    }
    annotation.update({"points": ["ball", "end"], "marks": marks})
    assert (folder / "annotations.csv").read_text().splitlines() == [
        "picture,point,x,y,visible",
        "one.jpg,ball,10.250,20.500,1",
        "one.jpg,end,,,0",
        "two.png,ball,300.000,0.000,0",
    ]
    again = Annotation(folder, ["middle"])
    assert again.points == ["middle", "ball", "end"]
    assert json.loads(json.dumps(again.marks)) == marks


@pytest.mark.parametrize(
    "marks",
    [
        {"four.jpg": {"ball": [1, 1, True]}},
        {"one.jpg": {"tail": [1, 1, True]}},
        {"one.jpg": {"ball": [401, 1, True]}},
        {"one.jpg": {"ball": [None, None, True]}},
        {"one.jpg": {"ball": [1, float("nan"), True]}},
        {"one.jpg": {"ball": [1, 1, "yes"]}},
        {"one.jpg": 3},
    ],
)
def test_marks_of_another_form_are_refused(folder: Path, marks: Any) -> None:
    annotation = Annotation(folder, ["ball"])
    with pytest.raises(CallError, match="not of this folder"):
        annotation.update({"points": ["ball"], "marks": marks})
    assert not (folder / "annotations.csv").exists()


def test_folders_without_two_pictures_are_refused(tmp_path: Path) -> None:
    with pytest.raises(CallError, match="found 0 pictures"):
        Annotation(tmp_path)
    with pytest.raises(CallError, match="folder not found"):
        Annotation(tmp_path / "no")


def test_a_damaged_file_is_not_overwritten(folder: Path) -> None:
    (folder / "annotations.csv").write_text("picture,point\n")
    with pytest.raises(SpecError, match="the header lacks columns"):
        Annotation(folder)


def test_other_pages_reach_nothing(folder: Path) -> None:
    with served(Annotation(folder, ["ball"])) as address:
        document = {"points": ["ball"], "marks": {}}
        for call in (
            lambda: post(f"{address}/marks", document, "guessed"),
            lambda: get(f"{address}/state", Host="evil.example"),
            lambda: get(f"{address}/picture/99"),
            lambda: get(f"{address}/picture/../annotations.csv"),
        ):
            with pytest.raises(urllib.error.HTTPError) as refused:
                call()
            refused.value.close()
        assert post(f"{address}/marks", document, token_of(address)) == {"saved": 0}
        assert get(f"{address}/picture/1")[:2] == b"\xff\xd8"


def test_suggestions_are_in_pixels_of_the_pictures(folder: Path) -> None:
    """`identity` answers the same place of the view: by hand, both pictures are their own view."""
    annotation = Annotation(folder, ["ball"])
    annotation.update({"points": ["ball"], "marks": {"one.jpg": {"ball": [100, 50, True]}}})
    suggester = Suggester(annotation, Identity)
    assert suggester.suggest(0, 2)["marks"] == {"ball": [100.0, 50.0]}
    assert "no visible marks" in suggester.suggest(2, 0)["warnings"][0]


def marks_of(folder: Path) -> list[str]:
    return (folder / "annotations.csv").read_text().splitlines()[1:]


def click_picture(browser: Browser, u: float, v: float) -> None:
    """Click a place of the picture, in its own pixels."""
    script = "const b = view.getBoundingClientRect(); return [b.left + left, b.top + top_, zoom]"
    x, y, zoom = browser.run(script)
    browser.click(x + u * zoom, y + v * zoom)


def test_points_are_clicked_in_a_browser(browser: Browser, folder: Path) -> None:
    """Click, next picture, hidden by keyboard, undo, zoom, a new point, suggestions."""
    annotation = Annotation(folder, ["ball", "end"])
    with served(annotation, Suggester(annotation, Identity)) as address:
        browser.size(1200, 800)
        browser.open(f"{address}/")
        browser.wait("document.body.dataset.ready && image(0).complete")
        click_picture(browser, 100, 150)
        browser.wait("$('said').textContent.includes('1 marks saved')")
        assert browser.run("return chosen") == "end"
        browser.keys("h")  # nobody sees the end here
        browser.wait("$('said').textContent.includes('2 marks saved')")
        name, point, x, y, visible = marks_of(folder)[0].split(",")
        assert (name, point, visible) == ("one.jpg", "ball", "1")
        assert float(x) == pytest.approx(100, abs=0.6)
        assert float(y) == pytest.approx(150, abs=0.6)
        assert marks_of(folder)[1] == "one.jpg,end,,,0"
        browser.keys("n")
        assert browser.run("return picture().name") == "three.webp"
        browser.keys("s")
        browser.wait("$('said').textContent.includes('1 points suggested')")
        assert marks_of(folder)[2].startswith("three.webp,ball,")
        browser.keys("\ue009", "z")  # Ctrl+Z
        browser.wait("$('said').textContent.includes('2 marks saved')")
        assert len(marks_of(folder)) == 2
        for _ in range(6):
            browser.keys("+")
        browser.run("left = 300 - 60.5 * zoom; top_ = 300 - 70.25 * zoom; draw()")
        browser.run("$('new').value = 'middle'; $('add').requestSubmit()")
        click_picture(browser, 60.5, 70.25)
        browser.wait("$('said').textContent.includes('3 marks saved')")
        name, point, x, y, _ = marks_of(folder)[2].split(",")
        assert (name, point) == ("three.webp", "middle")
        assert float(x) == pytest.approx(60.5, abs=0.2)  # a pixel of the window is less here
        assert float(y) == pytest.approx(70.25, abs=0.2)
        browser.open(f"{address}/")  # everything is there again
        browser.wait("document.body.dataset.ready")
        assert browser.run("return state.points") == ["ball", "end", "middle"]


@pytest.mark.parametrize("width", [400, 1200])
def test_the_page_fits_its_window(browser: Browser, folder: Path, width: int) -> None:
    with served(Annotation(folder, ["ball", "a point with quite a long name"])) as address:
        browser.size(width, 800)
        browser.open(f"{address}/")
        browser.wait("document.body.dataset.ready")
        assert browser.run("return document.documentElement.scrollWidth") <= width
        assert browser.run("return view.getBoundingClientRect().height") >= 240
