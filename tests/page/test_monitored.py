"""The page of a monitored rig: states, moves and pictures are those of the folder; the browser names cameras only."""

import shutil
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest

from passerby.cli.main import run
from passerby.common.errors import InputError
from passerby.core.figures import AdjustedFigures, MotionFigures
from passerby.interchange.calibration_json import read_document, write_document
from passerby.interchange.monitor_json import read_monitor
from passerby.monitoring.given_rig import read_given
from passerby.page.app import make_monitor_app
from passerby.page.monitored import MonitoredSession
from passerby.page.server import Opened, OpenedMonitoring, find_opened
from support.browser import CHROMIUM

from .conftest import PORT, TOKEN, Client
from .monitored_scene import AFTER, BEFORE, CALIBRATED, FPS, MOVED_S, SECONDS, monitored, rewrite


@pytest.fixture(scope="module")
def checked_once(tmp_path_factory):
    return monitored(tmp_path_factory.mktemp("monitored"))


@pytest.fixture
def checked(checked_once, tmp_path):
    """A copy of the folder of `passerby monitor`; the films are shared."""
    return shutil.copytree(checked_once, tmp_path / "checked")


class MonitorClient(Client):
    def __init__(self, folder):
        self.app = make_monitor_app(MonitoredSession(folder), TOKEN, PORT)

    def views(self, name):
        """The pictures of a camera by label, and the notes."""
        told = self.get("/api/views", f"camera={name}").json()
        return {one["label"]: one for one in told["pictures"]}, told["notes"]

    def grey(self, name, view):
        answer = self.get("/picture", f"camera={name}&of={view['source']}&frame={view['frame']}")
        assert answer.status == 200
        return cv2.imdecode(np.frombuffer(answer.body, np.uint8), cv2.IMREAD_COLOR).mean()


@pytest.mark.slow
def test_the_state_is_that_of_the_folder(checked):
    told = MonitorClient(checked).get("/api/monitor").json()
    assert {one["name"]: one["state"] for one in told["cameras"]} == {
        "C1": "steady",
        "C2": "moved",
        "C3": "steady",
        "C4": "steady",
    }
    (move,) = told["moves"]
    assert move["camera"] == "C2"
    assert abs(move["seconds"] - MOVED_S) < 3
    assert abs(move["degrees"] - 2) < 4 * move["degrees_sigma"]
    assert (told["rig"], told["footage"]) == ("out/rig.toml", "scene.toml")
    assert len(told["windows"]) == 3
    assert str(checked.parent) not in str(told)
    assert not {"scene_file", "rig_file", "calibration_scene_file"} & set(told)


@pytest.mark.slow
def test_it_is_told_anew_when_the_rig_is_monitored_again(checked):
    client = MonitorClient(checked)
    before = client.get("/api/monitor").json()
    rewrite(checked, lambda told: told["cameras"][1].update(state="steady"))
    after = client.get("/api/monitor").json()
    assert after["version"] != before["version"]
    assert after["cameras"][1]["state"] == "steady"


@pytest.mark.slow
def test_pictures_then_and_now_are_those_of_their_moments(checked):
    client = MonitorClient(checked)
    views, notes = client.views("C2")
    assert notes == []
    seen = {
        label.partition(" at 00")[0]: (view["side"], view["source"], client.grey("C2", view)) for label, view in views.items()
    }
    greys = {label: grey for label, (_, _, grey) in seen.items()}
    assert greys["at the calibration"] == pytest.approx(CALIBRATED, abs=4)
    assert greys["before the move"] == pytest.approx(BEFORE, abs=4)
    assert greys["after the move"] == pytest.approx(AFTER, abs=4)
    assert greys["at the end of the monitored footage"] == pytest.approx(AFTER, abs=4)
    assert [label for label, (side, _, _) in seen.items() if side == "then"] == ["at the calibration", "before the move"]
    assert views["at the end of the monitored footage"]["frame"] == SECONDS * FPS


@pytest.mark.slow
def test_without_the_films_of_the_calibration_the_earliest_picture_stands_in(checked, tmp_path):
    def away(told):
        told["calibration_scene_file"] = str(tmp_path / "gone" / "scene.toml")

    rewrite(checked, away)
    client = MonitorClient(checked)
    views, notes = client.views("C2")
    view = views["at the beginning of the monitored footage"]
    assert (view["source"], view["frame"]) == ("footage", 1)
    assert client.grey("C2", view) == pytest.approx(BEFORE, abs=4)
    assert "no picture of the calibration" in notes[0]
    assert str(tmp_path) not in notes[0]
    rewrite(checked, lambda told: told.pop("calibration_scene_file"))
    assert "does not name the scene file" in client.views("C2")[1][0]


@pytest.mark.slow
def test_only_what_the_calibration_used_is_its_picture(checked, tmp_path):
    """A camera that was moved while it was calibrated: the picture is of the part that was kept."""
    films = Path(read_monitor(checked).calibration_scene_file).parent
    then = tmp_path / "scene.toml"
    cameras = [f'[cameras.{name}]\nvideo = "{(films / name).as_posix()}.mp4"\n' for name in ("C1", "C2")]
    then.write_text("[scene]\nfps = 2\n" + "".join(cameras) + "from_s = 6\n")
    rewrite(checked, lambda told: told.update(calibration_scene_file=str(then)))
    views, notes = MonitorClient(checked).views("C2")
    assert notes == []
    assert views["at the calibration"]["frame"] == (13 + 20) // 2


@pytest.mark.parametrize(
    ("left_out", "frames", "shown"),
    [("before", (3, 4), (5 + 20) // 2), ("after", (7, 12), (1 + 6) // 2), ("between", (3, 6), (7 + 20) // 2)],
)
@pytest.mark.slow
def test_a_part_that_the_calibration_left_out_is_not_its_picture(checked, left_out, frames, shown):
    """The camera was moved while it filmed 20 frames; beside what was left out it saw nobody."""
    folder = Path(read_monitor(checked).rig_file).parent
    document = read_document(folder)
    values = {"metres": 0.1, "degrees": 9.0, "sigmas": 9.0, "shift": 1.0}
    moved = MotionFigures(camera="C2", frames=frames, seconds=None, left_out=left_out, **values)
    write_document(folder, replace(document, figures=AdjustedFigures(moved=(moved,))))
    views, _ = MonitorClient(checked).views("C2")
    write_document(folder, document)
    assert views["at the calibration"]["frame"] == shown


@pytest.mark.slow
def test_a_camera_of_boxes_has_no_pictures(checked):
    views, notes = MonitorClient(checked).views("C3")
    assert views == {}
    assert "has no video" in notes[0]


@pytest.mark.slow
def test_a_folder_of_an_older_passerby_is_shown(checked):
    """It named no files and no clocks."""

    def older(told):
        for key in ("scene_file", "rig_file", "calibration_scene_file"):
            del told[key]
        for camera in told["cameras"]:
            del camera["fps"], camera["time_offset_s"]

    rewrite(checked, older)
    client = MonitorClient(checked)
    told = client.get("/api/monitor").json()
    assert (told["rig"], told["footage"], len(told["moves"])) == (None, None, 1)
    assert "does not name the scene file" in client.views("C2")[1][0]


@pytest.mark.parametrize(
    "query",
    [
        "camera=..%2f..%2fsecret&of=footage&frame=1",
        "camera=C2&of=..%2fthen&frame=1",
        "camera=C2&frame=1",
        "camera=C2&of=footage&frame=-1",
        "camera=C2&of=footage&frame=%C2%B2",
        "camera=C2&of=footage&frame=99999999999",
        "of=footage",
    ],
)
@pytest.mark.slow
def test_what_names_no_picture_is_refused(checked, query):
    assert MonitorClient(checked).get("/picture", query).status == 422


@pytest.mark.slow
def test_only_the_opened_browser_is_answered(checked):
    client = MonitorClient(checked)
    assert client.get("/").status == 200
    assert b"monitor.js" in client.get("/").body
    assert client.get("/api/monitor", cookie=None).status == 403
    assert client.get("/api/monitor", origin="http://evil.example").status == 403
    assert client.post("/api/act").status == 404


@pytest.mark.slow
def test_what_is_opened(checked, session, capsys):
    assert find_opened(checked) == OpenedMonitoring(checked)
    assert isinstance(find_opened(session.scene_file), Opened)
    with pytest.raises(InputError, match="leave out --out"):
        find_opened(checked, checked / "out")
    (checked / "monitor.json").write_text('{"from_s": "x"}')
    assert run(["open", str(checked), "--no-browser"]) == 2
    error = capsys.readouterr().err
    assert "monitor.json: is not what `passerby monitor` writes: from_s is" in error
    assert error.count("\n") == 1


@pytest.mark.slow
def test_a_rig_that_was_monitored_keeps_the_scene_of_its_calibration(checked):
    """Monitored again and again, each time from the last folder: also if the file beside it is broken by then."""
    first = read_monitor(checked)
    assert first.calibration_scene_file is not None
    assert read_given(checked).calibration_scene_file == first.calibration_scene_file
    (checked / "monitor.json").write_text("{")
    assert read_given(checked).calibration_scene_file is None


@pytest.mark.system
@pytest.mark.skipif(CHROMIUM is None, reason="no Chromium: install the package chromium")
def test_then_and_now_by_the_keyboard(browser, checked, served):
    """The slider shows all of now at its beginning and all of then at its end; all is said in words."""
    page, errors = browser.new_context(viewport={"width": 390, "height": 800}).new_page(), []
    page.on("console", lambda said: errors.append(said.text) if said.type == "error" else None)
    page.on("pageerror", lambda error: errors.append(str(error)))
    page.goto(served(checked))
    card = page.locator("article[aria-label='Camera C2']")
    card.get_by_text("moved at 00:01:").wait_for()
    card.locator("img[alt^='Camera C2 at the calibration']").wait_for()
    card.locator("img[alt^='Camera C2 at the end of the monitored footage']").wait_for()
    slider = page.get_by_role("slider", name="Then and now of camera C2")
    for key, grey, text in (("Home", AFTER, "0 % then, 100 % now"), ("End", CALIBRATED, "100 % then, 0 % now")):
        slider.press(key)
        assert slider.get_attribute("aria-valuetext") == text
        picture = cv2.imdecode(np.frombuffer(card.locator(".wipe").screenshot(), np.uint8), cv2.IMREAD_COLOR)
        height, width = picture.shape[:2]
        assert picture[height // 3, [width // 4, 3 * width // 4]].mean() == pytest.approx(grey, abs=6)
    page.get_by_label("Left picture of camera C2").select_option(index=1)
    card.locator("img[alt^='Camera C2 before the move']").wait_for()
    assert page.get_by_role("img", name="Scores of camera C2 in 3 windows").count() == 1
    assert page.locator("article[aria-label='Camera C3']").get_by_text("camera C3 has no video").count() == 1
    assert page.locator("button").count() == 0
    assert page.evaluate("document.documentElement.scrollWidth") <= 390
    assert errors == []


@pytest.mark.system
@pytest.mark.skipif(CHROMIUM is None, reason="no Chromium: install the package chromium")
def test_a_camera_without_news_says_since_when(browser, checked, served):
    def carried(told):
        told["cameras"][1].update(carried=True, as_of="2026-03-01T08:00:00+00:00")
        told["moves"][0]["carried"] = True
        for window in told["windows"]:
            del window["cameras"]["C2"]

    rewrite(checked, carried)
    page, errors = browser.new_context().new_page(), []
    page.on("pageerror", lambda error: errors.append(str(error)))
    page.goto(served(checked))
    card = page.locator("article[aria-label='Camera C2']")
    card.get_by_text("No news since 2026-03-01T08:00:00+00:00").wait_for()
    assert card.get_by_text("noticed in an earlier run at").count() == 1
    assert page.get_by_role("img", name="Scores of camera C2").count() == 0
    assert page.get_by_role("img", name="Scores of camera C1 in 3 windows").count() == 1
    assert errors == []
