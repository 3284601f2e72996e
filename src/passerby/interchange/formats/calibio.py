"""calib.io's Camera Calibrator: its JSON export.

    {"Calibration": {"cameras": [{"model": {"polymorphic_id", "polymorphic_name", "ptr_wrapper": {"data": {"parameters":
     {"f": {"val"}, "ar", "cx", "cy", "k1", ..., "k6", "p1", "p2", "s1", ..., "s4", "tauX", "tauY"},
     "CameraModelCRT": {"CameraModelBase": {"imageSize": {"width", "height"}}}}}},
     "transform": {"rotation": {"rx", "ry", "rz"}, "translation": {"x", "y", "z"}}}]}}

The camera matrix is f, f ar, cx, cy; the coefficients are OpenCV's of the same names. `transform` is a Rodrigues vector and a
translation from the first camera's frame to this camera's, OpenCV's axes and pixels. The file does not state the unit, which
is that of the calibration board. A kind of object has its name (`polymorphic_name`) where it occurs first, under an id with
the highest bit set; later it only has the id.

Source: readCalibParameters.cpp, which calib.io publishes for readers of these files (public domain). Fisheye and other models
are not documented there, and are refused.
"""

from __future__ import annotations

from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from passerby.common.errors import InputError
from passerby.common.text import shortened
from passerby.core.cameras import Camera, Lens, Pose, Rig
from passerby.interchange.formats.format import FileSample, Format, Given
from passerby.interchange.formats.lens_models import trim_coefficients
from passerby.interchange.formats.values import load_json, numbers, read_count, table
from passerby.interchange.numbers import gather_rig, rotation_of

MODEL = "libCalib::CameraModelOpenCV"
NEW_KIND = 0x80000000
"""Bit that is added to the id of a kind of object where it occurs first."""
FOCAL = ("f", "ar", "cx", "cy")
COEFFICIENTS = ("k1", "k2", "p1", "p2", "k3", "k4", "k5", "k6", "s1", "s2", "s3", "s4", "tauX", "tauY")
"""Names of the coefficients, in OpenCV's order."""


def read(path: Path, given: Given) -> Rig:
    """Read the cameras. They are named cam0, cam1, ... in the order of the file, which has no names."""
    content = table(str(path), load_json(path, "a calibration of calib.io"), "table with Calibration")
    calibration = table(str(path), content.get("Calibration"), "table Calibration")
    listed = calibration.get("cameras")
    if not isinstance(listed, list) or not listed:
        raise InputError(f"{path}: Calibration has no list cameras: export the calibration from calib.io again")
    tables = [table(f"{path}: cameras[{index}]", item, "camera") for index, item in enumerate(listed)]
    given.unread.keys(content, ("Calibration",))
    given.unread.keys(calibration, ("cameras",))
    models = _models(tables)
    return gather_rig(
        path,
        (
            (f"cameras[{index}]", partial(_camera, index, values, model, given))
            for index, (values, model) in enumerate(zip(tables, models, strict=True))
        ),
    )


def _models(cameras: list[dict[Any, Any]]) -> list[str]:
    """Return the name of each camera's model, also if the file only has the model's id; empty if it is unknown."""
    known: dict[int, str] = {}
    names = []
    for values in cameras:
        model = values.get("model")
        number = model.get("polymorphic_id") if isinstance(model, dict) else None
        name = model.get("polymorphic_name") if isinstance(model, dict) else None
        kind = number & ~NEW_KIND if isinstance(number, int) else 0
        if isinstance(name, str):
            known[kind] = name
        names.append(known.get(kind, ""))
    return names


def _camera(index: int, values: dict[Any, Any], model: str, given: Given) -> Camera:
    """Read one camera. Raises `InputError` without the place."""
    if model != MODEL:
        raise InputError(f"its model is {shortened(model)}: only {MODEL} is documented: export that model from calib.io")
    inner = _find_table(values, "model", "ptr_wrapper", "data")
    parameters = _find_table(inner, "parameters")
    size = _find_table(inner, "CameraModelCRT", "CameraModelBase", "imageSize")
    given.unread.keys(values, ("model", "transform"))
    given.unread.keys(parameters, (*FOCAL, *COEFFICIENTS))
    f, ratio, cx, cy = (_value(parameters, key) for key in FOCAL)
    coefficients = np.array([_value(parameters, key) if key in parameters else 0.0 for key in COEFFICIENTS])
    lens = Lens(
        (read_count("imageSize", size, "width"), read_count("imageSize", size, "height")),
        np.array([[f, 0.0, cx], [0.0, f * ratio, cy], [0.0, 0.0, 1.0]]),
        trim_coefficients(coefficients, False),
    )
    if values.get("transform") is None:
        return Camera(f"cam{index}", lens)
    turn, shift = _find_table(values, "transform", "rotation"), _find_table(values, "transform", "translation")
    vector = np.array([float(numbers("rotation", turn, key, ())) for key in ("rx", "ry", "rz")])
    translation = np.array([float(numbers("translation", shift, key, ())) for key in ("x", "y", "z")])
    if given.metres_per_unit is None and translation.any():
        raise InputError(
            "does not state the unit of its translation, which is that of the calibration board: give it, as in --units mm"
        )
    return Camera(f"cam{index}", lens, Pose(rotation_of(vector), (given.metres_per_unit or 1.0) * translation))


def _find_table(values: dict[Any, Any], *keys: str) -> dict[Any, Any]:
    """Return the table under nested keys. Raises `InputError` where there is none."""
    for key in keys:
        values = table(key, values.get(key), "values")
    return values


def _value(parameters: dict[Any, Any], key: str) -> float:
    return float(numbers(key, table(key, parameters.get(key), "val"), "val", ()))


def _recognises(sample: FileSample) -> bool:
    calibration = sample.table.get("Calibration")
    return isinstance(calibration, dict) and isinstance(calibration.get("cameras"), list)


FORMAT = Format(
    name="calibio",
    title="calib.io's Camera Calibrator (JSON)",
    tools=("calib.io Camera Calibrator",),
    target="file",
    suffixes=(".json",),
    conventions=(
        "Read only. From the first camera's frame to each camera's (Rodrigues vector and translation), OpenCV's axes and "
        "pixels; --units states the unit, which is the calibration board's. OpenCV's pinhole with all coefficients; other "
        "models are refused. Cameras are called cam0, cam1, ... in the order of the file. The world is the first camera's "
        "frame (`passerby align`)."
    ),
    read=read,
    recognises=_recognises,
)
