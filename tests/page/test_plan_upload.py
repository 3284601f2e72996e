"""A plan's picture from a browser: whole PNG and JPEG are kept as they came, all else is refused before it is decoded."""

import struct
import zlib
from contextlib import suppress

import cv2
import numpy as np
import pytest

from passerby.common.errors import InputError
from passerby.interchange.plan_picture import read_plan_picture
from passerby.page import plan_pictures
from passerby.page.plan_pictures import (
    LARGEST_PX,
    MOST_BYTES,
    MOST_PIXELS,
    MOST_SCANS,
    UPLOADED,
    PlanPictures,
    check_plan,
    keep_plan,
    picture_header,
)

from .conftest import HOST

UPLOAD = "/api/plan/upload"


def picture(end=".png", width=60, height=40, options=()):
    shown = np.random.default_rng(0).integers(0, 255, (height, width, 3), dtype=np.uint8)
    return cv2.imencode(end, shown, list(options))[1].tobytes()


def chunk(kind, data):
    return struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))


def bomb(width, height):
    """A PNG of a few kilobytes at most whose header states so many pixels."""
    header = chunk(b"IHDR", struct.pack(">IIBBBBB", width, height, 1, 0, 0, 0, 0))
    return plan_pictures.PNG + header + chunk(b"IDAT", zlib.compress(b"\0" * 100_000, 9)) + chunk(b"IEND", b"")


@pytest.mark.parametrize(("end", "kind"), [(".png", "png"), (".jpg", "jpg")])
def test_a_picture_is_kept_as_it_came_under_the_name_of_its_content(client, session, end, kind):
    content = picture(end)
    told = client.post(UPLOAD, content).json()
    assert UPLOADED.fullmatch(told["image"])
    assert told["image"].endswith(kind)
    assert told["size"] == [60, 40]
    assert (session.scene_file.parent / told["image"]).read_bytes() == content
    assert client.post(UPLOAD, content).json() == told
    shown = client.get("/plan", f"image={told['image']}")
    assert cv2.imdecode(np.frombuffer(shown.body, np.uint8), 1).shape == (40, 60, 3)


def test_the_scene_file_is_left_alone(client, session):
    before = session.version
    client.post(UPLOAD, picture())
    assert session.version == before


@pytest.mark.parametrize(
    ("content", "why"),
    [
        (b"", "neither a PNG nor a JPEG"),
        (b"GIF89a" + b"\0" * 100, "neither"),
        (b"<svg xmlns='http://www.w3.org/2000/svg'/>", "neither"),
        (b"RIFF\0\0\0\0WEBP", "neither"),
        (picture()[:200], "cut off"),
        (picture()[:-12], "cut off"),
        (picture(".jpg")[:-2], "cut off"),
        (picture(".jpg")[:50], "cut off"),
        (b"\xff\xd8\xff\xda\xff\xd9", "cut off"),
        (b"\xff\xd8\xff\xe0\x00\x00" * 50 + b"\xff\xda\xff\xd9", "cut off"),
        (bomb(30_000, 30_000), "900 million"),
        (bomb(2**31 - 1, 2**31 - 1), "million"),
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


def test_a_bomb_is_small_and_never_decoded(monkeypatch):
    monkeypatch.setattr(plan_pictures, "decode_plan_picture", lambda *_: pytest.fail("decoded"))
    content = bomb(30_000, 30_000)
    assert len(content) < 4096
    with pytest.raises(InputError, match="900 million"):
        check_plan(content)


def test_a_picture_of_just_so_many_pixels_is_let_through(monkeypatch):
    decoded = []
    monkeypatch.setattr(plan_pictures, "decode_plan_picture", lambda *one: decoded.append(one))
    assert check_plan(bomb(MOST_PIXELS // 1000, 1000)) == "png"
    assert len(decoded) == 1
    with pytest.raises(InputError, match="million"):
        check_plan(bomb(MOST_PIXELS // 1000 + 1, 1000))


def test_a_progressive_jpeg_is_a_plan_and_one_of_endless_scans_is_not(tmp_path):
    content = picture(".jpg", options=[cv2.IMWRITE_JPEG_PROGRESSIVE, 1])
    assert 1 < content.count(plan_pictures.JPEG_SCAN) <= MOST_SCANS
    assert keep_plan(tmp_path, content).endswith(".jpg")
    scan = content[content.index(plan_pictures.JPEG_SCAN) : -2]
    with pytest.raises(InputError, match="scans"):
        picture_header(content[:-2] + scan * MOST_SCANS + content[-2:])


def test_damaged_pictures_raise_nothing_but_input_errors(tmp_path):
    rng = np.random.default_rng(1)
    for end in (".png", ".jpg"):
        whole = np.frombuffer(picture(end), np.uint8)
        for _ in range(150):
            broken = whole.copy()
            places = rng.integers(0, len(broken), 6)
            broken[places] = rng.integers(0, 256, 6)
            with suppress(InputError):
                keep_plan(tmp_path, broken.tobytes())


@pytest.mark.parametrize("path", ["../scene.toml", "scene.toml", "/etc/passwd", "plan-0.png", "plan-" + "0" * 20 + ".png/../x"])
def test_a_plan_is_a_name_that_the_server_gave_and_never_a_path(client, path):
    for address in ("/plan", "/api/plan/picture"):
        answer = client.get(address, f"image={path}")
        assert answer.status == 422
        assert "no such plan" in answer.json()["error"]
    assert "upload it" in client.get("/plan", f"image=plan-{'0' * 20}.png").json()["error"]
    assert "no plan yet" in client.get("/plan").json()["error"]


def test_the_upload_alone_takes_more_than_an_act(client):
    block = [b"x" * 1_000_000]
    answer, taken = client.ask("POST", UPLOAD, chunks=block * 2, origin=f"http://{HOST}")
    assert answer.status == 422
    assert len(taken) == 2
    answer, taken = client.ask("POST", "/api/act", chunks=block * 2, origin=f"http://{HOST}")
    assert (answer.status, len(taken)) == (413, 1)


def test_a_body_beyond_the_limit_is_never_read_to_its_end(client):
    chunks = [b"x" * 1_000_000] * 1000
    answer, taken = client.ask("POST", UPLOAD, chunks=chunks, origin=f"http://{HOST}")
    assert answer.status == 413
    assert len(taken) == MOST_BYTES // 1_000_000 + 1
    answer, taken = client.ask("POST", UPLOAD, body=b"x", origin=f"http://{HOST}", content_length=str(MOST_BYTES + 1))
    assert (answer.status, taken) == (413, [])


@pytest.mark.parametrize("headers", [{"cookie": None}, {"origin": "http://evil.example"}, {"host": "evil.example"}])
def test_nobody_else_can_upload(client, session, headers):
    before = sorted(session.scene_file.parent.iterdir())
    assert client.post(UPLOAD, picture(), **headers).status in (403, 421)
    assert sorted(session.scene_file.parent.iterdir()) == before


def test_a_photograph_that_says_how_it_is_turned_is_counted_as_a_calibration_counts_it(tmp_path):
    """EXIF's orientation 6: the camera was held upright, so that the file's width is the picture's height."""
    plain = picture(".jpg", width=64, height=40)
    tag = struct.pack(">HHIHH", 0x0112, 3, 1, 6, 0)
    exif = b"Exif\0\0MM\0*" + struct.pack(">IH", 8, 1) + tag + struct.pack(">I", 0)
    turned = plain[:2] + b"\xff\xe1" + struct.pack(">H", len(exif) + 2) + exif + plain[2:]
    assert picture_header(turned) == ("jpg", (64, 40))
    path = tmp_path / keep_plan(tmp_path, turned)
    shown = PlanPictures().shown(path)
    assert shown.size == (40, 64) == read_plan_picture(path).shape[1::-1]
    assert cv2.imdecode(np.frombuffer(shown.data, np.uint8), 1).shape[1::-1] == shown.size


def test_a_large_plan_is_shown_smaller_and_measured_as_it_is(tmp_path):
    path = tmp_path / "plan.png"
    cv2.imwrite(str(path), np.full((100, 2 * LARGEST_PX, 3), 200, np.uint8))
    shown = PlanPictures().shown(path)
    assert shown.size == (2 * LARGEST_PX, 100)
    assert cv2.imdecode(np.frombuffer(shown.data, np.uint8), 1).shape == (50, LARGEST_PX, 3)


def test_the_size_of_a_jpeg_is_found_behind_what_has_no_length():
    """Fill bytes and restart markers may stand between segments; a size that is stated after the scan is none."""
    content = picture(".jpg")
    assert picture_header(content[:2] + b"\xff\xff\xff\xd0\xff\x01" + content[2:]) == ("jpg", (60, 40))
    with pytest.raises(InputError, match="cut off or broken"):
        picture_header(content.replace(struct.pack(">HH", 40, 60), struct.pack(">HH", 0, 60)))
    frame = content[content.index(b"\xff\xc0") :]
    with pytest.raises(InputError, match="cut off or broken"):
        picture_header(content[:2] + b"\xff\xda\x00\x02" + frame)
