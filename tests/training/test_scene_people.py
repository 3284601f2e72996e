"""Crops of a calibrated scene's own people: that they show the right ones, what is reported, and what is refused."""

import json
import shutil
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest

from passerby.common.errors import EvidenceError, InputError
from passerby.core.cameras import Lens, Rig
from passerby.interchange.motchallenge import write_boxes
from passerby.interchange.output_folder import scene_file
from passerby.interchange.rig_toml import write_rig
from passerby.interchange.video_writer import VideoWriter
from passerby.training.scene_people import scene_people
from support.scenes.people_and_rigs import observe, ring

FPS, FRAMES, PEOPLE = 5.0, 60, 6
SIZE = (640, 360)
LENS = Lens(SIZE, np.array([[400.0, 0, 320], [0, 400.0, 180], [0, 0, 1]]), np.zeros(5))
COLOURS = [(200, 40, 40), (40, 200, 40), (40, 40, 200), (200, 200, 40), (200, 40, 200), (40, 200, 200)]
CAMERAS = ("C1", "C2", "C3")


def walkers():
    """(T, P, 2) six people who pace along lines of their own, far enough from each other."""
    pace = np.column_stack([np.linspace(-0.6, 0.6, FRAMES), np.zeros(FRAMES)])
    return np.array([(-2.6, -1.2), (-2.6, 1.4), (0.1, -2.3), (0.1, 2.6), (2.6, -1.0), (2.7, 1.7)]) + pace[:, None]


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    """A scene with videos, where people are rectangles of their own colours, and its calibration."""
    folder = tmp_path_factory.mktemp("yard")
    rig = Rig(tuple(replace(camera, lens=LENS) for camera in ring(3, height=5.0)))
    frame, identity = np.repeat(np.arange(1, FRAMES + 1), PEOPLE), np.tile(np.arange(1, PEOPLE + 1), FRAMES)
    seen = observe(rig, walkers().reshape(-1, 2), np.full(len(frame), 1.75), frame, identity)
    text = "[scene]\nname = 'yard'\nfps = 5.0\n"
    (folder / "videos").mkdir()
    for camera in rig:
        boxes = seen[camera.name].boxes
        write_boxes(folder / "out" / "tracks" / f"{camera.name}.txt", boxes)
        text += f"[cameras.{camera.name}]\nintrinsics = 'rig.toml'\nvideo = 'videos/{camera.name}.mp4'\n"
        with VideoWriter(folder / "videos" / f"{camera.name}.mp4", SIZE, FPS) as video:
            for number in range(1, FRAMES + 1):
                picture = np.full((SIZE[1], SIZE[0], 3), 110, np.uint8)
                mine = np.flatnonzero(boxes.frame == number)
                for row in mine[np.argsort(boxes.ltwh[mine, 1] + boxes.ltwh[mine, 3])]:  # the nearest last
                    left, top, width, height = np.round(boxes.ltwh[row]).astype(int)
                    picture[top : top + height, left : left + width] = COLOURS[boxes.identity[row] - 1]
                video.write(picture)
    write_rig(folder / "rig.toml", rig)
    (folder / "scene.toml").write_text(text)
    write_rig(folder / "out" / "rig.toml", rig)
    cameras = [{"name": name, "boxes": len(seen[name].boxes), "fps": FPS, "time_offset_s": 0.0} for name in rig.names]
    report = {"scene_file": str(folder / "scene.toml"), "verdict": "accepted", "reasons": [], "cameras": cameras}
    (folder / "out" / "calibration.json").write_text(json.dumps(report))
    return folder, rig, {name: one.boxes for name, one in seen.items()}


@pytest.fixture
def out(made, tmp_path):
    """A copy of the calibration, to be spoilt."""
    return shutil.copytree(made[0] / "out", tmp_path / "out")


def change(out, **values):
    path = out / "calibration.json"
    path.write_text(json.dumps(json.loads(path.read_text()) | values))


def test_crops_show_the_people_they_are_named_after(made, tmp_path):
    folder, _, boxes = made
    told = []
    found = scene_people(folder / "out", tmp_path, tell=lambda stage, done=0, total=0, *, part="": told.append(stage))
    crops = found.crops
    assert set(crops.cameras) == {f"yard/{name}" for name in CAMERAS}
    identity = [int(name.removeprefix("yard/").split("@")[0]) for name in crops.people]
    assert set(identity) == set(range(1, PEOPLE + 1))
    for path, person in zip(crops.paths, crops.person.tolist(), strict=True):
        picture = cv2.imread(str(path)).astype(float)
        height, width = picture.shape[:2]
        middle = picture[height // 4 : -height // 4, width // 4 : -width // 4].mean(axis=(0, 1))
        assert np.abs(np.array(COLOURS) - middle).sum(axis=1).argmin() == identity[person] - 1
    pairs, count = np.unique(np.column_stack([crops.person, crops.camera]), axis=0, return_counts=True)
    assert count.max() <= 24
    assert (np.bincount(pairs[:, 0]) >= 2).all()
    assert all(identity[a] != identity[b] for a, b in np.argwhere(crops.apart))
    assert crops.apart.sum() >= 20
    assert (found.scene.name, found.notes) == ("yard", ())
    assert {"reading", "checking identities"} <= set(told)
    figures = found.figures
    assert figures["crops"] == len(crops) == sum(figures["crops_by_camera"].values())
    assert (figures["people"], figures["identified"]) == (len(crops.people), sum(len(one) for one in boxes.values()))
    assert figures["sure"] + sum(figures["left_out"].values()) == figures["identified"]
    assert figures["sure_share"] == figures["sure"] / figures["identified"] > 0.4
    json.dumps(figures, allow_nan=False)
    again = scene_people(folder / "out", tmp_path)
    assert (again.crops.paths, again.figures) == (crops.paths, figures), "the same calibration gives the same crops"
    assert (again.crops.person == crops.person).all()


def test_a_scene_that_was_moved_is_named_and_frames_are_counted_alike_without_a_clock(made, out, tmp_path, monkeypatch):
    known = scene_people(out, tmp_path / "cache")
    cameras = json.loads((out / "calibration.json").read_text())["cameras"]
    change(out, cameras=[camera | {"fps": None, "time_offset_s": None} for camera in cameras])
    assert len(scene_people(out, tmp_path / "cache").crops) == len(known.crops)
    for place, said in ((str(tmp_path / "gone" / "scene.toml"), r"gone/scene\.toml: no such file.*new path"),
                        (None, "does not state the path of the scene file")):  # fmt: skip
        change(out, scene_file=place)
        with pytest.raises(InputError, match=said):
            scene_people(out, tmp_path / "cache")
    assert len(scene_people(out, tmp_path / "cache", made[0] / "scene.toml").crops) == len(known.crops) > 100
    monkeypatch.chdir(made[0] / "videos")
    assert scene_file(Path("../scene.toml")) == (made[0].resolve() / "scene.toml").as_posix()
    assert scene_file(None) is None


def test_a_doubtful_calibration_and_a_camera_without_video_are_named(made, out, tmp_path):
    change(out, verdict="doubtful")
    scene = made[0] / "two_videos.toml"
    scene.write_text((made[0] / "scene.toml").read_text().replace("video = 'videos/C3.mp4'", "tracks = 'C3.txt'"))
    found = scene_people(out, tmp_path / "cache", scene)
    assert set(found.crops.cameras) == {"yard/C1", "yard/C2"}
    assert "is doubtful" in found.notes[0]
    assert "no video of camera C3" in found.notes[1]


def test_one_camera_or_a_refused_calibration_teaches_nothing(made, out, tmp_path):
    _, rig, _ = made
    write_rig(out / "rig.toml", Rig((rig["C1"], *(replace(rig[name], pose=None) for name in ("C2", "C3")))))
    with pytest.raises(EvidenceError, match="1 of 3 cameras have a pose"):
        scene_people(out, tmp_path / "cache")
    change(out, verdict="refused", reasons=["all people walk on one line"])
    with pytest.raises(EvidenceError, match="was refused: all people walk on one line") as error:
        scene_people(out, tmp_path / "cache")
    assert (error.value.exit_status, error.value.reasons) == (3, ("all people walk on one line",))


@pytest.mark.parametrize("fault", ["no one known", "three people", "a moment", "wrong poses"])
def test_too_little_is_refused_with_figures(made, out, tmp_path, fault):
    _, rig, boxes = made
    spoilt = {
        "no one known": lambda seen: replace(seen, identity=np.full(len(seen), -1)),
        "three people": lambda seen: seen.take(seen.identity <= 3),
        "a moment": lambda seen: seen.take(seen.frame <= 6),
    }.get(fault, lambda seen: seen)
    for name, seen in boxes.items():
        write_boxes(out / "tracks" / f"{name}.txt", spoilt(seen))
    if fault == "wrong poses":
        turned = np.array([[0.0, -1, 0], [1, 0, 0], [0, 0, 1]])
        moves = (("C2", turned, [1.0, 2.0, 0.0]), ("C3", turned.T, [2.0, -1.0, 0.0]))
        wrong = (replace(rig[name], pose=rig[name].pose.moved(turn, np.array(shift))) for name, turn, shift in moves)
        write_rig(out / "rig.toml", Rig((rig["C1"], *wrong)))
    with pytest.raises(EvidenceError, match=r"identifies too few people reliably: \d+ people and \d+ crops") as error:
        scene_people(out, tmp_path / "cache")
    assert "identified boxes are reliable" in error.value.reasons[1]
    assert not (tmp_path / "cache" / "yard").exists()


def test_bad_input_is_named(made, out, tmp_path):
    def refused(match, scene=None, place=out):
        with pytest.raises(InputError, match=match):
            scene_people(place, tmp_path / "cache", scene)

    refused(r"nowhere/calibration\.json: no such file: name the folder", place=tmp_path / "nowhere")
    other = tmp_path / "other.toml"
    other.write_text((made[0] / "scene.toml").read_text().replace("C3", "D3"))
    refused(r"other\.toml: has no \[cameras\.C3\]", other)
    other.write_text("".join(f"[cameras.{name}]\nintrinsics = 'rig.toml'\ntracks = '{name}.txt'\n" for name in CAMERAS))
    refused(r"no calibrated camera has a video", other)
    whole = (out / "calibration.json").read_text()
    for cameras, match in (
        ([{"name": name, "fps": 5.0 if name == "C1" else None} for name in CAMERAS], "camera C2 has no fps, though others"),
        ([{"name": name, "fps": "fast"} for name in CAMERAS], "camera C1 has fps 'fast'"),
        ([{"name": "C1", "fps": 5.0}], "it has no camera C2, which rig.toml has"),
        (3, "cameras is 3, which should be a valid list"),
    ):
        change(out, cameras=cameras)
        refused(match)
    change(out, verdict=None)
    refused("verdict is None.*calibrate again")
    for name, text, match in (
        ("calibration.json", "[]", "it is not a table"),
        ("calibration.json", "{", "is not JSON"),
        ("calibration.json", whole, None),
        ("tracks/C2.txt", None, r"C2\.txt: no such file: the tracks of camera C2"),
        ("tracks/C2.txt", "1,1,5\n", r"C2\.txt: line 1: 3 columns"),
        ("rig.toml", None, r"rig\.toml: no such file"),
    ):
        (out / name).unlink() if text is None else (out / name).write_text(text)
        if match:
            refused(match)
