"""A plan's picture from a browser: whole PNG and JPEG are kept as they came, all else is refused before it is decoded."""

import struct
import zlib
from contextlib import suppress

import cv2
import numpy as np
import pytest

from passerby.common.errors import InputError
from passerby.interchange.plan_picture import read_plan_picture
from passerby.page import plan_pictures as pictures

UPLOAD = "/api/plan/upload"


def picture(end=".png", width=60, height=40, options=()):
    shown = np.random.default_rng(0).integers(0, 255, (height, width, 3), dtype=np.uint8)
    return cv2.imencode(end, shown, list(options))[1].tobytes()


def chunk(kind, data):
    return struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))


def bomb(width, height):
    """A PNG of a few kilobytes at most whose header states so many pixels."""
    header = chunk(b"IHDR", struct.pack(">IIBBBBB", width, height, 1, 0, 0, 0, 0))
    return pictures.PNG + header + chunk(b"IDAT", zlib.compress(b"\0" * 100_000, 9)) + chunk(b"IEND", b"")


@pytest.mark.parametrize(("end", "kind"), [(".png", "png"), (".jpg", "jpg")])
def test_a_picture_is_kept_as_it_came_under_the_name_of_its_content(client, session, end, kind):
    content, version = picture(end), session.version
    told = client.post(UPLOAD, content).json()
    assert pictures.UPLOADED.fullmatch(told["image"])
    assert told["image"].endswith(kind)
    assert told["size"] == [60, 40]
    assert (session.scene_file.parent / told["image"]).read_bytes() == content
    assert client.post(UPLOAD, content).json() == told
    shown = client.get("/plan", f"image={told['image']}")
    assert cv2.imdecode(np.frombuffer(shown.body, np.uint8), 1).shape == (40, 60, 3)
    assert session.version == version, "the scene file is left alone"


@pytest.mark.parametrize(
    ("content", "why"),
    [
        (b"", "neither a PNG nor a JPEG"),
        (b"<svg xmlns='http://www.w3.org/2000/svg'/>", "neither"),
        (picture()[:-12], "cut off"),
        (picture(".jpg")[:-2], "cut off"),
        (b"\xff\xd8\xff\xda\xff\xd9", "cut off"),
        (b"\xff\xd8\xff\xe0\x00\x00" * 50 + b"\xff\xda\xff\xd9", "cut off"),
        (bomb(30_000, 30_000), "900 million"),
        (bomb(0, 10), "no picture"),
        (picture(".jpg").replace(struct.pack(">HH", 40, 60), struct.pack(">HH", 65_500, 65_500)), "million"),
        (picture(width=60, height=5), "60 x 5"),
    ],
)  # fmt: skip
def test_what_is_no_plan_is_refused_in_one_line(client, session, content, why):
    before = sorted(session.scene_file.parent.iterdir())
    answer = client.post(UPLOAD, content)
    assert answer.status == 422
    assert why in answer.json()["error"]
    assert "\n" not in answer.json()["error"]
    assert sorted(session.scene_file.parent.iterdir()) == before


def test_a_picture_of_just_so_many_pixels_is_let_through_and_a_larger_one_never_decoded(monkeypatch):
    decoded = []
    monkeypatch.setattr(pictures, "decode_plan_picture", lambda *one: decoded.append(one))
    assert pictures.check_plan(bomb(pictures.MOST_PIXELS // 1000, 1000)) == "png"
    for width, height in ((pictures.MOST_PIXELS // 1000 + 1, 1000), (2**31 - 1, 2**31 - 1)):
        with pytest.raises(InputError, match="million"):
            pictures.check_plan(bomb(width, height))
    assert len(decoded) == 1


def test_a_progressive_jpeg_is_a_plan_and_one_of_endless_scans_is_not(tmp_path):
    content = picture(".jpg", options=[cv2.IMWRITE_JPEG_PROGRESSIVE, 1])
    assert 1 < content.count(pictures.JPEG_SCAN) <= pictures.MOST_SCANS
    assert pictures.keep_plan(tmp_path, content).endswith(".jpg")
    scan = content[content.index(pictures.JPEG_SCAN) : -2]
    with pytest.raises(InputError, match="scans"):
        pictures.picture_header(content[:-2] + scan * pictures.MOST_SCANS + content[-2:])


def test_damaged_pictures_raise_nothing_but_input_errors(tmp_path):
    rng = np.random.default_rng(1)
    for end in (".png", ".jpg"):
        whole = np.frombuffer(picture(end), np.uint8)
        for _ in range(150):
            broken = whole.copy()
            places = rng.integers(0, len(broken), 6)
            broken[places] = rng.integers(0, 256, 6)
            with suppress(InputError):
                pictures.keep_plan(tmp_path, broken.tobytes())


@pytest.mark.parametrize("path", ["../scene.toml", "scene.toml", "/etc/passwd", "plan-0.png", "plan-" + "0" * 20 + ".png/../x"])
def test_a_plan_is_a_name_that_the_server_gave_and_never_a_path(client, path):
    for address in ("/plan", "/api/plan/picture"):
        answer = client.get(address, f"image={path}")
        assert answer.status == 422
        assert "no such plan" in answer.json()["error"]
    assert "upload it" in client.get("/plan", f"image=plan-{'0' * 20}.png").json()["error"]
    assert "no plan yet" in client.get("/plan").json()["error"]


def test_a_photograph_that_says_how_it_is_turned_is_counted_as_a_calibration_counts_it(tmp_path):
    """EXIF's orientation 6: the camera was held upright, so that the file's width is the picture's height."""
    plain = picture(".jpg", width=64, height=40)
    tag = struct.pack(">HHIHH", 0x0112, 3, 1, 6, 0)
    exif = b"Exif\0\0MM\0*" + struct.pack(">IH", 8, 1) + tag + struct.pack(">I", 0)
    turned = plain[:2] + b"\xff\xe1" + struct.pack(">H", len(exif) + 2) + exif + plain[2:]
    assert pictures.picture_header(turned) == ("jpg", (64, 40))
    path = tmp_path / pictures.keep_plan(tmp_path, turned)
    shown = pictures.PlanPictures().shown(path)
    assert shown.size == (40, 64) == read_plan_picture(path).shape[1::-1]
    assert cv2.imdecode(np.frombuffer(shown.data, np.uint8), 1).shape[1::-1] == shown.size


def test_a_large_plan_is_shown_smaller_and_measured_as_it_is(tmp_path):
    path = tmp_path / "plan.png"
    cv2.imwrite(str(path), np.full((100, 2 * pictures.LARGEST_PX, 3), 200, np.uint8))
    shown = pictures.PlanPictures().shown(path)
    assert shown.size == (2 * pictures.LARGEST_PX, 100)
    assert cv2.imdecode(np.frombuffer(shown.data, np.uint8), 1).shape == (50, pictures.LARGEST_PX, 3)


def test_the_size_of_a_jpeg_is_found_behind_what_has_no_length():
    """Fill bytes and restart markers may stand between segments; a size that is stated after the scan is none."""
    content = picture(".jpg")
    assert pictures.picture_header(content[:2] + b"\xff\xff\xff\xd0\xff\x01" + content[2:]) == ("jpg", (60, 40))
    with pytest.raises(InputError, match="cut off or broken"):
        pictures.picture_header(content.replace(struct.pack(">HH", 40, 60), struct.pack(">HH", 0, 60)))
    frame = content[content.index(b"\xff\xc0") :]
    with pytest.raises(InputError, match="cut off or broken"):
        pictures.picture_header(content[:2] + b"\xff\xda\x00\x02" + frame)
