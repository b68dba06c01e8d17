"""Record the animation of README.md: a pointer moves along a rope in the explorer.

    python docs/record_explorer.py docs/pictures/explorer.webp

It starts `pliant explore sample don-rope sift` and drives a headless Chromium (chromium and
chromedriver of the system, Selenium), which points at places along the rope one after the other.
"""

from __future__ import annotations

import io
import shutil
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import numpy.typing as npt
from PIL import Image
from selenium import webdriver
from selenium.webdriver.support.wait import WebDriverWait

import pliant

SIZE, STEPS, PAUSE_MS, PAIR = (1000, 700), 26, 220, 0


def main() -> None:
    """Record one pair of the sample."""
    places = path_along(PAIR)
    command = [Path(sys.executable).with_name("pliant"), "explore", "sample", "don-rope", "sift"]
    server = subprocess.Popen(
        [*map(str, command), "--no-browser"], stdout=subprocess.PIPE, text=True
    )
    assert server.stdout is not None
    try:
        address = next(line.split()[0] for line in server.stdout if line.startswith("http"))
        frames = record(address, places)
    finally:
        server.terminate()
    frames[0].save(
        sys.argv[1],
        save_all=True,
        append_images=frames[1:],
        duration=PAUSE_MS,
        loop=0,
        quality=60,
        method=6,
    )


def path_along(pair: int) -> npt.NDArray[np.float64]:
    """Return places along the rope's centre line in the source of a pair, float64 (N, 2), px."""
    source = pliant.load("sample").pairs("test")[pair].source
    points = source.sequence.points()
    line = np.array([kind == "centreline" for kind in points["kind"].to_pylist()])
    table = source.correspondences
    seen = np.array([state == "visible" for state in table["visibility"].to_pylist()]) & line
    uv = np.stack([table["u_px"].to_numpy(), table["v_px"].to_numpy()], axis=1)[seen]
    return uv[np.linspace(2, len(uv) - 3, STEPS).round().astype(int)].astype(np.float64)


def record(address: str, places: npt.NDArray[np.float64]) -> list[Image.Image]:
    """Return what the page shows while the pointer is at each place."""
    options = webdriver.ChromeOptions()
    options.binary_location = shutil.which("chromium") or "chromium"
    for argument in ("headless=new", "no-sandbox", "disable-gpu", "disable-dev-shm-usage"):
        options.add_argument(f"--{argument}")
    driver = webdriver.Chrome(options, webdriver.ChromeService(shutil.which("chromedriver")))
    try:
        metrics = {"width": SIZE[0], "height": SIZE[1], "deviceScaleFactor": 1, "mobile": False}
        driver.execute_cdp_cmd("Emulation.setDeviceMetricsOverride", metrics)
        driver.get(address)
        wait = WebDriverWait(driver, 120, 0.1)
        wait.until(lambda _: driver.execute_script(_LOADED))
        driver.execute_script(_CHOOSE, PAIR)
        wait.until(lambda _: driver.execute_script(_SHOWN))
        frames = []
        for u, v in places:
            driver.execute_script(_POINT, float(u), float(v))
            time.sleep(0.3)  # the page marks as busy what it waits for
            wait.until(lambda _: driver.execute_script(_ANSWERED))
            frames.append(Image.open(io.BytesIO(driver.get_screenshot_as_png())).convert("RGB"))
        return frames
    finally:
        driver.quit()


_LOADED = "return document.body.dataset.ready === 'yes'"
_SHOWN = "return document.querySelector('#picture-a img').naturalWidth > 0"
_ANSWERED = "return !document.querySelector('tr.busy')"
_CHOOSE = """
const rows = [...document.querySelectorAll("#pairs li")];
const tests = rows.filter(row => row.textContent.includes("-test-"));
(tests[arguments[0]].querySelector("button") ?? tests[arguments[0]]).click();
document.getElementById("layout").firstElementChild.hidden = true;
document.getElementById("layout").style.display = "block";
"""
_POINT = """
const frame = document.querySelector("#picture-a .frame"), box = frame.getBoundingClientRect();
const image = frame.querySelector("img");
frame.dispatchEvent(new PointerEvent("pointermove", {
  bubbles: true, pointerType: "mouse",
  clientX: box.left + arguments[0] / image.naturalWidth * box.width,
  clientY: box.top + arguments[1] / image.naturalHeight * box.height,
}));
"""


if __name__ == "__main__":
    main()
