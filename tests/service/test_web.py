"""The pages in a real browser: a team's path and the host's, dark, 400 px, no console error."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

pytest.importorskip("selenium")

from selenium.webdriver.common.by import By
from selenium.webdriver.support.wait import WebDriverWait

from tests.browser import Browser
from tests.service.conftest import Halves, MakeTrial
from tests.service.server import Server, serving


class Page:
    """What a person does in a browser.

    Args:
        browser: The browser.
        server: The service.
    """

    def __init__(self, browser: Browser, server: Server) -> None:
        self.browser, self.server = browser, server

    def go(self, path: str) -> str:
        self.browser.open(self.server.address + path)
        return self.text()

    def text(self) -> str:
        return str(self.browser.run("return document.body.innerText"))

    def fill(self, name: str, value: str) -> None:
        place = (By.CSS_SELECTOR, f"main [name={name}]")
        waiting = WebDriverWait(self.browser.driver, 60)  # the driver may return before the page
        waiting.until(lambda driver: driver.find_element(*place)).send_keys(value)

    def sign_in(self, token: str) -> None:
        self.browser.open(self.server.address + "/login")
        self.browser.driver.delete_all_cookies()
        self.go("/login")
        self.fill("token", token)
        self.browser.follow("main button.main")


RULES = f"""
rules: |
  Name `{"a" * 99}` and https://example.org/{"b" * 99}

  | {" | ".join(f"column-{k}" for k in range(20))} |
  |{"---|" * 20}
"""


@contextmanager
def scripts_disabled(browser: Browser) -> Iterator[None]:
    """Let the pages run no JavaScript."""
    command = "Emulation.setScriptExecutionDisabled"
    browser.driver.execute_cdp_cmd(command, {"value": True})
    try:
        yield
    finally:
        browser.driver.execute_cdp_cmd(command, {"value": False})


TEAM = "Knots of a team that takes as many words for its name as a name may have here"


@pytest.mark.parametrize(
    ("width", "dark"), [pytest.param(1200, False, marks=pytest.mark.long), (400, True)]
)
def test_a_host_and_a_team(
    make_trial: MakeTrial,
    service_halves: Halves,
    browser: Browser,
    tmp_path: Path,
    width: int,
    dark: bool,
) -> None:
    trial = make_trial(RULES)
    with serving(trial.challenge.root, tmp_path / "log", "--workers", "1") as server:
        page = Page(browser, server)
        browser.size(1200, 900)
        page.sign_in(trial.host)
        page.fill("name", TEAM)
        browser.follow("form[action='/admin/invite'] button")
        browser.wait("document.getElementById('token')")
        token = str(browser.run("return document.getElementById('token').textContent"))
        assert token.startswith("pliant_")
        assert token not in page.go("/admin")
        twice = browser.run(
            "const form = document.querySelector('form[action=\"/admin/token\"]');"
            "const send = () => new Event('submit', { bubbles: true, cancelable: true });"
            "return [form.dispatchEvent(send()), form.dispatchEvent(send())];"
        )
        assert twice == [True, False]  # the second click of a double one

        page.sign_in(token)
        page.go("/submit")
        page.fill("file", str(service_halves.submissions[0]))
        browser.follow("main button.main")
        browser.wait("location.pathname === '/submissions/1'")
        browser.wait("document.querySelector('.state.scored')")
        assert "RMSE" in page.text()
        assert "Receipt" in page.text()
        with scripts_disabled(browser):
            submit_without_scripts(page, browser, server.address, token, service_halves.bad)
        assert "4 attempts left today, 99 in all" in page.go("/submit")
        assert TEAM in page.go("/")
        wide = "return document.querySelector('#board tbody th').clientWidth"
        assert browser.run(wide) >= 140  # px; not one word per line
        page.go("/submissions/2")
        lines = "return document.querySelector('.issues code').getClientRects().length"
        assert browser.run(lines) == 1

        page.sign_in(trial.host)
        page.go("/submissions")
        table = "document.querySelector('.scroll')"
        assert browser.run(f"return {table}.scrollWidth - {table}.clientWidth") == 0
        page.go("/admin")
        browser.follow("tr:last-child form[action='/admin/credit'] button")
        browser.wait("document.body.innerText.includes('test: 5 today, 100 in all')")
        page.fill("reason", "the figures of the paper")
        browser.run("document.querySelector('select[name=protocol]').value = 'paper'")
        browser.follow("form[action='/admin/rescore'] button")
        browser.wait("document.body.innerText.includes('1 submission waits')")
        trial.wait_until_idle(30)
        assert page.go("/submissions/1").count("truth 1") == 2
        browser.run(  # as if it were not scored yet, and the service gone
            "window.fetch = () => Promise.reject(); live.dataset.state = 'x';"
            "document.head.append(Object.assign(document.createElement('script'),"
            " { src: '/static/service.js' }));"
        )
        browser.wait("position.textContent === 'the service does not answer; this page asks again'")
        assert "rescored" in page.go("/admin/audit")
        look_at_every_page(page, width, dark)
        assert browser.errors() == []
        assert server.stop() == 0


def submit_without_scripts(
    page: Page, browser: Browser, address: str, token: str, file: Path
) -> None:
    """Sign in, look at the scored submission, and send a file that is refused."""
    browser.driver.delete_all_cookies()
    browser.driver.get(address + "/login")
    page.fill("token", token)
    browser.follow("main button.main")
    browser.driver.get(address + "/submissions/1")
    WebDriverWait(browser.driver, 60).until(
        lambda driver: (
            driver.find_elements(By.CSS_SELECTOR, ".state.scored")
            and "Receipt" in driver.page_source
        )
    )
    browser.driver.get(address + "/submit")
    page.fill("file", str(file))
    browser.follow("main button.main")
    WebDriverWait(browser.driver, 60).until(lambda driver: "FILE_UNREADABLE" in driver.page_source)
    assert browser.driver.find_elements(By.CSS_SELECTOR, ".state.refused")


def look_at_every_page(page: Page, width: int, dark: bool) -> None:
    """Every page fits its window, can be used by keyboard, and is readable in the dark."""
    paths = ("/", "/rules", "/data", "/submit", "/submissions", "/submissions/1", "/submissions/2",
             "/teams/2", "/admin", "/admin/audit")  # fmt: skip
    page.browser.size(width, 800, dark=dark)
    for path in paths:
        page.go(path)
        overflow = page.browser.run(
            "return document.documentElement.scrollWidth - document.documentElement.clientWidth"
        )
        assert overflow <= 0, (path, width)
        ratio = page.browser.run(_CONTRAST)
        assert ratio >= 4.5, (path, width, dark, ratio)
        unnamed = page.browser.run(
            "return [...document.querySelectorAll('input:not([type=hidden]), select')]"
            ".filter(e => !e.labels?.length && !e.ariaLabel).map(e => e.name)"
        )
        assert unnamed == [], path


_CONTRAST = """
const known = new Map();
const light = css => {
  if (!known.has(css)) known.set(css, painted(css));
  return known.get(css);
};
const painted = css => {
  const c = document.createElement("canvas").getContext("2d");
  c.fillStyle = css; c.fillRect(0, 0, 1, 1);
  const [r, g, b] = [...c.getImageData(0, 0, 1, 1).data].map(v => v / 255)
    .map(v => v <= 0.04045 ? v / 12.92 : ((v + 0.055) / 1.055) ** 2.4);
  return 0.2126 * r + 0.7152 * g + 0.0722 * b;
};
const back = element => {
  for (let e = element; e; e = e.parentElement) {
    const css = getComputedStyle(e).backgroundColor;
    if (!css.endsWith(", 0)") && css !== "transparent") return css;
  }
  return "white";
};
let least = 21;
for (const e of document.querySelectorAll("main *, nav *")) {
  if (![...e.childNodes].some(n => n.nodeType === 3 && n.textContent.trim())) continue;
  if (!e.checkVisibility() || e.disabled || e.tagName === "OPTION") continue;
  const [a, b] = [light(getComputedStyle(e).color), light(back(e))].sort((x, y) => y - x);
  least = Math.min(least, (a + 0.05) / (b + 0.05));
}
return least;
"""
