import json

import cv2
import numpy as np
import pytest

from passerby.common.errors import InputError
from passerby.core.cameras import Rig
from support.refusals import refused
from support.scenes.handmade_rigs import SIZE, facing, largest_told_px, read_back, same_cameras, written

# As docs/quickstart/data_conventions.md of nerfstudio shows it: one lens at the top, for all frames.
DOCUMENTED = {
    "fl_x": 1072.281897246229,
    "fl_y": 1068.6906965388932,
    "cx": 1504.0,
    "cy": 1000.0,
    "w": 3008,
    "h": 2000,
    "camera_model": "OPENCV_FISHEYE",
    "k1": 0.03126218448029553,
    "k2": 0.005177020067511987,
    "k3": 0.0006640977794272005,
    "k4": 0.00010067035656515042,
    "frames": [
        {
            "file_path": f"images/frame_0000{index}.jpeg",
            "transform_matrix": [[1.0, 0.0, 0.0, index], [0.0, 1.0, 0.0, 0.0], [0.0, 0.0, 1.0, 0.0], [0.0, 0.0, 0.0, 1.0]],
        }
        for index in (1, 2)
    ],
}


def test_a_camera_at_a_known_place(tmp_path):
    written("nerfstudio", Rig((facing("north", distortions=(-0.1, 0.02, 0.001, -0.002, 0.003)),)), tmp_path / "t.json")
    content = json.loads((tmp_path / "t.json").read_text())
    # nerfstudio takes numbers at the top for all cameras, so none may stand there.
    (frame,) = content.pop("frames")
    assert content == {"camera_model": "OPENCV", "orientation_override": "none"}
    # Columns: right, up, backward, place.
    np.testing.assert_allclose(
        frame.pop("transform_matrix"), [[1, 0, 0, 4], [0, 0, -1, -3], [0, 1, 0, 2.5], [0, 0, 0, 1]], atol=1e-12
    )
    numbers = {"fl_x": 1000.0, "fl_y": 1100.0, "cx": 960.5, "cy": 540.5, "w": SIZE[0], "h": SIZE[1]}
    bent = {"k1": -0.1, "k2": 0.02, "p1": 0.001, "p2": -0.002, "k3": 0.003, "k4": 0.0}
    assert {"file_path": "images/north.png", **numbers, **bent}.items() <= frame.items()


def test_the_documented_file(tmp_path):
    (tmp_path / "transforms.json").write_text(json.dumps(DOCUMENTED))
    rig, _ = read_back("nerfstudio", tmp_path)
    assert rig.names == ("frame_00001", "frame_00002")
    camera = rig["frame_00002"]
    assert camera.lens.fisheye
    assert camera.lens.size == (3008, 2000)
    np.testing.assert_array_equal(camera.lens.matrix[:2, 2], (1503.5, 999.5))
    np.testing.assert_array_equal(camera.lens.distortions, [DOCUMENTED[key] for key in ("k1", "k2", "k3", "k4")])
    # The identity looks along the world's -z, up is y.
    np.testing.assert_array_equal(camera.centre, (2, 0, 0))
    np.testing.assert_array_equal(camera.pose.R_cw, np.diag([1, -1, -1]))
    point = np.array([[2.3, 0.2, -1.5]])
    seen = cv2.fisheye.projectPoints(
        np.array([[[0.3, -0.2, 1.5]]]), np.zeros(3), np.zeros(3), camera.lens.matrix, camera.lens.distortions
    )[0][0, 0]
    np.testing.assert_allclose(camera.project(point)[0], seen, atol=1e-9)


def test_frames_of_the_same_name_in_different_folders(tmp_path):
    frames = [{**frame, "file_path": f"./{folder}/0.png"} for folder, frame in zip("ab", DOCUMENTED["frames"], strict=True)]
    (tmp_path / "t.json").write_text(json.dumps({**DOCUMENTED, "frames": frames}))
    assert read_back("nerfstudio", tmp_path / "t.json")[0].names == ("a/0", "b/0")


def test_fisheyes_are_held_and_mixed_rigs_lose(tmp_path):
    fisheye = facing("wide", distortions=(0.01, -0.002, 0.001, 0.0005), fisheye=True)
    assert written("nerfstudio", Rig((fisheye,)), tmp_path / "t.json") == ()
    assert same_cameras(Rig((fisheye,)), read_back("nerfstudio", tmp_path / "t.json")[0])
    mixed = Rig((fisheye, facing("narrow", distortions=(-0.05, 0.01, 0, 0, 0))))
    with pytest.raises(InputError, match=r"camera narrow: .*fisheye"):
        written("nerfstudio", mixed, tmp_path / "mixed.json")
    told = written("nerfstudio", mixed, tmp_path / "mixed.json", lossy=True)
    back, _ = read_back("nerfstudio", tmp_path / "mixed.json")
    assert len(told) == 1
    assert same_cameras(mixed, back, at_most_px=largest_told_px(told))


def test_size_and_unit_as_told(tmp_path):
    content = {key: value for key, value in DOCUMENTED.items() if key not in ("w", "h")}
    (tmp_path / "t.json").write_text(json.dumps(content))
    with pytest.raises(InputError, match="states no image size"):
        read_back("nerfstudio", tmp_path / "t.json")
    assert read_back("nerfstudio", tmp_path / "t.json", size=(3008, 2000))[0]["frame_00002"].lens.size == (3008, 2000)


@pytest.mark.parametrize(
    ("change", "match"),
    [
        ({"frames": [3]}, r"frames\[0\]: holds no frame"),
        ({"frames": []}, "has no list `frames`"),
        ({"camera_model": "EQUIRECTANGULAR"}, "camera_model 'EQUIRECTANGULAR' is not known"),
        ({"fl_x": -5}, "focal lengths above 0"),
        ({"w": 12.5}, "w is 12.5: a whole number"),
        ({"p1": 0.1}, "a fisheye has no tangential"),
        ({"camera_model": "OPENCV"}, "k4 = 0.00010067: OpenCV's pinhole has no such"),
        ({"frames": [{"file_path": "a", "transform_matrix": [[1, 0, 0, 0]] * 4}]}, "is not a rotation"),
        ({"frames": [{"file_path": "a"}]}, "transform_matrix is missing"),
        ({"frames": 2 * DOCUMENTED["frames"][:1]}, r"camera .*frame_00001.* occurs twice"),
    ],
)
def test_bad_files(tmp_path, change, match):
    path = tmp_path / "t.json"
    path.write_text(json.dumps({**DOCUMENTED, **change}))
    with refused(match, path):
        read_back("nerfstudio", path)
