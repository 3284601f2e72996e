"""Videos with sound: their clock offsets are measured before people are, and what is wrong with the sound is said once."""

from dataclasses import replace
from pathlib import Path

import av
import numpy as np
import pytest

import passerby
from passerby.common.arrays import Floats
from passerby.common.errors import InputError
from passerby.core.cameras import Rig
from passerby.perception.video import probe
from passerby.scene.camera_input import CameraInput
from passerby.scene.check import check_scene
from passerby.scene.inputs import read_inputs
from passerby.scene.scene import Scene
from passerby.scene.sound import measure_by_sound, sound_to_hear
from sources.sound import RATE, SoundCase, simulated_pair
from support.scenes.people_and_rigs import ring

FPS = 5


def film(path: Path, sound: Floats | None, *, seconds: int = 40) -> CameraInput:
    with av.open(str(path), "w") as container:
        video = container.add_stream("mpeg4", rate=FPS)
        video.width, video.height, video.pix_fmt = 32, 32, "yuv420p"
        audio = None if sound is None else container.add_stream("aac", rate=RATE, layout="mono")
        for number in range(seconds * FPS):
            picture = av.VideoFrame.from_ndarray(np.full((32, 32, 3), number % 200, np.uint8))
            container.mux(video.encode(picture))
        container.mux(video.encode())
        if audio is not None and sound is not None:
            for begin in range(0, len(sound), 1024):
                part = np.ascontiguousarray(sound[None, begin : begin + 1024], dtype=np.float32)
                frame = av.AudioFrame.from_ndarray(part, format="fltp", layout="mono")
                frame.sample_rate, frame.pts = RATE, begin
                container.mux(audio.encode(frame))
            container.mux(audio.encode())
    return CameraInput(path.stem, video=probe(path), fps=FPS)


def scene(folder: Path, key: str = "") -> Scene:
    path = folder / "scene.toml"
    path.write_text(f'[association]\n{key}\n[cameras.a]\nvideo = "a.mp4"\n[cameras.b]\nvideo = "b.mp4"\n')
    return Scene.load(path)


@pytest.fixture(scope="module")
def films(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, list[CameraInput], float]:
    folder = tmp_path_factory.mktemp("films")
    a, b, lag_s = simulated_pair(SoundCase(4, (38.0, 42.0)))
    return folder, [film(folder / "a.mp4", a), film(folder / "b.mp4", b)], lag_s


def test_the_sound_of_two_videos_tells_when_they_began(films: tuple[Path, list[CameraInput], float]) -> None:
    folder, readings, lag_s = films
    (measured,), (found,) = measure_by_sound(scene(folder), readings)
    assert (measured.cameras, measured.found_by) == (("a", "b"), "sound")
    assert measured.offset_s == pytest.approx(-lag_s, abs=0.02)
    assert (found.code, found.cameras) == ("offset_by_sound", ("b", "a"))
    assert found.values["offset_s"] == measured.offset_s


@pytest.mark.parametrize("key", ['sound = "off"', "max_offset_s = 0", 'mode = "appearance"'])
def test_nothing_is_listened_to_where_no_offset_is_wanted(key: str, films: tuple[Path, list[CameraInput], float]) -> None:
    folder, readings, _ = films
    assert measure_by_sound(scene(folder, key), readings) == ((), ())


def test_silence_is_named_once_and_sound_of_one_camera_passed_over(films, tmp_path):
    folder, (first, _), _ = films
    silent, without = film(tmp_path / "silent.mp4", np.zeros(15 * RATE)), film(tmp_path / "without.mp4", None)
    measured, findings = measure_by_sound(scene(folder), [first, silent, without])
    assert measured == ()
    assert [(one.code, one.cameras) for one in findings] == [("sound_unusable", ("silent",))]
    assert measure_by_sound(scene(folder), [first, without]) == ((), ())


def test_who_only_checks_or_monitors_decodes_no_sound(films, tmp_path, monkeypatch):
    folder, readings, lag_s = films

    def nobody_listens(_: object) -> None:
        raise AssertionError("the sound is decoded")

    monkeypatch.setattr("passerby.perception.sound._decode_samples", nobody_listens)
    (found,) = sound_to_hear(scene(folder), readings)
    assert (found.code, found.cameras) == ("sound_unheard", ("a", "b"))
    assert sound_to_hear(scene(folder, 'sound = "off"'), readings) == ()
    assert sound_to_hear(scene(folder), [readings[0], film(tmp_path / "without.mp4", None)]) == ()
    for name in "ab":
        (tmp_path / f"{name}.txt").write_text("1,-1,2,2,6,16,1\n150,-1,3,2,6,16,1\n")
    cameras = "".join(
        f'[cameras.{name}]\nvideo = "{folder / name}.mp4"\ndetections = "{name}.txt"\nhfov_deg = 60\n' for name in "ab"
    )
    (tmp_path / "scene.toml").write_text(cameras)
    both = Scene.load(tmp_path / "scene.toml")
    checked = check_scene(both)
    assert checked.faults == ()
    assert "sound_unheard" in [one.code for one in checked.diagnostics]
    assert read_inputs(both).measured == ()
    monkeypatch.undo()
    (measured,) = read_inputs(both, measure_clocks=measure_by_sound).measured
    assert measured.offset_s == pytest.approx(-lag_s, abs=0.02)


@pytest.mark.parametrize(
    ("command", "listener"),
    [("calibrate", "passerby.calibration.calibrate.measure_by_sound"), ("monitor", "passerby.monitoring.monitor.read_inputs")],
)
def test_only_a_calibration_measures_clocks_by_sound(command, listener, films, monkeypatch):
    asked = []

    def read(*arguments: object, **_: object) -> None:
        asked.append(arguments)
        raise InputError("read")

    monkeypatch.setattr(listener, read)
    rig = Rig(tuple(replace(camera, name=name) for camera, name in zip(ring(2), "ab", strict=True)))
    with pytest.raises(InputError, match="read"):
        passerby.calibrate(scene(films[0])) if command == "calibrate" else passerby.monitor(rig, scene(films[0]))
    assert len(asked) == 1
    assert measure_by_sound not in asked[0]
