"""A plan in a real browser: uploaded, its scale clicked, cameras and a point placed, saved, and the rig solved upon it."""

import json
import re
import xml.etree.ElementTree as ET

import cv2
import numpy as np
import pytest

from passerby.interchange.rig_toml import read_rig
from passerby.scene.scene import Scene
from support.browser import CHROMIUM

from .conftest import UNIT, DrawnPlan, middle
from .test_page_browser import CLICK_SD_PX, Hand

pytest.importorskip("playwright.sync_api", reason="no playwright: install the extra dev")

pytestmark = [pytest.mark.system, pytest.mark.skipif(CHROMIUM is None, reason="no Chromium: install the package chromium")]

WIDTH_SEEN = "Number(document.querySelector('#plan-place .plan-layer').getAttribute('viewBox').split(' ')[2])"
CLICKED_PX = 5.0
"""Of the plan: three pixels of the screen, on which its largest side has some 600. A wrong click is 150 off."""
FITTED = "() => document.querySelector('#plan-place').textContent.includes('lengths change by')"
"""Whether the server has tried what is placed."""
PLACED_M = 0.25
"""Of each camera on the plan after the calibration: six sigmas of a click of 2 px, and what people leave."""


class Placer(Hand):
    """Somebody who places a plan."""

    def __init__(self, browser, address, folder):
        super().__init__(browser, address)
        self.address = address
        self.plan = DrawnPlan(read_rig(folder / "scene" / "truth.toml"))
        self.path = folder / "Haus <b>.png"
        self.path.write_bytes(self.plan.png)

    def upload(self, metres_per_pixel=None):
        """Choose the plan, and wait until it is shown; give its scale."""
        self.page.set_input_files("#plan-file", str(self.path))
        self.until("() => Boolean(document.querySelector('#plan-place .plan-layer image'))")
        if metres_per_pixel:
            self.page.get_by_label("Metres per pixel").fill(str(metres_per_pixel))
            self.page.keyboard.press("Tab")

    def place(self, *names):
        """Click cameras where they are."""
        self.choose("Place a camera")
        for name in names:
            self.page.get_by_label("Camera to be placed").select_option(name)
            self.click_plan(self.plan.pixel(self.plan.truth[name].centre))

    def choose(self, label):
        """Press one of the buttons above the plan."""
        self.page.locator("#plan-place .toolbar").get_by_role("button", name=label).click()

    def click_plan(self, at):
        """Click a pixel of the plan that is shown as a whole."""
        stage = self.page.locator("#plan-place .plan-stage")
        stage.scroll_into_view_if_needed()
        box, size = stage.bounding_box(), self.plan.size
        scale = min(box["width"] / size[0], box["height"] / size[1])
        x, y = (
            side / 2 + (value + 0.5 - whole / 2) * scale
            for side, value, whole in zip((box["width"], box["height"]), at, size, strict=True)
        )
        stage.click(position={"x": x, "y": y})

    def text(self, selector):
        """What the page says there."""
        return self.page.locator(selector).text_content()


@pytest.fixture
def placer(browser, served, folder):
    """Fails at the end where the page said something was wrong."""
    placer = Placer(browser, served(folder / "scene" / "scene.toml", "--out", folder / "out"), folder)
    yield placer
    assert placer.errors == []
    placer.page.context.close()


def test_a_plan_is_placed_by_clicks_and_the_rig_is_solved_upon_it(placer, folder):
    plan, truth, scene = placer.plan, placer.plan.truth, folder / "scene" / "scene.toml"
    placer.upload()
    assert "Haus <b>.png" in placer.text("#plan-place")
    long = plan.size[0] - 100.0
    placer.click_plan([50, 50])
    placer.click_plan([50 + long, 50])
    placer.page.get_by_label("Metres between the two clicks").fill(f"{long * UNIT:.3f}")
    placer.page.keyboard.press("Tab")
    placer.place("C1", "C3")
    placer.until(FITTED)
    assert len(placer.page.locator("#plan-place .plan-seen").all()) == 4, "all cameras are shown before it is saved"
    placer.choose("Place a point")
    spot = middle(truth)
    placer.click_plan(plan.pixel(spot))
    assert placer.page.get_by_role("button", name="Save the plan").is_disabled()
    for name in ("C1", "C2"):
        placer.click(truth[name], spot)
    placer.until("() => document.querySelector('#plan-place').textContent.includes('C2, 0.')")
    placer.save("Save the plan")

    saved = Scene.load(scene).world.plan
    assert set(saved.cameras) == {"C1", "C3"}
    assert set(saved.points[0].pixels) == {"C1", "C2"}
    assert saved.distance.metres == pytest.approx(long * UNIT, abs=1e-3)
    assert (scene.parent / saved.image).read_bytes() == plan.png
    placer.page.get_by_role("button", name="Solve again").click()
    placer.until("() => document.getElementById('run-state').textContent === 'finished'")
    placer.until("() => Boolean(document.querySelector('#plan-view .plan-layer image'))")
    corner = plan.corner - (0, plan.size[1] * UNIT)
    for camera in read_rig(folder / "out" / "rig.toml"):
        assert np.linalg.norm(camera.centre[:2] - (truth[camera.name].centre[:2] - corner)) < PLACED_M
    assert all(url.startswith((placer.address.partition("?")[0], "blob:")) for url in placer.asked)


def test_a_saved_plan_is_changed_undone_and_removed(placer, folder):
    scene = folder / "scene" / "scene.toml"
    before = scene.read_bytes()
    placer.upload(UNIT)
    placer.place("C1", "C2", "C3")
    placer.save("Save the plan")
    placer.until(FITTED)
    placer.page.reload()
    placer.until("() => Boolean(document.querySelector('#plan-place .plan-layer image'))")
    placer.until(FITTED)
    placer.page.get_by_role("button", name="Remove camera C2 from the plan").click()
    placer.save("Save the plan")
    assert set(Scene.load(scene).world.plan.cameras) == {"C1", "C3"}
    placer.page.get_by_role("button", name="Undo").click()
    placer.until("() => document.querySelector('#plan-place').textContent.includes('Camera C2 at')")
    placer.until(FITTED)
    assert set(Scene.load(scene).world.plan.cameras) == {"C1", "C2", "C3"}
    placer.save("Remove the plan")
    assert Scene.load(scene).world is None
    placer.until("() => document.querySelector('#plan-place .plan-stage').getClientRects().length === 0")
    placer.save("Undo")
    placer.until(FITTED)
    placer.save("Undo")
    assert scene.read_bytes() == before


def test_points_alone_are_enough_and_a_wrong_one_is_changed(placer, folder):
    plan, truth, scene = placer.plan, placer.plan.truth, folder / "scene" / "scene.toml"
    right = [middle(truth) + [-1.5, -2.0, 0], middle(truth) + [1.5, 2.0, 0]]
    placer.upload(UNIT)
    placer.choose("Place a point")
    for number, spot in enumerate(right):
        placer.click_plan(plan.pixel(spot + [0, 3.0 * number, 0]))  # the second one is clicked 3 m off
        placer.click(truth["C1"], spot)
        placer.page.get_by_role("button", name="Next point").click()
    placer.until(FITTED)
    placer.page.get_by_role("button", name="Change point 2").click()
    placer.click_plan(plan.pixel(right[1]))
    placer.click(truth["C2"], right[1])
    placer.save("Save the plan")
    first, second = Scene.load(scene).world.plan.points
    assert np.linalg.norm(np.subtract(first.at, plan.pixel(right[0]))) < CLICKED_PX
    assert np.linalg.norm(np.subtract(second.at, plan.pixel(right[1]))) < CLICKED_PX
    assert (set(first.pixels), set(second.pixels)) == ({"C1"}, {"C1", "C2"})
    for name, at in second.pixels.items():
        assert np.linalg.norm(np.subtract(at, truth[name].project(right[1])[0])) < 5 * CLICK_SD_PX


def test_the_plan_is_zoomed_moved_and_used_without_a_mouse_and_the_view_is_saved(placer, folder, tmp_path):
    """A drag is no click; fingers and the wheel zoom; the view is saved as PNG, SVG and GeoJSON."""
    placer.until("() => document.querySelectorAll('#plan-view .plan-camera').length === 4")
    found = {}
    for role, label in (("button", "PNG"), ("link", "SVG"), ("link", "GeoJSON")):
        with placer.page.expect_download() as download:
            placer.page.get_by_role(role, name=f"Save as {label}", exact=True).click()
        found[label] = tmp_path / download.value.suggested_filename
        download.value.save_as(found[label])
    root = ET.parse(found["SVG"]).getroot()
    picture = cv2.imread(str(found["PNG"]))
    assert picture.shape[:2] == tuple(round(float(root.get(key))) for key in ("height", "width"))
    assert (picture == 255).mean() < 0.99, "something is drawn"
    assert len(json.loads(found["GeoJSON"].read_text())["features"]) >= 8

    placer.upload()
    stage = placer.page.locator("#plan-place .plan-stage")

    def middle_of_stage():
        stage.scroll_into_view_if_needed()
        box = stage.bounding_box()
        return box["x"] + box["width"] / 2, box["y"] + box["height"] / 2

    def seen():
        return [float(one) for one in placer.page.locator("#plan-place .plan-layer").get_attribute("viewBox").split()]

    whole, (x, y) = seen(), middle_of_stage()
    stage.focus()
    placer.page.mouse.move(x, y)
    placer.page.mouse.wheel(0, -100)
    placer.until(f"() => {WIDTH_SEEN} < {whole[2] - 1}")
    placer.page.locator("#plan-place").get_by_role("button", name="Zoom in").click()
    near = seen()
    assert near[2] == pytest.approx(whole[2] / 1.2 / 1.5)
    x, y = middle_of_stage()
    placer.page.mouse.move(x, y)
    placer.page.mouse.down()
    placer.page.mouse.move(x + 40, y + 20, steps=4)
    placer.page.mouse.up()
    assert seen()[0] < near[0]
    assert seen()[2] == near[2]
    assert "Camera C1 at" not in placer.text("#plan-place"), "a drag is no click"
    placer.page.locator("#plan-place").get_by_role("button", name="Show the whole drawing").click()
    assert seen() == whole
    fingers, (x, y) = placer.page.context.new_cdp_session(placer.page), middle_of_stage()
    for kind, apart in (("touchStart", 40), ("touchMove", 60), ("touchMove", 80), ("touchEnd", None)):
        points = [] if apart is None else [{"x": x - apart, "y": y, "id": 0}, {"x": x + apart, "y": y, "id": 1}]
        fingers.send("Input.dispatchTouchEvent", {"type": kind, "touchPoints": points})
    placer.until(f"() => {WIDTH_SEEN} < {0.6 * whole[2]}")
    placer.page.locator("#plan-place").get_by_role("button", name="Show the whole drawing").click()

    placer.choose("Place a camera")
    stage.focus()
    for key in ("+", "ArrowRight", "Shift+ArrowUp", "Enter"):
        placer.page.keyboard.press(key)
    placer.until("() => document.querySelector('#plan-place').textContent.includes('Camera C1 at')")
    at = [int(one) for one in re.search(r"Camera C1 at (\d+), (\d+)", placer.text("#plan-place")).groups()]
    centre = np.array(placer.plan.size) / 2
    assert centre[0] < at[0] < centre[0] + 60
    assert centre[1] - 10 < at[1] <= centre[1]


def test_a_file_that_is_no_plan_is_refused_with_a_sentence(placer, folder):
    for name, content, said in (
        ("notes.png", b"no picture", "neither a PNG nor a JPEG"), ("huge.png", b"\0" * 25_000_001, "may have 25 MB"),
    ):  # fmt: skip
        (folder / name).write_bytes(content)
        placer.page.set_input_files("#plan-file", str(folder / name))
        placer.until(f"() => document.getElementById('message').textContent.includes('{said}')")
    assert all("422" in one for one in placer.errors)
    placer.errors.clear()
