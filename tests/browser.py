"""A headless Chromium for tests, by Selenium.

The programs are the system's `chromium` and `chromedriver` (.ci/system-packages.txt).
"""

from __future__ import annotations

import json
import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any, Literal

from selenium import webdriver
from selenium.common.exceptions import JavascriptException, WebDriverException
from selenium.webdriver.common.actions.action_builder import ActionBuilder
from selenium.webdriver.common.actions.pointer_input import PointerInput
from selenium.webdriver.common.by import By
from selenium.webdriver.common.keys import Keys
from selenium.webdriver.support.expected_conditions import staleness_of
from selenium.webdriver.support.ui import WebDriverWait

CHROMIUM, DRIVER = shutil.which("chromium"), shutil.which("chromedriver")


class Browser:
    """One window of a browser.

    Args:
        driver: The session.
    """

    def __init__(self, driver: webdriver.Chrome) -> None:
        self.driver = driver

    def open(self, address: str) -> None:
        """Go to a page, and wait for all of it: on a busy machine the driver may return before."""
        self.driver.get(address)
        self.wait("true")

    def run(self, script: str, *arguments: Any) -> Any:
        """Run JavaScript in the page and return its value."""
        return self.driver.execute_script(script, *arguments)

    def wait(self, script: str, seconds: float = 60) -> None:
        """Wait until an expression is true in a page that is loaded, which may be the next one."""
        waiting = WebDriverWait(self.driver, seconds, 0.05, [JavascriptException])
        loaded = f"return document.readyState === 'complete' && !!({script})"
        waiting.until(lambda _: self.run(loaded), f"never true: {script}")

    def follow(self, selector: str, seconds: float = 60) -> None:
        """Press what leads to another page, and wait for that page; needs no scripts."""
        page = self.driver.find_element(By.TAG_NAME, "html")
        self.driver.find_element(By.CSS_SELECTOR, selector).click()
        # While a page goes, the driver may fail to find its node in another way than as stale.
        waiting = WebDriverWait(self.driver, seconds, 0.05, [WebDriverException])
        waiting.until(staleness_of(page), f"no page: {selector}")

    def click(self, x: float, y: float) -> None:
        """Press and release the mouse at a place of the window, CSS pixels."""
        self._point(x, y, press=True)

    def hover(self, x: float, y: float) -> None:
        """Move the mouse to a place of the window, CSS pixels."""
        self._point(x, y, press=False)

    def touch(self, x: float, y: float) -> None:
        """Tap a place of the window with a finger, CSS pixels."""
        self._point(x, y, press=True, kind="touch")

    def keys(self, *keys: str) -> None:
        """Press keys together, then release them."""
        actions = webdriver.ActionChains(self.driver, duration=0)
        for key in keys:
            actions.key_down(key)
        for key in reversed(keys):
            actions.key_up(key)
        actions.perform()

    def size(self, width: int, height: int, *, dark: bool = False) -> None:
        """Set the size of the page and the colour scheme that it is asked for."""
        metrics = {"width": width, "height": height, "deviceScaleFactor": 1, "mobile": False}
        scheme = {"name": "prefers-color-scheme", "value": "dark" if dark else "light"}
        self.driver.execute_cdp_cmd("Emulation.setDeviceMetricsOverride", metrics)
        self.driver.execute_cdp_cmd("Emulation.setEmulatedMedia", {"features": [scheme]})

    def errors(self) -> list[str]:
        """Return what the console has reported as errors since the last call."""
        entries = self.driver.get_log("browser")
        return [entry["message"] for entry in entries if entry["level"] == "SEVERE"]

    def requests(self) -> list[str]:
        """Return the addresses that the browser has asked for since the last call."""
        entries = self.driver.get_log("performance")
        events = (json.loads(entry["message"])["message"] for entry in entries)
        return [
            event["params"]["request"]["url"]
            for event in events
            if event["method"] == "Network.requestWillBeSent"
        ]

    def _point(
        self, x: float, y: float, *, press: bool, kind: Literal["mouse", "touch"] = "mouse"
    ) -> None:
        actions = ActionBuilder(self.driver, mouse=PointerInput(kind, kind), duration=0)
        actions.pointer_action.move_to_location(round(x), round(y))
        if press:
            actions.pointer_action.pointer_down().pointer_up()
        actions.perform()


@contextmanager
def chromium() -> Iterator[Browser]:
    """Start a browser, and end it."""
    assert CHROMIUM is not None
    options = webdriver.ChromeOptions()
    options.binary_location = CHROMIUM
    for argument in ("headless=new", "no-sandbox", "disable-gpu", "disable-dev-shm-usage"):
        options.add_argument(f"--{argument}")
    options.set_capability("goog:loggingPrefs", {"browser": "ALL", "performance": "ALL"})
    driver = webdriver.Chrome(options, webdriver.ChromeService(DRIVER))
    try:
        yield Browser(driver)
    finally:
        driver.quit()


__all__ = ["CHROMIUM", "DRIVER", "Browser", "Keys", "chromium"]
