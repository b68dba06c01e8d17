"""The explorer's page in a real browser: point, layers, browse, keys, links, dark, phone, 3D."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator
from importlib import resources
from pathlib import Path
from urllib.parse import parse_qsl, urlsplit

import pytest

from pliant.spec.dataset import Dataset
from pliant.spec.queries import QueryPair, RecordedPair
from pliant.viewer.explorer.app import Explorer
from pliant.viewer.explorer.documents import catalogue
from pliant.viewer.explorer.recorded import RecordedQueries
from tests.browser import Browser, Keys
from tests.viewer.explorer.conftest import SHIFT_PX, make_explorer
from tests.viewer.serving import served

PLACES = """
const frame = document.querySelector('#picture-a .frame').getBoundingClientRect();
return [frame.left, frame.top, frame.width / arguments[0]];
"""
CELLS = "document.querySelectorAll('#answers tbody tr')"
HEAT = "document.querySelector('#picture-b .heat').getAttribute('src')"
LOADED = "[...document.querySelectorAll('img.layer')].every(each => each.complete)"


class Page:
    """The page of an explorer in a browser."""

    def __init__(self, browser: Browser, explorer: Explorer, address: str) -> None:
        self.browser, self.explorer, self.address = browser, explorer, address

    def open(self, link: str = "", *, width: int = 1200, dark: bool = False) -> None:
        self.browser.open("about:blank")
        self.browser.size(width, 800, dark=dark)
        self.browser.open(self.address + link)
        self.browser.wait("document.body.dataset.ready")

    def at(self, u: float, v: float) -> tuple[float, float]:
        """Return where a place of the source is in the window."""
        left, top, zoom = self.browser.run(PLACES, self.explorer.dataset.size[0])
        return left + u * zoom, top + v * zoom

    def answered(self, place: str = "") -> None:
        """Wait until the live method's place is written, and is the given one."""
        said = f"{CELLS}[1].children[2].textContent"
        self.browser.wait(f"{said} === '{place}'" if place else f"{said} !== '–'", 20)

    def cell(self, row: int, column: int) -> str:
        text: str = self.browser.run(f"return {CELLS}[{row}].children[{column}].textContent")
        return text

    def place(self) -> tuple[float, float]:
        """Return the pixel that is asked about, by the address."""
        given = dict(parse_qsl(self.link().lstrip("#")))
        return float(given["u"]), float(given["v"])

    def link(self) -> str:
        """Return the address, which follows what is shown with a delay."""
        return str(
            self.browser.run(
                "return new Promise(done => setTimeout(() => done(location.hash), 150))"
            )
        )


@pytest.fixture(scope="module")
def page(browser: Browser, explorer: Explorer, address: str) -> Page:
    return Page(browser, explorer, address)


@pytest.fixture(autouse=True)
def silent(browser: Browser, address: str) -> Iterator[None]:
    """Every test: no error in the console, and no request to another machine."""
    browser.errors()
    browser.requests()
    yield
    assert browser.errors() == []
    hosts = {urlsplit(each).hostname for each in browser.requests() if each.startswith("http")}
    assert hosts <= {"127.0.0.1"}


def link_of(explorer: Explorer, pair: int = 0) -> str:
    """Return the link to a pair of the test split."""
    shown = explorer.queries.splits["test"].pairs[pair]
    return f"#a={shown.source.key}&b={shown.target.key}"


def first_query(explorer: Explorer, pair: int = 0) -> tuple[float, float]:
    u, v = explorer.queries.splits["test"].pairs[pair].uv_a_px[0].tolist()
    return u, v


def test_moving_the_pointer_shows_truth_answers_and_heat(page: Page) -> None:
    page.open(link_of(page.explorer))
    u, v = first_query(page.explorer)
    page.browser.hover(*page.at(u, v))
    page.answered()
    asked, _ = page.place()
    assert asked % 1 == 0.5  # the centre of a pixel
    answer = float(page.cell(1, 2).split(",")[0])
    assert answer == pytest.approx(asked + SHIFT_PX, abs=0.06)
    assert page.cell(1, 5) == "72 %"
    page.browser.wait(f"{CELLS}[2].children[3].textContent === '5.0'")  # recorded: 5 px off
    assert page.cell(0, 2) != "–"
    page.browser.wait(HEAT)
    before = page.browser.run(f"return {HEAT}")
    other = page.explorer.queries.splits["test"].pairs[0].uv_a_px[7].tolist()
    page.browser.hover(*page.at(*other))
    page.browser.wait(f"{HEAT} && {HEAT} !== arguments[0]".replace("arguments[0]", f"'{before}'"))
    page.browser.keys("h")
    page.browser.wait(f"!{HEAT}")


def test_a_pair_opens_at_a_point_that_both_pictures_show(page: Page) -> None:
    """The query in the middle of this pair's list has no point that the target shows."""

    def is_seen(pair: QueryPair) -> bool:
        middle = pair.uv_a_px[[len(pair) // 2]]
        found = page.explorer.truth.find(RecordedPair(pair.source, pair.target, middle))
        return found is not None and found.visibility == "visible"

    shown = [is_seen(pair) for pair in page.explorer.queries.splits["test"].pairs]
    page.open(link_of(page.explorer, shown.index(False)))
    page.browser.wait(f"{CELLS}[0].children[4].textContent === 'yes'")


def test_the_magnifier_fits_into_low_pictures(page: Page) -> None:
    page.open()
    page.answered()
    page.browser.run("document.getElementById('pictures').style.setProperty('--aspect', '12')")
    lowest_row = (
        "[...canvas.getContext('2d').getImageData(0, canvas.height - 1, canvas.width, 1).data]"
    )
    page.browser.wait(
        "(() => { const canvas = document.querySelector('#picture-b canvas');"
        " return canvas.clientHeight < 100 && canvas.height === canvas.clientHeight"
        f" && {lowest_row}.every(each => each === 0); }})()",
        10,
    )


def test_another_pair_shows_nothing_of_the_one_before(page: Page) -> None:
    page.open()
    page.answered()
    assert page.browser.run(f"return {HEAT}")
    page.browser.keys("n")
    page.answered("–")
    assert (page.cell(0, 2), page.browser.run(f"return {HEAT}")) == ("–", None)
    marks = """const canvas = document.querySelector('#picture-b canvas');
    const { width, height } = canvas;
    return canvas.getContext('2d').getImageData(0, 0, width, height).data.some(Boolean);
    """
    assert not page.browser.run(marks)


def test_a_damaged_file_is_named(page: Page) -> None:
    """The answer of the server to a truth that cannot be read."""
    page.open()
    page.answered()
    page.browser.run(
        """
        const ask = window.fetch, said = JSON.stringify({ error: "depth.exr: damaged" });
        window.fetch = where => where.startsWith("api/truth")
            ? Promise.resolve(new Response(said, { status: 422 })) : ask(where);
        """
    )
    page.browser.hover(*page.at(*first_query(page.explorer)))
    page.browser.wait("document.getElementById('status').textContent === 'depth.exr: damaged'")


def test_a_server_that_has_ended_is_named(page: Page) -> None:
    page.open(link_of(page.explorer))
    page.browser.run("window.fetch = () => Promise.reject(new TypeError('Failed to fetch'))")
    page.browser.hover(*page.at(*first_query(page.explorer)))
    page.browser.wait(
        "document.getElementById('status').textContent.startsWith('The command has ended. Run it')"
    )


def test_a_click_pins_and_arrow_keys_move(page: Page) -> None:
    page.open(link_of(page.explorer))
    u, v = first_query(page.explorer)
    page.browser.click(*page.at(u, v))
    page.browser.wait("document.getElementById('status').textContent.includes('Pinned')")
    before = page.place()
    x, y = page.at(u, v)
    page.browser.hover(x + 40, y)  # pinned: it stays
    page.browser.keys(Keys.ARROW_RIGHT)
    page.browser.keys(Keys.SHIFT, Keys.ARROW_DOWN)
    assert page.place() == (before[0] + 1, before[1] + 10)
    assert "pinned=1" in page.link()


def test_a_link_shows_the_same_again(page: Page) -> None:
    u, v = first_query(page.explorer, 2)
    place = f"{link_of(page.explorer, 2)}&u={int(u) + 0.5:g}&v={int(v) + 0.5:g}"
    page.open(f"{place}&layer=index&heat=0")
    page.answered(f"{int(u) + 0.5 + SHIFT_PX:.1f}, {int(v) + 0.5:.1f}")
    page.browser.wait(LOADED)
    source = page.browser.run("return document.querySelector('#picture-a .layer').src")
    assert "layer=index" in source
    assert page.browser.run("return document.querySelector('#picture-b .heat').src") == ""
    current = "document.querySelector('#pairs [aria-current=true]').dataset.pair"
    pairs = [pair for each in page.explorer.queries.splits.values() for pair in each.pairs]
    shown = page.explorer.queries.splits["test"].pairs[2]
    assert pairs[int(page.browser.run(f"return {current}"))] is shown
    page.browser.keys("1")
    page.browser.keys("h")
    page.browser.wait(HEAT)
    page.browser.keys("3")  # the colours of the index are not covered
    page.browser.wait(f"!{HEAT}")
    page.browser.run("location.hash = '#a=nobody/0&b=nobody/0'")  # an address of another dataset
    page.browser.wait(
        "document.querySelector('#picture-a figcaption').textContent.includes('rope')"
    )


def test_an_address_of_another_dataset_shows_what_there_is(
    page: Page, monkeypatch: pytest.MonkeyPatch
) -> None:
    listed = catalogue(page.explorer.dataset, page.explorer.queries, page.explorer.methods)
    assert listed["methods"][1]["answered"] == 1
    listed["methods"][1]["answered"] = 0.507
    monkeypatch.setattr("pliant.viewer.explorer.app.catalogue", lambda *_: listed)
    ropes = link_of(page.explorer)
    page.open(f"{ropes}&u=9999&v=3&layer=gone&tab=gone&tier=gone&sort=worst:9&method=7")
    page.answered()
    assert re.fullmatch(f"{re.escape(ropes)}&u=[0-9.]+&v=[0-9.]+", page.link())
    assert page.browser.run("return document.querySelector('#compare').checkVisibility()")
    written = page.browser.run("return document.getElementById('errors-of').textContent")
    assert written == "RMSE of moved 5 px, 50 % answered"
    other = next(each for each in page.explorer.dataset.sequences if each.tier != "rope")
    page.open(f"{ropes.partition('&')[0]}&b={other.id}/0")  # of another tier
    page.answered()


def test_pairs_are_filtered_and_sorted(page: Page) -> None:
    page.open()
    total = page.browser.run("return document.querySelectorAll('#pairs button').length")
    choose = "const s = document.getElementById(arguments[0]); s.value = arguments[1]; s.onchange()"
    page.browser.run(choose, "tier", "cloth-1")
    names = page.browser.run(
        "return [...document.querySelectorAll('#pairs b')].map(e => e.textContent)"
    )
    assert 0 < len(names) < total
    assert all(name.startswith("cloth-1") for name in names)
    page.browser.run(choose, "tier", "")
    page.browser.run("document.getElementById('measure').click()")  # the live method, pair by pair
    page.browser.wait(
        "!document.getElementById('measure').dataset.running && "
        "document.getElementById('sort').value === 'worst:0'"
    )
    shown = page.browser.run(
        "return [...document.querySelectorAll('#pairs span')].map(e => parseFloat(e.textContent))"
    )
    errors = [each for each in shown if each == each and each is not None]
    assert len(errors) > 4
    assert errors == sorted(errors, reverse=True)
    assert errors[0] > errors[-1]
    page.browser.run(choose, "sort", "best:0")
    rows = "document.querySelectorAll('#pairs li button')"
    page.browser.run(f"{rows}[0].click()")
    page.browser.keys("n")
    page.browser.wait(f"{rows}[1].getAttribute('aria-current') === 'true'")
    page.browser.keys("p")
    page.browser.wait(f"{rows}[0].getAttribute('aria-current') === 'true'")
    page.browser.keys(Keys.ARROW_RIGHT)  # without a pointer
    page.answered()


def test_every_layer_can_be_seen(page: Page) -> None:
    page.open()
    buttons = "document.querySelectorAll('#layers button')"
    names = page.browser.run(
        f"return [...{buttons}].filter(e => !e.disabled).map(e => e.dataset.layer)"
    )
    assert names == ["rgb", "depth", "index", "mask", "error"]  # no descriptors here
    for number, name in enumerate(names):
        page.browser.keys(str(1 + number + 2 * (name == "error")))
        page.browser.wait(
            f"document.querySelector('#picture-a .layer').src.includes('layer={name}')"
        )
        page.browser.wait(
            "[...document.querySelectorAll('img.layer')].every(e => e.naturalWidth === 160)"
        )
    faded = "document.querySelector('#picture-a .layer').classList.contains('loading')"
    for name in ("index", "error"):  # until it is there, the one before is seen
        press = f"document.querySelector('[data-layer={name}]').click(); return {faded}"
        assert page.browser.run(press)
        page.browser.wait(f"!{faded}")
    assert page.browser.run("return !document.getElementById('legend').hidden")
    page.browser.keys("m")  # a recorded method has no answer to every pixel
    page.browser.wait("document.querySelector('#picture-a .layer').src.includes('layer=rgb')")
    assert page.browser.run("return document.getElementById('legend').hidden")
    title = page.browser.run("return document.querySelector('[data-layer=error]').title")
    assert title == "moved 5 px does not have this layer: it is recorded at the queries only"


@pytest.mark.parametrize(
    ("tab", "dark"),
    [
        ("compare", False),
        ("scene", True),
        pytest.param("compare", True, marks=pytest.mark.long),
        pytest.param("scene", False, marks=pytest.mark.long),
    ],
)
def test_the_page_fits_a_phone(page: Page, tab: str, dark: bool) -> None:
    page.open(f"#tab={tab}", width=400, dark=dark)
    page.browser.run("localStorage.clear()")
    page.open(f"#tab={tab}", width=400, dark=dark)
    assert page.browser.run("return document.documentElement.scrollWidth") <= 400
    borders = "getComputedStyle(document.getElementById('answers')).borderCollapse"
    assert page.browser.run(f"return {borders}") == "separate"  # of cells that stay when it scrolls
    heights = (
        "return [...document.querySelectorAll('#answers tr')]"
        ".map(row => row.getBoundingClientRect().height % 1)"
    )
    assert not any(page.browser.run(heights))
    if tab == "scene":  # of configurations, which no tracks join
        tracks = "document.querySelector('#scene-parts [name=tracks]')"
        page.browser.wait(f"{tracks}.disabled && !{tracks}.checked")
    back, ink = page.browser.run(
        "const s = getComputedStyle(document.body); return [s.backgroundColor, s.color]"
    )
    levels = [sum(map(int, each.strip("rgb()").split(","))) for each in (back, ink)]
    assert (levels[0] < levels[1]) == dark
    assert abs(levels[0] - levels[1]) > 400
    assert page.browser.run("return localStorage.getItem('theme')") is None  # nobody chose
    page.browser.keys("t")
    switched = page.browser.run("return getComputedStyle(document.body).backgroundColor")
    assert switched != back
    page.browser.run("localStorage.clear()")


def test_colours_are_those_of_the_reports() -> None:
    def colours(package: str, name: str) -> dict[str, str]:
        text = resources.files(package).joinpath(name).read_text()
        return dict(re.findall(r"(--[a-z-]+): (light-dark\([^)]*\))", text))

    reports = colours("pliant.evaluator.report", "templates/style.css")
    explorer = colours("pliant.viewer.explorer", "static/explorer.css")
    shared = {"--ink", "--soft", "--line", "--accent", "--tint", "--paper"}
    assert shared <= set(reports)
    assert {name: explorer[name] for name in shared} == {name: reports[name] for name in shared}


def test_a_finger_points_too(page: Page) -> None:
    page.open(link_of(page.explorer), width=400)
    assert not page.browser.run("return document.getElementById('pairs').checkVisibility()")
    page.browser.run("document.querySelector('#picture-a').scrollIntoView()")
    u, v = first_query(page.explorer)
    page.browser.touch(*page.at(u, v))
    page.answered()
    assert "u=" in page.link()


def test_an_episode_plays_in_3d(
    browser: Browser, tiny_episode: Path, submit: Callable[[Path, float], Path]
) -> None:
    explorer = make_explorer(tiny_episode, submit(tiny_episode, 1.0))
    with served(explorer.application) as address:
        page = Page(browser, explorer, address)
        page.open("#tab=scene&frame=3")
        stage = "document.getElementById('stage').dataset"
        browser.wait(f"{stage}.frame === '3' && Number({stage}.parts) > 10", 30)  # tracks too
        note = browser.run("return document.getElementById('scene-note').textContent")
        assert "24 frames, an episode" in note
        assert "no mesh" in note
        browser.keys(Keys.ARROW_RIGHT)
        browser.wait(f"{stage}.frame === '4'")
        browser.keys(" ")
        browser.wait(f"Number({stage}.frame) > 6")
        browser.keys(" ")
        assert browser.run("return document.getElementById('play').textContent") == "▶ Play"
        browser.open("about:blank")  # before the server ends: nothing asks for more


def test_a_browser_without_3d_and_a_set_without_queries_say_so(page: Page) -> None:
    page.open()
    page.browser.run(
        "const real = HTMLCanvasElement.prototype.getContext;"
        "HTMLCanvasElement.prototype.getContext = function (kind, ...rest) {"
        " return kind.startsWith('webgl') ? null : real.call(this, kind, ...rest); }"
    )
    page.browser.keys("v")
    page.browser.wait(
        "document.getElementById('scene-note').textContent.startsWith('This browser')"
    )
    page.browser.errors()  # of three.js
    queries = page.explorer.queries
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(queries, "splits", {})
        page.open()
        assert page.browser.run("return document.getElementById('free').open")
        assert page.browser.run("return document.getElementById('next').disabled")


def test_frames_without_queries_open_at_a_point_of_the_object(
    page: Page, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The first two sequences, as each has one frame; swapped, the point is the same one."""
    monkeypatch.setattr(Dataset, "splits_with_queries", lambda dataset: [])
    monkeypatch.setattr(page.explorer, "queries", RecordedQueries(page.explorer.dataset))
    listed = catalogue(page.explorer.dataset, page.explorer.queries, page.explorer.methods)
    for sequence in listed["sequences"]:
        sequence[4] = 1
    monkeypatch.setattr("pliant.viewer.explorer.app.catalogue", lambda *_: listed)
    page.open()
    page.answered()
    ids = [each.id for each in page.explorer.dataset.sequences]
    assert page.link().startswith(f"#a={ids[0]}/0&b={ids[1]}/0&")
    frames = [page.explorer.dataset.sequence(each)[0] for each in ids[:2]]
    assert all(frame.mask is not None for frame in frames)
    u, v = page.place()
    assert frames[0].mask[int(v), int(u)]  # type: ignore[index]
    true_px = [float(each) for each in page.cell(0, 2).split(",")]
    page.browser.keys("x")
    page.browser.wait(f"location.hash.startsWith('#a={ids[1]}') && location.hash.includes('&u=')")
    assert page.place() == pytest.approx(true_px, abs=0.51)
