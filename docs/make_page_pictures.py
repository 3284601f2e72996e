"""Photographs the local page for the documentation, into `docs/figures`.

    passerby demo -o demo
    python docs/make_page_pictures.py demo/out

Needs the extras `dev` and `page`, and a Chromium of the machine's package manager. The demonstration's people are drawn, so the
pictures show nobody. Nothing is saved in the scene file.
"""

from __future__ import annotations

import re
import shutil
import subprocess
import sys
import time
from pathlib import Path

import cv2
import numpy as np
from playwright.sync_api import Page, sync_playwright

FOLDER = Path(__file__).resolve().parent / "figures"
BROWSERS = ("chromium", "chromium-browser", "google-chrome", "chrome")
JPEG_QUALITY = 80
SIZE = {"width": 1180, "height": 860}
LOADED = """() => { const all = [...document.querySelectorAll('.stage img')];
    return all.length > 0 && all.every((one) => one.complete && one.naturalWidth); }"""
CLICKED = (0.5, 0.7)
"""Of the first picture's width and height: on the ground."""


def main(out: Path) -> None:
    """Make the pictures from the output folder of a calibration with videos."""
    browser = next(filter(None, map(shutil.which, BROWSERS)), None)
    if browser is None:
        sys.exit("no Chromium: install the package chromium")
    command = [sys.executable, "-m", "passerby", "open", str(out), "--no-browser"]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as server:
        assert server.stdout is not None
        address = next(filter(None, (re.search(r"http://\S+", line) for line in server.stdout))).group()
        try:
            with sync_playwright() as running:
                page = running.chromium.launch(executable_path=browser, args=["--no-sandbox"]).new_page(
                    viewport=SIZE, color_scheme="light"
                )
                page.goto(address)
                _until(page, LOADED)
                _keep(page, "page.jpg")
                page.click("[data-tool=length]")
                stage = page.locator(".stage").first
                page.locator("#cameras").evaluate("(one) => one.scrollIntoView()")
                box = stage.bounding_box()
                assert box is not None
                stage.click(position={"x": CLICKED[0] * box["width"], "y": CLICKED[1] * box["height"]})
                _until(page, "() => document.querySelectorAll('.epipolar').length > 1")
                _keep(page, "page-length.jpg")
        finally:
            server.terminate()


def _until(page: Page, condition: str) -> None:
    """Wait until a function holds; the page's policy forbids the browser's waiting functions."""
    end = time.monotonic() + 60
    while not page.evaluate(condition):
        if time.monotonic() > end:
            sys.exit(f"the page never came so far: {condition}")
        page.wait_for_timeout(100)
    page.wait_for_timeout(1500)


def _keep(page: Page, name: str) -> None:
    """Write what the window shows as JPEG."""
    picture = cv2.imdecode(np.frombuffer(page.screenshot(), np.uint8), cv2.IMREAD_COLOR)
    cv2.imwrite(str(FOLDER / name), picture, [cv2.IMWRITE_JPEG_QUALITY, JPEG_QUALITY])
    print(f"written: docs/figures/{name}")


if __name__ == "__main__":
    main(Path(sys.argv[1]))
