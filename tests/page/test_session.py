"""What the server tells of a scene: faults, people, pictures, findings, runs; and what can be opened."""

import errno
import json
import os
import shutil
import subprocess
import sys
import time

import numpy as np
import pytest

from passerby.cli.main import run
from passerby.common.errors import InputError
from passerby.interchange.calibration_json import CalibrationDocument, CameraEntry, DiagnosticEntry, write_document
from passerby.interchange.rig_toml import read_rig
from passerby.interchange.storage.atomic import cannot_write
from passerby.interchange.video_writer import VideoWriter
from passerby.page import pictures, work
from passerby.page.app import prepare_pictures
from passerby.page.server import find_opened
from passerby.page.session import Session, outcome
from passerby.page.work import EVENTS, FOLDER, RESULT, RUN_LOCK, Work
from passerby.perception.sources.recording import open_source
from support.scenes.output_folders import written_output

from .conftest import Client, act, decoded
from .test_acts import length


def test_faults_and_people_are_told_of_each_camera(client, session):
    told = client.get("/api/check").json()
    assert [one["name"] for one in told["cameras"]] == ["C1", "C2", "C3", "C4"]
    text = session.scene_file.read_text()
    session.scene_file.write_text(text.replace("tracks/C2.txt", "tracks/gone.txt"))
    told = client.get("/api/check").json()
    assert [bool(one["faults"]) for one in told["cameras"]] == [False, True, False, False]
    (session.out / "tracks").mkdir()
    rows = ((4, 1, 10), (9, 1, 11), (9, 2, 50))
    text = "".join(f"{frame},{who},{left},20,30,60,1,-1,-1,-1\n" for frame, who, left in rows)
    (session.out / "tracks" / "C1.txt").write_text(text)
    told = client.get("/api/people", "camera=C1&frame=5").json()
    assert (told["frame"], told["boxes"]) == (4, [[10.0, 20.0, 30.0, 60.0]])
    most = client.get("/api/people", "camera=C1").json()
    assert (most["frame"], len(most["boxes"]), most["first"], most["last"], most["fps"]) == (9, 2, 4, 9, 5.0)
    assert "has no video" in most["why"]


def test_a_finding_stands_beside_every_camera_that_it_names_and_one_of_all_cameras_at_the_top(tmp_path):
    said = {"alone": ("B",), "pair": ("A", "B"), "all": ("A", "B", "C"), "scene": ()}
    told = tuple(DiagnosticEntry(code="x", severity="doubt", cameras=names, text=text) for text, names in said.items())
    cameras = tuple(CameraEntry(name=name) for name in "ABC")
    write_document(tmp_path, CalibrationDocument(verdict="doubtful", reasons=tuple(said), diagnostics=told, cameras=cameras))
    found = outcome(tmp_path)
    assert {one["name"]: one["problems"] for one in found["cameras"]} == {"A": ["pair"], "B": ["alone", "pair"], "C": []}
    assert found["reasons"] == [*list(said)[:3], "and 1 more: see the report"]


def test_a_scene_file_and_folders_can_be_opened(session, tmp_path):
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
        (folder / name).parent.mkdir(exist_ok=True)
        with VideoWriter(folder / name, (64, 48), 20.0) as video:
            for grey in greys:
                video.write(np.full((48, 64, 3), grey + 30 * number, np.uint8))


def of_two(folder, first="A.mp4", second="B.mp4"):
    scene = folder / "scene.toml"
    scene.write_text(f'[cameras.A]\nvideo = "{first}"\n[cameras.B]\nvideo = "{second}"\n')
    return Session(scene, folder / "out")


def test_a_picture_is_that_of_its_frame_and_waits_for_no_other_camera(tmp_path, monkeypatch):
    """The frame that is named is the one that is shown: a person is pointed at in it."""
    videos(tmp_path, ("A.mp4", "B.mp4"), range(5, 205, 5))
    opened = []
    monkeypatch.setattr(pictures, "open_source", lambda source, name="": opened.append(name) or open_source(source, name))
    client = Client(of_two(tmp_path))
    told = client.get("/api/people", "camera=A&frame=30").json()
    assert [told[key] for key in ("frame", "first", "last", "size", "why", "fps")] == [30, 1, 40, [64, 48], None, 20.0]
    answer = client.get("/picture", "camera=A&frame=30")
    assert (answer.headers["content-type"], answer.headers["x-frame"]) == ("image/jpeg", "30")
    assert decoded(answer.body).mean() == pytest.approx(150, abs=4)
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
    ended = []
    for _ in range(2):
        work.prepare()
        ended.append(work._waiting.process)
        ended[-1].kill()
        ended[-1].wait(timeout=60)
    assert ended[0] is not ended[1]
    work.start(tmp_path / "missing.toml", "v")
    assert work._process not in ended
    work._process.wait(timeout=60)
    assert work.status()["state"] == "failed"
    assert "missing.toml" in work.status()["error"]


def test_a_full_disk_stops_a_run_that_cannot_be_noted_and_fails_one_whose_words_are_lost(tmp_path, monkeypatch):
    begun, programs = [], ["import time; time.sleep(100)", "raise SystemExit(2)"]

    def full(path, _):
        raise cannot_write(path, OSError(errno.ENOSPC, os.strerror(errno.ENOSPC)))

    def begin(*_):
        begun.append(subprocess.Popen([sys.executable, "-c", programs[len(begun)]]))
        return begun[-1]

    monkeypatch.setattr(work, "_begin", begin)
    one = Work(tmp_path / "out")
    with monkeypatch.context() as patch:
        patch.setattr(work, "write_text", full)
        with pytest.raises(InputError, match=r"run\.json: cannot be written .*: make room there"):
            one.start(tmp_path / "scene.toml", "version")
    assert begun[0].poll() is not None
    assert not one.running()
    one.start(tmp_path / "scene.toml", "version")
    while one.running():
        time.sleep(0.02)
    told = one.status()
    assert told["state"] == "failed"
    assert told["error"].startswith(f"{one.folder}: the calibration ended, but what it says could not be written: make room")
