"""A data set as a scene folder: what is in it by what the set states, and nothing where it cannot be made."""

from dataclasses import replace
from pathlib import Path

import av
import cv2
import numpy as np
import pytest

from passerby.common.errors import InputError
from passerby.core.cameras import Rig
from passerby.core.observations import UNKNOWN, Boxes, Keypoints
from passerby.datasets.published import GroundTruth, Published
from passerby.datasets.scene_folder import write_scene_folder
from passerby.interchange.coco import read_keypoints
from passerby.interchange.motchallenge import read_boxes
from passerby.interchange.rig_toml import read_rig
from passerby.scene.scene import Scene
from support.scenes.people_and_rigs import ring

RIG = ring(3)
SIZE = (64, 48)


def boxes(identity: int = 4) -> Boxes:
    return Boxes([1, 2], [identity, identity], [[10.0, 20, 30, 90], [12, 20, 30, 90]], [1.0, 0.5])


def joints(identity: int = 4) -> Keypoints:
    return Keypoints([1, 2], [identity] * 2, np.full((2, 2, 2), 40.0), np.full((2, 2), 0.5), ("head", "foot"))


def pictures(folder: Path, camera: str, count: int = 3, size: tuple[int, int] = SIZE) -> tuple[Path, ...]:
    paths = tuple(folder / camera / f"{number:04d}.png" for number in range(count))
    for number, path in enumerate(paths):
        path.parent.mkdir(parents=True, exist_ok=True)
        cv2.imwrite(str(path), np.full((size[1], size[0], 3), 60 * number + 20, np.uint8))
    return paths


@pytest.fixture
def source(tmp_path: Path) -> Path:
    (tmp_path / "set").mkdir()
    return tmp_path / "set"


def files(folder: Path) -> list[str]:
    return sorted(path.relative_to(folder).as_posix() for path in folder.rglob("*") if path.is_file())


def test_identities_of_two_cameras_make_a_scene_that_is_given(tmp_path: Path, source: Path) -> None:
    """With the truth beside it; a camera that sees no one is left out, and that is noted."""
    ground = GroundTruth(np.array([2, 1]), np.array([4, 4]), np.array([[1.0, 2.0], [0.5, 2.0]]))
    published = Published(
        "yard", RIG, 25.0, {"C1": boxes(), "C2": boxes()}, {"C1": joints()}, ground=ground, notes=("A note.",)
    )
    made = write_scene_folder(published, tmp_path / "scene", source)
    assert (made.mode, made.videos) == ("given", None)
    assert made.notes == ("A note.", "C3 is not in scene.toml: it has no people in its view.")
    assert files(tmp_path / "scene") == [
        "dataset.toml", "ground_positions.csv", "intrinsics.toml", "keypoints/C1.json", "scene.toml", "tracks/C1.txt",
        "tracks/C2.txt", "truth.toml",
    ]  # fmt: skip
    scene = Scene.load(made.scene)
    assert (list(scene.cameras), scene.scene.fps, scene.association.mode) == (["C1", "C2"], 25.0, "given")
    assert read_boxes(tmp_path / "scene" / "tracks" / "C1.txt").identity.tolist() == [4, 4]
    assert read_keypoints(tmp_path / "scene" / "keypoints" / "C1.json").identity.tolist() == [4, 4]
    assert all(camera.pose is None for camera in read_rig(tmp_path / "scene" / "intrinsics.toml"))
    assert made.truth is not None
    np.testing.assert_allclose(read_rig(made.truth)["C2"].centre, RIG["C2"].centre, atol=1e-9)
    lines = (tmp_path / "scene" / "ground_positions.csv").read_text().splitlines()
    assert lines == ["frame,id,x_m,y_m", "1,4,0.5000,2.0000", "2,4,1.0000,2.0000"]


def test_identities_of_one_camera_alone_are_truth_and_kept_from_the_calibration(tmp_path: Path, source: Path) -> None:
    unposed = Rig(tuple(replace(camera, pose=None) for camera in RIG))
    published = Published("yard", unposed, 5.0, {"C1": boxes(), "C2": boxes(UNKNOWN)}, {"C2": joints(UNKNOWN), "C1": joints()})
    made = write_scene_folder(published, tmp_path / "scene", source)
    assert (made.mode, made.truth) == ("combined", None)
    folder = tmp_path / "scene"
    assert files(folder) == [
        "dataset.toml", "detections/C1.txt", "detections/C2.txt", "intrinsics.toml", "keypoints/C1.json", "keypoints/C2.json",
        "scene.toml", "truth/C1.txt",
    ]  # fmt: skip
    assert read_boxes(folder / "detections" / "C1.txt").identity.tolist() == [UNKNOWN] * 2
    assert read_keypoints(folder / "keypoints" / "C1.json").identity.tolist() == [UNKNOWN] * 2
    assert read_boxes(folder / "truth" / "C1.txt").identity.tolist() == [4, 4]


def test_pictures_become_videos_where_a_scene_cannot_do_without(tmp_path: Path, source: Path) -> None:
    shown = {"C1": pictures(source, "C1"), "C2": pictures(source, "C2", size=(65, 49)), "C3": pictures(source, "C3")}
    published = Published("yard", RIG, 10.0, pictures=shown, picture_frames={"C3": (1, 2, 4)})
    made = write_scene_folder(published, tmp_path / "scene", source)
    assert made.mode == "combined"
    assert made.notes == (
        "C3 is not in scene.toml: it has no people in its view.",
        "No video is made of the images of C3: they do not go from frame 1 on without a gap.",
    )
    for camera in ("C1", "C2"):
        with av.open(str(tmp_path / "scene" / "videos" / f"{camera}.mp4")) as container:
            frames = [frame.to_ndarray(format="bgr24") for frame in container.decode(video=0)]
        # A row or column more than H.264 can take is left out.
        assert [frame.shape for frame in frames] == [(48, 64, 3)] * 3
        assert [round(float(frame.mean()), -1) for frame in frames] == [20.0, 80.0, 140.0]
    listed = (tmp_path / "scene" / "pictures.csv").read_text().splitlines()
    assert (len(listed), listed[-1]) == (10, f"C3,4,{shown['C3'][2].resolve().as_posix()}")


def test_videos_beside_identities_make_a_second_scene_and_keypoints_alone_make_one(tmp_path: Path, source: Path) -> None:
    named = {camera: source / f"{camera}.mp4" for camera in ("C1", "C2")}
    published = Published("yard", RIG, 25.0, {"C1": boxes(), "C2": boxes()}, videos=named)
    made = write_scene_folder(published, tmp_path / "scene", source)
    assert (made.mode, made.videos) == ("given", tmp_path / "scene" / "videos.toml")
    assert made.videos is not None
    scene = Scene.load(made.videos)
    assert [str(table.video) for table in scene.cameras.values()] == [path.resolve().as_posix() for path in named.values()]
    assert (scene.association.mode, scene.scene.fps) == ("combined", None)
    keypoints = Published("two", RIG, 5.0, keypoints=dict.fromkeys(("C1", "C2"), joints()))
    assert write_scene_folder(keypoints, tmp_path / "alone", source).mode == "given"
    assert read_keypoints(tmp_path / "alone" / "keypoints" / "C1.json").identity.tolist() == [4, 4]


def test_too_little_for_a_scene_is_refused_with_why(tmp_path: Path, source: Path) -> None:
    gap, shown = (source / "1.png", source / "3.png"), {"C1": pictures(source, "C1"), "C2": pictures(source, "C2")}
    two = ("C1", "C2")
    for published, told in (
        (Published("yard", RIG, 25.0),
         "has people in no cameras of 3: two are needed with boxes, keypoints, a video or images;"),
        (Published("yard", RIG, 9.0, pictures=dict.fromkeys(two, gap), picture_frames=dict.fromkeys(two, (1, 3))),
         "No video is made of the images of C1: they do not go from frame 1 on without a gap"),
        (Published("yard", RIG, 25.0, {"C1": boxes()}), "has people in 1 camera of 3: two are needed"),
        (Published("yard", RIG, None, pictures=shown),
         r"\(No video is made of the images of C1: the set states no frame rate\); fetch more of the set"),
    ):  # fmt: skip
        with pytest.raises(InputError, match=told):
            write_scene_folder(published, tmp_path / "scene", source)
    with pytest.raises(InputError, match=r"inside: lies in the folder of the data set, .*: give one outside of it"):
        write_scene_folder(Published("yard", RIG, 25.0, {"C1": boxes(), "C2": boxes()}), source / "inside", source)
    assert not (tmp_path / "scene").exists()
    assert not (source / "inside").exists()


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (lambda path: path.write_bytes(b"broken"), r"0002\.png: is not an image that can be read: fetch it again"),
        (lambda path: cv2.imwrite(str(path), np.zeros((20, 64, 3), np.uint8)),
         r"0002\.png: has another size than .*0000\.png: images of one camera must be alike"),
    ],
)  # fmt: skip
def test_a_picture_that_fits_no_video_leaves_the_scene_before(tmp_path: Path, source: Path, change, said: str) -> None:
    given = Published("yard", RIG, 10.0, {"C1": boxes(), "C2": boxes()})
    write_scene_folder(given, tmp_path / "scene", source)
    before = {name: (tmp_path / "scene" / name).read_bytes() for name in files(tmp_path / "scene")}
    shown = {"C1": pictures(source, "C1"), "C2": pictures(source, "C2")}
    change(shown["C2"][2])
    with pytest.raises(InputError, match=said):
        write_scene_folder(replace(given, pictures=shown), tmp_path / "scene", source, film=True)
    assert {name: (tmp_path / "scene" / name).read_bytes() for name in files(tmp_path / "scene")} == before
    assert sorted(path.name for path in tmp_path.iterdir()) == ["scene", "set"]


def test_a_set_that_contradicts_itself_is_a_fault_of_its_reader(source: Path) -> None:
    with pytest.raises(ValueError, match=r"boxes of \['C9'\], who are no cameras of the rig"):
        Published("yard", RIG, 25.0, {"C9": boxes()})
    with pytest.raises(ValueError, match="camera C1 has 2 numbers for 3 images"):
        Published("yard", RIG, 25.0, pictures={"C1": pictures(source, "C1")}, picture_frames={"C1": (1, 2)})
