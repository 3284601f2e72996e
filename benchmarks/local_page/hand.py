"""Somebody at the page in a real browser, with an unsteady hand."""

from __future__ import annotations

import shutil
import time
from collections.abc import Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING

import numpy as np

from local_page.serving import TIMEOUT_S
from passerby.common.arrays import Floats
from passerby.core.cameras import Camera

if TYPE_CHECKING:
    from playwright.sync_api import Browser, ConsoleMessage, Page

BROWSERS = ("chromium", "chromium-browser", "google-chrome", "chrome")
SIZE = {"width": 1300, "height": 900}


@contextmanager
def chromium() -> Iterator[Browser]:
    """The browser of the machine. Raises `RuntimeError` where it has none."""
    path = next(filter(None, map(shutil.which, BROWSERS)), None)
    if path is None:
        raise RuntimeError("no Chromium: install the package chromium")
    from playwright.sync_api import sync_playwright  # other pages of results are made where it is not installed

    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=path, args=["--no-sandbox"])
        yield browser
        browser.close()


class Hand:
    """Clicks with noise, and what the browser complained about meanwhile."""

    def __init__(self, page: Page, rng: np.random.Generator, noise_px: float) -> None:
        self.page, self.clicks = page, 0
        self.errors: list[str] = []
        self.asked: list[str] = []
        self._rng, self._noise_px = rng, noise_px
        page.set_default_timeout(1000 * TIMEOUT_S)
        page.on("console", self._hear)
        page.on("pageerror", lambda error: self.errors.append(str(error)))
        page.on("request", lambda request: self.asked.append(request.url))

    def _hear(self, said: ConsoleMessage) -> None:
        if said.type == "error":
            self.errors.append(said.text)

    def until(self, condition: str) -> None:
        """Wait until a JavaScript function holds; the page's policy forbids the browser's own waiting functions."""
        end = time.monotonic() + TIMEOUT_S
        while not self.page.evaluate(condition):
            if time.monotonic() > end:
                raise TimeoutError(condition)
            self.page.wait_for_timeout(20)

    def click(self, camera: Camera, point: Floats) -> None:
        """Click where a camera sees a point (3,) of the world, give or take."""
        stage = self.page.locator(f"article[aria-label='Camera {camera.name}'] .stage")
        stage.scroll_into_view_if_needed()
        box, (width, height) = stage.bounding_box(), camera.lens.size
        assert box is not None
        u, v = camera.project(point[None])[0] + self._rng.normal(scale=self._noise_px, size=2) + 0.5
        stage.click(position={"x": u * box["width"] / width, "y": v * box["height"] / height})
        self.clicks += 1

    def save(self, label: str) -> None:
        """Press a button of the tool, and wait until the act is acknowledged."""
        with self.page.expect_response("**/api/act") as answer:
            self.page.get_by_role("button", name=label).click()
        if answer.value.status != 200:
            raise RuntimeError(f"{label}: {answer.value.text()}")
