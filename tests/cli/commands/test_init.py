"""`passerby init`: folders as people have them become scene files that load, and nothing is invented or overwritten."""

import os
import re
import shutil

import cv2
import numpy as np
import pytest
import typer

from passerby.cli.commands.init import init
from passerby.cli.main import run
from passerby.common.errors import InputError
from passerby.interchange.rig_toml import read_lens, read_rig
from passerby.interchange.video_writer import VideoWriter
from passerby.scene.inputs import read_cameras
from passerby.scene.scene import Scene
from support.refusals import refused
from support.scenes.recorded_videos import FOCAL, write_recorded

WIDTH, HEIGHT = 64, 48


@pytest.fixture(scope="session")
def clip(tmp_path_factory):
    path = tmp_path_factory.mktemp("clip") / "clip.mp4"
    with VideoWriter(path, (WIDTH, HEIGHT), fps=25) as video:
        for shade in range(10):
            video.write(np.full((HEIGHT, WIDTH, 3), 20 * shade, np.uint8))
    return path


@pytest.fixture
def folder(tmp_path, clip):
    """Fills a folder with videos of the given names."""

    def fill(*names):
        for name in names:
            path = tmp_path / "shoot" / name
            path.parent.mkdir(parents=True, exist_ok=True)
            shutil.copy(clip, path)
        return tmp_path / "shoot"

    return fill


def rig(*names, width=WIDTH, height=HEIGHT, focal=60.0):
    return "".join(
        f"[{name}]\nsize = [{width}, {height}]\ndistortions = [0.0, 0.0, 0.0, 0.0, 0.0]\n"
        f"matrix = [[{focal}, 0.0, {width / 2}], [0.0, {focal}, {height / 2}], [0.0, 0.0, 1.0]]\n"
        for name in names
    )


def write_opencv(path, focal=60.0, size=(WIDTH, HEIGHT), centre=(WIDTH / 2, HEIGHT / 2)):
    path.parent.mkdir(parents=True, exist_ok=True)
    storage = cv2.FileStorage(str(path), cv2.FILE_STORAGE_WRITE)
    for key, value in zip(("image_width", "image_height"), size or (), strict=False):
        storage.write(key, value)
    storage.write("camera_matrix", np.array([[focal, 0, centre[0]], [0, focal, centre[1]], [0, 0, 1]]))
    storage.write("dist_coeffs", np.zeros((5, 1)))
    storage.release()


def videos(scene):
    return {name: table.video.as_posix() for name, table in scene.cameras.items()}


def lenses(scene):
    return {name: read_lens(scene.resolve(table.intrinsics), name) for name, table in scene.cameras.items()}


def told(capsys):
    return capsys.readouterr().out


def started(place):
    """The scene file that `init` writes into a folder."""
    init(place)
    return Scene.load(place / "scene.toml")


def images(folder, count=3):
    folder.mkdir(parents=True, exist_ok=True)
    for number in range(count):
        cv2.imwrite(str(folder / f"{number:06d}.jpg"), np.zeros((HEIGHT, WIDTH, 3), np.uint8))


def test_videos_and_a_rig_file_become_a_scene_that_a_command_writes_too(folder, tmp_path, capsys):
    place = folder("videos/cam1.mp4", "videos/cam2.mp4", "videos/cam10.mp4")
    (place / "rig.toml").write_text(rig("cam1", "cam2", "cam10"))
    scene = started(place)
    assert scene.scene.name == "shoot"
    assert list(videos(scene).items()) == [(name, f"videos/{name}.mp4") for name in ("cam1", "cam2", "cam10")]
    assert {table.intrinsics.as_posix() for table in scene.cameras.values()} == {"rig.toml"}
    assert all(lens.focal == 60 for lens in lenses(scene).values())
    assert sorted(path.name for path in place.iterdir()) == ["rig.toml", "scene.toml", "videos"]
    out = told(capsys)
    assert re.search(r"cam1 +videos/cam1.mp4 +64 x 48 +25 +0.4 s +h264 +found", out)
    assert f"1. passerby check {place}/scene.toml\n  2. passerby calibrate {place}/scene.toml -o out" in out
    assert run(["init", str(place), "-o", str(tmp_path / "my scene.toml"), "--force"]) == 0
    assert f"passerby check '{tmp_path}/my scene.toml'" in told(capsys)


def test_the_rig_file_that_serves_most_cameras_is_taken_and_the_others_are_named(folder, capsys):
    place = folder("a.mp4", "b.mp4", "c.mp4")
    for name, cameras, focal in (("calib", "ab", 50.0), ("other", "abc", 60.0), ("rig", "abc", 70.0)):
        (place / f"{name}.toml").write_text(rig(*cameras, focal=focal))
    assert {lens.focal for lens in lenses(started(place)).values()} == {70}
    for name in ("calib", "other"):
        (place / f"{name}.toml").unlink()
    (place / "rig.toml").write_text(rig("c0", "c1"))
    (place / "broken.toml").write_text("[")
    # A template with FX and FY, as earlier versions wrote it.
    (place / "intrinsics.toml").write_text(rig("a").replace("60.0", '"FX"', 1))
    init(place, force=True)
    out = told(capsys)
    assert "rig.toml: c0, c1 cannot be matched with the cameras a, b, c" in out
    assert "broken.toml: is not TOML" in out
    assert re.search(r"a +a.mp4 .* INCOMPLETE\n", out)
    assert re.search(r"b +b.mp4 .* estimated\n", out)


@pytest.mark.parametrize("names", [("Cam 1 (left).MP4", 'it\'s "2" [x].mov'), ("1/a.mp4", "2/b.mkv")])
def test_every_switched_off_setting_is_one(folder, names):
    """Without the # before the settings the file is a scene file too."""
    place = folder(*names)
    as_written, path = started(place), place / "scene.toml"
    path.write_text(re.sub(r"(?m)^#(?=\S)", "", path.read_text()))
    scene = Scene.load(path)
    assert len(scene.scale.distances) == len(scene.scale.lengths) == len(scene.scale.camera_heights) == 1
    assert scene.solver.reference == next(iter(scene.cameras))

    def kept(one):
        perception = one.perception.detector, one.perception.embedder, one.perception.keypoints
        return one.association.mode, one.association.search_s, one.scale.person_height_m, *perception

    assert kept(scene) == kept(as_written)
    assert all(scene.resolve(table.video).is_file() for table in scene.cameras.values())


def test_without_intrinsics_they_are_estimated(folder, capsys):
    place = folder("cam1.mp4", "cam2.mp4")
    scene = started(place)
    assert all(table.intrinsics is None and table.image_size is None for table in scene.cameras.values())
    assert sorted(path.name for path in place.iterdir()) == ["cam1.mp4", "cam2.mp4", "scene.toml"]
    out = told(capsys)
    assert len(re.findall(r"cam[12] .* estimated\n", out)) == 2
    assert "no intrinsics for cam1, cam2: focal length, principal point and distortion will be estimated" in out

    # Of one camera they are found later: the other one's are still estimated.
    (place / "rig.toml").write_text(rig("cam1"))
    init(place, force=True)
    mixed = Scene.load(place / "scene.toml")
    assert [mixed.cameras[name].intrinsics is None for name in ("cam1", "cam2")] == [False, True]
    assert re.search(r"cam1 .* found\n(.*\n)?cam2 .* estimated\n", told(capsys))


def test_cameras_are_called_as_in_the_rig_file_and_tables_that_no_camera_can_be_called_as_are_copied(folder, capsys):
    place = folder("a/walk-cam1.mp4", "a/walk-cam2.mp4", "b/Cam 1 (left).mp4", "b/Cam 2 (right).mp4")
    (place / "a" / "calibration").mkdir()
    (place / "a" / "calibration" / "Calib.toml").write_text(rig("int_cam_01", "int_cam_02"))
    (place / "a" / "Config.toml").write_text("[project]\nframe_rate = 30\n")
    scene = started(place / "a")
    assert videos(scene) == {"int_cam_01": "walk-cam1.mp4", "int_cam_02": "walk-cam2.mp4"}
    assert len(lenses(scene)) == 2
    assert "camera cam1 is called int_cam_01" in told(capsys)
    (place / "b" / "rig.toml").write_text(rig('"1 (left)"', '"2 (right)"', focal=70.0))
    assert {name: lens.focal for name, lens in lenses(started(place / "b")).items()} == {"1 left": 70, "2 right": 70}
    assert read_rig(place / "b" / "intrinsics.toml").metadata == {"source": "rig.toml"}


@pytest.mark.parametrize(
    "places",
    [
        ("calib/cam1.yml", "calib/cam2.yml"),
        ("Calibration/intrinsics_cam1.xml", "Calibration/intrinsics_cam2.xml"),
        ("intrinsics/cam1/calib.json", "intrinsics/cam2/calib.json"),
        ("cam1_calibration.yaml", "cam2_calibration.yaml"),
    ],
)
def test_files_of_opencv(folder, places, capsys):
    place = folder("cam1/video.mp4", "cam2/video.mp4")
    for focal, name in zip((60, 70), places, strict=True):
        write_opencv(place / name, focal)
    (place / "notes.json").write_text("{}")
    scene = started(place)
    assert videos(scene) == {"cam1": "cam1/video.mp4", "cam2": "cam2/video.mp4"}
    assert {name: lens.focal for name, lens in lenses(scene).items()} == {"cam1": 60, "cam2": 70}
    assert "MISSING" not in told(capsys)


def test_a_file_of_opencv_without_the_picture_size(folder, capsys):
    place = folder("cam1.mp4", "cam2.mp4")
    write_opencv(place / "calib" / "cam1.yml", size=None)
    write_opencv(place / "calib" / "cam2.yml", size=None, centre=(WIDTH, HEIGHT))
    scene, out = started(place), told(capsys)
    assert re.search(r"cam1 .* size assumed\n", out)
    assert re.search(r"cam2 .* estimated\n", out)
    assert "cam2.yml: does not state the image size, and its principal point [64.0, 48.0] is not that of the 64 x 48" in out
    assert scene.cameras["cam2"].intrinsics is None
    assert read_lens(place / scene.cameras["cam1"].intrinsics, "cam1").size == (WIDTH, HEIGHT)
    assert "ASSUMED: that file does not say" in (place / "scene.toml").read_text()


@pytest.mark.parametrize(
    ("size", "state", "what"),
    [((48, 64), "WRONG SIZE", "rotated by 90 degrees"), ((128, 96), "WRONG SIZE", "scaled by 0.5"), ((64, 56), "found", "")],
)
def test_a_lens_of_another_size(folder, capsys, size, state, what):
    place = folder("a.mp4", "b.mp4")
    (place / "rig.toml").write_text(rig("a", width=size[0], height=size[1]) + rig("b"))
    init(place)
    out = told(capsys)
    assert re.search(rf"a +a.mp4 .* {state}\n", out)
    assert what in out
    text = (place / "scene.toml").read_text()
    assert ("# TO DO: its frames are 64 x 48" in text) == bool(what)
    assert ("without its last columns or rows" in text) != bool(what)
    Scene.load(place / "scene.toml")


def test_videos_that_are_left_out_are_named(folder, capsys):
    place = folder("cam1.mp4", "cam2.mp4", "cam2.avi", ".cam4.mp4", "old/cam1.mp4")
    (place / "cam5.ts").write_text("export const a = 1\n" * 100)
    images(place / "pictures" / "front")
    assert list(started(place).cameras) == ["cam1", "cam2"]
    out = told(capsys)
    for said in ("cam5.ts: is text, not a video", "1 hidden video", "taken to be a copy of cam2.avi", f"videos in {place}/old"):
        assert said in out


def test_a_video_that_cannot_be_read_stays_a_camera(folder, capsys):
    """So that no calibration leaves it out by mistake: `init` ends with 2, and `check` reports the file."""
    place = folder("cam1.mp4", "cam2.mp4")
    (place / "cam3.mp4").write_bytes(b"")
    with pytest.raises(typer.Exit) as ended:
        init(place)
    assert ended.value.exit_code == 2
    assert re.search(r"cam3 +cam3.mp4 .* UNREADABLE\n", out := told(capsys))
    assert "1. camera cam3:" in out
    assert "holds 0 bytes" in out
    scene = Scene.load(place / "scene.toml")
    assert list(scene.cameras) == ["cam1", "cam2", "cam3"]
    *_, third = read_cameras(scene)
    assert any("holds 0 bytes" in fault for fault in third.faults)


@pytest.mark.parametrize(
    ("names", "expected", "told"),
    [
        (("north/GX010001.MP4", "north/GX020001.MP4", "gate/GX010001.MP4", "overview.mp4"),
         {"gate": "gate/GX010001.MP4", "north": "north"},
         ("camera north: 2 pieces", "overview.mp4: the cameras are assumed to be the subfolders")),
        (("videos/a.mp4", "videos/b.mp4", "annotated/a.mp4", "annotated/b.mp4"), {"a": "videos/a.mp4", "b": "videos/b.mp4"},
         ()),
    ],
)  # fmt: skip
def test_which_folders_are_cameras(folder, capsys, names, expected, told):
    place = folder(*names)
    init(place)
    assert videos(Scene.load(place / "scene.toml")) == expected
    out = capsys.readouterr().out
    assert all(text in out for text in told)


@pytest.mark.parametrize(
    ("files", "said"),
    [({}, "neither it nor a folder in it"), ({"a.mp4": None}, "holds only one camera"),
     ({"a.mp4": b"", "b.mp4": b"no video"}, r"neither it nor .*a.mp4: holds 0 bytes"),
     *(({f"{place}/{number:06d}.jpg": b"" for number in range(3)},
        r"holds 3 images of one camera \(.*000000.jpg, ...\) and no video: give the folder")
       for place in (".", "front", "pictures/front"))],
)  # fmt: skip
def test_too_few_cameras_are_an_error(tmp_path, clip, files, said):
    place = tmp_path / "shoot"
    place.mkdir()
    for name, content in files.items():
        (place / name).parent.mkdir(parents=True, exist_ok=True)
        (place / name).write_bytes(clip.read_bytes() if content is None else content)
    for path, told in ((place, said), (tmp_path / "none", "no such folder"), (clip, "is a file: give the folder")):
        with refused(told, path):
            init(path)
    assert not list(place.rglob("scene.toml"))


def test_a_scene_file_elsewhere_finds_the_videos_and_the_intrinsics_beside_it(folder, tmp_path, monkeypatch, capsys):
    place = folder("a.mp4", "b.mp4")
    (tmp_path / "linked").symlink_to(tmp_path / "deep" / "er")
    (tmp_path / "deep" / "er").mkdir(parents=True)
    (tmp_path / "elsewhere").mkdir()
    (tmp_path / "elsewhere" / "intrinsics.toml").write_text(rig("a", "b"))
    init(place, tmp_path / "elsewhere" / "my.toml")
    assert len(re.findall(r"[ab] .* found\n", told(capsys))) == 2
    assert sorted(path.name for path in (tmp_path / "elsewhere").iterdir()) == ["intrinsics.toml", "my.toml"]
    (place / "rig.toml").write_text(rig("a", "b"))
    init(place, tmp_path / "linked" / "my.toml")
    for out in ("elsewhere/my.toml", "linked/my.toml"):
        scene = Scene.load(tmp_path / out)
        assert all(scene.resolve(table.video).is_file() for table in scene.cameras.values())
        assert {lens.focal for lens in lenses(scene).values()} == {60}
    assert not (place / "scene.toml").exists()
    monkeypatch.chdir(place)
    scene = started(place.relative_to(place))
    assert (videos(scene), Scene.load(place / "scene.toml").name) == ({"a": "a.mp4", "b": "b.mp4"}, "shoot")


def test_nothing_is_overwritten(folder):
    place = folder("a.mp4", "b.mp4")
    (place / "rig.toml").write_text(rig("a", "b"))
    init(place)
    path = place / "scene.toml"
    path.write_text(path.read_text() + "# mine\n")
    with pytest.raises(InputError, match=r"scene.toml: is there already: .*--force"):
        init(place)
    assert "# mine" in path.read_text()
    init(place, force=True)
    assert "# mine" not in path.read_text()
    for out, force, told in ((place / "rig.toml", True, "is not a scene file"), (place, False, "is a folder: name the scene")):
        with refused(told, out):
            init(place, out, force=force)
    assert (place / "rig.toml").read_text() == rig("a", "b")
    assert sorted(path.name for path in place.iterdir()) == ["a.mp4", "b.mp4", "rig.toml", "scene.toml"]


MINUTES = [f"2024-05-01_10-{minute:02d}-00.mp4" for minute in range(3)]
FRIGATE = [
    f"recordings/2024-05-01/{hour}/{camera}/{second}.mp4"
    for hour in (13, 14)
    for camera in ("front", "back yard")
    for second in ("00.00", "00.10", "00.20")
]


@pytest.mark.parametrize(
    ("names", "below", "expected"),
    [
        ([f"{camera}_{name}" for camera in ("front", "back") for name in MINUTES], "",
         {"back": "back_[12]*.mp4", "front": "front_[12]*.mp4"}),
        ([f"{camera}/{name}" for camera in ("front", "back") for name in MINUTES], "", {"back": "back", "front": "front"}),
        ([f"{camera}/{number:03d}.mkv" for camera in ("front", "back") for number in range(3)], "",
         {"back": "back", "front": "front"}),
        *((FRIGATE, below, {camera: f"{pattern}{camera}/*.mp4" for camera in ("back yard", "front")})
          for below, pattern in (("", "recordings/*/*/"), ("recordings/2024-05-01", "*/"), ("recordings/2024-05-01/13", ""))),
    ],
)  # fmt: skip
def test_pieces_of_recordings_are_cameras(folder, capsys, names, below, expected):
    """Each camera's pieces are one video, in the folders and patterns that a scene file takes."""
    scene = started(folder(*names) / below)
    assert videos(scene) == expected
    assert "pieces" in told(capsys)
    readings = read_cameras(scene)
    assert [fault for reading in readings for fault in reading.faults] == []
    assert [len(reading.video.files) for reading in readings] == [3, 3]


def test_a_part_of_long_recordings_is_proposed_and_pieces_of_one_camera_are_not_enough(folder, capsys):
    hours = [name.replace("/14/", "/16/") for name in FRIGATE]
    hours += [f"recordings/2024-05-01/16/{camera}/40.00.mp4" for camera in ("front", "back yard")]
    place = folder(*hours)
    scene = started(place)
    assert (str(scene.scene.from_), str(scene.scene.until)) == ("2024-05-01 16:00:00", "2024-05-01 16:15:00")
    assert "too few images can be looked at: choose a time with many people" in told(capsys)
    folder(*(f"minutes/{name}" for name in MINUTES), *(f"below/videos/{name}" for name in MINUTES))
    for below in ("minutes", "below", "recordings/2024-05-01/13/front"):
        with refused(r"holds pieces of one camera's recording .* in a row", "in a folder of its own"):
            init(place / below)
        assert not list((place / below).rglob("*.toml"))
    # Phones that filmed together: their videos overlap.
    phones = ("VID_20240501_100000.mp4", "VID_20240501_100000_1.mp4", "PXL_20240501_100000123.mp4")
    folder(*(f"phones/{name}" for name in phones))
    assert len(started(place / "phones").cameras) == 3


@pytest.mark.parametrize("above", ["", "images/"])
def test_images_of_two_cameras_are_cameras(tmp_path, capsys, above):
    for name in (f"{above}C1", f"{above}C2", "calibration"):
        images(tmp_path / name)
    init(tmp_path)
    assert "replace IMAGES PER SECOND" in told(capsys)
    path = tmp_path / "scene.toml"
    with pytest.raises(InputError, match="fps"):
        Scene.load(path)
    path.write_text(path.read_text().replace('"IMAGES PER SECOND"', "10.0"))
    scene = Scene.load(path)
    assert videos(scene) == {"C1": f"{above}C1", "C2": f"{above}C2"}
    assert [len(reading.video.files) for reading in read_cameras(scene)] == [3, 3]


def test_the_metadata_of_the_videos_are_used_or_suggested(tmp_path, capsys):
    """A focal length is used as it is; one device twice is a suggestion."""
    phone = {"make": "Google", "model": "Pixel 8"}
    for name, metadata in (("a", phone), ("b", phone), ("c", {**phone, FOCAL: "24"}), ("d", {})):
        write_recorded(tmp_path / f"cam {name}.mkv", metadata)
    init(tmp_path)
    out, path = told(capsys), tmp_path / "scene.toml"
    states = " ".join(re.search(rf"(?m)^{name} .* (\w+)$", out)[1] for name in "abcd")
    assert states == "estimated estimated metadata estimated"
    assert "the metadata of b state the same device as those of a: cameras of one model can share" in out
    text = path.read_text()
    assert text.count("Google Pixel 8") == 1
    assert all(table.lens is None and table.focal_35mm is None for table in Scene.load(path).cameras.values())

    path.write_text(text.replace("#lens", "lens").replace("#focal_35mm", "focal_35mm"))
    stated = Scene.load(path)
    assert stated.models["b"] == ("a", "b")
    assert stated.cameras["c"].focal_35mm == 24

    # With intrinsics of one of them, the others can begin with these.
    (tmp_path / "rig.toml").write_text(rig("b"))
    init(tmp_path, force=True)
    assert '#lens = "same as b"' in path.read_text()


def test_boxes_without_videos_and_beside_one(folder, tmp_path, capsys):
    place = tmp_path / "boxes"
    for key, ending in (("detections", "txt"), ("keypoints", "json")):
        (place / key).mkdir(parents=True)
        for name in ("north", "gate"):
            (place / key / f"{name}.{ending}").write_text("")
    init(place)
    out = told(capsys)
    assert "camera north: replace WIDTH and HEIGHT by the size of the images in which its people were detected" in out
    path = place / "scene.toml"
    with pytest.raises(InputError, match=r"image_size"):
        Scene.load(path)
    path.write_text(path.read_text().replace('["WIDTH", "HEIGHT"]', "[640, 480]"))
    scene = Scene.load(path)
    assert scene.cameras["north"].detections.as_posix() == "detections/north.txt"
    assert scene.cameras["gate"].keypoints.as_posix() == "keypoints/gate.json"
    assert scene.cameras["gate"].image_size == (640, 480)

    place = folder("V1.mp4")
    (place / "detections").mkdir()
    for name in ("V1", "V2"):
        (place / "detections" / f"{name}.txt").write_text("")
    init(place)
    path = place / "scene.toml"
    path.write_text(path.read_text().replace('["WIDTH", "HEIGHT"]', "[640, 480]"))
    scene = Scene.load(path)
    assert scene.cameras["V1"].watched
    assert scene.cameras["V2"].detections is not None
    assert scene.cameras["V2"].fps == 25
    assert "assumed: 25 frames per second, as the video's, for V2" in told(capsys)


def test_names_that_a_file_can_have(folder, capsys):
    """Line ends, control characters and broken UTF-8 in names, and links that lead nowhere."""
    place = folder("a\nb/x\ty.mp4", "a\nb/#1 \\.mp4")
    shutil.copy(place / "a\nb" / "x\ty.mp4", os.fsencode(place / "a\nb") + b"/\xff.mp4")
    (place / "a\nb" / "gone.mp4").symlink_to(place / "nowhere")
    write_opencv(place / "calib" / "x y.yml")
    scene = started(place)
    assert list(scene.cameras) == ["1", "x y"]
    assert all(scene.resolve(table.video).is_file() for table in scene.cameras.values())
    assert read_lens(scene.resolve(scene.cameras["x y"].intrinsics), "x y").focal == 60
    assert r"'\udcff.mp4'" in told(capsys)
