"""BioCV's .calib files: the order of their numbers, millimetres, folders."""

import numpy as np
import pytest

from passerby.common.errors import InputError
from passerby.interchange.formats import read_rig_as
from support.scenes.handmade_rigs import LOOKING_NORTH, MATRIX, PIXELS, POINTS, SIZE, TRANSLATION


def calib(path, distortion=(0, 0, 0, 0, 0), rotation=LOOKING_NORTH):
    rows = [*np.column_stack([rotation, 1000 * np.array(TRANSLATION)]).tolist(), [0, 0, 0, 1]]
    blocks = [
        f"{SIZE[0]}\n{SIZE[1]}",
        *("\n".join(" ".join(map(str, row)) for row in block) for block in (MATRIX.tolist(), rows)),
    ]
    path.write_text("\n".join([*blocks[:2], "", blocks[2], "", " ".join(map(str, distortion)), ""]))
    return path


def test_points_by_hand(tmp_path):
    rig, losses = read_rig_as("biocv", calib(tmp_path / "00.calib"))
    assert ((rig.names, losses), rig["00"].lens.size) == ((("00",), ()), SIZE)
    np.testing.assert_allclose(rig["00"].project(POINTS), PIXELS, atol=1e-6)


def test_a_folder(tmp_path):
    for number in (10, 2):
        calib(tmp_path / f"{number}.calib", (-0.1, 0.02, 0.001, -0.002, 0.003))
    rig, _ = read_rig_as("biocv", tmp_path)
    assert rig.names == ("2", "10")
    np.testing.assert_array_equal(rig["2"].lens.distortions, (-0.1, 0.02, 0.001, -0.002, 0.003))


def test_bad_files(tmp_path):
    path = calib(tmp_path / "00.calib", (0.1, 0.2))
    with pytest.raises(InputError, match=r"00.calib: the file: holds no width, height"):
        read_rig_as("biocv", path)
    with pytest.raises(InputError, match=r"the 4 x 4 matrix: .* not a rotation"):
        read_rig_as("biocv", calib(path, rotation=np.diag([1.0, 1, -1])))
    (tmp_path / "empty").mkdir()
    with pytest.raises(InputError, match=r"holds no [.]calib file"):
        read_rig_as("biocv", tmp_path / "empty")
