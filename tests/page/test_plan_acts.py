"""A plan through the server: its picture is uploaded, a draft is tried on the rig, saved into the scene file, undone."""

import struct
import zlib
from contextlib import suppress

import cv2
import numpy as np
import pytest

from passerby.common.errors import InputError
from passerby.interchange.plan_picture import read_plan_picture
from passerby.interchange.rig_toml import read_rig, write_rig
from passerby.page import plan_pictures as pictures
from passerby.page.session import Session
from passerby.scene.scene import Scene

from .conftest import UNIT, Client, DrawnPlan, act, decoded, middle, refusal, scene_of

UPLOAD = "/api/plan/upload"
UNKNOWN = "plan-" + "0" * 20 + ".png"


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
    assert decoded(client.get("/plan", f"image={told['image']}").body).shape == (40, 60, 3)
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
        (bomb(2**31 - 1, 2**31 - 1), "million"),
        (bomb(0, 10), "no picture"),
        (picture(".jpg").replace(struct.pack(">HH", 40, 60), struct.pack(">HH", 65_500, 65_500)), "million"),
        (picture(width=60, height=5), "60 x 5"),
    ],
)  # fmt: skip
def test_a_file_that_is_no_plan_is_refused_in_one_line_and_a_large_one_never_decoded(
    client, session, content, why, monkeypatch
):
    if "million" in why:
        monkeypatch.delattr(pictures, "decode_plan_picture")
    before = sorted(session.scene_file.parent.iterdir())
    said = refusal(client.post(UPLOAD, content))
    assert why in said
    assert "\n" not in said
    assert sorted(session.scene_file.parent.iterdir()) == before


def test_a_progressive_jpeg_is_a_plan_and_one_of_endless_scans_is_not(tmp_path):
    content = picture(".jpg", options=[cv2.IMWRITE_JPEG_PROGRESSIVE, 1])
    assert content.count(pictures.JPEG_SCAN) > 1
    assert pictures.keep_plan(tmp_path, content).endswith(".jpg")
    scan = content[content.index(pictures.JPEG_SCAN) : -2]
    with pytest.raises(InputError, match="scans"):
        pictures.picture_header(content[:-2] + scan * 1000 + content[-2:])


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


def test_the_size_of_a_jpeg_is_found_behind_what_has_no_length():
    """Fill bytes and restart markers may stand between segments; a size that is stated after the scan is none."""
    content = picture(".jpg")
    assert pictures.picture_header(content[:2] + b"\xff\xff\xff\xd0\xff\x01" + content[2:]) == ("jpg", (60, 40))
    frame = content[content.index(b"\xff\xc0") :]
    for broken in (
        content.replace(struct.pack(">HH", 40, 60), struct.pack(">HH", 0, 60)), content[:2] + b"\xff\xda\x00\x02" + frame,
    ):  # fmt: skip
        with pytest.raises(InputError, match="cut off or broken"):
            pictures.picture_header(broken)


@pytest.mark.parametrize("path", ["../scene.toml", "scene.toml", "/etc/passwd", "plan-0.png", f"{UNKNOWN}/../x"])
def test_a_plan_is_a_name_that_the_server_gave_and_never_a_path(client, path):
    for address in ("/plan", "/api/plan/picture"):
        assert "no such plan" in refusal(client.get(address, f"image={path}"))
    assert "upload it" in client.get("/plan", f"image={UNKNOWN}").json()["error"]
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
    assert decoded(shown.data).shape[1::-1] == shown.size


def test_a_large_plan_is_shown_smaller_and_measured_as_it_is(tmp_path):
    path = tmp_path / "plan.png"
    cv2.imwrite(str(path), np.full((100, 8192, 3), 200, np.uint8))
    shown = pictures.PlanPictures().shown(path)
    assert shown.size == (8192, 100)
    assert decoded(shown.data).shape == (50, 4096, 3)


@pytest.fixture
def plan(session):
    return DrawnPlan(read_rig(session.scene_file.parent / "truth.toml"))


@pytest.fixture
def draft(client, plan):
    """Two cameras and a point amid the cameras, placed where they are on an uploaded plan."""
    image = client.post(UPLOAD, plan.png).json()["image"]
    points = [plan.point(middle(plan.truth), "C1", "C2")]
    return {"image": image, "metres_per_pixel": UNIT, "cameras": plan.cameras("C1", "C3"), "points": points}


def fit(client, draft):
    return client.post("/api/plan/fit", draft)


def test_a_saved_plan_is_in_the_file_and_in_the_state_until_it_is_undone(client, session, plan, draft):
    before = session.scene_file.read_bytes()
    answer = act(client, session, act="plan", plan=draft)
    assert answer.status == 200
    told, state = Scene.load(session.scene_file).world.plan, answer.json()
    assert (told.image.name, set(told.cameras)) == (draft["image"], {"C1", "C3"})
    assert (state["world"], state["plan"]["name"]) == ("plan", draft["image"])
    assert state["plan"]["cameras"]["C1"] == plan.cameras("C1")["C1"]
    assert str(session.scene_file.parent) not in answer.body.decode()
    assert act(client, session, act="undo").status == 200
    assert session.scene_file.read_bytes() == before


def test_a_draft_shows_every_camera_on_the_plan_and_a_wrong_placement_before_it_is_saved(client, session, plan, draft):
    write_rig(session.out / "rig.toml", plan.truth.moved(np.eye(3), np.zeros(3), 1.25))
    before = session.version
    told = fit(client, draft).json()
    assert session.version == before
    assert told["scale_percent"] == pytest.approx(-20, abs=0.5)
    for one in told["cameras"]:
        assert one["at"] == pytest.approx(plan.pixel(plan.truth[one["name"]].centre), abs=2)
        assert len(one["seen"]) > 3
    placed = {(one["point"], one["camera"]) for one in told["placements"]}
    assert placed == {(None, "C1"), (None, "C3"), ("1", "C1"), ("1", "C2")}
    assert all(one["off_m"] < 0.05 and one["used"] for one in told["placements"])

    write_rig(session.out / "rig.toml", plan.truth)
    draft["cameras"] = plan.cameras("C1", "C2", "C3", "C4")
    draft["cameras"]["C2"][0] -= 150
    told = fit(client, draft).json()
    (wrong,) = [one for one in told["placements"] if not one["used"]]
    assert wrong["camera"] == "C2"
    assert wrong["off_m"] == pytest.approx(150 * UNIT, abs=0.1)
    assert any("C2" in one for one in told["notes"])


def test_placements_are_changed_and_removed_and_the_picture_stays(client, session, plan, draft):
    act(client, session, act="plan", plan=draft)
    changed = {**draft, "image": None, "points": [], "cameras": plan.cameras("C1", "C2", "C3")}
    assert act(client, session, act="plan", plan=changed).status == 200
    told = scene_of(session)["world"]["plan"]
    assert (told["image"], set(told["cameras"]), "points" in told) == (draft["image"], {"C1", "C2", "C3"}, False)
    assert act(client, session, act="remove_plan").status == 200
    assert "world" not in scene_of(session)
    assert act(client, session, act="remove_plan").status == 422


@pytest.mark.parametrize(
    ("change", "why"),
    [
        ({"metres_per_pixel": None}, "needs its scale"),
        ({"distance": {"between": [[0, 0], [9, 9]], "metres": 3}}, "needs its scale"),
        ({"metres_per_pixel": -1}, "greater than 0"),
        ({"metres_per_pixel": None, "distance": {"between": [[5, 5], [5, 5]], "metres": 3}}, "twice"),
        ({"cameras": {}}, "place two or more"),
        ({"cameras": {"C1": [5, 5], "C3": [99_000, 5]}}, "outside"),
        ({"cameras": {"C1": [5, 5], "C9": [50, 5]}}, "C9"),
        ({"points": [{"at": [5, 5], "pixels": {"C1": [9000, 9000]}}]}, "outside"),
        ({"image": "../truth.toml"}, "no such plan"),
        ({"image": UNKNOWN}, "plan-0"),
        ({"image": None}, "no plan yet"),
        ({"extra": 1}, "not permitted"),
    ],
)
def test_a_draft_that_is_no_plan_is_refused_with_a_sentence(client, session, draft, change, why):
    before = session.scene_file.read_bytes()
    said = refusal(act(client, session, act="plan", plan={**draft, **change}))
    assert why in said
    assert str(session.scene_file.parent) not in said
    assert session.scene_file.read_bytes() == before
    assert fit(client, {**draft, **change}).status == 422


def test_the_further_keys_of_a_plan_count_in_the_draft_and_without_a_rig_it_can_be_saved(client, session, draft):
    assert act(client, session, act="plan", plan=draft).status == 200
    again = {**draft, "image": None}
    before = fit(client, again).json()["turn_sigma_deg"]
    text = session.scene_file.read_text().replace("[world.plan]\n", "[world.plan]\nsd_px = 20\n")
    session.scene_file.write_text(text)
    assert fit(client, again).json()["turn_sigma_deg"] > 3 * before
    (session.out / "rig.toml").unlink()
    assert "calibrate first" in fit(client, again).json()["error"]
    assert act(client, session, act="plan", plan={**draft, "points": []}).status == 200


def test_a_plan_anywhere_is_shown_by_its_file_name_only(session, plan, tmp_path):
    (tmp_path / "elsewhere").mkdir()
    sheet = tmp_path / "elsewhere" / "sheet.png"
    sheet.write_bytes(plan.png)
    cameras = ", ".join(f"{name} = {at}" for name, at in plan.cameras("C1", "C3").items())
    with session.scene_file.open("a") as file:
        file.write(f'\n[world.plan]\nimage = "{sheet}"\nmetres_per_pixel = {UNIT}\ncameras = {{ {cameras} }}\n')
    client = Client(Session(session.scene_file, session.out))
    state = client.get("/api/state")
    assert state.json()["plan"]["name"] == "sheet.png"
    assert b"elsewhere" not in state.body
    assert client.get("/api/plan/picture").json()["size"] == list(plan.size)
    assert client.get("/plan").headers["content-type"] == "image/png"
