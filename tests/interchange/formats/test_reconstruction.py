"""Models of COLMAP and transforms of nerfstudio, as these tools write them, and broken ones."""

import json
import re
import struct

import numpy as np
import pytest

from passerby.common.errors import InputError
from passerby.core.cameras import Rig
from passerby.core.observations import Clock
from passerby.core.trajectories import Trajectories
from passerby.interchange.formats import Export, Given, export, read_rig_as
from support.refusals import refused
from support.scenes.handmade_rigs import SIZE, facing, largest_told_px, read_back, same_cameras, written
from support.tiers import thinned

RAYS = np.array([[0.3, -0.2, 1.0], [-0.5, 0.1, 1.1]])
# Parameters, and where pycolmap 4.2.1 (Camera.img_from_cam) has RAYS: pixels from the corner of the first one.
EXACT = {
    "SIMPLE_PINHOLE": ((1000.0, 640.5, 360.25), ((940.5, 160.25), (185.954545455, 451.159090909))),
    "PINHOLE": ((1000.0, 1010.0, 640.5, 360.25), ((940.5, 158.25), (185.954545455, 452.068181818))),
    "SIMPLE_RADIAL": ((1000.0, 640.5, 360.25, -0.12), ((935.82, 163.37), (197.675056349, 448.81498873))),
    "RADIAL": ((1000.0, 640.5, 360.25, -0.12, 0.03), ((935.9721, 163.2686), (197.045442127, 448.940911575))),
    "OPENCV": ((1000.0, 1010.0, 640.5, 360.25, -0.2, 0.05, 0.001, -0.002),
        ((932.2135, 163.78581), (203.100530267, 448.734907762))),
    "OPENCV_FISHEYE": ((500.0, 510.0, 640.5, 360.25, 0.03, -0.01, 0.002, -0.0005),
        ((784.96124584, 262.016352829), (426.553270386, 403.895132841))),
    "FULL_OPENCV": ((1000.0, 1010.0, 640.5, 360.25, -0.2, 0.05, 0.001, -0.002, 0.01, 0.02, -0.01, 0.004),
        ((931.50828703, 164.2606534), (204.739031812, 448.40393045))),
    "SIMPLE_RADIAL_FISHEYE": ((500.0, 640.5, 360.25, 0.03), ((784.981410258, 263.929059828), (426.480436476, 403.053912705))),
    "RADIAL_FISHEYE": ((500.0, 640.5, 360.25, 0.03, -0.01), ((784.960766223, 263.942822518), (426.555983047, 403.038803391))),
    "SIMPLE_FISHEYE": ((500.0, 640.5, 360.25), ((784.464225351, 264.273849766), (427.683341789, 402.813331642))),
    "FISHEYE": ((500.0, 510.0, 640.5, 360.25), ((784.464225351, 262.354326762), (427.683341789, 403.664598275))),
}  # fmt: skip
FITTED = {
    "FOV": ((700.0, 710.0, 640.5, 360.25, 0.9), ((857.419328016, 213.571216294), (319.372907836, 425.39292441))),
    "THIN_PRISM_FISHEYE": ((500.0, 510.0, 640.5, 360.25, 0.03, -0.01, 0.0012, -0.0008, 0.002, -0.0005, 0.0007, -0.0009),
        ((784.822613948, 262.124872584), (426.355439604, 403.962395307))),
    "RAD_TAN_THIN_PRISM_FISHEYE": (
        (500.0, 510.0, 640.5, 360.25, 0.03, -0.01, 0.002, -0.0005, 0.0001, -2e-05, 0.0012, -0.0008, 0.0007, -0.0009,
         0.0003, 0.0002),
        ((785.213943745, 261.888697855), (426.966851162, 403.799478707))),
    "SIMPLE_DIVISION": ((1000.0, 640.5, 360.25, -0.1), ((936.698219961, 162.784520026), (195.323168533, 449.285366293))),
    "DIVISION": ((1000.0, 1010.0, 640.5, 360.25, -0.1), ((936.698219961, 160.809865226), (195.323168533, 450.175719956))),
    "EUCM": ((700.0, 710.0, 640.5, 360.25, 0.55, 1.1), ((842.809901337, 223.449971477), (340.768285609, 421.052719205))),
}  # fmt: skip
MODELS = [
    "SIMPLE_PINHOLE", "PINHOLE", "SIMPLE_RADIAL", "RADIAL", "OPENCV", "OPENCV_FISHEYE", "FULL_OPENCV", "FOV",
    "SIMPLE_RADIAL_FISHEYE", "RADIAL_FISHEYE", "THIN_PRISM_FISHEYE", "RAD_TAN_THIN_PRISM_FISHEYE", "SIMPLE_DIVISION",
    "DIVISION", "SIMPLE_FISHEYE", "FISHEYE", "EUCM",
]  # fmt: skip
"""As COLMAP numbers them."""


def write_text_model(folder, model, parameters, images="1 1 0 0 0 0 0 0 7 C1.png\n\n"):
    folder.mkdir(exist_ok=True)
    (folder / "cameras.txt").write_text(f"# Camera list\n7 {model} 1280 720 {' '.join(map(str, parameters))}\n")
    (folder / "images.txt").write_text("# Image list\n" + images)


def write_binary_model(folder, model, parameters):
    folder.mkdir(exist_ok=True)
    packed = struct.pack(f"<QIiQQ{len(parameters)}d", 1, 7, MODELS.index(model), 1280, 720, *parameters)
    (folder / "cameras.bin").write_bytes(packed)
    image = struct.pack("<QI7dI", 1, 1, 1, 0, 0, 0, 0, 0, 0, 7) + b"C1.png\0" + struct.pack("<Q2dq", 1, 5.0, 6.0, -1)
    (folder / "images.bin").write_bytes(image)


@pytest.mark.parametrize("model", EXACT)
def test_models_of_colmap_that_opencv_has(model, tmp_path):
    """As binary files; the next tests read text."""
    write_binary_model(tmp_path, model, EXACT[model][0])
    rig, told = read_rig_as("colmap-bin", tmp_path)
    assert told == ()
    np.testing.assert_allclose(rig["C1"].project(RAYS), np.array(EXACT[model][1]) - 0.5, atol=1e-8)


@thinned("model", FITTED, every=2)
def test_models_of_colmap_that_opencv_has_not(model, tmp_path):
    parameters, pixels = FITTED[model]
    write_text_model(tmp_path, model, parameters)
    with pytest.raises(InputError, match=rf"camera C1: COLMAP's model {model} is none of OpenCV's.*--lossy"):
        read_rig_as("colmap", tmp_path)
    rig, told = read_rig_as("colmap", tmp_path, lossy=True)
    stated = float(re.search(r"up to ([\d.e+-]+) px off", told[0])[1])
    off = np.linalg.norm(rig["C1"].project(RAYS) - (np.array(pixels) - 0.5), axis=1).max()
    assert off <= stated < 5


def test_a_thin_prism_of_zeros_is_the_fisheye_of_opencv(tmp_path):
    write_text_model(tmp_path, "THIN_PRISM_FISHEYE", (500.0, 510.0, 640.5, 360.25, 0.03, -0.01, 0, 0, 0.002, -0.0005, 0, 0))
    rig, losses = read_rig_as("colmap", tmp_path)
    assert losses == ()
    np.testing.assert_allclose(rig["C1"].project(RAYS), np.array(EXACT["OPENCV_FISHEYE"][1]) - 0.5, atol=1e-8)


def test_an_equirectangular_camera_is_left_out(tmp_path):
    write_text_model(tmp_path, "EQUIRECTANGULAR", (1280, 720))
    with pytest.raises(InputError, match="holds no camera with a lens"):
        read_rig_as("colmap", tmp_path, lossy=True)
    with (tmp_path / "cameras.txt").open("a") as file:
        file.write("8 PINHOLE 640 480 500 500 320 240\n")
    with pytest.raises(InputError, match=r"camera C1: COLMAP's model EQUIRECTANGULAR.*--lossy"):
        read_rig_as("colmap", tmp_path)
    assert read_rig_as("colmap", tmp_path, lossy=True)[0].names == ("camera8",)


def test_images_of_one_camera_and_cameras_without_images_are_read_by_either_name(tmp_path):
    images = "2 0.8 0.6 0 0 1 2 3 7 yard/a.JPG\n1.0 2.0 -1 5 6 3\n1 1 0 0 0 0 0 0.5 7 two words.png\n\n"
    write_text_model(tmp_path, "PINHOLE", EXACT["PINHOLE"][0], images=images)
    with (tmp_path / "cameras.txt").open("a") as file:
        file.write("9 PINHOLE 640 480 500 500 320 240\n")
    rig, _ = read_rig_as("colmap", tmp_path, Given(metres_per_unit=0.5))
    assert rig.names == ("two words", "yard_a", "camera9")
    np.testing.assert_allclose(rig["yard_a"].pose.R_cw, [[1, 0, 0], [0, 0.28, -0.96], [0, 0.96, 0.28]], atol=1e-12)
    np.testing.assert_allclose(rig["yard_a"].pose.t_cw, [0.5, 1, 1.5])
    assert (rig["camera9"].pose, rig["camera9"].lens.matrix[0, 2]) == (None, 319.5)
    write_binary_model(tmp_path / "sparse", "PINHOLE", EXACT["PINHOLE"][0])
    for form, path in (("colmap", tmp_path / "sparse"), ("colmap-bin", tmp_path / "sparse" / "cameras.bin")):
        assert read_rig_as(form, path)[0].names == ("C1",)


@pytest.mark.parametrize(("name", "text", "message"), [
    ("cameras.txt", "7 PINHOLE 1280\n", "line 1: has 3 values: CAMERA_ID"),
    ("cameras.txt", "7 PINHOLE 1280 720 1 2 x 4\n", "line 1: '1 2 x 4': finite numbers"),
    ("cameras.txt", "7 PINHOLE 1280 7.5 1 2 3 4\n", "whole numbers are needed"),
    ("cameras.txt", "7 PINHOLE 1280 720 1 2 3\n", "has 3 parameters, but model PINHOLE takes 4"),
    ("cameras.txt", "7 PINHOLES 1280 720 1 2 3 4\n", "'PINHOLES' is not known"),
    ("cameras.txt", "8 PINHOLE 1280 720 1 2 3 4\n", "image C1.png is of camera 7"),
    ("images.txt", "1 1 0 0 0 0 0 0 7\n", "line 1: has 9 values: IMAGE_ID"),
    ("images.txt", "1 0 0 0 0 0 0 0 7 C1.png\n", "is not a rotation"),
])  # fmt: skip
def test_broken_text_of_colmap_is_refused(name, text, message, tmp_path):
    write_text_model(tmp_path, "PINHOLE", EXACT["PINHOLE"][0])
    (tmp_path / name).write_text(text)
    with refused(re.escape(message), tmp_path):
        read_rig_as("colmap", tmp_path)


CAMERAS = struct.pack("<QIiQQ4d", 1, 7, 1, 1280, 720, 1000, 1010, 640.5, 360.25)


@pytest.mark.parametrize(("name", "content", "message"), [
    ("cameras.bin", struct.pack("<QIiQQ", 1, 7, 99, 1280, 720),
     r"cameras\.bin: camera 7: COLMAP's model number 99 is not known"),
    ("cameras.bin", struct.pack("<Q", 2**60), "ends at byte 8, in the middle of an entry"),
    ("cameras.bin", CAMERAS[:32] + struct.pack("<d", np.nan) + CAMERAS[40:],
     r"cameras\.bin: camera 7: parameters \(nan, .*: finite numbers are needed"),
    ("images.bin", struct.pack("<QI7dI", 1, 1, 1, 0, 0, 0, 0, 0, 0, 7) + b"C1.png\0" + struct.pack("<Q", 2**61),
     "in the middle of an entry"),
])  # fmt: skip
def test_broken_binary_files_of_colmap_are_refused(tmp_path, name, content, message):
    with pytest.raises(InputError, match=r"has neither cameras\.txt nor cameras\.bin"):
        read_rig_as("colmap", tmp_path)
    write_binary_model(tmp_path, "PINHOLE", EXACT["PINHOLE"][0])
    assert (tmp_path / "cameras.bin").read_bytes() == CAMERAS
    (tmp_path / name).write_bytes(content)
    with refused(message, tmp_path):
        read_rig_as("colmap-bin", tmp_path)


def test_people_are_points_of_colmap(tmp_path):
    whole = np.arange(5)
    xyz = np.column_stack([whole, 2.0 * whole, np.full(5, 0.9)])
    people = Trajectories(whole, whole, whole / 10, xyz, np.full(5, 0.1), whole, whole, Clock(10.0))
    for form in ("colmap", "colmap-bin"):
        export(Export(Rig((facing(),)), "x", people), form, tmp_path)
    lines = [line for line in (tmp_path / "points3D.txt").read_text().splitlines() if not line.startswith("#")]
    np.testing.assert_allclose([[float(word) for word in line.split()[1:4]] for line in lines], xyz)
    packed = (tmp_path / "points3D.bin").read_bytes()
    assert (struct.unpack_from("<Q", packed), len(packed)) == ((5,), 8 + 5 * (8 + 24 + 3 + 8 + 8))
    np.testing.assert_allclose(struct.unpack_from("<Q3d", packed, 8 + 51), [2, *xyz[1]])


# As docs/quickstart/data_conventions.md of nerfstudio shows it: one lens at the top, for all frames.
DOCUMENTED = {
    "fl_x": 1072.281897246229, "fl_y": 1068.6906965388932, "cx": 1504.0, "cy": 1000.0, "w": 3008, "h": 2000,
    "camera_model": "OPENCV_FISHEYE",
    "k1": 0.03126218448029553, "k2": 0.005177020067511987, "k3": 0.0006640977794272005, "k4": 0.00010067035656515042,
    "frames": [
        {"file_path": f"images/frame_0000{index}.jpeg",
         "transform_matrix": [[1.0, 0.0, 0.0, index], [0.0, 1.0, 0.0, 0.0], [0.0, 0.0, 1.0, 0.0], [0.0, 0.0, 0.0, 1.0]]}
        for index in (1, 2)
    ],
}  # fmt: skip


def test_nerfstudio_finds_a_camera_at_a_known_place(tmp_path):
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


def test_the_documented_file_of_nerfstudio_is_read(tmp_path):
    (tmp_path / "transforms.json").write_text(json.dumps(DOCUMENTED))
    rig, _ = read_back("nerfstudio", tmp_path)
    assert rig.names == ("frame_00001", "frame_00002")
    camera = rig["frame_00002"]
    assert (camera.lens.fisheye, camera.lens.size) == (True, (3008, 2000))
    np.testing.assert_array_equal(
        camera.lens.matrix, [[DOCUMENTED["fl_x"], 0, 1503.5], [0, DOCUMENTED["fl_y"], 999.5], [0, 0, 1]]
    )
    np.testing.assert_array_equal(camera.lens.distortions, [DOCUMENTED[key] for key in ("k1", "k2", "k3", "k4")])
    # The identity looks along the world's -z, up is y.
    np.testing.assert_array_equal(camera.centre, (2, 0, 0))
    np.testing.assert_array_equal(camera.pose.R_cw, np.diag([1, -1, -1]))
    frames = [{**frame, "file_path": f"./{folder}/0.png"} for folder, frame in zip("ab", DOCUMENTED["frames"], strict=True)]
    sizeless = {key: value for key, value in DOCUMENTED.items() if key not in ("w", "h")}
    (tmp_path / "transforms.json").write_text(json.dumps({**sizeless, "frames": frames}))
    with pytest.raises(InputError, match="states no image size"):
        read_back("nerfstudio", tmp_path)
    rig, _ = read_back("nerfstudio", tmp_path, size=(3008, 2000))
    assert (rig.names, rig["b/0"].lens.size) == (("a/0", "b/0"), (3008, 2000))


def test_a_rig_of_fisheyes_and_others_is_a_loss_of_nerfstudio(tmp_path):
    fisheye = facing("wide", distortions=(0.01, -0.002, 0.001, 0.0005), fisheye=True)
    mixed = Rig((fisheye, facing("narrow", distortions=(-0.05, 0.01, 0, 0, 0))))
    with pytest.raises(InputError, match=r"camera narrow: .*fisheye"):
        written("nerfstudio", mixed, tmp_path / "mixed.json")
    (loss,) = written("nerfstudio", mixed, tmp_path / "mixed.json", lossy=True)
    back, _ = read_back("nerfstudio", tmp_path / "mixed.json")
    assert same_cameras(mixed, back, at_most_px=largest_told_px([loss]))


@pytest.mark.parametrize(("change", "message"), [
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
])  # fmt: skip
def test_broken_files_of_nerfstudio_are_refused(tmp_path, change, message):
    path = tmp_path / "t.json"
    path.write_text(json.dumps({**DOCUMENTED, **change}))
    with refused(message, path):
        read_back("nerfstudio", path)
