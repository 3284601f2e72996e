import cv2
import numpy as np
import pytest

from passerby.common.errors import InputError
from passerby.core.cameras import Rig
from support.refusals import refused
from support.scenes.handmade_rigs import CENTRE, LOOKING_NORTH, MATRIX, SIZE, TRANSLATION, facing, read_back, written


def opencv(name, columns, *values):
    return (
        f"{name}: !!opencv-matrix\r\n  rows: {len(values) // columns}\r\n  cols: {columns}\r\n  dt: d\r\n"
        f"  data: [{', '.join(f'{value:.6f}' for value in values)}]\r\n"
    )


# As EasyMocap's own writer has it: six digits, Windows' line ends, no picture size.
INTRI = '%YAML:1.0\r\n---\r\nnames:\r\n  - "01"\r\n  - "02"\r\n' + "".join(
    opencv(f"K_{name}", 3, *MATRIX.ravel()) + opencv(f"dist_{name}", 5, *bent)
    for name, bent in (("01", (-0.1, 0.02, 0.001, -0.002, 0.003)), ("02", (0, 0, 0, 0, 0)))
)
EXTRI = '%YAML:1.0\r\n---\r\nnames:\r\n  - "01"\r\n' + opencv("R_01", 1, np.pi / 2, 0, 0) + opencv("T_01", 1, *TRANSLATION)


def node(path, key):
    """A matrix as EasyMocap reads it."""
    file = cv2.FileStorage(str(path), cv2.FILE_STORAGE_READ)
    return file.getNode(key).mat()


def test_a_camera_at_a_known_place(tmp_path):
    written("easymocap", Rig((facing("north", distortions=(-0.1, 0.02, 0.001, -0.002, 0.003)),)), tmp_path)
    extri, intri = tmp_path / "extri.yml", tmp_path / "intri.yml"
    assert all(path.read_text().startswith("%YAML:1.0\n---\n") for path in (intri, extri))
    for path, key, expected in (
        (extri, "R_north", [[np.pi / 2], [0], [0]]), (extri, "Rot_north", LOOKING_NORTH),
        (extri, "T_north", np.reshape(TRANSLATION, (3, 1))), (intri, "K_north", MATRIX),
        (intri, "dist_north", [[-0.1, 0.02, 0.001, -0.002, 0.003]]),
    ):  # fmt: skip
        np.testing.assert_allclose(node(path, key), expected, atol=1e-12)
    file = cv2.FileStorage(str(intri), cv2.FILE_STORAGE_READ)
    assert (int(file.getNode("W_north").real()), int(file.getNode("H_north").real())) == SIZE
    assert file.getNode("names").at(0).string() == "north"


def test_a_file_of_easymocap(tmp_path):
    (tmp_path / "intri.yml").write_bytes(INTRI.encode())
    (tmp_path / "extri.yml").write_bytes(EXTRI.encode())
    with pytest.raises(InputError, match=r"camera 01: states no image size.*--size"):
        read_back("easymocap", tmp_path)
    rig, _ = read_back("easymocap", tmp_path, size=SIZE)
    assert rig.names == ("01", "02")
    np.testing.assert_allclose(rig["01"].centre, CENTRE, atol=1e-5)
    np.testing.assert_array_equal(rig["01"].lens.distortions, [-0.1, 0.02, 0.001, -0.002, 0.003])
    assert rig["02"].pose is None


@pytest.mark.parametrize("told", ["[", '["one", 2]'])
def test_names_that_were_not_told_whole_are_those_of_the_file(tmp_path, told):
    """What Passerby adds to tell them may have been edited by hand."""
    written("easymocap", Rig((facing("a b"), facing("é"))), tmp_path)
    path = tmp_path / "intri.yml"
    lines = path.read_text().splitlines(keepends=True)
    (index,) = [k for k, line in enumerate(lines) if line.startswith("passerby_names")]
    lines[index] = f"passerby_names: '{told}'\n"
    path.write_text("".join(lines))
    assert len(read_back("easymocap", tmp_path)[0]) == 2
    assert not {"a b", "é"} & set(read_back("easymocap", tmp_path)[0].names)


@pytest.mark.parametrize(
    ("intri", "extri", "match"),
    [
        ("nothing: 1", None, "has no list `names`"),
        ("\x00", None, "is not YAML"),
        ("[1]", None, "holds no table of OpenCV"),
        (INTRI.replace("K_02", "K_03"), None, "camera 02: K_02 is missing"),
        (INTRI.replace("1100.000000", "-1100.000000"), None, "camera 01: matrix .* focal lengths"),
        (INTRI.replace('"02"', '"01"'), None, "camera 01 occurs twice"),
        (INTRI, EXTRI.replace("T_01", "T_1"), "camera 01: R_01 or T_01 is missing"),
        (INTRI, EXTRI.replace("1.570796, ", ""), "camera 01: R_01 is .*: 3 numbers are needed"),
    ],
)
def test_bad_files(tmp_path, intri, extri, match):
    (tmp_path / "intri.yml").write_text(intri)
    if extri is not None:
        (tmp_path / "extri.yml").write_text(extri)
    with refused(match, tmp_path):
        read_back("easymocap", tmp_path, size=SIZE)
