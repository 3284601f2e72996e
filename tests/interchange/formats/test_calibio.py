"""calib.io's JSON: names of coefficients, the unit, ids of models that are named once."""

import json

import numpy as np
import pytest

from passerby.common.errors import InputError
from passerby.interchange.formats import Given, read_rig_as
from support.scenes.handmade_rigs import PIXELS, POINTS, SIZE, TRANSLATION

COEFFICIENTS = dict(zip(("k1", "k2", "p1", "p2", "k3"), (-0.1, 0.02, 0.001, -0.002, 0.003), strict=True))


def camera(first=True, translation=TRANSLATION, **parameters):
    values = {"f": 1000.0, "ar": 1.1, "cx": 960.0, "cy": 540.0} | parameters
    kind = {"polymorphic_id": 0x80000001, "polymorphic_name": "libCalib::CameraModelOpenCV"} if first else {"polymorphic_id": 1}
    size = {"CameraModelBase": {"imageSize": dict(zip(("width", "height"), SIZE, strict=True))}}
    data = {"parameters": {key: {"val": value, "state": 0} for key, value in values.items()}, "CameraModelCRT": size}
    return {
        "model": kind | {"ptr_wrapper": {"id": 1, "data": data}},
        "transform": {
            "rotation": {"rx": np.pi / 2, "ry": 0.0, "rz": 0.0}, "translation": dict(zip("xyz", translation, strict=True)),
        },
    }  # fmt: skip


def read(folder, *cameras, **given):
    path = folder / "calib.json"
    path.write_text(json.dumps({"Calibration": {"cameras": cameras, "poses": [1]}}))
    told = Given(**given)
    return read_rig_as("calibio", path, told)[0], told.unread.told


def test_points_by_hand(tmp_path):
    rig, unread = read(tmp_path, camera(), camera(first=False, **COEFFICIENTS), metres_per_unit=1.0)
    assert rig.names == ("cam0", "cam1")
    np.testing.assert_allclose(rig["cam0"].project(POINTS), PIXELS, atol=1e-6)
    np.testing.assert_array_equal(rig["cam1"].lens.distortions, (-0.1, 0.02, 0.001, -0.002, 0.003))
    assert unread == ("not read: poses",)


def test_the_unit_is_asked_for_where_it_matters(tmp_path):
    with pytest.raises(InputError, match=r"cameras\[0\]: does not state the unit.*--units mm"):
        read(tmp_path, camera())
    assert read(tmp_path, camera(translation=(0.0, 0.0, 0.0)))[0]["cam0"].pose is not None


def test_other_models_are_refused(tmp_path):
    other = camera()
    other["model"]["polymorphic_name"] = "libCalib::CameraModelFisheye"
    with pytest.raises(InputError, match=r"cameras\[0\]: its model is 'libCalib::CameraModelFisheye'"):
        read(tmp_path, other)
    other = camera()
    del other["model"]["ptr_wrapper"]["data"]["parameters"]["f"]
    with pytest.raises(InputError, match=r"cameras\[0\]: f: holds no val"):
        read(tmp_path, other)
