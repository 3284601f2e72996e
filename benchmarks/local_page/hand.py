"""Somebody at the page in a real browser, with an unsteady hand."""

from __future__ import annotations

import shutil
import time
from collections.abc import Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any

import numpy as np
from axe_playwright_python.sync_playwright import Axe

from local_page.serving import TIMEOUT_S
from passerby.calibration.alignment.lengths import measure_length
from passerby.common.arrays import Floats
from passerby.core.cameras import Camera, Rig
from passerby.page.geometry import measure_axis

ENDS_M = ((-2.0, -2.5, 0.0), (2.0, 2.5, 0.0))
"""Of the length, from the middle of the cameras, on the ground: both are in all pictures of the terrace."""


def ends_of(truth: Rig) -> Floats:
    """(2, 3) the two points of the world that are clicked."""
    middle = np.mean([camera.centre for camera in truth], axis=0) * [1, 1, 0]
    return np.asarray(middle + np.array(ENDS_M))


def best_views(rig: Rig, truth: Rig, ends: Floats) -> tuple[tuple[str, str], str]:
    """The two pictures for a length and the one for an axis with the smallest sigmas that the page states."""
    names = [camera.name for camera in rig.posed()]
    pairs = [(one, two) for one in names for two in names if one < two]

    def sigma(pair: tuple[str, str]) -> float:
        return measure_length(rig, {name: truth[name].project(ends) for name in pair}).sigma_m

    def heading(name: str) -> float:
        return measure_axis(rig, [(name, (float(u), float(v))) for u, v in truth[name].project(ends)]).heading_sigma_deg

    return min(pairs, key=sigma), min(names, key=heading)


def against(truth: Rig, ends: Floats, found: Rig) -> tuple[float, float]:
    """Scale (found over true, less one) and heading error in degrees, by the positions of the cameras.

    The world's origin is the first end, and its x axis runs through the second.
    """
    along = (ends[1] - ends[0])[:2] / np.linalg.norm(ends[1] - ends[0])
    turn = np.array([[along[0], along[1]], [-along[1], along[0]]])
    names = [camera.name for camera in found.posed()]
    right = np.array([turn @ (truth[name].centre - ends[0])[:2] for name in names])
    ours = np.array([found[name].centre[:2] for name in names])
    a, b = right - right.mean(axis=0), ours - ours.mean(axis=0)
    angle = np.degrees(np.arctan2((a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]).sum(), (a * b).sum()))
    return float(np.sqrt((b**2).sum() / (a**2).sum()) - 1), float(angle)


def access_faults(page: Any) -> list[str]:
    """The serious and critical violations in a Playwright page as it stands, each as "rule: elements"."""
    found = Axe().run(page).response["violations"]
    return [
        f"{one['id']}: {', '.join(' '.join(node['target']) for node in one['nodes'])}"
        for one in found
        if one["impact"] in ("serious", "critical")
    ]


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
