"""K, R and t as JSON: layouts by hand, units, VoxelPose's centres, CMU Panoptic's world."""

import json

import numpy as np
import pytest

from passerby.common.errors import InputError
from passerby.core.cameras import Rig
from passerby.interchange.formats import Given, read_rig_as
from support.refusals import refused
from support.scenes.handmade_rigs import CENTRE, LOOKING_NORTH, MATRIX, PIXELS, POINTS, SIZE, TRANSLATION, facing, written

TABLE = {"K": MATRIX.tolist(), "R": LOOKING_NORTH.tolist(), "t": list(TRANSLATION), "dist": [0.0] * 5, "imgSize": list(SIZE)}


def read(folder, content, form="krt-json", **given):
    path = folder / "cameras.json"
    path.write_text(json.dumps(content))
    told = Given(**given)
    return read_rig_as(form, path, told)[0], told.unread.told


def flat(table):
    """Matrices as lists of numbers, as 4DAssociation has them."""
    return {key: np.ravel(value).tolist() for key, value in table.items()}


@pytest.mark.parametrize(
    ("content", "name"),
    [
        ({"north": TABLE}, "north"),
        ({"north": flat(TABLE)}, "north"),
        ([TABLE | {"name": "north"}], "north"),
        ({"cameras": [TABLE | {"id": 3}]}, "3"),
        ({"cameras": {"north": TABLE}, "units": "m"}, "north"),
        ({"0": {key: value for key, value in TABLE.items() if key not in "Rt"}
          | {"RT": np.column_stack([LOOKING_NORTH, TRANSLATION]).tolist()}}, "0"),
        ({"0": TABLE | {"R": [np.pi / 2, 0, 0]}}, "0"),
    ],
)  # fmt: skip
def test_points_by_hand_in_every_layout(tmp_path, content, name):
    rig, unread = read(tmp_path, content, metres_per_unit=1.0)
    assert (rig.names, unread) == ((name,), ())
    np.testing.assert_allclose(rig[name].project(POINTS), PIXELS, atol=1e-6)


def test_the_unit_is_stated_or_asked_for(tmp_path):
    with pytest.raises(InputError, match=r"camera 0: does not state the unit.*--units mm"):
        read(tmp_path, {"0": TABLE})
    for unit, many in (("m", 1.0), ("cm", 100.0), ("mm", 1000.0)):
        table = TABLE | {"t": [many * value for value in TRANSLATION], "unit": unit}
        np.testing.assert_allclose(read(tmp_path, {"0": table})[0]["0"].centre, CENTRE, atol=1e-9)
    with pytest.raises(InputError, match="unit is 'feet': write one of m, cm, mm"):
        read(tmp_path, {"0": TABLE | {"unit": "feet"}})


def test_voxelpose_has_the_centre_in_millimetres(tmp_path):
    table = {
        "fx": 1000.0, "fy": 1100.0, "cx": 960.0, "cy": 540.0, "k": [[0.1], [0.01], [0.001]], "p": [[0.002], [0.003]],
        "R": LOOKING_NORTH.tolist(), "T": [[1000 * value] for value in CENTRE],
    }  # fmt: skip
    rig, _ = read(tmp_path, {"0": table}, size=SIZE)
    np.testing.assert_allclose(rig["0"].centre, CENTRE, atol=1e-9)
    np.testing.assert_array_equal(rig["0"].lens.distortions, [0.1, 0.01, 0.002, 0.003, 0.001])


def test_what_is_not_read_is_told(tmp_path):
    _, unread = read(tmp_path, {"a": TABLE | {"rms": 0.3}, "b": TABLE | {"rms": 0.2}, "date": "today"}, metres_per_unit=1.0)
    assert unread == ("not read: date, rms (2 times)",)
    table = {key: value for key, value in TABLE.items() if key != "dist"}
    assert read(tmp_path, {"a": table}, metres_per_unit=1.0)[1] == ("not read: camera a states no distortion: none is assumed",)


def test_panoptics_world_has_y_down_and_centimetres(tmp_path):
    # Level, 2.5 m above the floor (y = -250), looking along Panoptic's +z, which is this world's +y.
    table = {
        "name": "00_03", "type": "hd", "panel": 0, "node": 3, "resolution": list(SIZE), "K": MATRIX.tolist(),
        "distCoef": [0.0] * 5, "R": np.eye(3).tolist(), "t": [[-400.0], [250.0], [300.0]],
    }  # fmt: skip
    rig, unread = read(tmp_path, {"calibDataSource": "171026", "cameras": [table]}, "panoptic")
    np.testing.assert_allclose(rig["00_03"].centre, CENTRE, atol=1e-9)
    np.testing.assert_allclose(rig["00_03"].project(POINTS), PIXELS, atol=1e-6)
    assert unread == ("not read: calibDataSource",)
    with pytest.raises(InputError, match="import it with --format panoptic"):
        read(tmp_path, {"cameras": [table]}, metres_per_unit=0.01)


def test_what_is_written_is_what_the_tools_read(tmp_path):
    rig = Rig((facing("18181920", distortions=(-0.1, 0.02, 0.001, -0.002, 0.003)),))
    written("krt-json", rig, tmp_path / "a.json")
    table = json.loads((tmp_path / "a.json").read_text())["18181920"]
    assert [len(table[key]) for key in ("K", "R", "T", "RT", "distCoeff", "imgSize")] == [9, 9, 3, 12, 5, 2]
    np.testing.assert_allclose(table["T"], TRANSLATION)
    written("panoptic", rig, tmp_path / "b.json")
    (table,) = json.loads((tmp_path / "b.json").read_text())["cameras"]
    np.testing.assert_allclose(table["R"], np.eye(3), atol=1e-12)
    np.testing.assert_allclose(np.ravel(table["t"]), [-400, 250, 300])


@pytest.mark.parametrize(
    ("change", "match"),
    [
        ({"R": [[1, 0, 0], [0, 1, 0], [0, 0, -1]]}, "camera a: R: .*not a rotation"),
        ({"R": None}, "camera a: has no R"),
        ({"imgSize": None}, "states no image size.*--size"),
        ({"RT": [1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0]}, "R and T are not those in RT"),
    ],
)
def test_bad_tables(tmp_path, change, match):
    with refused(match, tmp_path):
        read(tmp_path, {"a": TABLE | change}, metres_per_unit=1.0)
