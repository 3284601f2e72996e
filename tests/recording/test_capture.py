"""Cameras on loopback are recorded, in real time, and calibrated."""

import json
import os
import signal
import subprocess
import sys
import threading
import time
from contextlib import ExitStack

import av
import cv2
import numpy as np
import pytest

from passerby.cli.main import run
from passerby.common.errors import InputError
from passerby.evaluation.metrics import compare
from passerby.interchange.rig_toml import read_rig
from passerby.recording.capture import CaptureOptions, record
from passerby.recording.pieces import PieceWriter
from passerby.recording.settings import Stream
from sources.stream_servers import Film, mjpeg_camera, rtsp_camera
from support.scenes.puppet_videos import film as film_puppets
from support.scenes.puppet_videos import puppets

pytestmark = [pytest.mark.slow, pytest.mark.system]
FPS, SECONDS = 10, 30
LOGIN = "keeper:t0psecret"


def picture(index):
    """Its number can be read from where the bar stands."""
    image = np.full((120, 320, 3), 30, np.uint8)
    image[:, index : index + 8] = 255
    return image


def bar(image):
    return int(np.argmax(image[60].max(axis=1) > 140))


@pytest.fixture(scope="module")
def film(tmp_path_factory):
    path = tmp_path_factory.mktemp("film") / "film.mp4"
    with av.open(str(path), "w") as target:
        stream = target.add_stream("libx264", rate=FPS, options={"g": "10", "keyint_min": "10", "bf": "0", "crf": "10"})
        stream.width, stream.height, stream.pix_fmt = 320, 120, "yuv420p"
        for index in range(FPS * SECONDS):
            for packet in stream.encode(av.VideoFrame.from_ndarray(picture(index), format="bgr24")):
                target.mux(packet)
        for packet in stream.encode(None):
            target.mux(packet)
    return Film.read(path)


def stream_of(name, port, login=LOGIN):
    return Stream(name, f"rtsp://{login}@127.0.0.1:{port}/live")


def shown(piece):
    """(seconds since 1970, number of the picture) of all pictures of a piece."""
    with av.open(str(piece.path)) as container:
        return [
            (piece.begin_s + float(frame.pts * frame.time_base), bar(frame.to_ndarray(format="bgr24")))
            for frame in container.decode(video=0)
        ]


def off_s(recording, camera):
    """How late the pictures' times are, by the camera's own begin."""
    pictures = [one for piece in recording.pieces for one in shown(piece)]
    return np.array([seconds - camera.began - number / FPS for seconds, number in pictures])


def test_cameras_are_recorded_in_pieces_with_their_wall_times(film, tmp_path):
    with rtsp_camera(film, password=LOGIN) as (first, one), rtsp_camera(film, clock_off_s=float("nan")) as (second, other):
        streams = stream_of("north", first), stream_of("gate", second)
        found = record(streams, tmp_path, CaptureOptions(7.0, piece_s=2.0))
    north, gate = found.cameras
    assert found.ended == "time"
    assert (north.clock, gate.clock) == ("sender", "arrival")
    assert min(north.seconds, gate.seconds) > 3
    assert len(north.pieces) > 1
    assert not north.gaps
    assert np.abs(off_s(north, one)).max() < 0.02
    assert np.abs(off_s(gate, other)).max() < 0.5
    assert sorted(path.name for path in (tmp_path / "north").iterdir()) == [piece.path.name for piece in north.pieces]


def test_a_connection_that_breaks_is_made_anew_and_the_gap_is_stated(film, tmp_path):
    with rtsp_camera(film, breaks_s=(5.0,)) as (port, camera):
        found = record((stream_of("a", port),), tmp_path, CaptureOptions(12.0, piece_s=2.0))
    (recording,) = found.cameras
    assert len(recording.gaps) == 1
    assert 4.0 < recording.gaps[0].from_s - camera.began < 5.2
    assert 0.5 < recording.gaps[0].until_s - recording.gaps[0].from_s < 5
    assert np.abs(off_s(recording, camera)).max() < 0.02


def test_a_camera_clock_that_is_wrong_by_an_hour_is_stated_and_not_used(film, tmp_path):
    with rtsp_camera(film, clock_off_s=3600.0) as (port, camera):
        found = record((stream_of("a", port),), tmp_path, CaptureOptions(9.0, piece_s=4.0))
    assert found.cameras[0].clock == "arrival"
    assert found.cameras[0].unset_s == pytest.approx(3600, abs=1)
    assert np.abs(off_s(found.cameras[0], camera)).max() < 0.5


def test_a_camera_that_sends_nothing_for_long_after_it_was_connected_to_is_recorded(film, tmp_path):
    """The first picture comes at second 6, amid the connection's end at 4 without one and the host's being given up at 8."""
    with rtsp_camera(film, silent_s=5.5) as (port, camera):
        found = record((stream_of("a", port),), tmp_path, CaptureOptions(12.0, piece_s=1.0, timeout_s=4.0))
    (recording,) = found.cameras
    assert recording.seconds > 2
    assert np.abs(off_s(recording, camera)).max() < 0.02


def test_what_no_file_can_hold_is_a_fault_of_the_camera_not_of_the_folder(film, tmp_path, monkeypatch):
    """As if its pictures had no size."""
    monkeypatch.setattr(PieceWriter, "_size_known", lambda *_: True)
    with rtsp_camera(film, silent_s=5.5) as (port, _), pytest.raises(InputError, match=r"camera a .*Matroska"):
        record((stream_of("a", port),), tmp_path, CaptureOptions(9.0, piece_s=1.0, timeout_s=4.0))
    assert not list(tmp_path.rglob("*.part"))


def test_jpeg_pictures_over_http(tmp_path):
    pictures = [cv2.imencode(".jpg", picture(index))[1].tobytes() for index in range(80)]
    with mjpeg_camera(pictures, FPS) as port:
        found = record((Stream("a", f"http://127.0.0.1:{port}/x.mjpg"),), tmp_path, CaptureOptions(4.0, piece_s=1.0))
    pictures = [one for piece in found.cameras[0].pieces for one in shown(piece)]
    numbers = [number for _, number in pictures]
    assert len(found.cameras[0].pieces) > 1
    assert numbers == list(range(numbers[0], numbers[0] + len(numbers)))
    seconds = np.array([second for second, _ in pictures])
    np.testing.assert_allclose(np.diff(seconds).mean(), 1 / FPS, rtol=0.2)


@pytest.mark.parametrize("login", ["keeper:wr0ngsecret", "", LOGIN])
def test_a_camera_that_cannot_be_reached_is_named_without_its_password(film, tmp_path, login):
    with rtsp_camera(film, password=LOGIN) as (port, _):
        if login == LOGIN:
            port = 9  # nothing listens there
        with pytest.raises(InputError, match=r"camera a \(rtsp://127\.0\.0\.1:\d+\): ") as raised:
            record((stream_of("a", port, login or "x"),), tmp_path, CaptureOptions(20.0, timeout_s=2.0))
    assert "secret" not in str(raised.value)
    assert "keeper" not in str(raised.value)


def test_all_cameras_that_refuse_the_user_are_reported_and_not_tried_again(film, tmp_path):
    with rtsp_camera(film, password=LOGIN) as (first, one), rtsp_camera(film, password=LOGIN) as (second, other):
        streams = stream_of("a", first, "keeper:wr0ng"), stream_of("b", second, "keeper:wr0ng")
        with rtsp_camera(film) as (third, _), pytest.raises(InputError) as raised:
            record((*streams, stream_of("c", third)), tmp_path, CaptureOptions(20.0, timeout_s=10.0))
    told = str(raised.value)
    assert told.count("401 Unauthorized") == 2
    assert "camera a (" in told
    assert "camera b (" in told
    assert "camera c (" not in told
    assert "user name and password" in told
    assert (len(one.connections), len(other.connections)) == (1, 1)


def test_the_others_go_on_if_the_user_says_so(film, tmp_path):
    told = []

    def tell(stage, done=0, total=0, *, part=""):
        pass

    tell.warning = told.append
    with rtsp_camera(film) as (port, _):
        streams = stream_of("a", port), stream_of("gone", 9)
        found = record(streams, tmp_path, CaptureOptions(5.0, piece_s=1.0, timeout_s=1.0, without_missing=True), tell)
    assert found.cameras[0].seconds > 2
    assert not found.cameras[1].pieces
    assert len(told) == 1
    assert "camera gone" in told[0]


def test_a_recording_ends_when_it_is_as_large_as_allowed_or_stopped_with_the_piece_at_work(film, tmp_path):
    with rtsp_camera(film) as (port, _):
        found = record((stream_of("a", port),), tmp_path / "large", CaptureOptions(20.0, piece_s=1.0, most_bytes=1))
    assert found.ended == "space"
    assert 1 <= len(found.cameras[0].pieces) <= 3
    stop = threading.Event()
    with rtsp_camera(film) as (port, _):
        threading.Timer(5.0, stop.set).start()
        found = record((stream_of("a", port),), tmp_path / "stopped", CaptureOptions(60.0, piece_s=60.0), stop=stop)
    assert found.ended == "stopped"
    assert found.cameras[0].seconds > 1
    assert not list(tmp_path.rglob("*.part"))


@pytest.mark.parametrize("sign", [signal.SIGINT, signal.SIGKILL])
def test_the_command_line_keeps_what_is_finished(film, tmp_path, sign):
    out = tmp_path / "out"
    with rtsp_camera(film, password=LOGIN) as (port, _):
        hosts = {"a": "127.0.0.1", "b": "localhost"}  # one address of two cameras is refused
        cameras = (f'[cameras.{name}]\nstream = "rtsp://${{LOGIN}}@{host}:{port}/live"\n' for name, host in hosts.items())
        (tmp_path / "cameras.toml").write_text("".join(cameras))
        arguments = [sys.executable, "-m", "passerby", "record", str(tmp_path / "cameras.toml"), "-o", str(out), "--piece", "1"]
        with subprocess.Popen(
            arguments, env=os.environ | {"LOGIN": LOGIN}, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
        ) as run:
            until = time.monotonic() + 60
            while len(list(out.glob("a/*.mkv"))) < 2 and time.monotonic() < until and run.poll() is None:
                time.sleep(0.05)
            run.send_signal(sign)
            shown_on, errors = run.communicate(timeout=60)
    pieces = sorted(out.glob("a/*.mkv"))
    assert len(pieces) >= 2
    for piece in pieces:
        with av.open(str(piece)) as container:
            # The last one may have been cut short by the signal.
            assert sum(1 for _ in container.decode(video=0)) >= (1 if piece == pieces[-1] else 5)
    assert (out / "scene.toml").is_file()
    assert "secret" not in shown_on + errors + (out / "scene.toml").read_text()
    if sign == signal.SIGINT:
        assert run.returncode == 130
        assert not list(out.rglob("*.part"))
        told = json.loads((out / "recording.json").read_text())
        assert told["ended"] == "stopped"
        assert [camera["name"] for camera in told["cameras"]] == ["a", "b"]


def test_streams_become_a_rig(tmp_path):
    """Three cameras, recorded for a minute and calibrated: one breaks off three times, the clock of another is off by 2 s."""
    faults = {"C1": {}, "C2": {"breaks_s": (15.0, 33.0, 50.0)}, "C3": {"clock_off_s": 2.0}}
    film_puppets(puppets(75.0, 12.5, 3, 6, seed=2), tmp_path, key_every=round(12.5))
    truth = read_rig(tmp_path / "truth.toml")
    began, cameras, site = time.time(), "", tmp_path / "site"
    with ExitStack() as stack:
        for name in truth.names:
            server = rtsp_camera(Film.read(tmp_path / f"{name}.mp4"), password=LOGIN, began=began, **faults[name])
            port, _ = stack.enter_context(server)
            cameras += f'[cameras.{name}]\nstream = "rtsp://{LOGIN}@127.0.0.1:{port}/"\nintrinsics = "rig.toml"\n'
        (tmp_path / "cameras.toml").write_text(cameras)
        assert run(["record", str(tmp_path / "cameras.toml"), "-o", str(site), "--seconds", "60"]) == 0
    recorded = json.loads((site / "recording.json").read_text())
    assert [len(camera["gaps"]) for camera in recorded["cameras"]] == [0, 3, 0]
    scene, out = site / "scene.toml", tmp_path / "out"
    scene.write_text(scene.read_text() + '\n[perception]\ndetector = "background"\nembedder = "stripes"\nkeypoints = "none"\n')
    assert run(["calibrate", str(scene), "-o", str(out), "--no-report"]) in (0, 3)
    rig, document = read_rig(out / "rig.toml"), json.loads((out / "calibration.json").read_text())
    # The same minute of the files gives 45 mm. What is recorded in real time is never quite the same, and in so short a film
    # puppets are missed too often for the verdict to be the same each time.
    assert len(rig.posed()) == 3
    assert compare(rig, truth).similarity.mean_position_mm < 150
    offsets = np.array([camera["time_offset_s"] for camera in document["cameras"]])
    np.testing.assert_allclose(offsets - offsets[0], [0, 0, -2], atol=0.05)
    written = "".join(path.read_text() for path in site.glob("*.*") if path.is_file()) + json.dumps(document)
    assert "t0psecret" not in written
