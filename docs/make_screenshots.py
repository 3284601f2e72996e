"""Photographs a report for the documentation, into `docs/figures`.

    passerby demo -o demo
    passerby demo --no-intrinsics -o unknown
    passerby simulate --preset basketball --cameras 64 --seconds 20 -o hall
    passerby calibrate hall/scene.toml -o hall/out
    python docs/make_screenshots.py demo/out unknown/out hall/out

Needs the extra `dev` (playwright) and a Chromium of the machine's package manager. The demonstration's people are drawn, so the
pictures show nobody.
"""

from __future__ import annotations

import shutil
import sys
import tempfile
from pathlib import Path

import cv2
import numpy as np
from playwright.sync_api import Page, sync_playwright

from passerby.report.contents import contents_from
from passerby.report.page import write_report

FOLDER = Path(__file__).resolve().parent / "figures"
BROWSERS = ("chromium", "chromium-browser", "google-chrome", "chrome")
FLAGS = ["--no-sandbox", "--use-angle=swiftshader", "--enable-unsafe-swiftshader"]
JPEG_QUALITY = 82


def main(out: Path, without_intrinsics: Path, site: Path) -> None:
    """Make the pictures from the output folders of two calibrations with videos, and of one with many cameras."""
    browser = next(filter(None, map(shutil.which, BROWSERS)), None)
    if browser is None:
        sys.exit("no Chromium: install the package chromium")
    with tempfile.TemporaryDirectory() as folder, sync_playwright() as running:
        page = running.chromium.launch(executable_path=browser, args=FLAGS).new_page(
            viewport={"width": 1180, "height": 900}, color_scheme="light"
        )
        _open(page, out, Path(folder) / "report.html")
        _keep(page, {"x": 0, "y": 0, "width": 1180, "height": 775}, "report.jpg")
        _keep(page, {"x": 0, "y": _top(page, "views", out), "width": 1180, "height": 735}, "report-view.jpg")
        _open(page, without_intrinsics, Path(folder) / "without.html")
        page.locator("#lenses details").evaluate("(one) => { one.open = true; }")
        top, end = _top(page, "lenses", without_intrinsics), _top(page, "rig", without_intrinsics)
        _keep(page, {"x": 0, "y": top, "width": 1180, "height": end - top}, "report-lenses.jpg")
        _keep_site(page, site, Path(folder) / "site.html")


def _keep_site(page: Page, out: Path, path: Path) -> None:
    """Photograph the list and the map of a report of many cameras."""
    write_report(contents_from(out), path)
    page.goto(path.as_uri())
    page.locator("#rig").scroll_into_view_if_needed()
    page.locator("#rig-above[data-names]").wait_for()
    page.evaluate("scrollTo({ top: 0, behavior: 'instant' })")
    page.wait_for_timeout(1000)
    top = _top(page, "cameras", out)
    _keep(page, {"x": 0, "y": top, "width": 1180, "height": _top(page, "rig", out) + 930 - top}, "report-site.jpg")


def _open(page: Page, out: Path, path: Path) -> None:
    """Show the report of an output folder, written to `path`."""
    write_report(contents_from(out), path)
    page.goto(path.as_uri())
    page.wait_for_function("document.querySelectorAll('.js-plotly-plot').length > 3")
    page.wait_for_timeout(3000)


def _top(page: Page, section: str, out: Path) -> float:
    """Where a section begins on the page, pixels."""
    box = page.locator(f"#{section}").bounding_box()
    if box is None:
        sys.exit(f"{out}: its report has no section {section}: a calibration of videos is needed, once without intrinsics")
    return box["y"] - 10


def _keep(page: Page, clip: dict[str, float], name: str) -> None:
    """Photograph a part of the whole page."""
    raw = page.screenshot(full_page=True, clip=clip)  # type: ignore[arg-type]
    picture = cv2.imdecode(np.frombuffer(raw, dtype=np.uint8), cv2.IMREAD_COLOR)
    cv2.imwrite(str(FOLDER / name), picture, [cv2.IMWRITE_JPEG_QUALITY, JPEG_QUALITY])
    print(f"written: {FOLDER / name}")


if __name__ == "__main__":
    main(Path(sys.argv[1]), Path(sys.argv[2]), Path(sys.argv[3]))
