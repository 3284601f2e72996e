"""Addresses of streams where a file is needed: the error says what to do, and no user name or password is repeated anywhere."""

import json
import traceback
from pathlib import Path

import pytest
from pydantic import ValidationError

from passerby.cli.main import run
from passerby.common.errors import EvidenceError, InputError
from passerby.common.text import not_a_file, remove_credentials
from passerby.interchange.storage.safe_parsing import FileFaults
from passerby.scene.scene import Scene
from passerby.scene.tables import CameraTable, SceneTable

ADDRESSES = [
    "rtsp://walter:hunter2@10.0.0.5:554/Streaming/Channels/101",
    "rtsp://walter:hunter2 with@signs@10.0.0.5/live",
    "rtsp://10.0.0.5:554/user=walter_password=hunter2_channel=1_stream=0.sdp",
    "http://10.0.0.5/video.cgi?user=walter&pwd=hunter2",
    "rtmp://10.0.0.5/bcs/channel0.bcs?channel=0&token=hunter2&user=walter",
    "ffmpeg:rtsp://walter:hunter2@10.0.0.5/live",
    "srt://10.0.0.5:9000?passphrase=x&user=walter&password=hunter2",
]
SECRETS = ("hunter2", "walter")


def scene_with(folder, line, table="cameras.C1"):
    text = {"cameras.C1": 'intrinsics = "rig.toml"\n', "cameras.C2": 'intrinsics = "rig.toml"\ntracks = "C2.txt"\n'}
    text[table] = text.get(table, "") + f"{line}\n"
    path = folder / "scene.toml"
    path.write_text("".join(f"[{name}]\n{content}" for name, content in text.items()))
    return path


def assert_kept_secret(*texts):
    for text in texts:
        for secret in SECRETS:
            assert secret not in text


@pytest.mark.parametrize("address", ADDRESSES)
def test_a_stream_is_answered_with_what_to_do_and_its_password_is_repeated_nowhere(tmp_path, capsys, monkeypatch, address):
    monkeypatch.chdir(tmp_path)
    scene = scene_with(tmp_path, f"video = {json.dumps(address)}")
    for command in (["check"], ["check", "--json"], ["calibrate", "-v"], ["monitor", "rig.toml"]):
        assert run([command[0], *command[1:], str(scene)]) == 2
        told = capsys.readouterr()
        assert_kept_secret(told.out, told.err)
        if command[0] != "monitor":
            assert "[cameras.C1] video: is the address of a stream" in told.err
            assert "record all cameras with `passerby record`" in told.err
            assert len(told.err.splitlines()) == 1
    for path in tmp_path.rglob("*"):
        if path.is_file() and path != scene:
            assert_kept_secret(path.read_text())
    for make in (
        lambda: Scene.load(scene),
        lambda: Scene.model_validate({"cameras": {"C1": {"intrinsics": "a", "video": address}}}),
        lambda: Scene.model_validate({"cameras": {"C1": {"intrinsics": "a", "vidio": address}}}),
        lambda: Scene.model_validate({"cameras": {address: {"intrinsics": "a"}}}),
        lambda: CameraTable(intrinsics="a", video=address),
        lambda: CameraTable(intrinsics="a", fps=address),
        lambda: CameraTable(intrinsics="a", video=Path(address.replace("//", "/"))),
    ):
        with pytest.raises((InputError, ValidationError)) as caught:
            make()
        assert_kept_secret(str(caught.value), "".join(traceback.format_exception(caught.value)))
        if isinstance(caught.value, ValidationError):
            assert_kept_secret(str(caught.value.errors()))


@pytest.mark.parametrize(
    ("line", "table"),
    [
        ('fps = "rtsp://walter:hunter2@h/x"', "cameras.C2"),
        ('tracks = "rtsp://walter:hunter2@h/x"', "cameras.C1"),
        ('"rtsp://walter:hunter2@h/x" = 1', "cameras.C1"),
        ('tracks = "a.txt"\nintrinsics = "b"\n[cameras."rtsp://walter:hunter2@a.longer.host"]\ntracks = "x"', "cameras.C2"),
        ('models = "https://walter:hunter2@h/x"', "perception"),
        ('mode = ["http://walter:hunter2@h/x"]', "association"),
    ],
)  # fmt: skip
def test_wherever_an_address_stands_in_a_scene_its_password_is_not_repeated(tmp_path, capsys, line, table):
    run(["check", str(scene_with(tmp_path, line, table))])
    told = capsys.readouterr()
    assert_kept_secret(told.out, told.err)


@pytest.mark.parametrize("command", ["init", "check", "calibrate", "track", "report", "export", "models fetch", "evaluate x"])
def test_an_address_on_the_command_line(tmp_path, capsys, monkeypatch, command):
    monkeypatch.chdir(tmp_path)
    assert run([*command.split(), ADDRESSES[0]]) == 2
    assert_kept_secret(*capsys.readouterr())
    if command == "init":
        run(["init", ADDRESSES[2]])
        assert "is the address of a stream (rtsp://...)" in capsys.readouterr().err
    assert not list(tmp_path.iterdir())


def test_devices_and_files_by_address_are_answered_and_other_text_stays():
    assert "`passerby record`" in (not_a_file("/dev/video0") or "")
    assert "write the path of the file instead" in (not_a_file("file:///a/b.mp4") or "")
    with pytest.raises(ValidationError, match="is a device: write it as `stream`"):
        CameraTable(intrinsics="a", video="/dev/video0")
    assert remove_credentials("see https://example.org/a?b=c: no") == "see https://example.org/a?b=c: no"
    assert SceneTable(name="from https://example.org/page").name == "from https://example.org/page"
    assert remove_credentials("a rtsp://u:p@h/x b") == "a rtsp://...@h/x b"
    faults = FileFaults([f"x: {ADDRESSES[0]}", f"y: {ADDRESSES[1]}"])
    assert_kept_secret(str(faults), *faults.faults)
    assert_kept_secret(str(EvidenceError(ADDRESSES[0])), *EvidenceError("x", (ADDRESSES[0],)).reasons)


@pytest.mark.parametrize(
    "text",
    [
        "videos/north.mp4", "C:/videos/a@b.mp4", "/home/me@work/dev/video0.mp4", "a: /b@c", "../x:y/z@w.mp4", "password=1.mp4",
        "http.mp4", "out/rtsp/cam@2.mp4",
    ],
)  # fmt: skip
def test_paths_stay_as_they_are(text):
    assert remove_credentials(text) == text
    assert not_a_file(text) is None
    assert str(CameraTable(intrinsics="a", video=text).video) == str(Path(text))
    assert str(InputError(text)) == text


def test_a_bugs_traceback_repeats_no_password(monkeypatch, capsys):
    def broken(path):
        raise RuntimeError(f"cannot do anything with {ADDRESSES[0]}")

    monkeypatch.setattr("passerby.scene.check.check_scene", broken)
    assert run(["check", "scene.toml"]) == 1
    told = capsys.readouterr().err
    assert "RuntimeError: cannot do anything with rtsp://...@10.0.0.5" in told
    assert_kept_secret(told)
