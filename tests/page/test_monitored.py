"""The page of a monitored rig: states, moves and pictures are those of the folder; the browser names cameras only.

C1 and C2 have films of plain greys; C3 and C4 have boxes only; C2 is turned in the monitored footage.
"""

import json
import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from passerby.cli.main import run
from passerby.common.errors import InputError
from passerby.core.figures import AdjustedFigures, MotionFigures
from passerby.core.observations import Clock
from passerby.interchange.calibration_json import CalibrationDocument, CameraEntry, read_document, write_document
from passerby.interchange.monitor_json import read_monitor
from passerby.interchange.video_writer import VideoWriter
from passerby.monitoring.given_rig import read_given
from passerby.page.app import make_monitor_app
from passerby.page.monitored import MonitoredSession
from passerby.page.server import Opened, OpenedMonitoring, find_opened
from support.browser import CHROMIUM
from support.scenes.walkers_for_monitor import FPS, calibrated, knocked, true_rig, walkers, write_watched

from .conftest import PORT, TOKEN, Client, decoded, listen

pytestmark = pytest.mark.slow
needs_browser = pytest.mark.skipif(CHROMIUM is None, reason="no Chromium: install the package chromium")

CALIBRATED, BEFORE, AFTER = 40, 110, 200
"""Grey values of the films: at the calibration, and before and after C2 was turned."""
MOVED_S, SECONDS = 90.0, 160


def film(path, size, greys):
    with VideoWriter(path, size, FPS) as video:
        for grey in greys:
            video.write(np.full((size[1], size[0], 3), grey, np.uint8))


@pytest.fixture(scope="module")
def checked_once(tmp_path_factory):
    """The folder of `passerby monitor`, beside a calibration's folder with its films and the footage."""
    folder, rig = tmp_path_factory.mktemp("monitored"), true_rig()
    for name in ("then", "today", "out"):
        (folder / name).mkdir()
    seen = walkers(rig, SECONDS, knocks={"C2": (MOVED_S, knocked(rig["C2"].pose, (0, 2, 0)))})
    given, scene = write_watched(folder / "today", calibrated(rig), seen)
    lines, then = scene.read_text(), "[scene]\n"
    for name, brighter in {"C1": 3, "C2": 0}.items():  # two cameras never have the same film
        size = rig[name].lens.size
        film(folder / "then" / f"{name}.mp4", size, [CALIBRATED + brighter] * 20)
        greys = [BEFORE if k / FPS < MOVED_S or name != "C2" else AFTER for k in range(int(SECONDS * FPS))]
        film(folder / "today" / f"{name}.mp4", size, [grey + brighter for grey in greys])
        lines = lines.replace(f'tracks = "{name}.txt"', f'tracks = "{name}.txt"\nvideo = "{name}.mp4"')
        then += f'[cameras.{name}]\nvideo = "{name}.mp4"\n'
    scene.write_text(lines)
    (folder / "then" / "scene.toml").write_text(then)
    given.rename(folder / "out" / "rig.toml")
    shutil.copy(folder / "out" / "rig.toml", folder / "today")
    clock = Clock(FPS)
    cameras = tuple(CameraEntry(name=name, fps=clock.fps, time_offset_s=clock.offset_s) for name in rig.names)
    then = CalibrationDocument(verdict="accepted", scene_file=str(folder / "then" / "scene.toml"), cameras=cameras)
    write_document(folder / "out", then)
    assert run(["monitor", str(folder / "out"), str(scene), "-o", str(folder / "checked")]) == 3
    return folder / "checked"


@pytest.fixture
def checked(checked_once, tmp_path):
    """A copy of the folder of `passerby monitor`; the films are shared."""
    return shutil.copytree(checked_once, tmp_path / "checked")


def rewrite(folder, change):
    path = folder / "monitor.json"
    told = json.loads(path.read_text())
    change(told)
    path.write_text(json.dumps(told))


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
        return decoded(answer.body).mean()


def test_the_state_is_that_of_the_folder_and_changes_with_it(checked):
    client = MonitorClient(checked)
    told = client.get("/api/monitor").json()
    states = {"C1": "steady", "C2": "moved", "C3": "steady", "C4": "steady"}
    assert {one["name"]: one["state"] for one in told["cameras"]} == states
    (move,) = told["moves"]
    assert move["camera"] == "C2"
    assert abs(move["seconds"] - MOVED_S) < 3
    assert abs(move["degrees"] - 2) < 4 * move["degrees_sigma"]
    assert (told["rig"], told["footage"]) == ("out/rig.toml", "scene.toml")
    assert len(told["windows"]) == 3
    assert str(checked.parent) not in str(told)
    assert not {"scene_file", "rig_file", "calibration_scene_file"} & set(told)
    rewrite(checked, lambda told: told["cameras"][1].update(state="steady"))
    after = client.get("/api/monitor").json()
    assert after["version"] != told["version"]
    assert after["cameras"][1]["state"] == "steady"


def test_pictures_then_and_now_are_those_of_their_moments(checked):
    client = MonitorClient(checked)
    views, notes = client.views("C2")
    assert notes == []
    seen = {label.partition(" at 00")[0]: (view["side"], client.grey("C2", view)) for label, view in views.items()}
    greys = {label: grey for label, (_, grey) in seen.items()}
    assert greys["at the calibration"] == pytest.approx(CALIBRATED, abs=4)
    assert greys["before the move"] == pytest.approx(BEFORE, abs=4)
    assert greys["after the move"] == pytest.approx(AFTER, abs=4)
    assert greys["at the end of the monitored footage"] == pytest.approx(AFTER, abs=4)
    assert [label for label, (side, _) in seen.items() if side == "then"] == ["at the calibration", "before the move"]
    assert views["at the end of the monitored footage"]["frame"] == SECONDS * FPS
    views, notes = client.views("C3")
    assert views == {}
    assert "has no video" in notes[0]


def test_without_the_films_of_the_calibration_the_earliest_picture_stands_in(checked, tmp_path):
    rewrite(checked, lambda told: told.update(calibration_scene_file=str(tmp_path / "gone" / "scene.toml")))
    client = MonitorClient(checked)
    views, notes = client.views("C2")
    view = views["at the beginning of the monitored footage"]
    assert (view["source"], view["frame"]) == ("footage", 1)
    assert client.grey("C2", view) == pytest.approx(BEFORE, abs=4)
    assert "no picture of the calibration" in notes[0]
    assert str(tmp_path) not in notes[0]
    rewrite(checked, lambda told: told.pop("calibration_scene_file"))
    assert "does not name the scene file" in client.views("C2")[1][0]


def test_only_the_part_that_the_calibration_used_is_its_picture(checked, tmp_path):
    """A camera that was moved while it was calibrated, in 20 frames: by the scene file or by what the calibration found."""
    folder = Path(read_monitor(checked).rig_file).parent
    document = read_document(folder)
    values = {"metres": 0.1, "degrees": 9.0, "sigmas": 9.0, "shift": 1.0}
    for left_out, frames, shown in (
        ("before", (3, 4), (5 + 20) // 2), ("after", (7, 12), (1 + 6) // 2), ("between", (3, 6), (7 + 20) // 2),
    ):  # fmt: skip
        moved = MotionFigures(camera="C2", frames=frames, seconds=None, left_out=left_out, **values)
        write_document(folder, replace(document, figures=AdjustedFigures(moved=(moved,))))
        views, _ = MonitorClient(checked).views("C2")
        write_document(folder, document)
        assert views["at the calibration"]["frame"] == shown, left_out
    films = Path(read_monitor(checked).calibration_scene_file).parent
    then = tmp_path / "scene.toml"
    cameras = [f'[cameras.{name}]\nvideo = "{(films / name).as_posix()}.mp4"\n' for name in ("C1", "C2")]
    then.write_text("[scene]\nfps = 2\n" + "".join(cameras) + "from_s = 6\n")
    rewrite(checked, lambda told: told.update(calibration_scene_file=str(then)))
    views, notes = MonitorClient(checked).views("C2")
    assert notes == []
    assert views["at the calibration"]["frame"] == (13 + 20) // 2


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


def test_only_the_opened_browser_is_answered_and_only_with_pictures_of_cameras(checked):
    client = MonitorClient(checked)
    assert client.get("/").status == 200
    assert b"monitor.js" in client.get("/").body
    assert client.get("/api/monitor", cookie=None).status == 403
    assert client.get("/api/monitor", origin="http://evil.example").status == 403
    assert client.post("/api/act").status == 404
    own = "camera=C2&of=footage"
    for query in ("camera=..%2f..%2fsecret&of=footage&frame=1", "camera=C2&of=..%2fthen&frame=1", "camera=C2&frame=1",
                  f"{own}&frame=-1", f"{own}&frame=%C2%B2", f"{own}&frame=99999999999", "of=footage"):  # fmt: skip
        assert client.get("/picture", query).status == 422, query


def test_a_monitored_folder_is_opened_and_names_its_calibrations_scene(checked, session, capsys):
    assert find_opened(checked) == OpenedMonitoring(checked)
    assert isinstance(find_opened(session.scene_file), Opened)
    with pytest.raises(InputError, match="leave out --out"):
        find_opened(checked, checked / "out")
    # Monitored again and again, each time from the last folder: also if the file beside it is broken by then.
    first = read_monitor(checked)
    assert first.calibration_scene_file is not None
    assert read_given(checked).calibration_scene_file == first.calibration_scene_file
    (checked / "monitor.json").write_text("{")
    assert read_given(checked).calibration_scene_file is None
    (checked / "monitor.json").write_text('{"from_s": "x"}')
    assert run(["open", str(checked), "--no-browser"]) == 2
    error = capsys.readouterr().err
    assert "monitor.json: is not what `passerby monitor` writes: from_s is" in error
    assert error.count("\n") == 1


@pytest.mark.system
@needs_browser
def test_then_and_now_by_the_keyboard_and_since_when_there_is_no_news(browser, checked, served):
    """The slider shows all of now at its beginning and all of then at its end; all is said in words."""
    page = browser.new_context(viewport={"width": 390, "height": 800}).new_page()
    errors = listen(page)
    page.goto(served(checked))
    card = page.locator("article[aria-label='Camera C2']")
    card.get_by_text("moved at 00:01:").wait_for()
    card.locator("img[alt^='Camera C2 at the calibration']").wait_for()
    card.locator("img[alt^='Camera C2 at the end of the monitored footage']").wait_for()
    slider = page.get_by_role("slider", name="Then and now of camera C2")
    for key, grey, text in (("Home", AFTER, "0 % then, 100 % now"), ("End", CALIBRATED, "100 % then, 0 % now")):
        slider.press(key)
        assert slider.get_attribute("aria-valuetext") == text
        picture = decoded(card.locator(".wipe").screenshot())
        height, width = picture.shape[:2]
        assert picture[height // 3, [width // 4, 3 * width // 4]].mean() == pytest.approx(grey, abs=6)
    page.get_by_label("Left picture of camera C2").select_option(index=1)
    card.locator("img[alt^='Camera C2 before the move']").wait_for()
    assert page.get_by_role("img", name="Scores of camera C2 in 3 windows").count() == 1
    assert page.locator("article[aria-label='Camera C3']").get_by_text("camera C3 has no video").count() == 1
    assert page.locator("button").count() == 0
    assert page.evaluate("document.documentElement.scrollWidth") <= 390

    def carried(told):
        told["cameras"][1].update(carried=True, as_of="2026-03-01T08:00:00+00:00")
        told["moves"][0]["carried"] = True
        for window in told["windows"]:
            del window["cameras"]["C2"]

    rewrite(checked, carried)
    page.reload()
    card.get_by_text("No news since 2026-03-01T08:00:00+00:00").wait_for()
    assert card.get_by_text("noticed in an earlier run at").count() == 1
    assert page.get_by_role("img", name="Scores of camera C2").count() == 0
    assert page.get_by_role("img", name="Scores of camera C1 in 3 windows").count() == 1
    assert errors == []
