"""A headless Chromium for tests, by the WebDriver protocol and nothing but the standard library.

The programs are the system's `chromium` and `chromedriver` (.ci/system-packages.txt).
"""

from __future__ import annotations

import base64
import json
import re
import shutil
import subprocess
import tempfile
import time
import urllib.error
import urllib.request
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

CHROMIUM, DRIVER = shutil.which("chromium"), shutil.which("chromedriver")


class Browser:
    """One window of a browser.

    Args:
        session: Address of the WebDriver session.
    """

    def __init__(self, session: str) -> None:
        self._session = session

    def open(self, address: str) -> None:
        """Go to a page."""
        _call("POST", f"{self._session}/url", {"url": address})

    def run(self, script: str, *arguments: Any) -> Any:
        """Run JavaScript in the page and return its value."""
        body = {"script": script, "args": list(arguments)}
        return _call("POST", f"{self._session}/execute/sync", body)

    def wait(self, script: str, seconds: float = 60) -> None:
        """Wait until an expression is true in the page."""
        end = time.monotonic() + seconds
        while not self.run(f"return !!({script})"):
            assert time.monotonic() < end, f"never true: {script}"
            time.sleep(0.05)

    def click(self, x: float, y: float) -> None:
        """Press and release the mouse at a place of the window, CSS pixels."""
        place = {"type": "pointerMove", "duration": 0, "x": round(x), "y": round(y)}
        press = [{"type": kind, "button": 0} for kind in ("pointerDown", "pointerUp")]
        self._act({"type": "pointer", "id": "mouse", "actions": [place, *press]})

    def keys(self, *keys: str) -> None:
        """Press keys together, then release them."""
        down = [{"type": "keyDown", "value": key} for key in keys]
        up = [{"type": "keyUp", "value": key} for key in reversed(keys)]
        self._act({"type": "key", "id": "keyboard", "actions": [*down, *up]})

    def size(self, width: int, height: int, *, dark: bool = False) -> None:
        """Set the size of the page and the colour scheme that it is asked for."""
        metrics = {"width": width, "height": height, "deviceScaleFactor": 1, "mobile": False}
        scheme = {"name": "prefers-color-scheme", "value": "dark" if dark else "light"}
        for command, given in (
            ("Emulation.setDeviceMetricsOverride", metrics),
            ("Emulation.setEmulatedMedia", {"features": [scheme]}),
        ):
            body = {"cmd": command, "params": given}
            _call("POST", f"{self._session}/goog/cdp/execute", body)

    def hover(self, x: float, y: float) -> None:
        """Move the mouse to a place of the window, CSS pixels."""
        place = {"type": "pointerMove", "duration": 0, "x": round(x), "y": round(y)}
        self._act({"type": "pointer", "id": "mouse", "actions": [place]})

    def touch(self, x: float, y: float) -> None:
        """Tap a place of the window with a finger, CSS pixels."""
        place = {"type": "pointerMove", "duration": 0, "x": round(x), "y": round(y)}
        press = [{"type": kind, "button": 0} for kind in ("pointerDown", "pointerUp")]
        kind = {"pointerType": "touch"}
        self._act(
            {"type": "pointer", "id": "finger", "parameters": kind, "actions": [place, *press]}
        )

    def errors(self) -> list[str]:
        """Return what the console has reported as errors since the last call."""
        return [entry["message"] for entry in self._log("browser") if entry["level"] == "SEVERE"]

    def requests(self) -> list[str]:
        """Return the addresses that the browser has asked for since the last call."""
        events = (json.loads(entry["message"])["message"] for entry in self._log("performance"))
        return [
            event["params"]["request"]["url"]
            for event in events
            if event["method"] == "Network.requestWillBeSent"
        ]

    def _log(self, kind: str) -> list[dict[str, Any]]:
        entries: list[dict[str, Any]] = _call("POST", f"{self._session}/se/log", {"type": kind})
        return entries

    def screenshot(self, out: Path) -> None:
        """Write what the window shows as a PNG."""
        out.write_bytes(base64.b64decode(_call("GET", f"{self._session}/screenshot")))

    def _act(self, source: dict[str, Any]) -> None:
        _call("POST", f"{self._session}/actions", {"actions": [source]})


@contextmanager
def chromium() -> Iterator[Browser]:
    """Start a browser, and end it."""
    assert CHROMIUM is not None
    with tempfile.TemporaryDirectory() as profile, _driver() as root:
        arguments = ["--headless=new", "--no-sandbox", "--disable-gpu", "--disable-dev-shm-usage"]
        options = {"binary": CHROMIUM, "args": [*arguments, f"--user-data-dir={profile}"]}
        logs = {"browser": "ALL", "performance": "ALL"}
        always = {"goog:chromeOptions": options, "goog:loggingPrefs": logs}
        wanted = {"capabilities": {"alwaysMatch": always}}
        session = f"{root}/{_call('POST', root, wanted)['sessionId']}"
        try:
            yield Browser(session)
        finally:
            with suppress(OSError):
                _call("DELETE", session)


@contextmanager
def _driver() -> Iterator[str]:
    """Start chromedriver on a free port; yield the address of its sessions."""
    assert DRIVER is not None
    with subprocess.Popen([DRIVER, "--port=0"], stdout=subprocess.PIPE, text=True) as driver:
        try:
            assert driver.stdout is not None
            lines = (re.search(r"successfully on port (\d+)", line) for line in driver.stdout)
            port = next(found[1] for found in lines if found)
            yield f"http://127.0.0.1:{port}/session"
        finally:
            driver.terminate()


def _call(method: str, address: str, body: dict[str, Any] | None = None) -> Any:
    data = None if method == "GET" else json.dumps(body or {}).encode()
    headers = {"Content-Type": "application/json"}
    request = urllib.request.Request(address, data, headers, method=method)
    try:
        with urllib.request.urlopen(request, timeout=120) as answer:
            return json.load(answer)["value"]
    except urllib.error.HTTPError as error:
        with error:
            raise AssertionError(json.load(error)["value"]["message"]) from None
