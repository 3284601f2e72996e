"""Photographs the local page for the documentation, into `docs/figures`.

    passerby demo -o demo
    python docs/make_page_pictures.py demo/out              # all of them
    python docs/make_page_pictures.py demo/out plan         # those of a plan: of a copy, which is calibrated again

Needs the extras `dev` and `page`, and a Chromium of the machine's package manager. The demonstration's people are drawn, so the
pictures show nobody. Nothing is saved in the scene file. The monitored rig is that of the demonstration, see `watch_scene.py`.
"""

from __future__ import annotations

import re
import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray
from playwright.sync_api import Page, sync_playwright
from watch_scene import MOVE, monitor_turned

from passerby.core.cameras import Rig
from passerby.interchange.rig_toml import read_rig

FOLDER = Path(__file__).resolve().parent / "figures"
BROWSERS = ("chromium", "chromium-browser", "google-chrome", "chrome")
JPEG_QUALITY = 80
SIZE = {"width": 1180, "height": 860}
LOADED = """() => { const all = [...document.querySelectorAll('.stage img')];
    return all.length > 0 && all.every((one) => one.complete && one.naturalWidth); }"""
UNIT, MARGIN_M = 0.02, 1.5
"""Of the plan: metres per pixel, and metres around the cameras."""
CLICKED = (0.5, 0.7)
"""Of the first picture's width and height: on the ground."""
NAMED = 3
"""The box of the first picture that is pointed at: a person that all cameras see."""
WIPED = (
    f"""() => document.querySelectorAll("article[aria-label='Camera {MOVE.camera}'] .wipe img:not([hidden])").length === 2"""
)


def main(out: Path, parts: list[str]) -> None:
    """Make the pictures from the output folder of a calibration with videos."""
    for name, photograph in PARTS.items():
        if not parts or name in parts:
            photograph(out)


@contextmanager
def _opened(*opened: str, loaded: str = LOADED) -> Iterator[Page]:
    """The page of `passerby open` with these arguments, once its pictures are there."""
    browser = next(filter(None, map(shutil.which, BROWSERS)), None)
    if browser is None:
        sys.exit("no Chromium: install the package chromium")
    command = [sys.executable, "-m", "passerby", "open", *opened, "--no-browser"]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as server:
        assert server.stdout is not None
        address = next(filter(None, (re.search(r"http://\S+", line) for line in server.stdout))).group()
        try:
            with sync_playwright() as running:
                page = running.chromium.launch(executable_path=browser, args=["--no-sandbox"]).new_page(
                    viewport=SIZE, color_scheme="light"
                )
                page.goto(address)
                _until(page, loaded)
                yield page
        finally:
            server.terminate()


def photograph_marks(out: Path) -> None:
    """The page as it opens, and a length that is being marked."""
    with _opened(str(out)) as page:
        _keep(page, "page.jpg")
        page.click("[data-tool=length]")
        stage = page.locator(".stage").first
        page.locator("#cameras").evaluate("(one) => one.scrollIntoView()")
        box = stage.bounding_box()
        assert box is not None
        stage.click(position={"x": CLICKED[0] * box["width"], "y": CLICKED[1] * box["height"]})
        _until(page, "() => document.querySelectorAll('.epipolar').length > 1")
        _keep(page, "page-length.jpg")


def photograph_person(out: Path) -> None:
    """A person of the first picture, pointed at."""
    with _opened(str(out)) as page:
        page.click("[data-tool=person]")
        _until(page, "() => document.querySelectorAll('.stage .box').length > 3")
        page.locator("#cameras").evaluate("(one) => one.scrollIntoView()")
        stage = page.locator(".stage").first
        box, person = stage.bounding_box(), stage.locator(".box").nth(NAMED).bounding_box()
        assert box is not None
        assert person is not None
        stage.click(
            position={"x": person["x"] - box["x"] + person["width"] / 2, "y": person["y"] - box["y"] + person["height"] / 2}
        )
        _until(page, "() => document.querySelectorAll('.crop').length > 1")
        _keep(page, "page-person.jpg")


def photograph_watch(out: Path) -> None:
    """A monitored rig one of whose cameras was turned."""
    with tempfile.TemporaryDirectory() as folder, _opened(str(monitor_turned(out, Path(folder))), loaded=WIPED) as page:
        page.locator(f"article[aria-label='Camera {MOVE.camera}']").evaluate("(one) => one.scrollIntoView({block: 'center'})")
        _keep(page, "page-watch.jpg")


def photograph_plan(out: Path) -> None:
    """A plan with two cameras on it, and the rig from above once it was calibrated again."""
    with tempfile.TemporaryDirectory() as temporary:
        folder = Path(temporary) / "demo"
        shutil.copytree(out.parent, folder)
        scene, truth = folder / "scene" / "scene.toml", read_rig(folder / "scene" / "truth.toml")
        copy = str(scene), "--out", str(folder / "out")
        plan = _draw_plan(truth)
        cv2.imwrite(str(folder / "plan.png"), plan)
        with _opened(*copy) as page:
            page.set_input_files("#plan-file", str(folder / "plan.png"))
            page.get_by_label("Metres per pixel").fill(str(UNIT))
            page.keyboard.press("Tab")
            page.locator("#plan-place .toolbar").get_by_role("button", name="Place a camera").click()
            for name in truth.names[:3:2]:
                page.get_by_label("Camera to be placed").select_option(name)
                _click_plan(page, _on_plan(truth, truth[name].centre), plan.shape)
            _until(page, "() => document.querySelectorAll('#plan-place .plan-seen').length === 4")
            page.locator("#plan-place .toolbar").evaluate("(one) => one.scrollIntoView()")
            _keep(page, "page-plan.jpg")
            page.get_by_role("button", name="Save the plan").click()
            _until(page, "() => !document.getElementById('undo').disabled")
        command = [sys.executable, "-m", "passerby", "calibrate", str(scene), "-o", str(folder / "out")]
        subprocess.run(command, check=True, stdout=subprocess.DEVNULL)
        with _opened(*copy) as page:
            _until(page, "() => Boolean(document.querySelector('#plan-view image'))")
            page.locator("#plan").evaluate("(one) => one.scrollIntoView()")
            _keep(page, "page-above.jpg")


def _draw_plan(truth: Rig) -> NDArray[np.uint8]:
    """A floor plan of the terrace between its cameras: walls, a door, and a paved middle."""
    low, high = _corners(truth)
    width, height = np.ceil((high - low) / UNIT).astype(int).tolist()
    picture = np.full((height, width, 3), 252, np.uint8)
    wall = int(0.25 / UNIT)
    inner = int((MARGIN_M - 0.6) / UNIT)
    cv2.rectangle(picture, (inner, inner), (width - inner, height - inner), (60, 60, 60), wall)
    cv2.rectangle(
        picture, (width // 2 - 60, height - inner - wall), (width // 2 + 60, height - inner + wall), (252, 252, 252), -1
    )
    paved = (width // 4, height // 4), (3 * width // 4, 3 * height // 4)
    cv2.rectangle(picture, *paved, (222, 230, 226), -1)
    return picture


def _corners(truth: Rig) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Of the plan, metres of the true world."""
    centres = np.array([camera.centre[:2] for camera in truth])
    return centres.min(axis=0) - MARGIN_M, centres.max(axis=0) + MARGIN_M


def _on_plan(truth: Rig, place: NDArray[np.float64]) -> NDArray[np.float64]:
    """The plan's pixel of a place."""
    low, high = _corners(truth)
    return np.array([place[0] - low[0], high[1] - place[1]]) / UNIT - 0.5


def _click_plan(page: Page, at: NDArray[np.float64], shape: tuple[int, ...]) -> None:
    """Click a pixel of the plan that is shown as a whole."""
    stage = page.locator("#plan-place .plan-stage")
    stage.scroll_into_view_if_needed()
    box = stage.bounding_box()
    assert box is not None
    sides, whole = np.array([box["width"], box["height"]]), np.array(shape[1::-1])
    x, y = sides / 2 + (at + 0.5 - whole / 2) * (sides / whole).min()
    stage.click(position={"x": float(x), "y": float(y)})


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


PARTS = {
    "marks": photograph_marks,
    "person": photograph_person,
    "plan": photograph_plan,
    "watch": photograph_watch,
}

if __name__ == "__main__":
    main(Path(sys.argv[1]), sys.argv[2:])
