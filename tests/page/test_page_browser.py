"""The page in a real browser: six clicks make a metric, oriented rig; marks, faults and findings stand beside their camera."""

import time
import tomllib

import numpy as np
import pytest

from passerby.calibration.alignment.lengths import measure_length
from passerby.geometry.rotations import exp_rotation
from passerby.interchange.rig_toml import read_rig
from passerby.page.geometry import ground_point, measure_axis
from passerby.page.work import Work
from support.accessibility import access_faults
from support.browser import CHROMIUM

from .conftest import listen, middle

pytest.importorskip("playwright.sync_api", reason="no playwright: install the extra dev")

pytestmark = [pytest.mark.system, pytest.mark.skipif(CHROMIUM is None, reason="no Chromium: install the package chromium")]

PATIENCE_S = 240
"""A busy machine calibrates slowly; this only bounds a test that fails."""
CLICK_SD_PX = 2.0
MEDIAN_SCALE, MEDIAN_HEADING_DEG, HANDS = 0.008, 0.8, 10
"""What six such clicks must reach, the median of so many hands."""
SIGMAS = 3.0
"""Of one hand: within so many of the sigmas that the page itself states."""


@pytest.fixture
def address(folder, served):
    """Of the page of the calibrated scene."""
    return served(folder / "scene" / "scene.toml", "--out", folder / "out")


class Hand:
    """Somebody at the page, with an unsteady hand."""

    def __init__(self, browser, address):
        self.page = browser.new_context(viewport={"width": 1300, "height": 900}).new_page()
        self.page.set_default_timeout(1000 * PATIENCE_S)
        self.errors, self.asked = listen(self.page), []
        self.page.on("request", lambda one: self.asked.append(one.url))
        self.rng, self.clicks = np.random.default_rng(0), 0
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


def test_the_median_of_ten_hands(folder):
    """The rig that six clicks make, without solving again: scaled by the length, laid along the axis."""
    scene, out = folder / "scene", folder / "out"
    truth, rig = read_rig(scene / "truth.toml"), read_rig(out / "rig.toml")
    ends = middle(truth) + np.array([[-2.0, -2.5, 0.0], [2.0, 2.5, 0.0]])
    pair, axis_camera = best_views(rig, truth, ends)
    scales, headings = [], []
    for seed in range(HANDS):
        rng = np.random.default_rng(seed)
        clicks = {name: truth[name].project(ends) + rng.normal(scale=CLICK_SD_PX, size=(2, 2)) for name in pair}
        factor = np.linalg.norm(ends[1] - ends[0]) / measure_length(rig, clicks).metres
        axis = truth[axis_camera].project(ends) + rng.normal(scale=CLICK_SD_PX, size=(2, 2))
        first, second = (ground_point(rig, axis_camera, tuple(at)) for at in axis)
        turn = exp_rotation(np.array([0.0, 0.0, -np.arctan2(*(second - first)[1::-1])]))
        scale, heading, _ = against(truth, ends, rig.moved(turn, -factor * turn @ first, factor))
        scales.append(abs(scale - 1))
        headings.append(abs(heading))
    print(f"scale {100 * np.median(scales):.2f} %, heading {np.median(headings):.2f} degrees")
    assert np.median(scales) < MEDIAN_SCALE
    assert np.median(headings) < MEDIAN_HEADING_DEG


def test_six_clicks_make_a_metric_and_oriented_rig(browser, address, folder):
    out, truth = folder / "out", read_rig(folder / "scene" / "truth.toml")
    ends = middle(truth) + np.array([[-2.0, -2.5, 0.0], [2.0, 2.5, 0.0]])
    before = read_rig(out / "rig.toml")
    pair, axis_camera = best_views(before, truth, ends)
    hand = Hand(browser, address)

    hand.page.click("[data-tool=length]")
    for name in pair:
        for end in ends:
            hand.click(truth[name], end)
    hand.until("() => document.getElementById('measured').textContent.includes('residual')")
    hand.page.get_by_label("Length in metres").fill(f"{np.linalg.norm(ends[1] - ends[0]):.3f}")
    hand.save("Save the length")
    hand.page.click("[data-tool=world]")
    for end in ends:
        hand.click(truth[axis_camera], end)
    hand.until("() => document.getElementById('tool').textContent.includes('runs through')")
    hand.save("Save the world frame")
    assert hand.clicks == 6

    hand.page.get_by_role("button", name="Solve again").click()
    hand.until("() => document.getElementById('run-state').textContent === 'finished'")
    hand.until("() => document.querySelector('#result table thead').textContent.includes('moved m')")
    assert Work(out).status()["state"] == "done"

    scale, heading, origin = against(truth, ends, read_rig(out / "rig.toml"))
    length_sigma, heading_sigma = stated(before, truth, ends, pair, axis_camera)
    assert abs(scale - 1) < SIGMAS * length_sigma
    assert abs(heading) < SIGMAS * heading_sigma
    assert np.linalg.norm(origin) < 0.15
    assert hand.errors == []
    assert all(url.startswith(address.partition("?")[0]) for url in hand.asked)


def test_marks_are_made_by_clicks_and_taken_back(browser, address, folder):
    """A region, a time, a line, and a poster that is no person: each is in the file and out of it again."""
    scene, truth = folder / "scene" / "scene.toml", read_rig(folder / "scene" / "truth.toml")
    before, spot = tomllib.loads(scene.read_text()), middle(truth)
    hand, name = Hand(browser, address), truth.names[0]
    page = hand.page
    page.click("[data-tool=region]")
    for x, y in ((-1, -1), (1, -1), (1, 1)):
        hand.click(truth[name], spot + [x, y, 0])
    hand.save("Exclude the region")
    (corners,) = tomllib.loads(scene.read_text())["cameras"][name]["exclude"]
    assert len(corners) == 3
    hand.until("() => document.querySelectorAll('.region').length === 1")
    page.click("[data-tool=time]")
    hand.click(truth[name], spot)
    page.get_by_label("From, seconds of its recording").fill("1.5")
    page.get_by_label("To, seconds", exact=True).fill("2")
    hand.save("Exclude the time")
    assert tomllib.loads(scene.read_text())["cameras"][name]["exclude_s"] == [[1.5, 2.0]]
    for label in (f"Remove: Region 1 of {name}", f"Remove: Camera {name} is not used"):
        hand.save(label)
    assert tomllib.loads(scene.read_text()) == before

    page.click("[data-tool=line]")
    for height in (0.0, 2.0):
        hand.click(truth[name], spot + [0, 0, height])
    hand.until("() => document.getElementById('line-told').textContent.includes('it is off by')")
    hand.save("Save the line")
    (line,) = tomllib.loads(scene.read_text())["world"]["lines"]
    assert (line["direction"], list(line["points"])) == ("vertical", [name])
    hand.save("Remove: A vertical line")
    assert tomllib.loads(scene.read_text()) == before

    page.click("[data-tool=identity]")
    hand.until("() => document.querySelectorAll('.box').length > 0")
    box = page.locator("article[aria-label='Camera C1'] .box").first
    box.scroll_into_view_if_needed()
    shown = box.bounding_box()
    page.mouse.click(shown["x"] + shown["width"] / 2, shown["y"] + shown["height"] / 2)
    assert page.get_by_role("button", name="The same person").is_disabled()
    hand.save("Not a person")
    (poster,) = tomllib.loads(scene.read_text())["association"]["not_people"]
    assert poster["camera"] == "C1"
    hand.save("Undo")
    assert tomllib.loads(scene.read_text()) == before
    assert hand.errors == []


def test_an_answer_of_before_an_act_does_not_undo_it_on_the_page(browser, address, folder):
    """The page asks for the state again and again. An answer that was under way during an act is older than the act's own."""
    scene = folder / "scene" / "scene.toml"
    before = scene.read_text()
    hand, held = Hand(browser, address), []
    hand.page.route("**/api/state", lambda route: held.append((route, route.fetch())))
    end = time.monotonic() + PATIENCE_S
    while not held:
        assert time.monotonic() < end, "the page does not ask for the state"
        hand.page.wait_for_timeout(50)
    hand.save("Leave camera C1 out")
    assert scene.read_text() != before
    route, answer = held.pop()
    with hand.page.expect_response("**/api/state"):
        route.fulfill(response=answer)
    hand.page.unroute("**/api/state")
    hand.page.wait_for_timeout(50)
    hand.save("Undo")
    assert tomllib.loads(scene.read_text()) == tomllib.loads(before)
    assert hand.errors == []


def test_axe_finds_nothing_serious_whatever_is_shown(browser, address):
    """At every tool, since each has a form of its own."""
    hand = Hand(browser, address)
    for scheme in ("light", "dark"):
        hand.page.emulate_media(color_scheme=scheme)
        for button in hand.page.locator("[data-tool]").all():
            button.click()
            assert access_faults(hand.page) == [], (scheme, button.text_content())


def best_views(rig, truth, ends):
    """The pair of pictures and the one picture whose clicks the page states the smallest sigmas for."""
    names = [name for name in rig.names if rig[name].pose is not None]
    pairs = [(one, two) for one in names for two in names if one < two]
    pair = min(pairs, key=lambda pair: stated(rig, truth, ends, pair, pair[0])[0])
    return pair, min(names, key=lambda name: stated(rig, truth, ends, pair, name)[1])


def stated(rig, truth, ends, pair, axis_camera):
    """The relative sigma of a length and the sigma of a heading in degrees, as the page states them."""
    length = measure_length(rig, {name: truth[name].project(ends) for name in pair})
    axis = measure_axis(rig, [(axis_camera, tuple(at)) for at in truth[axis_camera].project(ends)])
    return length.sigma_m / length.metres, axis.heading_sigma_deg


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
