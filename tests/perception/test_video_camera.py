"""What the metadata of a recording say of its camera, and that nothing else is taken for it."""

import struct

import numpy as np
import pytest

from passerby.common.errors import InputError
from passerby.perception.video_camera import RecordingCamera
from passerby.perception.video_probe import probe
from support.scenes.recorded_videos import FLOAT, FOCAL, SIGNED, TEXT, write_recorded

PHONE = {"com.apple.quicktime.make": "Apple", "com.apple.quicktime.model": "iPhone 13"}
NOTHING = RecordingCamera()


@pytest.mark.parametrize(
    ("name", "metadata", "camera"),
    [
        *(
            (f"a.{ending}", {**PHONE, FOCAL: "26"}, RecordingCamera(26.0, "Apple iPhone 13"))
            for ending in ("mp4", "mov", "mkv")
        ),
        ("a.mp4", {}, NOTHING),
        ("b.avi", PHONE, NOTHING),  # which has no such metadata
        *(("a.mkv", {FOCAL: text}, NOTHING) for text in ("0", "-26", "nan", "inf", "1e9", "26/1", "", "\x00")),
    ],
)
def test_metadata_of_the_file_and_what_is_no_focal_length(tmp_path, name, metadata, camera):
    assert probe(write_recorded(tmp_path / name, metadata)).camera == camera


@pytest.mark.parametrize("value", [(SIGNED, struct.pack(">i", 27)), (FLOAT, struct.pack(">f", 27.0)), (TEXT, b"27.00mm")])
def test_metadata_of_the_track(tmp_path, value):
    """Where phones write the focal length; FFmpeg passes it over."""
    lens = (TEXT, b"iPhone 13 back camera")
    path = write_recorded(tmp_path / "a.mov", PHONE, {"com.apple.quicktime.camera.lens_model": lens, FOCAL: value})
    assert probe(path).camera == RecordingCamera(27.0, "Apple iPhone 13, back camera")


def test_names_are_one_line_that_a_terminal_can_show(tmp_path):
    name = "Pixel\n8\x1b[31m" + 500 * "x"
    device = probe(write_recorded(tmp_path / "a.mkv", {"make": "Google", "model": name})).camera.device
    assert device.startswith("Google Pixel 8 [31mxx")
    assert device.isprintable()
    assert len(device) < 120
    # Names that are no text are read as far as they are.
    path = write_recorded(tmp_path / "a.mp4", {**PHONE, "com.apple.quicktime.model": "iPhoneXXXX 13"})
    data = path.read_bytes()
    assert b"XXXX" in data
    path.write_bytes(data.replace(b"XXXX", b"\xff\xfe\xe9\xc0"))
    device = probe(path).camera.device
    assert device.startswith("Apple iPhone")
    assert device.encode().endswith(b"13")


def test_damaged_metadata_are_no_metadata(tmp_path):
    """Every third byte of the track's metadata is changed; FFmpeg itself refuses a few such files."""
    whole = write_recorded(tmp_path / "a.mov", PHONE, {FOCAL: (SIGNED, struct.pack(">i", 27))})
    data = whole.read_bytes()
    start, path = data.index(b"hdlr" + bytes(8) + b"mdta") - 12, tmp_path / "b.mov"
    rng, found = np.random.default_rng(0), []
    (length,) = struct.unpack(">I", data[start : start + 4])
    for place in range(start, start + length, 3):
        for value in (255, int(rng.integers(256))):
            path.write_bytes(data[:place] + bytes([value]) + data[place + 1 :])
            try:
                found.append(probe(path).camera.focal_35mm)
            except InputError:
                continue
    assert len(found) > 0.8 * 2 * length / 3
    assert {None, 27.0} <= set(found)
    assert all(focal is None or 4 <= focal <= 2000 for focal in found)
