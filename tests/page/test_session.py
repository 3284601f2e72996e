"""Acts through the server: acknowledged ones are in the file, stale and wrong ones change nothing."""

import errno
import json
import os
import shutil
import subprocess
import sys
import time

import cv2
import numpy as np
import pytest

from passerby.calibration.alignment.scene_world import align_rig
from passerby.cli.main import run
from passerby.common.errors import InputError
from passerby.core.cameras import Rig
from passerby.interchange.rig_toml import read_rig, write_rig
from passerby.interchange.storage.atomic import cannot_write
from passerby.interchange.video_writer import VideoWriter
from passerby.page import pictures, work
from passerby.page.app import prepare_pictures
from passerby.page.server import find_opened
from passerby.page.session import Session
from passerby.page.work import EVENTS, FOLDER, RESULT, RUN_LOCK, Work
from passerby.perception.sources.recording import open_source
from passerby.scene.scene import Scene
from passerby.scene.world_tables import WorldTable
from support.scenes.output_folders import written_output

from .conftest import Client, act, scene_of


@pytest.fixture
def truth(session):
    return read_rig(session.scene_file.parent / "truth.toml")


def length(rig, metres=None, ends=((0.0, 3.0, 0.0), (1.0, 5.0, 0.0)), cameras=2):
    """A length on the ground that cameras see, as an act. Ends are offsets from the middle of the cameras' views."""
    ends = np.array(ends) - [0.5, 4.0, 0] + middle(rig)
    points = {name: rig[name].project(ends).round(2).tolist() for name in rig.names[:cameras]}
    return {"act": "length", "metres": metres or float(np.linalg.norm(ends[1] - ends[0])), "points": points}


def middle(rig):
    """Amid the cameras, on the ground."""
    return np.mean([camera.centre for camera in rig], axis=0) * [1, 1, 0]


def test_corrections_of_identities_are_in_the_file_and_can_be_removed(client, session):
    boxes = [{"camera": "C1", "frame": 5, "at": [10.0, 20.125]}, {"camera": "C2", "frame": 6, "at": [30.0, 20.0]}]
    given = act(client, session, act="identities", key="same", boxes=boxes)
    assert (given.status, "correct the ids there" in given.body.decode()) == (422, True)
    session.scene_file.write_text(session.scene_file.read_text().replace('mode = "given"', 'mode = "combined" # no ids'))
    lines = session.scene_file.read_text().splitlines()
    for key in ("same", "different"):
        assert act(client, session, act="identities", key=key, boxes=boxes).status == 200
    state = act(client, session, act="not_people", box=boxes[0]).json()
    boxes[0]["at"][1] = 20.12
    corrected = {"same": [{"boxes": boxes}], "different": [{"boxes": boxes}], "not_people": boxes[:1]}
    assert (state["same"], state["not_people"]) == (corrected["same"], corrected["not_people"])
    assert scene_of(session)["association"] == {"mode": "combined"} | corrected
    assert set(lines) <= set(session.scene_file.read_text().splitlines())
    assert act(client, session, act="identities", key="same", boxes=boxes[:1]).status == 422
    assert act(client, session, act="identities", key="all", boxes=boxes).status == 422
    for key in corrected:
        assert act(client, session, act="remove", key=key, number=1).status == 200
    assert scene_of(session)["association"] == {"mode": "combined"}


def test_a_line_is_measured_and_written(client, session, truth):
    places = middle(truth) + np.array([[0.0, 0.0, 0.0], [0.0, 0.0, 2.0]])
    points = {truth.names[0]: truth[truth.names[0]].project(places).round(2).tolist()}
    told = json.loads(client.post("/api/line", json.dumps({"direction": "vertical", "points": points}).encode()).body)
    assert told["off_deg"] < 3 * told["sigma_deg"] + 1
    assert client.post("/api/line", b'{"direction": "up", "points": {}}').status == 422
    state = json.loads(act(client, session, act="line", direction="vertical", points=points).body)
    assert state["lines"] == [{"direction": "vertical", "points": points}]
    assert act(client, session, act="line", direction="horizontal", points=points).status == 422
    assert act(client, session, act="remove", key="lines", number=1).status == 200
    assert "world" not in scene_of(session)


@pytest.mark.parametrize(("key", "check"), [("lengths", False), ("checks", True)])
def test_an_acknowledged_length_is_in_the_file_and_in_the_state(client, session, truth, key, check):
    """It may only check the rig."""
    answer = act(client, session, **length(truth), check=check)
    (told,) = scene_of(session)["scale"][key]
    assert (answer.status, answer.json()["version"]) == (200, session.version)
    assert {name: [one["metres"] for one in answer.json()[name]] for name in ("lengths", "checks")} == (
        {"lengths": [], "checks": []} | {key: [told["metres"]]}
    )
    assert len(getattr(Scene.load(session.scene_file).scale, key)) == 1
    assert act(client, session, act="remove", key=key, number=1).status == 200
    assert key not in scene_of(session).get("scale", {})


@pytest.mark.parametrize(
    ("content", "why"),
    [
        ({"act": "length", "metres": -1, "points": {}}, "greater than 0"),
        ({"act": "length", "metres": 1, "points": {"C1": [[1, 1], [2, 2]]}}, "at least 2"),
        ({"act": "length", "metres": 1, "points": {"C1": [[1, 1], [2, 2]], "C9": [[1, 1], [2, 2]]}}, "C9"),
        ({"act": "person", "camera": "C9", "frame": 1, "at": [1, 1], "height_m": 1.8}, "C9"),
        ({"act": "person", "camera": "C1", "frame": 1, "at": [1, 1], "height_m": 18}, "less than 3"),
        ({"act": "leave_out", "camera": "C9"}, "not there"),
        ({"act": "remove", "key": "lengths", "number": 1}, "not there"),
        ({"act": "undo"}, "no act"),
        ({"act": "explode"}, "act"),
        ({"act": "length", "metres": 1e999, "points": {}}, ""),
    ],
)
def test_a_wrong_act_is_refused_with_a_sentence(client, session, content, why):
    before = session.scene_file.read_bytes()
    answer = act(client, session, **content)
    assert answer.status == 422
    assert why in answer.json()["error"]
    assert session.scene_file.read_bytes() == before


@pytest.mark.parametrize("body", [b"[", b"1", b"[]", b"null", b'{"act": {}}', b"[" * 5000])
def test_what_is_no_act_is_refused(client, body):
    for path in ("/api/act", "/api/epipolar", "/api/length", "/api/ground", "/api/axis", "/api/person", "/api/plan/fit"):
        assert client.post(path, body).status == 422


def test_undo_takes_back_act_after_act_byte_for_byte(client, session, truth):
    texts = [session.scene_file.read_bytes()]
    act(client, session, **length(truth))
    texts.append(session.scene_file.read_bytes())
    act(client, session, act="person", camera="C1", frame=3, at=[100, 100], height_m=1.8)
    for before in reversed(texts):
        assert client.get("/api/state").json()["can_undo"]
        assert act(client, session, act="undo").status == 200
        assert session.scene_file.read_bytes() == before
    assert not client.get("/api/state").json()["can_undo"]


def test_a_stale_act_changes_nothing_and_what_an_editor_wrote_is_never_undone(client, session, truth):
    act(client, session, **length(truth))
    seen = session.version
    session.scene_file.write_text(session.scene_file.read_text() + "\n# by an editor\n")
    before = session.scene_file.read_bytes()
    answer = act(client, session, seen, **length(truth))
    assert answer.status == 409
    assert "changed meanwhile" in answer.json()["error"]
    assert not client.get("/api/state").json()["can_undo"]
    assert act(client, session, act="undo").status == 422
    assert session.scene_file.read_bytes() == before


def test_a_camera_is_left_out_and_comes_back(client, session):
    act(client, session, act="leave_out", camera="C4")
    assert client.get("/api/state").json()["cameras"] == ["C1", "C2", "C3"]
    act(client, session, act="undo")
    assert client.get("/api/state").json()["cameras"] == ["C1", "C2", "C3", "C4"]


def test_two_clicks_set_the_frame_that_the_command_line_then_finds(client, session, truth):
    origin, along = middle(truth) + [0.3, -1.0, 0], middle(truth) + [1.0, 2.0, 0]
    clicks = [{"camera": truth.names[0], "at": truth[truth.names[0]].project(one)[0].tolist()} for one in (origin, along)]
    same = act(client, session, act="world", origin=clicks[0], along_x=clicks[0])
    assert (same.status, "farther away" in same.json()["error"]) == (422, True)
    assert act(client, session, act="world", origin=clicks[0], along_x=clicks[1]).status == 200
    points = session.scene_file.parent / scene_of(session)["world"]["points"]
    motion = align_rig(truth, WorldTable(points=points)).motion
    moved = [motion.scale * motion.rotation @ one + motion.translation for one in (origin, along)]
    assert moved[0] == pytest.approx([0, 0, 0], abs=2e-3)
    assert moved[1] == pytest.approx([np.linalg.norm(along - origin), 0, 0], abs=2e-3)


@pytest.mark.parametrize("length_first", [False, True])
def test_a_marked_length_corrects_the_distance_of_the_two_clicks(client, session, truth, length_first):
    """The rig is a tenth too small: the frame's points must fit the one that the length will make."""
    small = truth.moved(np.eye(3), np.zeros(3), 0.9)
    write_rig(session.out / "rig.toml", Rig(small.cameras))
    first = truth.names[0]
    ends = [middle(truth) + offset for offset in ([0.3, -1.0, 0], [1.0, 2.0, 0])]
    clicks = [{"camera": first, "at": truth[first].project(one)[0].tolist()} for one in ends]
    world = {"act": "world", "origin": clicks[0], "along_x": clicks[1]}
    for one in [length(truth), world] if length_first else [world, length(truth)]:
        assert act(client, session, **one).status == 200
    rows = (session.scene_file.parent / scene_of(session)["world"]["points"]).read_text().splitlines()
    assert float(rows[2].split(",")[4]) == pytest.approx(np.linalg.norm(ends[1] - ends[0]), rel=2e-3)


def test_geometry_is_answered_by_the_rig(client, truth):
    marks = length(truth)
    found = client.post("/api/length", json.dumps(marks["points"]).encode()).json()
    assert found["metres"] == pytest.approx(marks["metres"], rel=1e-3)
    lines = client.post("/api/epipolar", json.dumps({"camera": "C1", "at": marks["points"]["C1"][0]}).encode()).json()["lines"]
    assert {one["camera"] for one in lines} == {"C2", "C3", "C4"}


def test_check_is_told_beside_each_camera(client, session):
    told = client.get("/api/check").json()
    assert [one["name"] for one in told["cameras"]] == ["C1", "C2", "C3", "C4"]
    text = session.scene_file.read_text()
    session.scene_file.write_text(text.replace("tracks/C2.txt", "tracks/gone.txt"))
    told = client.get("/api/check").json()
    assert [bool(one["faults"]) for one in told["cameras"]] == [False, True, False, False]


def test_people_of_the_nearest_frame_and_of_the_fullest_are_told(client, session):
    (session.out / "tracks").mkdir()
    rows = ((4, 1, 10), (9, 1, 11), (9, 2, 50))
    text = "".join(f"{frame},{who},{left},20,30,60,1,-1,-1,-1\n" for frame, who, left in rows)
    (session.out / "tracks" / "C1.txt").write_text(text)
    told = client.get("/api/people", "camera=C1&frame=5").json()
    assert (told["frame"], told["boxes"]) == (4, [[10.0, 20.0, 30.0, 60.0]])
    most = client.get("/api/people", "camera=C1").json()
    assert (most["frame"], len(most["boxes"]), most["first"], most["last"], most["fps"]) == (9, 2, 4, 9, 5.0)
    assert "has no video" in most["why"]


def test_a_run_is_found_by_its_files_after_the_server_was_ended(tmp_path):
    work = Work(tmp_path)
    work.folder.mkdir()
    assert work.status()["state"] == "none"
    progress = {"part": "north", "done": 64, "total": 300, "seconds": 4.1}
    events = [{"event": "begin"}, {"event": "progress", **progress}, {"event": "note", "text": "odd"}]
    (work.folder / EVENTS).write_text("".join(f"{json.dumps({'stage': 'processing videos', **one})}\n" for one in events))
    hold = "f = open(sys.argv[1], 'a'); fcntl.flock(f, fcntl.LOCK_EX); print('held', flush=True); sys.stdin.read()"
    command = [sys.executable, "-c", f"import sys, fcntl; {hold}", str(work.folder / RUN_LOCK)]
    with subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE) as other:
        other.stdout.readline()
        told = work.status()
        assert (told["state"], told["notes"], told["stages"][0]["parts"]) == ("running", ["odd"], {"north": [64, 300]})
        with pytest.raises(InputError, match="running already"):
            work.start(tmp_path / "scene.toml", "v")
        other.stdin.close()
    assert work.status()["state"] == "stopped"
    with (work.folder / EVENTS).open("a") as file:
        file.write("error: scene.toml: is not TOML\n")
    assert work.status()["error"] == "scene.toml: is not TOML"
    (work.folder / RESULT).write_text('{"verdict": "accepted"}')
    assert work.status()["state"] == "done"


def test_what_can_be_opened(session, tmp_path):
    opened = find_opened(session.scene_file)
    assert (opened.scene_file, opened.out.name) == (session.scene_file, "out")
    assert find_opened(session.scene_file.parent).scene_file == session.scene_file
    out = written_output(tmp_path / "site")
    assert find_opened(out).scene_file == tmp_path / "site" / "scene.toml"
    shutil.copytree(tmp_path / "site", tmp_path / "copy")
    with pytest.raises(InputError, match=r"passerby open SCENE -o .*copy/out"):
        find_opened(tmp_path / "copy" / "out")
    with pytest.raises(InputError, match="no such file"):
        find_opened(tmp_path / "nothing")
    (tmp_path / "empty").mkdir()
    with pytest.raises(InputError):
        find_opened(tmp_path / "empty")


def test_without_the_extra_the_command_names_it(monkeypatch, capsys, session):
    for name in [name for name in sys.modules if name.partition(".")[0] == "starlette" or name.startswith("passerby.page")]:
        monkeypatch.delitem(sys.modules, name)
    monkeypatch.setitem(sys.modules, "starlette", None)
    assert run(["open", str(session.scene_file), "--no-browser"]) == 2
    assert "pip install 'passerby[page]'" in capsys.readouterr().err
    assert not (session.out / FOLDER).exists()


def videos(folder, names, greys=(40,) * 20):
    """A film of 20 pictures a second for each name, each brighter than the one before."""
    for number, name in enumerate(names):
        with VideoWriter(folder / name, (64, 48), 20.0) as video:
            for grey in greys:
                video.write(np.full((48, 64, 3), grey + 30 * number, np.uint8))


def of_two(folder, first="A.mp4", second="B.mp4"):
    scene = folder / "scene.toml"
    scene.write_text(f'[cameras.A]\nvideo = "{first}"\n[cameras.B]\nvideo = "{second}"\n')
    return Session(scene, folder / "out")


def test_a_picture_is_that_of_its_frame(tmp_path):
    """The frame that is named is the one that is shown: a person is pointed at in it."""
    videos(tmp_path, ("A.mp4", "B.mp4"), range(5, 205, 5))
    client = Client(of_two(tmp_path))
    told = client.get("/api/people", "camera=A&frame=30").json()
    assert [told[key] for key in ("frame", "first", "last", "size", "why", "fps")] == [30, 1, 40, [64, 48], None, 20.0]
    answer = client.get("/picture", "camera=A&frame=30")
    assert (answer.headers["content-type"], answer.headers["x-frame"]) == ("image/jpeg", "30")
    picture = cv2.imdecode(np.frombuffer(answer.body, np.uint8), cv2.IMREAD_COLOR)
    assert picture.mean() == pytest.approx(150, abs=4)


def test_a_picture_of_one_camera_waits_for_no_other_camera(tmp_path, monkeypatch):
    videos(tmp_path, ("A.mp4", "B.mp4"))
    opened = []
    monkeypatch.setattr(pictures, "open_source", lambda source, name="": opened.append(name) or open_source(source, name))
    client = Client(of_two(tmp_path))
    assert client.get("/picture", "camera=A&frame=1").status == 200
    assert client.get("/api/people", "camera=A&frame=3").json()["why"] is None
    assert opened == ["A"]


def test_first_pictures_are_there_before_a_browser_asks(tmp_path):
    """One that cannot be had keeps no other camera's back."""
    videos(tmp_path, ("B.mp4",))
    session = of_two(tmp_path)
    assert session.pictures.known(session.version, "B", 1) is None
    prepare_pictures(session)
    known = session.pictures.known(session.version, "B", 1)
    assert Client(session).get("/picture", "camera=B&frame=1").body == known.jpeg
    session.scene_file.write_text("[cameras")
    prepare_pictures(session)


def test_recordings_in_pieces_count_from_their_common_wall_time(tmp_path):
    """Frame numbers of one camera depend on when the other one begins, as in a calibration: two seconds at 20 a second."""
    for name in ("A", "B"):
        (tmp_path / name).mkdir()
    videos(tmp_path, ("A/2024-05-01_10-00-00.mp4", "B/2024-05-01_10-00-02.mp4"))
    client = Client(of_two(tmp_path, "A", "B"))
    first, second = (client.get("/api/people", f"camera={name}").json()["first"] for name in ("A", "B"))
    assert second - first == 40


@pytest.mark.slow
def test_first_pictures_need_no_import_of_what_calibrates():
    """These imports take longer than the pictures; they come with the check of the scene, afterwards."""
    code = (
        "import sys, passerby.page.server as s; light = set(sys.modules); import passerby.page.app, passerby.page.session; "
        "print(sorted(light & {'numpy', 'cv2', 'starlette'}), "
        "sorted({'scipy.spatial', 'scipy.optimize', 'passerby.association', 'passerby.scene.check'} & set(sys.modules)))"
    )
    found = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert found.stdout.split("\n")[0] == "[] []"


@pytest.mark.slow
def test_a_prepared_calibration_writes_what_the_command_line_writes(simulated, session, tmp_path):
    """The process that was begun before the button is pressed gives the same bytes, holds the lock, and answers once."""
    served = Session(session.scene_file, tmp_path / "page", serves=True)
    client = Client(served)
    shutil.copytree(session.out, served.out)
    truth = read_rig(session.scene_file.parent / "truth.toml")
    assert act(client, served, **length(truth, metres=3.0)).status == 200
    waiting = served.work._waiting.process
    other = Work(served.out)
    assert not other.running()
    served.work.start(served.scene_file, served.version)
    assert served.work._process is waiting
    assert other.running()
    with pytest.raises(InputError, match="running already"):
        other.start(served.scene_file, served.version)
    waiting.wait(timeout=240)
    assert other.status()["state"] == "done"
    assert run(["calibrate", str(served.scene_file), "-o", str(tmp_path / "line")]) in (0, 3)
    for name in ("rig.toml", "calibration.json"):
        assert (served.out / name).read_bytes() == (tmp_path / "line" / name).read_bytes()


@pytest.mark.slow
def test_a_prepared_process_that_has_ended_is_replaced(session, tmp_path):
    work = Work(tmp_path / "out", prepares=True)
    work.prepare()
    first = work._waiting.process
    first.kill()
    first.wait(timeout=60)
    work.prepare()
    second = work._waiting.process
    assert second is not first
    second.kill()
    second.wait(timeout=60)
    work.start(tmp_path / "missing.toml", "v")
    assert work._process not in (first, second)
    work._process.wait(timeout=60)
    assert work.status()["state"] == "failed"
    assert "missing.toml" in work.status()["error"]


def test_a_run_that_cannot_be_noted_on_a_full_disk_does_not_go_on(tmp_path, monkeypatch):
    begun = []

    def full(path, _):
        raise cannot_write(path, OSError(errno.ENOSPC, os.strerror(errno.ENOSPC)))

    lasting = [sys.executable, "-c", "import time; time.sleep(100)"]
    monkeypatch.setattr(work, "_begin", lambda *_: begun.append(subprocess.Popen(lasting)) or begun[0])
    monkeypatch.setattr(work, "write_text", full)
    one = Work(tmp_path / "out")
    with pytest.raises(InputError, match=r"run\.json: cannot be written .*: make room there"):
        one.start(tmp_path / "scene.toml", "version")
    assert begun[0].poll() is not None
    assert not one.running()


def test_a_run_whose_words_a_full_disk_did_not_take_has_failed(tmp_path, monkeypatch):
    monkeypatch.setattr(work, "_begin", lambda *_: subprocess.Popen([sys.executable, "-c", "raise SystemExit(2)"]))
    one = Work(tmp_path / "out")
    one.start(tmp_path / "scene.toml", "version")
    while one.running():
        time.sleep(0.02)
    told = one.status()
    assert told["state"] == "failed"
    assert told["error"].startswith(f"{one.folder}: the calibration ended, but what it says could not be written: make room")
