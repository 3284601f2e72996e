"""What stands beside a camera in a real browser: the same person elsewhere, its faults, what was found; and that it moved."""

import shutil
import tomllib

import numpy as np
import pytest

from passerby.core.figures import AdjustedFigures
from passerby.core.lens_figures import FocalFigures, LensFigures
from passerby.interchange.calibration_json import CalibrationDocument, CameraEntry, DiagnosticEntry, write_document
from passerby.interchange.motchallenge import read_boxes
from passerby.interchange.rig_toml import read_rig
from passerby.interchange.video_writer import VideoWriter
from support.browser import CHROMIUM

from .conftest import decoded, listen

pytestmark = [pytest.mark.system, pytest.mark.skipif(CHROMIUM is None, reason="no Chromium: install the package chromium")]

FPS, FRAMES = 5.0, 20
GREYS = {"C1": 60, "C2": 180}
"""C1 and C2 have films, of plain greys; C3 and C4 have boxes only."""


@pytest.fixture
def out(session):
    """The output folder of a calibration of the simulated scene, as its true identities make it."""
    scene, truth = session.scene_file, read_rig(session.out / "rig.toml")
    text = scene.read_text()
    for name, grey in GREYS.items():
        width, height = truth[name].lens.size
        with VideoWriter(scene.parent / f"{name}.mp4", (width, height), FPS) as video:
            for _ in range(FRAMES):
                video.write(np.full((height, width, 3), grey, np.uint8))
        text = text.replace(f"[cameras.{name}]\n", f'[cameras.{name}]\nvideo = "{name}.mp4"\n')
    scene.write_text(text)
    shutil.copytree(scene.parent / "tracks", session.out / "tracks")
    focal = FocalFigures(stated_px=900.0, refined_px=1203.4, sigma_px=15.2, people_sigma_px=None, far=False, told=True)
    said = DiagnosticEntry(code="x", severity="doubt", cameras=("C2",), text="camera C2 is odd")
    write_document(
        session.out,
        CalibrationDocument(
            verdict="doubtful",
            scene_file=str(scene),
            reasons=("camera C2 is odd",),
            diagnostics=(said,),
            cameras=tuple(
                CameraEntry(name=name, fps=FPS, time_offset_s=0.25 * (name == "C2"), time_offset_sigma_s=0.004 * (name == "C2"))
                for name in truth.names
            ),
            figures=AdjustedFigures(lenses={"C2": LensFigures(focal=focal)}),
        ),
    )
    return session.out


@pytest.fixture
def page(browser, served, out):
    """Somebody at the page; an error of the console fails the test."""
    page = browser.new_context(viewport={"width": 1300, "height": 900}).new_page()
    errors = listen(page, but="422")
    page.goto(served(out))
    card(page, "C1").locator(".known", has_text="frames/s").wait_for()
    yield page
    assert errors == []


def card(page, name):
    return page.locator(f"article[aria-label='Camera {name}']")


def test_the_same_person_is_cut_out_of_the_other_pictures(page, out):
    frame = int(card(page, "C1").locator("input[type=range]").input_value())
    boxes, size = read_boxes(out / "tracks" / "C1.txt"), read_rig(out / "rig.toml")["C1"].lens.size
    row = int(np.flatnonzero(boxes.frame == frame)[0])
    middle = boxes.ltwh[row, :2] + boxes.ltwh[row, 2:] / 2 + 0.5
    page.click("[data-tool=person]")
    page.get_by_label("Height in metres, with shoes").fill("1.83")
    stage = card(page, "C1").locator(".stage")
    stage.scroll_into_view_if_needed()
    with page.expect_response("**/api/person") as asked:
        box = stage.bounding_box()
        stage.click(position={"x": middle[0] * box["width"] / size[0], "y": middle[1] * box["height"] / size[1]})
    told = asked.value.json()
    crops = page.get_by_role("group", name=f"Person {told['identity']} in each camera")
    crops.wait_for()
    names = [one["camera"] for one in told["seen"]]
    assert {"C2", "C3"} <= set(names)
    assert crops.locator("figure").count() == len(names)
    for name, grey in GREYS.items():
        figure = crops.locator("figure").nth(names.index(name))
        figure.scroll_into_view_if_needed()
        page.wait_for_timeout(500)
        picture = decoded(figure.locator("svg").screenshot())
        assert np.median(picture) == pytest.approx(grey, abs=8)
    crops.locator("figcaption", has_text="C3").get_by_text("no picture").wait_for()
    assert page.get_by_label("Height in metres, with shoes").input_value() == "1.83"


def test_a_camera_that_moved_is_kept_in_part_and_faults_and_findings_stand_beside_it(page, session):
    before = session.scene_file.read_text()
    page.click("[data-tool=moved]")
    frames = card(page, "C1").locator("input[type=range]")
    frames.evaluate("(one) => { one.value = 11; one.dispatchEvent(new Event('change')); }")
    card(page, "C1").get_by_text("frame 11", exact=True).wait_for()
    card(page, "C1").locator(".stage").click()
    assert page.get_by_label("Moved at, seconds of its recording").input_value() == "2"
    page.get_by_role("radio", name="after").check()
    page.get_by_role("button", name="Keep this part").click()
    remove = page.get_by_role("button", name="Remove: Camera C1 is used only after 2 s")
    remove.wait_for()
    assert tomllib.loads(session.scene_file.read_text())["cameras"]["C1"]["from_s"] == 2.0
    with page.expect_response("**/api/act"):
        remove.click()
    assert tomllib.loads(session.scene_file.read_text()) == tomllib.loads(before)

    assert card(page, "C2").locator(".notes").get_by_text("camera C2 is odd").count() == 1
    assert card(page, "C2").get_by_text("Found: focal length 1203 ± 15 px · clock +0.250 ± 0.004 s").count() == 1
    assert card(page, "C1").get_by_text("Found: clock of the rig").count() == 1
    assert card(page, "C1").locator(".notes").get_by_text("odd").count() == 0

    text = session.scene_file.read_text()
    session.scene_file.write_text(text.replace("tracks/C3.txt", "tracks/gone.txt"))
    card(page, "C3").locator(".faults").get_by_text("gone.txt").wait_for()
    assert page.locator("#faults .faults").count() == 0

    # What cannot be read as a scene takes no camera away; what names a camera's table stands beside it.
    session.scene_file.write_text(text.replace('video = "C2.mp4"', "video = 3"))
    card(page, "C2").locator(".faults").get_by_text("video").wait_for()
    assert page.locator("#faults .faults").count() == 1
    assert page.get_by_role("button", name="Solve again").is_disabled()
    assert page.locator("article").count() == 4
    session.scene_file.write_text(text)
    page.locator("#faults .faults").wait_for(state="detached")
    assert card(page, "C2").locator(".faults li").count() == 0
