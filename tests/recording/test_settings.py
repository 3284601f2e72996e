"""A file of cameras to record: its addresses and secrets, the scene file made of it, options, and the time of what arrives."""

import pytest

from passerby.common.errors import InputError
from passerby.recording.capture import CaptureOptions
from passerby.recording.pieces import WallClock
from passerby.recording.scene_streams import write_scene_file
from passerby.recording.settings import read_plan
from passerby.scene.scene import Scene

SECRET = "s3cr&t@pw"


def plan_of(folder, text, environment=None):
    path = folder / "cameras.toml"
    path.write_text(text)
    return read_plan(path, environment or {})


def test_user_names_and_passwords_come_from_the_environment_or_a_file(tmp_path):
    (tmp_path / "secrets.env").write_text(f"# of the cameras\nPASSWORD='{SECRET}'\n\n")
    plan = plan_of(
        tmp_path,
        '[recording]\nsecrets = "secrets.env"\n[cameras.north]\nstream = "rtsp://${USER_NAME}:${PASSWORD}@host:554/a?b=1"\n'
        'hfov_deg = 90\n[cameras.gate]\nstream = "/dev/video0"\n[scene]\nname = "yard"\n',
        {"USER_NAME": "admin"},
    )
    north, gate = plan.streams
    assert north.address == f"rtsp://admin:{SECRET}@host:554/a?b=1"
    assert (north.shown, gate.shown) == ("rtsp://host:554", "/dev/video0")
    for text in (repr(north), str(north), repr(plan), north.hidden(f"cannot open {north.address} for admin:{SECRET}")):
        assert SECRET not in text
        assert "admin" not in text
    assert plan.cameras["north"] == {"hfov_deg": 90}


CAMERA = "[cameras.a]\nstream = 'rtsp://h/a'\n"


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "names no cameras"),
        ("[cameras.a]\nstrem = 'rtsp://h/a'\n", "has no stream"),
        (f"{CAMERA}[cameras.b]\nstream = 'rtsp://h/a'\n", r"\[cameras.b\] stream: its address is that of camera a: give each"),
        ("[cameras.a]\nstream = 'rtsp://u:hidden@'\n", "names no host"),
        ("[cameras.a]\nstream = 'ftp://u:hidden@h/a'\n", "is no address that can be recorded"),
        ("[cameras.a]\nstream = 'hidden.mp4'\n", "is no address that can be recorded"),
        ("[cameras.a]\nstream = 3\n", "is not a text"),
        ("[cameras.a]\nstream = 'rtsp://${NOBODY}@h/a'\n", r"\$\{NOBODY\} is not set"),
        (f"{CAMERA}transport = 'pigeon'\n", 'write "tcp" or "udp"'),
        ("[cameras.'../a']\nstream = 'rtsp://h/a'\n", "cannot be that of a folder"),
        (f"[recording]\nsecret = 'x'\n{CAMERA}", "unknown; the only key is secrets"),
        (f"[recording]\nsecrets = 'none.env'\n{CAMERA}", "none.env"),
        (f"[recording]\nsecrets = 's.env'\n{CAMERA}", "line 2 is not NAME=VALUE"),
    ],
)
def test_what_is_wrong_with_a_file_of_cameras_is_named_without_its_secrets(tmp_path, text, message):
    (tmp_path / "s.env").write_text("A=1\nhidden\n")
    with pytest.raises(InputError, match=message) as raised:
        plan_of(tmp_path, text)
    assert "hidden" not in str(raised.value)


def test_the_scene_file_is_there_before_anything_is_recorded(tmp_path):
    """And names intrinsics from the recording's folder: the file of cameras may lie anywhere, and so may what it names."""
    text = "[cameras.a]\nstream='rtsp://u:hidden@h/a'\nhfov_deg=90\n[cameras.b]\nstream='rtsp://h/b'\n[scene]\nname='yard'\n"
    plan = plan_of(tmp_path, text)
    path = write_scene_file(plan, tmp_path / "out")
    scene = Scene.load(path)
    assert (scene.name, list(scene.cameras), scene.cameras["a"].hfov_deg) == ("yard", ["a", "b"], 90)
    assert "hidden" not in path.read_text()
    path.write_text(path.read_text().replace('name = "yard"', 'name = "court"'))
    assert (write_scene_file(plan, tmp_path / "out"), Scene.load(path).name) == (path, "court")
    with pytest.raises(InputError, match="without camera c"):
        write_scene_file(plan_of(tmp_path, "[cameras.c]\nstream='rtsp://h/c'\n"), tmp_path / "out")
    (tmp_path / "plans").mkdir()
    text = f"{CAMERA}intrinsics='../lens.toml'\n[cameras.b]\nstream='rtsp://h/b'\nhfov_deg=90\n"
    scene = Scene.load(write_scene_file(plan_of(tmp_path / "plans", text), tmp_path / "deep" / "out"))
    assert scene.resolve(scene.cameras["a"].intrinsics) == (tmp_path / "lens.toml").resolve()


@pytest.mark.parametrize(
    ("text", "message"),
    [("hfov = 90\n", "hfov"), ("[solver]\nmethod = 'guess'\n", "method"), ("[perception]\nfps = 3\n", "has no place here")],
)
def test_a_wrong_scene_is_named_before_the_recording(tmp_path, text, message):
    plan = plan_of(tmp_path, f"[cameras.b]\nstream='rtsp://h/b'\n{CAMERA}{text}")
    with pytest.raises(InputError, match=message):
        write_scene_file(plan, tmp_path / "out")
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize(
    "options", [{"seconds": 0}, {"seconds": float("nan")}, {"seconds": 9, "piece_s": 0}, {"seconds": 9, "most_bytes": 0}]
)
def test_options_that_cannot_be(options):
    with pytest.raises(InputError, match="give"):
        CaptureOptions(**options)


def test_wall_time_is_the_senders_where_that_can_be():
    clock = WallClock()
    assert clock.settled() is None
    clock.arrived(2.0, 1002.4, None)
    clock.arrived(3.0, 1003.1, None)
    arrival = clock.settled()
    assert arrival.at(5.0) == pytest.approx(1005.1)
    # Later packets change nothing any more, but for a word of the sender.
    clock.arrived(4.0, 1004.0, None)
    assert clock.settled() == arrival
    clock.arrived(5.0, 1005.0, 999.8)
    sender = clock.settled()
    assert (sender.source, sender.at(5.0)) == ("sender", pytest.approx(1004.8))
    assert sender.sigma_s < arrival.sigma_s
    # A sender's clock that was never set is not believed.
    unset = WallClock()
    unset.arrived(0.0, 5000.0, 5000.0 + 36_000.0)
    assert (unset.settled().source, unset.unset_s) == ("arrival", pytest.approx(36_000.0))
