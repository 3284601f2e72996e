"""The page in a real browser: six clicks make a metric, oriented rig."""

import re
import shutil
import subprocess
import sys
import time

import numpy as np
import pytest

from passerby.cli.main import run
from passerby.interchange.rig_toml import read_rig
from passerby.page.work import Work

playwright = pytest.importorskip("playwright.sync_api", reason="no playwright: install the extra dev")

CHROMIUM = next(filter(None, map(shutil.which, ("chromium", "chromium-browser", "google-chrome", "chrome"))), None)
pytestmark = pytest.mark.skipif(CHROMIUM is None, reason="no Chromium: install the package chromium")

PATIENCE_S = 240
"""A busy machine calibrates slowly; this only bounds a test that fails."""
CLICK_SD_PX = 2.0
SCALE, HEADING_DEG = 0.008, 0.8
"""What six such clicks must reach."""


@pytest.fixture(scope="session")
def browser():
    with playwright.sync_playwright() as running:
        browser = running.chromium.launch(executable_path=CHROMIUM, args=["--no-sandbox"], timeout=1000 * PATIENCE_S)
        yield browser
        browser.close()


@pytest.fixture
def calibrated_scene(tmp_path):
    """A scene of boxes and its calibration, which knows the scale by people's heights only."""
    scene, out = tmp_path / "scene", tmp_path / "out"
    options = ["--people", "6", "--seconds", "20", "--box-noise", "0.02", "--seed", "5", "--person-height-mean-m", "1.80"]
    assert run(["simulate", "-o", str(scene), *options]) == 0
    text = (scene / "scene.toml").read_text()
    # The people are said to be of usual height, so that something is left to be marked.
    text = re.sub(r"(?m)^person_height.*\n", "", text)
    (scene / "scene.toml").write_text(text)
    assert run(["calibrate", str(scene / "scene.toml"), "-o", str(out), "--no-report"]) in (0, 3)
    return scene, out


@pytest.fixture
def address(calibrated_scene):
    """Of the page, served by the program itself."""
    command = [sys.executable, "-m", "passerby", "open", str(calibrated_scene[1]), "--no-browser"]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as server:
        found = next(filter(None, (re.search(r"http://127.0.0.1:\d+/\S+", line) for line in server.stdout)))
        yield found.group()
        server.terminate()


class Hand:
    """Somebody at the page, with an unsteady hand."""

    def __init__(self, browser, address, seed):
        self.page = browser.new_context(viewport={"width": 1300, "height": 900}).new_page()
        self.page.set_default_timeout(1000 * PATIENCE_S)
        self.errors, self.asked = [], []
        # Scenes of boxes have no pictures, and the browser says so of each.
        told = lambda one: (
            self.errors.append(one.text) if one.type == "error" and "/picture" not in one.location["url"] else None
        )  # noqa: E731
        self.page.on("console", told)
        self.page.on("pageerror", lambda error: self.errors.append(str(error)))
        self.page.on("request", lambda one: self.asked.append(one.url))
        self.rng, self.clicks = np.random.default_rng(seed), 0
        self.page.goto(address)
        self.until("() => document.querySelectorAll('.layer[viewBox]').length === 4")

    def until(self, condition):
        """Wait until a function holds; the page's policy forbids the browser's waiting functions."""
        end = time.monotonic() + PATIENCE_S
        while not self.page.evaluate(condition):
            assert time.monotonic() < end, f"never: {condition}"
            self.page.wait_for_timeout(50)

    def click(self, camera, point):
        """Click on a point of the world in a camera's picture."""
        stage = self.page.locator(f"article[aria-label='Camera {camera.name}'] .stage")
        stage.scroll_into_view_if_needed()
        box, (width, height) = stage.bounding_box(), camera.lens.size
        u, v = camera.project(point)[0] + self.rng.normal(scale=CLICK_SD_PX, size=2) + 0.5
        stage.click(position={"x": u * box["width"] / width, "y": v * box["height"] / height})
        self.clicks += 1

    def save(self, label):
        """Press a button, and wait until the server has acknowledged."""
        with self.page.expect_response("**/api/act") as answer:
            self.page.get_by_role("button", name=label).click()
        assert answer.value.status == 200


def test_six_clicks_make_a_metric_and_oriented_rig(browser, address, calibrated_scene):
    scene, out = calibrated_scene
    truth = read_rig(scene / "truth.toml")
    middle = np.mean([camera.centre for camera in truth], axis=0) * [1, 1, 0]
    ends = middle + np.array([[-2.0, -2.5, 0.0], [2.0, 2.5, 0.0]])
    one, other = truth.names[0], truth.names[1]
    hand = Hand(browser, address, 0)

    hand.page.click("[data-tool=length]")
    for name in (one, other):
        for end in ends:
            hand.click(truth[name], end)
    hand.until("() => document.getElementById('measured').textContent.includes('residual')")
    hand.page.get_by_label("Length in metres").fill(f"{np.linalg.norm(ends[1] - ends[0]):.3f}")
    hand.save("Save the length")
    hand.page.click("[data-tool=world]")
    for end in ends:
        hand.click(truth[one], end)
    hand.until("() => document.getElementById('tool').textContent.includes('runs through')")
    hand.save("Save the world frame")
    assert hand.clicks == 6

    hand.page.get_by_role("button", name="Solve again").click()
    hand.until("() => document.getElementById('run-state').textContent === 'finished'")
    hand.until("() => document.querySelector('#result table thead').textContent.includes('moved m')")
    assert Work(out).status()["state"] == "done"

    scale, heading, origin = against(truth, ends, read_rig(out / "rig.toml"))
    assert abs(scale - 1) < SCALE
    assert abs(heading) < HEADING_DEG
    assert np.linalg.norm(origin) < 0.15
    assert hand.errors == []
    assert all(url.startswith(address.partition("?")[0]) for url in hand.asked)


def against(truth, ends, found):
    """Scale (found over true), heading error in degrees and error of the origin, by the places of the cameras."""
    along = (ends[1] - ends[0])[:2] / np.linalg.norm(ends[1] - ends[0])
    turn = np.array([[along[0], along[1]], [-along[1], along[0]]])
    names = [name for name in truth.names if found[name].pose is not None]
    right = np.array([turn @ (truth[name].centre - ends[0])[:2] for name in names])
    ours = np.array([found[name].centre[:2] for name in names])
    a, b = right - right.mean(axis=0), ours - ours.mean(axis=0)
    angle = np.degrees(np.arctan2((a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]).sum(), (a * b).sum()))
    return float(np.sqrt((b**2).sum() / (a**2).sum())), float(angle), ours.mean(axis=0) - right.mean(axis=0)
