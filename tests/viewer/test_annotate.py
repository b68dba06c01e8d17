"""The annotation page: its server by hand, and the page in a real browser."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image

from pliant.baselines.controls import Identity
from pliant.cli.annotate import earlier_marks
from pliant.spec.errors import CallError, SpecError
from pliant.viewer.annotate_app import annotate_application
from pliant.viewer.annotation import Annotation, Suggester
from pliant.viewer.local_app import LocalServer
from tests.browser import Browser, Keys
from tests.conftest import Called
from tests.privilege import without_privilege
from tests.viewer.serving import ask, below, served

SIZES = {"one.jpg": (400, 300), "two.png": (300, 400), "three.webp": (200, 150)}


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    rng = np.random.default_rng(0)
    for name, (width, height) in SIZES.items():
        rgb = rng.integers(60, 200, (height // 20, width // 20, 3)).astype(np.uint8)
        Image.fromarray(rgb).resize((width, height), Image.Resampling.NEAREST).save(tmp_path / name)
    return tmp_path


def application(annotation: Annotation, *, suggests: bool = False) -> Any:
    suggester = Suggester(annotation, Identity()) if suggests else None
    return partial(annotate_application, annotation, suggester)


@contextmanager
def shown(
    browser: Browser, annotation: Annotation, *, suggests: bool = False, **size: Any
) -> Iterator[str]:
    """Show the page in a browser, by default 1200 px wide; yield its address."""
    browser.errors()
    with served(application(annotation, suggests=suggests)) as address:
        browser.size(size.pop("width", 1200), 800, **size)
        browser.open(address)
        browser.wait("document.body.dataset.ready && image(0).complete")
        yield address


def test_marks_are_written_and_read_again(folder: Path) -> None:
    annotation = Annotation(folder, ["ball", "end"])
    marks = {
        "one.jpg": {
            "ball": [10.25, 20.5, True, "suggested"],
            "end": [None, None, False, "marked"],
        },
        "two.png": {"ball": [300, 0, False, "confirmed"]},
    }
    annotation.update({"points": ["ball", "new, yet", "end"], "marks": marks})
    assert (folder / "annotations.csv").read_text().splitlines() == [
        "picture,point,x,y,visible,source",
        "one.jpg,ball,10.250,20.500,1,suggested",
        "one.jpg,end,,,0,marked",
        "two.png,ball,300.000,0.000,0,confirmed",
        ',"new, yet",,,,',
    ]
    points, earlier = earlier_marks(folder)
    again = Annotation(folder, ["middle", *points], earlier)
    assert again.points == ["middle", "ball", "end", "new, yet"]
    assert json.loads(json.dumps(again.state()["marks"])) == marks
    assert (again.count(), again.count("suggested")) == (3, 1)


@pytest.mark.parametrize(
    "marks",
    [
        {"four.jpg": {"ball": [1, 1, True, "marked"]}},
        {"one.jpg": {"tail": [1, 1, True, "marked"]}},
        {"one.jpg": {"ball": [401, 1, True, "marked"]}},
        {"one.jpg": {"ball": [None, None, True, "marked"]}},
        {"one.jpg": {"ball": [1, float("nan"), True, "marked"]}},
        {"one.jpg": {"ball": [1, 1, "yes", "marked"]}},
        {"one.jpg": {"ball": [1, 1, True, "guessed"]}},
        {"one.jpg": {"ball": [1, 1, True]}},
        {"one.jpg": 3},
    ],
)
def test_marks_of_another_form_are_refused(folder: Path, marks: Any) -> None:
    annotation = Annotation(folder, ["ball"])
    with pytest.raises(
        CallError, match=r"not of this folder|one.jpg, point 'ball'.* in 400x300 px"
    ):
        annotation.update({"points": ["ball"], "marks": marks})
    with pytest.raises(CallError, match=r"not of this folder; found point 'a\\nb'"):
        annotation.update({"points": ["a\nb"], "marks": {}})
    assert not (folder / "annotations.csv").exists()


def test_folders_without_two_pictures_are_refused(tmp_path: Path) -> None:
    with pytest.raises(CallError, match=r"found 0 pictures.*\.gif$"):
        Annotation(tmp_path)
    (tmp_path / "IMG_1.HEIC").touch()
    with pytest.raises(CallError, match="1 HEIC file left out: save them as JPEG"):
        Annotation(tmp_path)
    with pytest.raises(CallError, match="folder not found"):
        Annotation(tmp_path / "no")


@pytest.mark.parametrize("name", [b"new\nline.png", b"no utf-8 \xff.png"])
def test_names_that_annotations_cannot_say_are_refused(name: bytes, folder: Path) -> None:
    (folder / "two.png").rename(folder / os.fsdecode(name))
    with pytest.raises(CallError, match=r"cannot be printed; found .*\.png'. Rename the file"):
        Annotation(folder)


def test_heic_files_next_to_pictures_are_named(
    folder: Path, monkeypatch: pytest.MonkeyPatch, called: Called
) -> None:
    (folder / "IMG_1.HEIC").touch()
    (folder / "text.png").write_text("no picture")
    monkeypatch.setattr(LocalServer, "run", lambda server: server._socket.close())
    _, said, _ = called("annotate", folder, "--no-browser")
    assert said.startswith("3 pictures; 1 HEIC file left out: save them as JPEG; ")
    assert "1 picture left out: not readable (text.png)\n" in said


def test_pictures_of_rarer_formats_are_shown(folder: Path) -> None:
    for name in ("four.TGA", "five.jp2"):
        Image.new("RGB", (20, 10)).save(folder / name)
    names = [picture.name for picture in Annotation(folder).pictures]
    assert sorted(names) == sorted(["five.jp2", "four.TGA", *SIZES])


@pytest.mark.parametrize("name", ["left/one.jpg", "four.ppm", "five.png"])
def test_marks_of_pictures_that_are_not_shown_are_kept(name: str, folder: Path) -> None:
    """Pictures in another folder, of another format, or not readable."""
    (folder / name).parent.mkdir(exist_ok=True)
    (folder / name).write_bytes(b"" if name == "five.png" else (folder / "one.jpg").read_bytes())
    rows = f"picture,point,x,y,visible\none.jpg,ball,1,2,1\n{name},ball,3,4,1\n"
    (folder / "annotations.csv").write_text(rows)
    with pytest.raises(CallError, match=f"that the page does not show; found '{name}'"):
        Annotation(folder, *earlier_marks(folder))
    assert (folder / "annotations.csv").read_text() == rows


def test_a_damaged_file_is_not_overwritten(folder: Path) -> None:
    (folder / "annotations.csv").write_text("picture,point\n")
    with pytest.raises(SpecError, match="the header lacks columns"):
        earlier_marks(folder)


def test_a_folder_in_the_place_of_the_file_is_refused_at_start(folder: Path) -> None:
    (folder / "annotations.csv").mkdir()
    with pytest.raises(CallError, match=r"annotations\.csv: file not found; found a folder"):
        earlier_marks(folder)


@pytest.mark.skipif(sys.platform != "linux", reason="needs prctl")
def test_a_folder_that_cannot_be_written_is_refused_at_start(folder: Path) -> None:
    folder.chmod(0o555)
    program = "from pliant.cli.main import main; main()"
    done = subprocess.run(
        [sys.executable, "-c", program, "annotate", folder, "--no-browser", "--method", "missing"],
        capture_output=True,
        text=True,
        preexec_fn=without_privilege,
        timeout=60,
    )
    folder.chmod(0o755)
    assert "the output folder cannot be written to" in done.stderr
    assert done.returncode == 2


def test_the_page_asks_and_saves(folder: Path) -> None:
    annotation = Annotation(folder, ["ball"])
    with served(application(annotation, suggests=True)) as address:

        def post(name: str, document: Any) -> tuple[int, Any]:
            body = document if isinstance(document, bytes) else json.dumps(document).encode()
            status, said = ask(address, below(address, name), "POST", body=body)
            return status, json.loads(said)

        assert json.loads(ask(address, below(address, "state"))[1])["suggests"]
        assert ask(address, below(address, "picture/1"))[1][:2] == b"\xff\xd8"
        for number in ("99", "9" * 5000, "-1", "%00", "..%2fannotations.csv"):
            assert ask(address, below(address, f"picture/{number}"))[0] in (400, 404)
        marks = {"one.jpg": {"ball": [9, 9, True, "marked"]}}
        saved = {"saved": 1, "suggested": 0, "revision": 1}
        assert post("marks", {"points": ["ball"], "marks": marks}) == (200, saved)
        assert post("suggest", {"source": 0, "target": 2})[1]["marks"] == {"ball": [9.0, 9.0]}
        for broken in (b"", b"{", b"[" * 10**5, b"9" * 5000, b"null", b"\xff"):
            assert post("marks", broken)[0] == 400
            assert post("suggest", broken)[0] == 400
        assert post("suggest", b'{"source": 1e999, "target": 0}')[0] == 400
        (folder / "two.png").unlink()
        assert ask(address, below(address, "picture/2"))[0] == 422
        assert ask(address, "/marks", "POST", body=b"{}")[0] == 403
    assert marks_of(folder) == ["one.jpg,ball,9.000,9.000,1,marked"]


def test_suggestions_are_in_pixels_of_the_pictures(folder: Path) -> None:
    """`identity` answers the same place of the view: by hand, both pictures are their own view."""
    annotation = Annotation(folder, ["ball", "end"])
    marks = {"ball": [100, 50, True, "marked"], "end": [90, 40, True, "suggested"]}
    annotation.update({"points": ["ball", "end"], "marks": {"one.jpg": marks}})
    suggester = Suggester(annotation, Identity())
    assert suggester.suggest(0, 2)["marks"] == {"ball": [100.0, 50.0]}  # none from a suggestion
    assert "no visible marks" in suggester.suggest(2, 0)["warnings"][0]


def marks_of(folder: Path) -> list[str]:
    rows = (folder / "annotations.csv").read_text().splitlines()[1:]
    return [row for row in rows if not row.startswith(",")]  # a point without marks


def click_picture(browser: Browser, u: float, v: float) -> None:
    """Click a place of the picture, in its own pixels."""
    script = "const b = view.getBoundingClientRect(); return [b.left + left, b.top + top_, zoom]"
    x, y, zoom = browser.run(script)
    browser.click(x + u * zoom, y + v * zoom)


def test_points_are_clicked_in_a_browser(browser: Browser, folder: Path) -> None:
    """Click, next picture, hidden by keyboard, undo, zoom, a new point."""
    with shown(browser, Annotation(folder, ["ball", "end"])) as address:
        click_picture(browser, 100, 150)
        browser.wait("$('said').textContent.includes('1 mark saved')")
        assert browser.run("return chosen") == "end"
        browser.keys("h")  # nobody sees the end here
        browser.wait("$('said').textContent.includes('2 marks saved')")
        name, point, x, y, visible, source = marks_of(folder)[0].split(",")
        assert (name, point, visible, source) == ("one.jpg", "ball", "1", "marked")
        assert float(x) == pytest.approx(100, abs=0.6)
        assert float(y) == pytest.approx(150, abs=0.6)
        assert marks_of(folder)[1] == "one.jpg,end,,,0,marked"
        browser.keys("n")
        assert browser.run("return picture().name") == "three.webp"
        for _ in range(6):
            browser.keys("+")
        browser.run("left = 300 - 60.5 * zoom; top_ = 300 - 70.25 * zoom; draw()")
        browser.run("$('new').value = 'middle'; $('add').requestSubmit()")
        click_picture(browser, 60.5, 70.25)
        browser.wait("$('said').textContent.includes('3 marks saved')")
        name, point, x, y, *_ = marks_of(folder)[2].split(",")
        assert (name, point) == ("three.webp", "middle")
        assert float(x) == pytest.approx(60.5, abs=0.2)  # a pixel of the window is less here
        assert float(y) == pytest.approx(70.25, abs=0.2)
        browser.keys(Keys.CONTROL, "z")
        browser.wait("$('said').textContent.includes('2 marks saved')")
        browser.open(address)  # everything is there again
        browser.wait("document.body.dataset.ready")
        assert browser.run("return state.points") == ["ball", "end", "middle"]
        assert browser.run("return $('suggest').hidden")
    assert browser.errors() == []


def test_a_picture_that_cannot_be_decoded_says_why_in_its_place(
    browser: Browser, folder: Path
) -> None:
    """Not in the status line, where the next picture would keep it."""
    Image.fromarray(np.zeros((10, 20), np.float32)).save(folder / "four.tif")  # not from its header
    annotation = Annotation(folder, ["ball"])
    at = [picture.name for picture in annotation.pictures].index("four.tif")
    with shown(browser, annotation):
        browser.run(f"go({at})")
        browser.wait("$('unshown').textContent.includes('its pixels are floating-point')")
        browser.run(f"go({at} + 1)")
        browser.wait("$('unshown').textContent === ''")
        assert browser.run("return $('said').className") == ""
    assert all("status of 422" in error for error in browser.errors())


def test_points_are_renamed_and_deleted_with_their_marks(browser: Browser, folder: Path) -> None:
    said = "$('said').textContent"
    annotation = Annotation(folder, ["ball", "end"])
    marks = {"ball": [10, 20, True, "marked"], "end": [30, 40, False, "confirmed"]}
    annotation.update({"points": ["ball", "end"], "marks": {"one.jpg": marks, "two.png": marks}})
    with shown(browser, annotation):
        browser.run("chosen = 'ball'; render(); $('new').value = 'end'; $('rename').click()")
        browser.wait(f"{said} === 'There is a point end already'")
        browser.run("$('new').value = 'knot'; $('rename').click()")
        browser.wait(f"{said} === '4 marks saved'")
        assert [row.split(",")[1] for row in marks_of(folder)] == ["knot", "end"] * 2
        assert browser.run("return [chosen, $('new').value]") == ["knot", ""]
        browser.run("$('drop').click()")
        browser.wait(f"{said} === '2 marks saved'")
        assert marks_of(folder) == [
            f"{name},end,30.000,40.000,0,confirmed" for name in ("one.jpg", "two.png")
        ]
        browser.run("$('drop').click()")
        browser.wait(f"{said} === '0 marks saved'")
        assert browser.run("return [chosen, $('drop').disabled, $('rename').disabled]") == [
            None,
            True,
            True,
        ]
        for _ in range(3):
            browser.keys(Keys.CONTROL, "z")
        browser.wait(f"{said} === '4 marks saved'")
        assert annotation.points == ["ball", "end"]
        assert marks_of(folder)[0] == "one.jpg,ball,10.000,20.000,1,marked"
    assert browser.errors() == []


def test_a_whole_picture_stays_whole_in_another_window(browser: Browser, folder: Path) -> None:
    is_whole = "left >= 0 && left + picture().width * zoom <= view.getBoundingClientRect().width"
    with shown(browser, Annotation(folder, ["ball"])):
        browser.size(390, 800)
        browser.wait(is_whole)
        browser.keys("+")
        browser.keys("+")
        before = browser.run("return [zoom, left]")
        browser.size(700, 800)
        browser.run("return new Promise(requestAnimationFrame)")
        assert browser.run("return [zoom, left]") == before


def test_two_fingers_zoom_and_mark_nothing(browser: Browser, folder: Path) -> None:
    annotation = Annotation(folder, ["ball"])
    with shown(browser, annotation):
        before = browser.run("const b = view.getBoundingClientRect(); return [zoom, b.left, b.top]")

        def touch(kind: str, *at: tuple[int, int]) -> None:
            points = [
                {"x": before[1] + x, "y": before[2] + y, "id": n} for n, (x, y) in enumerate(at)
            ]
            browser.driver.execute_cdp_cmd(
                "Input.dispatchTouchEvent", {"type": kind, "touchPoints": points}
            )

        under = "return [(200 - left) / zoom, (150 - top_) / zoom]"
        middle = browser.run(under)
        touch("touchStart", (180, 150))
        touch("touchStart", (180, 150), (220, 150))
        touch("touchMove", (160, 150), (240, 150))
        touch("touchEnd")
        browser.wait(f"Math.abs(zoom / {before[0]} - 2) < 0.01")
        assert browser.run(under) == pytest.approx(middle, abs=0.1)
        browser.hover(before[1] + 300, before[2] + 300)
        assert browser.run(under) == pytest.approx(middle, abs=0.1)
        assert browser.run("return Object.keys(own()).length") == 0
        assert browser.errors() == []


def test_a_second_window_does_not_undo_the_marks_of_the_first(
    browser: Browser, folder: Path
) -> None:
    with shown(browser, Annotation(folder, ["ball", "end"])) as address:
        first = browser.driver.current_window_handle
        browser.driver.switch_to.new_window("tab")
        browser.open(address)
        browser.wait("document.body.dataset.ready")
        browser.keys("h")
        browser.wait("$('said').textContent === '1 mark saved'")
        browser.keys("h")
        browser.wait("$('said').textContent === '0 marks saved'")
        browser.keys("h")
        browser.wait("$('said').textContent === '1 mark saved'")
        browser.driver.close()
        browser.driver.switch_to.window(first)
        browser.keys(Keys.ARROW_DOWN)
        browser.keys("h")
        browser.wait("$('said').textContent.startsWith('Not saved')")
        assert "changed in another window. Reload" in browser.run("return $('said').textContent")
        browser.open(address)
        browser.wait("document.body.dataset.ready")
        browser.keys("h")
        browser.wait("$('said').textContent === '2 marks saved'")
    assert len(marks_of(folder)) == 2


def test_marking_by_keyboard_undo_elsewhere_and_a_server_that_has_ended(
    browser: Browser, folder: Path
) -> None:
    said = "$('said').textContent"
    leave = "return dispatchEvent(new Event('beforeunload', { cancelable: true }))"
    with shown(browser, Annotation(folder, ["constructor", "end"])) as address:
        assert browser.run("return chosen") == "constructor"  # a name that every object has
        browser.keys(Keys.SHIFT, Keys.ARROW_RIGHT)
        browser.wait(f"{said} === '1 mark saved'")
        assert browser.run(leave)
        name, point, x, y, *_ = marks_of(folder)[0].split(",")
        assert (name, point) == ("one.jpg", "constructor")
        assert float(x) == pytest.approx(200 + 4 / browser.run("return zoom"), abs=0.01)
        assert float(y) == pytest.approx(150, abs=0.01)
        browser.run("document.querySelectorAll('#points button')[1].focus()")
        browser.keys(Keys.ENTER)
        assert browser.run("return document.activeElement.dataset.point") == "end"  # still there
        browser.keys("n")
        browser.driver.refresh()
        browser.wait("document.body.dataset.ready && picture().name === 'three.webp'")
        browser.keys("h")
        browser.wait(f"{said} === '2 marks saved'")
        browser.keys("p")
        browser.keys(Keys.CONTROL, "z")
        browser.wait(f"{said} === '1 mark saved' && picture().name === 'three.webp'")
        assert address in browser.driver.current_url
    browser.keys("h")
    browser.wait(f"{said}.startsWith('Not saved: the command has ended. Run it again')")
    assert len(marks_of(folder)) == 1
    assert not browser.run(leave)  # the browser asks before the change is lost
    browser.errors()  # the refused connection


def test_a_suggestion_counts_once_it_is_confirmed_or_moved(browser: Browser, folder: Path) -> None:
    annotation = Annotation(folder, ["ball", "end", "middle"])
    placed = {name: [50 + 9 * k, 50, True, "marked"] for k, name in enumerate(annotation.points)}
    annotation.update({"points": annotation.points, "marks": {"one.jpg": placed}})
    said = "$('said').textContent"

    def sources() -> list[str]:
        return [row.split(",")[-1] for row in marks_of(folder) if row.startswith("three")]

    with shown(browser, annotation, suggests=True):
        browser.keys("n")
        browser.keys("s")
        browser.wait(f"{said}.includes('3 points suggested')")
        assert sources() == ["suggested"] * 3
        notes = "return [...document.querySelectorAll('#points small')].map(e => e.textContent)"
        assert browser.run(notes) == ["suggested"] * 3
        browser.keys(Keys.ENTER)  # the first; the next is chosen
        browser.wait(f"{said}.includes('2 of them suggested')")
        assert browser.run("return chosen") == "end"
        browser.wait("image(at).complete")
        click_picture(browser, 80, 60)  # moved
        browser.wait(f"{said}.includes('1 of them suggested')")
        assert sources() == ["confirmed", "marked", "suggested"]
        browser.keys(Keys.SHIFT, Keys.ENTER)
        browser.wait(f"{said} === '6 marks saved'")
        assert sources() == ["confirmed", "marked", "confirmed"]
        assert browser.run("return $('confirm').disabled")
        browser.keys(Keys.DELETE)
        browser.keys("s")
        browser.wait(f"{said}.includes('1 point suggested')")


@pytest.mark.parametrize("dark", [False, True])
@pytest.mark.parametrize("width", [400, 1200])
def test_the_page_fits_its_window(browser: Browser, folder: Path, width: int, dark: bool) -> None:
    annotation = Annotation(folder, ["ball", "a point with quite a long name"])
    with shown(browser, annotation, width=width, dark=dark):
        assert browser.run("return document.documentElement.scrollWidth") <= width
        assert browser.run("return view.getBoundingClientRect().height") >= 240
        assert browser.run("return $('said').getBoundingClientRect().bottom <= innerHeight")
        places = """const at = $('next').getBoundingClientRect(); return [at.left, at.top];"""
        before = browser.run(places)
        browser.run("$('name').textContent = '2 of 3: ' + 'long name '.repeat(30)")
        assert browser.run(places) == before  # under the finger that has just touched it
        paper = browser.run("return getComputedStyle(document.body).backgroundColor")
        assert (sum(map(int, paper.strip("rgb()").split(","))) < 300) == dark
    assert browser.errors() == []
