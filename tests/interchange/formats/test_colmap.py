"""COLMAP's models: cameras of every kind that COLMAP has, models as COLMAP writes them, and files that are broken."""

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
from support.scenes.handmade_rigs import facing
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
def test_models_that_opencv_has(model, tmp_path):
    """As binary files; the next tests read text."""
    write_binary_model(tmp_path, model, EXACT[model][0])
    rig, told = read_rig_as("colmap-bin", tmp_path)
    assert told == ()
    np.testing.assert_allclose(rig["C1"].project(RAYS), np.array(EXACT[model][1]) - 0.5, atol=1e-8)


@thinned("model", FITTED, every=2)
def test_models_that_opencv_has_not(model, tmp_path):
    parameters, pixels = FITTED[model]
    write_text_model(tmp_path, model, parameters)
    with pytest.raises(InputError, match=rf"camera C1: COLMAP's model {model} is none of OpenCV's.*--lossy"):
        read_rig_as("colmap", tmp_path)
    rig, told = read_rig_as("colmap", tmp_path, lossy=True)
    stated = float(re.search(r"up to ([\d.e+-]+) px off", told[0])[1])
    off = np.linalg.norm(rig["C1"].project(RAYS) - (np.array(pixels) - 0.5), axis=1).max()
    assert off <= stated < 5


def test_prisms_of_zero_are_opencvs_fisheye(tmp_path):
    write_text_model(tmp_path, "THIN_PRISM_FISHEYE", (500.0, 510.0, 640.5, 360.25, 0.03, -0.01, 0, 0, 0.002, -0.0005, 0, 0))
    rig, told = read_rig_as("colmap", tmp_path)
    assert told == ()
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


def test_images_of_one_camera_and_cameras_without_images(tmp_path):
    images = "2 0.8 0.6 0 0 1 2 3 7 yard/a.JPG\n1.0 2.0 -1 5 6 3\n1 1 0 0 0 0 0 0.5 7 two words.png\n\n"
    write_text_model(tmp_path, "PINHOLE", EXACT["PINHOLE"][0], images=images)
    with (tmp_path / "cameras.txt").open("a") as file:
        file.write("9 PINHOLE 640 480 500 500 320 240\n")
    rig, _ = read_rig_as("colmap", tmp_path, Given(metres_per_unit=0.5))
    assert rig.names == ("two words", "yard_a", "camera9")
    np.testing.assert_allclose(rig["yard_a"].pose.R_cw, [[1, 0, 0], [0, 0.28, -0.96], [0, 0.96, 0.28]], atol=1e-12)
    np.testing.assert_allclose(rig["yard_a"].pose.t_cw, [0.5, 1, 1.5])
    assert (rig["camera9"].pose, rig["camera9"].lens.matrix[0, 2]) == (None, 319.5)


def test_either_name_reads_what_lies_there(tmp_path):
    write_binary_model(tmp_path / "sparse", "PINHOLE", EXACT["PINHOLE"][0])
    assert read_rig_as("colmap", tmp_path / "sparse")[0].names == ("C1",)
    assert read_rig_as("colmap-bin", tmp_path / "sparse" / "cameras.bin")[0].names == ("C1",)


@pytest.mark.parametrize(
    ("name", "text", "said"),
    [
        ("cameras.txt", "7 PINHOLE 1280\n", "line 1: has 3 values: CAMERA_ID"),
        ("cameras.txt", "7 PINHOLE 1280 720 1 2 x 4\n", "line 1: '1 2 x 4': finite numbers"),
        ("cameras.txt", "7 PINHOLE 1280 7.5 1 2 3 4\n", "whole numbers are needed"),
        ("cameras.txt", "7 PINHOLE 1280 720 1 2 3\n", "has 3 parameters, but model PINHOLE takes 4"),
        ("cameras.txt", "7 PINHOLES 1280 720 1 2 3 4\n", "'PINHOLES' is not known"),
        ("cameras.txt", "8 PINHOLE 1280 720 1 2 3 4\n", "image C1.png is of camera 7"),
        ("images.txt", "1 1 0 0 0 0 0 0 7\n", "line 1: has 9 values: IMAGE_ID"),
        ("images.txt", "1 0 0 0 0 0 0 0 7 C1.png\n", "is not a rotation"),
    ],
)
def test_faults_of_text(name, text, said, tmp_path):
    write_text_model(tmp_path, "PINHOLE", EXACT["PINHOLE"][0])
    (tmp_path / name).write_text(text)
    with refused(re.escape(said), tmp_path):
        read_rig_as("colmap", tmp_path)


def test_faults_of_binary_files(tmp_path):
    write_binary_model(tmp_path, "PINHOLE", EXACT["PINHOLE"][0])
    whole = (tmp_path / "images.bin").read_bytes()
    (tmp_path / "cameras.bin").write_bytes(struct.pack("<QIiQQ", 1, 7, 99, 1280, 720))
    with pytest.raises(InputError, match=r"cameras\.bin: camera 7: COLMAP's model number 99 is not known"):
        read_rig_as("colmap-bin", tmp_path)
    (tmp_path / "cameras.bin").write_bytes(struct.pack("<Q", 2**60))
    with pytest.raises(InputError, match="ends at byte 8, in the middle of an entry"):
        read_rig_as("colmap-bin", tmp_path)
    write_binary_model(tmp_path, "PINHOLE", (float("nan"), 1010.0, 640.5, 360.25))
    with pytest.raises(InputError, match=r"cameras\.bin: camera 7: parameters \(nan, .*: finite numbers are needed"):
        read_rig_as("colmap-bin", tmp_path)
    write_binary_model(tmp_path, "PINHOLE", EXACT["PINHOLE"][0])
    (tmp_path / "images.bin").write_bytes(whole[:-24] + struct.pack("<Q", 2**61))
    with pytest.raises(InputError, match="in the middle of an entry"):
        read_rig_as("colmap-bin", tmp_path)
    with pytest.raises(InputError, match=r"has neither cameras\.txt nor cameras\.bin"):
        read_rig_as("colmap", tmp_path.parent)


def test_people_are_points(tmp_path):
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
