"""Files of cameras and scenes whose videos are streams: read, and recorded once, without an address in anything written."""

import json
import shutil
from dataclasses import replace
from functools import partial

import pytest

import passerby
from passerby.cli.commands.record import record_if_needed as make_recording
from passerby.cli.main import run
from passerby.common.errors import InputError
from passerby.common.progress import ProgressForm
from passerby.core.cameras import Rig
from passerby.interchange.rig_toml import write_rig
from passerby.recording import scene_streams
from passerby.recording.capture import CameraRecording, Recording, record
from passerby.recording.scene_streams import RECORDING_FILE, make_recorded_scene, read_streamed, record_scene
from passerby.scene.scene import Scene
from support.scenes.puppet_videos import film, puppets

SECRETS = ("walter", "hunter2")
ADDRESS = "rtsp://walter:hunter2@10.0.0.12:554/live?password=hunter2"
RECORDING = "[recording]\nseconds = 30\n"


@pytest.fixture(scope="module")
def filmed(tmp_path_factory):
    folder = tmp_path_factory.mktemp("filmed")
    film(puppets(4.0, 5.0, 2, 3), folder)
    return folder


@pytest.fixture
def folder(filmed, tmp_path):
    shutil.copy(filmed / "rig.toml", tmp_path / "rig.toml")
    return tmp_path


def scene(folder, video=ADDRESS, extra=RECORDING):
    text = "".join(
        f'[cameras.{name}]\nintrinsics = "rig.toml"\nvideo = "{one}"\n' for name, one in (("C1", video), ("C2", "/dev/video0"))
    )
    path = folder / "scene.toml"
    perception = '[perception]\ndetector = "background"\nembedder = "stripes"\nkeypoints = "none"\n'
    path.write_text(f"{text}{extra}{perception}[association]\nmax_offset_s = 0\n")
    return path


def recorded(folder, filmed, cameras=("C1", "C2")):
    """What a recording leaves."""
    for name in cameras:
        (folder / name).mkdir(parents=True)
        shutil.copy(filmed / f"{name}.mp4", folder / name / "20261122T080000.000.mp4")
    listed(folder, {name: [{"file": "x"}] for name in cameras})
    return folder


def listed(folder, pieces):
    rows = [{"name": name, "pieces": own} for name, own in pieces.items()]
    (folder / RECORDING_FILE).write_text(json.dumps({"cameras": rows}))


def assert_kept_secret(folder, *texts):
    written = [path.read_text(errors="replace") for path in folder.rglob("*") if path.is_file() and path.name != "scene.toml"]
    for secret in SECRETS:
        assert not any(secret in text for text in (*texts, *written))


def forbid_recording(monkeypatch):
    def record(*_, **__):
        raise AssertionError("nothing is to be recorded")

    monkeypatch.setattr(scene_streams, "record", record)


def test_streams_become_folders_of_a_recording(folder, filmed):
    streamed = read_streamed(scene(folder))
    assert [stream.address for stream in streamed.streams] == [ADDRESS, "/dev/video0"]
    assert (streamed.seconds, streamed.folder_for(folder / "out")) == (30.0, folder / "out" / "recording")
    found = make_recorded_scene(streamed, recorded(folder / "out" / "recording", filmed))
    assert [str(table.video) for table in found.cameras.values()] == ["out/recording/C1", "out/recording/C2"]
    assert not any(secret in repr(streamed) + found.model_dump_json() for secret in SECRETS)
    # Variables of a file of secrets, and another folder.
    (folder / "secrets.env").write_text("WHO=walter\nWORD=hunter2\n")
    path = scene(folder, "rtsp://${WHO}:${WORD}@10.0.0.12/", f'{RECORDING}secrets = "secrets.env"\nfolder = "kept"\n')
    streamed = read_streamed(path, {})
    assert streamed.streams[0].address == "rtsp://walter:hunter2@10.0.0.12/"
    assert streamed.folder_for(folder / "out") == folder / "kept"
    # Scenes of files; one says how long to record all the same.
    assert read_streamed(scene(folder, "C1.mp4", "")) is None
    assert read_streamed(folder / "missing.toml") is None
    path = scene(folder, "C1.mp4")
    assert [stream.camera for stream in read_streamed(path).streams] == ["C2"]
    path.write_text(path.read_text().replace('"/dev/video0"', '["a.mp4", "b.mp4"]'))
    assert read_streamed(path) is None


@pytest.mark.parametrize("command", ["check", "calibrate"])
@pytest.mark.parametrize(
    ("video", "extra", "message"),
    [
        (ADDRESS, "", "or add [recording] seconds = 600: then `passerby calibrate` records it first"),
        (ADDRESS, "[recording]\nfolder = 'x'\n", "[recording]"),
        (ADDRESS, "[recording]\nseconds = 0\n", "[recording] seconds"),
        (ADDRESS, "[recording]\nseconds = 5\nlength = 3\n", "[recording]: unknown key 'length'"),
        ("rtsp://walter:hunter2@", RECORDING, "names no host"),
        ("rtsp://${NOT_SET_HERE}:hunter2@h/", RECORDING, "${NOT_SET_HERE} is not set"),
        (ADDRESS, f"{RECORDING}secrets = 'none.env'\n", "none.env"),
        (ADDRESS, f"{RECORDING}[solver]\nmethod = 'guess'\n", "[solver] method"),
    ],
)
def test_what_is_wrong_is_one_error_without_a_password(folder, capsys, monkeypatch, command, video, extra, message):
    forbid_recording(monkeypatch)
    path = scene(folder, video, extra)
    assert run([command, str(path), *(["-o", str(folder / "out")] if command == "calibrate" else [])]) == 2
    said = capsys.readouterr()
    assert message in said.err
    assert_kept_secret(folder, said.out, said.err)


def test_a_check_says_what_would_be_recorded_and_finds_other_faults(folder, capsys, monkeypatch):
    forbid_recording(monkeypatch)
    assert run(["check", "--json", str(scene(folder))]) == 0
    said = capsys.readouterr()
    found = json.loads(said.out)
    told = [one for one in found["diagnostics"] if one["code"] == "stream_unrecorded"]
    assert [one["cameras"] for one in told] == [["C1"], ["C2"]]
    assert "rtsp://10.0.0.12:554" in told[0]["text"]
    assert_kept_secret(folder, said.out, said.err)
    assert not [one for one in found["diagnostics"] if one["code"] == "frame_rate_missing"]
    write_rig(folder / "rig.toml", Rig(()))
    for command in (["check"], ["calibrate", "-o", str(folder / "out")]):
        assert run([*command, str(scene(folder))]) == 2
        assert "rig.toml" in capsys.readouterr().err


def recorder(filmed, made, monkeypatch):
    """What `record` does, without a camera."""

    def record(streams, place, options, tell, stop):
        made.append([stream.address for stream in streams])
        assert (options.seconds, options.without_missing) == (30.0, False)
        recorded(place, filmed)
        return Recording(tuple(CameraRecording(stream.camera, (), None, None, None) for stream in streams), "time")

    monkeypatch.setattr(scene_streams, "record", record)
    monkeypatch.setattr(scene_streams, "write_recording", lambda *_: None)


def test_a_recording_is_made_once(folder, filmed, capsys, monkeypatch):
    made = []
    recorder(filmed, made, monkeypatch)
    streamed = read_streamed(scene(folder))
    first, second = (make_recording(streamed, folder / "out", False, ProgressForm.auto) for _ in range(2))
    assert (made, first.cameras) == ([[ADDRESS, "/dev/video0"]], second.cameras)
    assert "the recording that is there is used; to record anew, remove that folder" in capsys.readouterr().err


@pytest.mark.slow
@pytest.mark.system
def test_nothing_of_a_whole_run_repeats_an_address(folder, filmed, capsys, monkeypatch):
    made = []
    recorder(filmed, made, monkeypatch)
    out = folder / "out"
    for _ in range(2):
        assert run(["calibrate", "-v", str(scene(folder)), "-o", str(out)]) in (0, 3)
    assert len(made) == 1
    said = capsys.readouterr()
    document = json.loads((out / "calibration.json").read_text())
    assert document["wall_clock_origin"] == "2026-11-22T08:00:00"
    assert_kept_secret(out, said.out, said.err)


def test_a_recording_that_was_stopped_is_kept_and_not_calibrated(folder, capsys, monkeypatch):
    monkeypatch.setattr(scene_streams, "record", lambda *_: Recording((), "stopped"))
    assert run(["calibrate", str(scene(folder)), "-o", str(folder / "out")]) == 130
    assert "was stopped before its time" in capsys.readouterr().err
    assert not list((folder / "out").rglob(RECORDING_FILE))


def test_a_recording_of_other_cameras_is_refused(folder, filmed):
    streamed = read_streamed(scene(folder))
    place = recorded(folder / "out" / "recording", filmed, ("C1",))
    for rows, message in (
        ({"C1": [{"file": "x"}]}, "a recording without camera C2 is there: to record anew, remove"),
        ({"C1": [1], "C2": []}, "nothing was recorded of camera C2"),
        (None, "is not the list of a recording"),
    ):
        listed(place, rows) if rows else (place / RECORDING_FILE).write_text("[]")
        with pytest.raises(InputError, match=message):
            make_recorded_scene(streamed, place)


def test_functions_and_monitor_refuse_streams_in_one_line(folder, capsys, monkeypatch):
    """Only the commands that calibrate and check know what to do with them."""
    forbid_recording(monkeypatch)
    path = scene(folder)
    said = "[recording] seconds counts only for the commands `passerby calibrate` and `passerby check`"
    for function in (passerby.calibrate, partial(passerby.monitor, folder / "rig.toml"), Scene.load):
        with pytest.raises(InputError) as raised:
            function(path)
        assert said in str(raised.value)
        assert "or add" not in str(raised.value)
        assert "hunter2" not in str(raised.value)
    assert run(["monitor", str(folder / "rig.toml"), str(path)]) == 2
    told = capsys.readouterr().err
    assert said in told
    assert len(told.splitlines()) == 1
    assert_kept_secret(folder, told)


def test_a_camera_that_does_not_answer_is_named_with_what_the_scene_file_allows(folder, monkeypatch):
    def impatient(streams, place, options, *others):
        return record(streams, place, replace(options, timeout_s=1.0), *others)

    monkeypatch.setattr(scene_streams, "record", impatient)
    path = scene(folder, "rtsp://walter:hunter2@127.0.0.1:9/live")
    with pytest.raises(InputError, match=r"camera C\d \(.*with without_missing = true under \[recording\] in .*scene\.toml"):
        record_scene(read_streamed(path), folder / "out")
