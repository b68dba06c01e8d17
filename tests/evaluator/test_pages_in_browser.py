"""Reports and leaderboards in a real browser: what a reader can do with them."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from pliant.cli.main import run
from pliant.evaluator import evaluate, write_report
from pliant.evaluator.report import charts
from pliant.evaluator.report.charts import Labels
from pliant.models.training.run_page import Section, write_run_page
from tests.browser import Browser

pytestmark = pytest.mark.slow

PAGES = ("reports/far/report.html", "board.html", "run/report.html")
BOX = {"p5": 1.0, "p25": 2.0, "p50": 3.0, "p75": 4.0, "p95": 5.0}
CHARTS = [
    charts.line_chart({"loss": ([0, 100], [5.0, np.nan])}, Labels('"Loss" & <b>', "step")),
    charts.cdf_chart({"a & <b>": ([1, 2, 4], [0.1, 0.5, 1.0]), "c": ([1, 4], [0.2, 0.9])}),
    charts.histogram_chart({"a": [0.2, 0.8]}, [0, 1, 2], Labels("t", "x", "y")),
    charts.box_chart({"a": BOX, "b": BOX}),
    charts.reliability_chart({"a": {"confidence": [0.5], "frequency": [0.4]}}, radius_px=8),
    charts.sparsification_chart(
        {"a": {"removed": [0, 0.5], "rmse_px": [4, 3], "best_rmse_px": [4, 1]}}
    ),
    charts.interval_chart({"a": (-1.0, 0.5, 2.0), "b": (0.5, 1.0, 2.0)}, title="t", x="x"),
]
VISIBLE = "[...document.querySelectorAll('figure.example')].filter(f => !f.hidden)"


@pytest.fixture(scope="module")
def pages(scene_maker: Any, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A report and a leaderboard of four, on a cloth and a rope tier."""
    folder = tmp_path_factory.mktemp("pages")
    scene = scene_maker(folder / "data", sequences=6, frames=2, queries=16)
    middle = np.zeros_like(scene.true_px)
    for pair in np.unique(scene.pair):
        middle[scene.pair == pair] = scene.true_px[scene.pair == pair].mean(axis=0)
    rng = np.random.default_rng(0)
    facts = {"date": "2026-11-01", "author": "R. Eader", "code": "https://example.org/near"}
    for name, uv, extra in (
        ("near", scene.true_px + rng.normal(0, 3, middle.shape), facts),
        ("far", scene.true_px + rng.normal(0, 70, middle.shape), {"link": "javascript:alert(1)"}),
        ("centroid", middle, {}),
    ):
        path = scene.submit(
            folder / f"{name}.parquet", scene.table(uv), method={"name": name, **extra}
        )
        scores = evaluate(path, scene.root)
        write_report(scores, folder / "reports" / name, data=scene.root)
    reports = str(folder / "reports")
    assert run(["leaderboard", reports, "--out", str(folder / "board.html")]) == 0
    (folder / "run").mkdir()
    table = [["method", "RMSE"], ["a long name of a method", "3.25"]]
    sections = [Section("Curves", charts=CHARTS), Section("Scores", table=table)]
    write_run_page(folder / "run", {"steps": 100, "commit": None}, sections)
    return folder


def opened(browser: Browser, page: Path, width: int = 1200, *, dark: bool = False) -> None:
    browser.size(width, 900, dark=dark)
    browser.open(page.as_uri())


def report(pages: Path) -> Path:
    return pages / "reports" / "far" / "report.html"


@pytest.mark.parametrize("name", PAGES)
@pytest.mark.parametrize(
    ("width", "dark"), [pytest.param(1200, False, marks=pytest.mark.long), (400, True)]
)
def test_a_page_fits_reports_no_error_and_asks_for_nothing(
    browser: Browser, pages: Path, name: str, width: int, dark: bool
) -> None:
    browser.errors(), browser.requests()
    opened(browser, pages / name, width, dark=dark)
    undrawn = "document.querySelectorAll('[data-chart]:not([data-drawn])').length"
    browser.wait(f"{undrawn} === 0")
    assert browser.run("return document.querySelectorAll('[data-chart] svg').length") >= 1
    assert browser.run("return document.documentElement.scrollWidth") <= width
    paper = browser.run("return getComputedStyle(document.body).backgroundColor")
    assert paper == ("rgb(22, 25, 28)" if dark else "rgb(255, 255, 255)")
    assert browser.errors() == []
    assert {url.split(":")[0] for url in browser.requests()} <= {"file", "data"}


@pytest.mark.parametrize("width", [400, 1200])
def test_a_long_name_of_a_method_leaves_room_for_the_figures(
    browser: Browser, pages: Path, width: int
) -> None:
    page = pages / "long.html"
    long = "near, by a method with a name that " + 20 * "goes on and " + "ends"
    page.write_text(re.sub(r"\bnear\b", long, (pages / "board.html").read_text()))
    opened(browser, page, width)
    browser.wait("document.querySelectorAll('[data-chart]:not([data-drawn])').length === 0")
    left = "getBoundingClientRect().left"
    assert browser.run(f"return document.querySelector('#board td').{left}") < 0.5 * width
    cut = f"f.querySelector('.role-title text').{left} < f.{left} - 1"
    charts = "[...document.querySelectorAll('[data-chart]')]"
    assert not browser.run(f"return {charts}.some(f => {cut})")


def test_a_chart_tells_its_values_and_has_the_ink_of_the_page(
    browser: Browser, pages: Path
) -> None:
    opened(browser, pages / "run" / "report.html", dark=True)
    browser.wait("document.querySelectorAll('[data-drawn]').length === 7")
    box = browser.run(
        "const e = document.querySelectorAll('[data-chart]')[3].querySelector('.mark-rect path');"
        "e.scrollIntoView({block: 'center'}); const b = e.getBoundingClientRect();"
        "return [b.x + b.width / 2, b.y + b.height / 2]"
    )
    alone = "document.querySelector('[data-chart] .mark-symbol path')"  # no line leads to it
    assert browser.run(f"return {alone}.getAttribute('opacity')") != "0"
    browser.hover(*box)
    browser.wait("!document.querySelector('.tip').hidden")
    text = browser.run("return document.querySelector('.tip').innerText")
    assert text.split("\n")[:2] == ["name a", "p5 1"]
    browser.hover(5, 5)
    browser.wait("document.querySelector('.tip').hidden")
    label = "document.querySelector('[data-chart] .role-axis-label text')"
    assert browser.run(f"return getComputedStyle({label}).fill") == "rgb(226, 230, 234)"
    texts = browser.run("return document.querySelectorAll('[data-chart]')[0].textContent")
    assert '"Loss" & <b>' in texts


def test_the_theme_can_be_switched_and_stays(browser: Browser, pages: Path) -> None:
    opened(browser, report(pages))
    browser.run("document.getElementById('theme').click()")
    paper = "return getComputedStyle(document.body).backgroundColor"
    assert browser.run(paper) == "rgb(22, 25, 28)"
    browser.open(report(pages).as_uri())
    assert browser.run(paper) == "rgb(22, 25, 28)"
    browser.run("document.getElementById('theme').click(); localStorage.clear()")
    assert browser.run(paper) == "rgb(255, 255, 255)"


def test_paper_shows_what_the_page_folds(browser: Browser, pages: Path) -> None:
    opened(browser, report(pages))
    hidden = "[...document.querySelectorAll('details > :not(summary, pre)')].filter(each =>"
    hidden += " !each.checkVisibility({contentVisibilityProperty: true})).length"
    assert browser.run(f"return {hidden}") > 0
    browser.driver.execute_cdp_cmd("Emulation.setEmulatedMedia", {"media": "print"})
    assert browser.run(f"return {hidden}") == 0
    browser.driver.execute_cdp_cmd("Emulation.setEmulatedMedia", {"media": ""})


def choose(browser: Browser, field: str, value: str) -> None:
    browser.run(
        "const e = document.getElementById(arguments[0]); e.value = arguments[1];"
        "e.dispatchEvent(new Event('input', {bubbles: true}))",
        field,
        value,
    )


def test_pairs_are_filtered_and_sorted(browser: Browser, pages: Path) -> None:
    opened(browser, report(pages))
    assert browser.run(f"return {VISIBLE}.length") == 12
    errors = f"return {VISIBLE}.map(f => Number(f.dataset.rmse))"
    down = browser.run(errors)
    assert down == sorted(down, reverse=True)
    choose(browser, "order", "rmse")
    assert browser.run(errors) == down[::-1]
    choose(browser, "tier", "rope")
    assert set(browser.run(f"return {VISIBLE}.map(f => f.dataset.tier)")) == {"rope"}
    assert browser.run("return document.getElementById('count').textContent") == "6 of 12 pairs"
    rows = "[...document.querySelectorAll('section tbody tr[data-tier]')]"
    assert browser.run(f"return {rows}.filter(r => !r.hidden).map(r => r.dataset.tier)") == ["rope"]
    choose(browser, "tier", "")
    causes = browser.run(f"return {VISIBLE}.map(f => f.dataset.cause)")
    choose(browser, "cause", "off_object")
    kept = browser.run(f"return {VISIBLE}.map(f => f.dataset.cause)")
    assert len(kept) == causes.count("off_object") > 0
    choose(browser, "find", "nothing of this name")
    assert browser.run(f"return {VISIBLE}.length") == 0


def test_a_point_under_the_pointer_tells_its_figures(browser: Browser, pages: Path) -> None:
    opened(browser, report(pages))
    browser.run("document.querySelector('figure.example').scrollIntoView({block: 'center'})")
    point, at = browser.run(
        "const f = document.querySelector('figure.example'), svg = f.querySelector('svg.pair');"
        "const point = JSON.parse(f.dataset.points)[3];"
        "const at = new DOMPoint(point[2] + Number(svg.dataset.left), point[3])"
        ".matrixTransform(svg.getScreenCTM());"
        "return [point, [at.x, at.y]]"
    )
    browser.hover(*at)
    browser.wait("!document.getElementById('tip').hidden")
    text = browser.run("return document.getElementById('tip').innerText")
    assert f"Truth ({point[2]:.1f}, {point[3]:.1f})" in text
    assert f"Answer ({point[4]:.1f}, {point[5]:.1f})" in text
    assert f"Error {point[6]:.1f} px" in text
    error = np.hypot(point[4] - point[2], point[5] - point[3])
    assert point[6] == pytest.approx(error, abs=0.15)
    assert browser.run("return document.querySelectorAll('svg.marked .on').length") == 2
    browser.hover(5, 5)
    browser.wait("document.getElementById('tip').hidden")


def test_every_line_of_a_chart_has_its_full_contrast(browser: Browser, tmp_path: Path) -> None:
    """Dashes of 1 px are blurred into a paler line."""
    series = {name: ([0, 1, 2], [2.0, 1.0, k]) for k, name in enumerate("abcdef")}
    section = Section("Curves", charts=[charts.line_chart(series, Labels("t", "x"))])
    write_run_page(tmp_path, {}, [section])
    opened(browser, tmp_path / "report.html")
    browser.wait("document.querySelectorAll('[data-chart]:not([data-drawn])').length === 0")
    dashes = browser.run(
        "return [...document.querySelectorAll('.mark-line path')].map(line => "
        "(line.getAttribute('stroke-dasharray') ?? '').split(',').map(Number))"
    )
    assert len(dashes) == 6
    assert all(min(each[::2]) >= 2 for each in dashes if len(each) > 1 and each[1] > 0)
    assert len({tuple(each) for each in dashes}) == 5


def test_a_pair_is_enlarged_on_a_phone(browser: Browser, pages: Path) -> None:
    opened(browser, report(pages), 390)
    browser.run("document.querySelector('figure.example').click()")
    browser.wait("document.getElementById('large').open")
    wide = "document.querySelector('#large svg.pair').getBoundingClientRect().width"
    assert browser.run(f"return {wide}") > 700
    assert browser.run("return document.documentElement.scrollWidth") <= 390


def test_a_pair_is_enlarged_by_click_and_key(browser: Browser, pages: Path) -> None:
    opened(browser, report(pages))
    first = "document.querySelector('figure.example')"
    small = browser.run(f"{first}.scrollIntoView({{block: 'center'}}); return {first}.clientWidth")
    box = browser.run(f"const b = {first}.getBoundingClientRect(); return [b.x + 20, b.y + 20]")
    browser.click(*box)
    browser.wait("document.getElementById('large').open")
    wide = browser.run("return document.querySelector('#large svg.pair').clientWidth")
    assert wide > 1.8 * small
    browser.keys("\ue00c")  # Escape
    browser.wait("!document.getElementById('large').open")
    browser.run(f"{first}.focus()")
    browser.keys("\ue007")  # Enter
    browser.wait("document.getElementById('large').open")
    browser.run("document.getElementById('large').close()")


def test_a_leaderboard_sorts_methods_and_keeps_controls_apart(
    browser: Browser, pages: Path
) -> None:
    opened(browser, pages / "board.html")
    rows = "[...document.querySelector('#board').tBodies[0].rows]"
    names = f"return {rows}.map(r => r.cells[0].innerText)"
    assert browser.run(names) == ["near", "far"]
    browser.run("document.querySelectorAll('#board button.sort')[0].click()")
    assert browser.run(names) == ["far", "near"]
    after = "getComputedStyle(document.querySelector('#board button.sort'), '::after').content"
    assert browser.run(f"return {after}") == '" ▲"'  # arrows say which way is better
    text = browser.run("return document.querySelector('#controls').innerText")
    assert "Controls, not ranked" in text
    assert "centroid" in text
    body = browser.run("return document.body.innerText")
    assert "near (" in body.split("beats answering with the middle of the object")[0]
    assert "R. Eader" in body
    links = browser.run("return [...document.querySelectorAll('#board a')].map(a => a.href)")
    assert links == ["https://example.org/near"]
