"""NVIDIA: DeepStream's MV3DT (`mv3dt`) and the calibration.json of AutoMagicCalib and Metropolis (`amc`).

`mv3dt` is a folder with `camInfo/NAME.yml` for each camera, as the data set folder of DeepStream's multi-view 3D tracking has
it. `projectionMatrix_3x4_w2p` has 12 numbers, row by row: world to pixels, `K [R | t]`, the world's z up from the ground at
0, metres, pixels from the upper left corner. `modelInfo` has `height` and `radius` of a person's cylinder in the world's
unit. Beside it are `map.png` and `transforms.yml` for the viewer of the data set (`nvidia_folder`). The older
`projectionMatrix_3x4`, to which DeepStream adds half the picture's size, and the K, R and t that AutoMagicCalib writes
besides, are read too.

`amc` is one JSON file: `calibrationType` cartesian and `sensors`, each with `id`, `coordinates` (its place, metres),
`intrinsicMatrix` (3 x 3), `extrinsicMatrix` (3 x 4, world to camera, OpenCV's axes), `cameraMatrix` (their product) and
`attributes`: names and values as text, `frameWidth` and `frameHeight` among them. `scaleFactor` and
`translationToGlobalCoordinates` map to a floor plan; Passerby has none here and writes 1 and 0. `homography` is not written:
the data sets of the AI City Challenge have it from the ground to pixels, Metropolis' newer services read it from pixels to
the ground. `imageCoordinates` and `globalCoordinates` are written: points on the ground from which both compute a missing
homography.

Both formats have pinholes without distortion. For a camera with distortion, `mv3dt` has `dewarper/NAME.txt` beside `camInfo`:
the configuration of DeepStream's Gst-nvdewarper that removes the distortion. The matrices are those of its output pictures.
`amc` cannot store distortion: it is a loss, unless the videos are rectified first. The position of the origin in a pixel is not
documented; OpenCV's pixels are written. A NAME, or id, has ASCII letters, digits and `_ . -` and begins with a letter or digit.
If a name has to change, the true name is kept in a comment (`mv3dt`, with the picture's size) or in the attribute `trueName`
(`amc`).

Sources: deepstream-tracker-3d-multi-view/README.md ("Running MV3DT on Custom Datasets") of
github.com/NVIDIA-AI-IOT/deepstream_reference_apps; "Single-View 3D Tracking" and "The 3x4 Camera Projection Matrix" in
docs.nvidia.com/metropolis/deepstream/dev-guide/text/DS_plugin_gst-nvtracker.html; README.md of
github.com/NVIDIA-AI-IOT/auto-magic-calib; docs.nvidia.com/vss/system-components/calibration/calibration-schema;
generate_cam_info_configs.py (which makes `camInfo` from calibration.json, and checks the ids) and calibration_base.py of
github.com/NVIDIA-AI-Blueprints/video-search-and-summarization.
"""

from __future__ import annotations

import json
import re
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import yaml
from scipy.linalg import rq

from passerby.common.arrays import Floats
from passerby.common.errors import InputError
from passerby.common.text import shortened
from passerby.core.cameras import Camera, Lens, Pose, Rig
from passerby.core.stature import PERSON_HEIGHT_M
from passerby.interchange.formats.drawing import draw
from passerby.interchange.formats.format import Export, FileSample, Format, Given, Losses
from passerby.interchange.formats.lens_models import PINHOLE, PINHOLE_SKEWED, RADTAN_5, LensModel, express_lens
from passerby.interchange.formats.nvidia_folder import MAP, TRANSFORMS, dewarper_config, map_files, read_dewarper
from passerby.interchange.formats.values import (
    load_json,
    numbers,
    parse_yaml,
    read_count,
    rotation,
    table,
    tame_names,
)
from passerby.interchange.storage.safe_parsing import NotParsed, parse_json, read_text
from passerby.interchange.storage.text_formats import to_json

CAMERAS, DEWARPERS, CALIBRATION = "camInfo", "dewarper", "calibration.json"
FORBIDDEN, FIRST = re.compile(r"[^A-Za-z0-9_.-]"), re.compile(r"[A-Za-z0-9]")
PERSON_RADIUS_M = 0.3
"""Radius of the cylinder that MV3DT uses for a person, as in NVIDIA's files. Its height is Passerby's mean body height."""
GROUND_POINTS = (0.125, 0.375, 0.625, 0.875)
"""Positions of the pixels whose points on the ground are written, as shares of width and height."""
FARTHEST_GROUND_M = 60.0
"""Largest distance of such a point from the camera. Farther away, a tenth of a pixel moves the point by decimetres."""
LEAST_SKEW_PX = 1e-6
"""Least skew that is kept. Smaller values are rounding errors of the decomposition of a projection matrix."""
READ_FILE = ("projectionMatrix_3x4_w2p", "projectionMatrix_3x4", "K", "R", "t", "modelInfo")
"""Keys of a camera's file that are known. `modelInfo` is the size of a person for the tracker."""
READ_SENSOR = (
    "type", "id", "coordinates", "attributes", "intrinsicMatrix", "extrinsicMatrix", "cameraMatrix", "imageCoordinates",
    "globalCoordinates",
)  # fmt: skip
"""Keys of a sensor that are read, or that repeat its matrices."""
_COMMENT = re.compile(r"^# passerby: (\{.*\})$", re.MULTILINE)


def _write_mv3dt(export: Export, losses: Losses) -> Mapping[str, bytes]:
    """Write one file for each camera, and the map. The line %YAML:1.0 is left out: NVIDIA's own Python readers reject it."""
    rig = export.posed(losses)
    names = tame_names(rig.names, FORBIDDEN, FIRST)
    files = {}
    for camera in rig:
        lens = express_lens(camera, (*_pinholes(camera), RADTAN_5), losses)[0]
        if lens.distortions.any():
            files[f"{DEWARPERS}/{names[camera.name]}.txt"] = dewarper_config(lens)
        told = json.dumps({"name": camera.name, "size": list(lens.size)})
        content = {
            "projectionMatrix_3x4_w2p": (lens.matrix @ _extrinsics(camera)).ravel().tolist(),
            "modelInfo": {"height": PERSON_HEIGHT_M, "radius": PERSON_RADIUS_M},
        }
        text = f"# passerby: {told}\n{yaml.safe_dump(content, sort_keys=False, default_flow_style=False)}"
        files[f"{CAMERAS}/{names[camera.name]}.yml"] = text.encode("utf-8")
    return files | map_files(draw(rig), names)


def _write_amc(export: Export, losses: Losses) -> Mapping[str, bytes]:
    """Write the rig as NVIDIA's calibration.json."""
    rig = export.posed(losses)
    names = tame_names(rig.names, FORBIDDEN, FIRST)
    sensors = [_sensor(camera, names[camera.name], losses) for camera in rig]
    content = {"version": "1.0", "osmURL": "", "calibrationType": "cartesian", "sensors": sensors}
    return {"": to_json(content).encode("utf-8")}


def _sensor(camera: Camera, name: str, losses: Losses) -> dict[str, Any]:
    """Return the entry of a camera in calibration.json."""
    lens = _pinhole(camera, losses)
    attributes = {"frameWidth": str(lens.size[0]), "frameHeight": str(lens.size[1])}
    if name != camera.name:
        attributes["trueName"] = camera.name
    pixels, ground = _ground_points(replace(camera, lens=lens))
    return {
        "type": "camera",
        "id": name,
        "origin": {"lng": 0, "lat": 0},
        "geoLocation": {"lng": 0, "lat": 0},
        "coordinates": dict(zip("xyz", camera.centre.tolist(), strict=True)),
        "scaleFactor": 1,
        "translationToGlobalCoordinates": {"x": 0, "y": 0},
        "attributes": [{"name": key, "value": value} for key, value in attributes.items()],
        "place": [],
        "imageCoordinates": [{"x": x, "y": y} for x, y in pixels.tolist()],
        "globalCoordinates": [{"x": x, "y": y, "z": 0} for x, y in ground.tolist()],
        "intrinsicMatrix": lens.matrix,
        "extrinsicMatrix": _extrinsics(camera),
        "cameraMatrix": lens.matrix @ _extrinsics(camera),
        "rois": [],
        "tripwires": [],
    }


def _pinhole(camera: Camera, losses: Losses) -> Lens:
    """Return the camera's lens as a pinhole without distortion. Distortion is a loss."""
    return express_lens(camera, _pinholes(camera), losses)[0]


def _pinholes(camera: Camera) -> tuple[LensModel, ...]:
    """Return the models without distortion for a camera's lens. A lens without skew gets none to improve the fit."""
    return (PINHOLE, PINHOLE_SKEWED) if camera.lens.matrix[0, 1] else (PINHOLE,)


def _extrinsics(camera: Camera) -> Floats:
    """Return the matrix (3, 4) `[R | t]`, world to camera."""
    assert camera.pose is not None
    return np.column_stack([camera.pose.R_cw, camera.pose.t_cw])


def _ground_points(camera: Camera) -> tuple[Floats, Floats]:
    """Compute pixels (N, 2) and the points (N, 2) of the ground z = 0 that they show; none if fewer than four show it."""
    assert camera.pose is not None
    shares = np.stack(np.meshgrid(GROUND_POINTS, GROUND_POINTS), axis=-1).reshape(-1, 2)
    pixels = np.round(shares * camera.lens.size)
    rays = np.column_stack([pixels, np.ones(len(pixels))]) @ np.linalg.inv(camera.lens.matrix).T @ camera.pose.R_cw
    rays /= np.linalg.norm(rays, axis=1, keepdims=True)
    with np.errstate(divide="ignore", invalid="ignore"):
        far = -camera.centre[2] / rays[:, 2]
    seen = (far > 0) & (far < FARTHEST_GROUND_M)
    if np.count_nonzero(seen) < 4 or len(np.unique(pixels[seen, 1])) < 2:
        return np.zeros((0, 2)), np.zeros((0, 2))
    return pixels[seen], (camera.centre + far[seen, None] * rays[seen])[:, :2]


def _read_mv3dt(path: Path, given: Given) -> Rig:
    """Read the cameras of a folder, or of one file."""
    folder = path / CAMERAS if (path / CAMERAS).is_dir() else path
    files = [path] if path.is_file() else sorted(file for file in folder.iterdir() if file.suffix in (".yml", ".yaml"))
    cameras = []
    for file in files:
        text = read_text(file, "a camera file of MV3DT (YAML)")
        values = table(str(file), parse_yaml(file, text), "projection matrix")
        if path.is_file() or {"K", "projectionMatrix_3x4_w2p", "projectionMatrix_3x4"} & values.keys():
            cameras.append(_camera_file(file, values, _read_comment(text), given))
        else:
            given.unread.add(f"{file.name}, which has no projection matrix")
    return _rig(folder, cameras)


def _read_comment(text: str) -> dict[str, Any]:
    """Read Passerby's comment in a file; empty if there is none."""
    found = _COMMENT.search(text)
    try:
        told = parse_json(found[1]) if found else {}
    except NotParsed:
        told = {}
    return told if isinstance(told, dict) else {}


def _camera_file(file: Path, values: dict[Any, Any], told: dict[str, Any], given: Given) -> Camera:
    """Read the camera of one `camInfo` file."""
    place = str(file)
    given.unread.keys(values, READ_FILE)
    name = told.get("name")
    size = (
        (read_count(place, {"w": told["size"][0]}, "w"), read_count(place, {"h": told["size"][1]}, "h"))
        if _is_pair(told)
        else None
    )
    size = size or given.size_of(place)
    metres = given.metres_per_unit or 1.0
    if "K" in values:
        matrix, t = numbers(place, values, "K", (3, 3)), numbers(place, values, "t", (3,))
        pose = Pose(rotation(f"{place}: R", numbers(place, values, "R", (3, 3))), metres * t)
    elif "projectionMatrix_3x4_w2p" in values:
        matrix, pose = _decompose_projection(place, numbers(place, values, "projectionMatrix_3x4_w2p", (3, 4)), metres)
    else:
        to_corner = np.array([[1.0, 0.0, size[0] / 2], [0.0, 1.0, size[1] / 2], [0.0, 0.0, 1.0]])
        matrix, pose = _decompose_projection(place, to_corner @ numbers(place, values, "projectionMatrix_3x4", (3, 4)), metres)
    dewarper = file.parent.parent / DEWARPERS / f"{file.stem}.txt"
    lens = read_dewarper(dewarper, size) if dewarper.is_file() else _lens(place, size, matrix)
    return Camera(name if isinstance(name, str) and name else file.stem, lens, pose)


def _is_pair(told: dict[str, Any]) -> bool:
    return isinstance(told.get("size"), list) and len(told["size"]) == 2


def _read_amc(path: Path, given: Given) -> Rig:
    """Read the cameras of a calibration.json, or of a folder with this file."""
    path = path / CALIBRATION if path.is_dir() else path
    content = table(str(path), load_json(path, "a calibration.json of NVIDIA"), "list `sensors`")
    sensors = content.get("sensors")
    if not isinstance(sensors, list):
        raise InputError(f"{path}: has no list `sensors`: is it another kind of file?")
    given.unread.keys(content, ("sensors", "calibrationType", "version"))
    cameras = []
    for index, sensor in enumerate(sensors):
        values = table(f"{path}: sensors[{index}]", sensor, "sensor")
        if values.get("type", "camera") == "camera":
            given.unread.keys(values, (*READ_SENSOR, *(("scaleFactor",) if values.get("scaleFactor") == 1 else ())))
            cameras.append(_camera_sensor(f"{path}: sensor {shortened(values.get('id'))}", values, given))
        else:
            given.unread.add(f"sensor {shortened(values.get('id'))}, which is no camera")
    return _rig(path, cameras)


def _camera_sensor(place: str, values: dict[Any, Any], given: Given) -> Camera:
    """Read one sensor from its two matrices; if one is missing, from `cameraMatrix`, which some tools fit to points."""
    listed = values.get("attributes")
    items = [item for item in listed if isinstance(item, dict)] if isinstance(listed, list) else []
    attributes = {str(item.get("name")): item.get("value") for item in items}
    known = "frameWidth" in attributes and "frameHeight" in attributes
    size = (_pixels(place, attributes, "frameWidth"), _pixels(place, attributes, "frameHeight")) if known else None
    size = size or given.size_of(place)
    metres = given.metres_per_unit or 1.0
    if values.get("intrinsicMatrix") is not None and values.get("extrinsicMatrix") is not None:
        matrix = numbers(place, values, "intrinsicMatrix", (3, 3))
        rows = numbers(place, values, "extrinsicMatrix", (-1,))
        if rows.size not in (12, 16):
            raise InputError(f"{place}: extrinsicMatrix has {rows.size} numbers: 3 x 4 are needed")
        Rt = rows.reshape(-1, 4)[:3]
        pose = Pose(rotation(f"{place}: extrinsicMatrix", Rt[:, :3]), metres * Rt[:, 3])
    elif values.get("cameraMatrix") is not None:
        matrix, pose = _decompose_projection(place, numbers(place, values, "cameraMatrix", (3, 4)), metres)
    else:
        raise InputError(
            f"{place}: has neither intrinsicMatrix and extrinsicMatrix nor cameraMatrix: a homography is not enough"
        )
    name = attributes.get("trueName") or values.get("id")
    if not isinstance(name, str) or not name:
        raise InputError(f"{place}: id is {shortened(name)}: a text is needed")
    return Camera(name, _lens(place, size, matrix), pose)


def _pixels(place: str, attributes: dict[str, Any], key: str) -> int:
    """Read a whole number above 0 that may be a text. Raises `InputError`."""
    try:
        return read_count(place, {key: float(attributes[key])}, key)
    except (TypeError, ValueError, OverflowError):
        raise InputError(f"{place}: {key} is {shortened(attributes[key])}: a whole number above 0 is needed") from None


def _decompose_projection(place: str, projection: Floats, metres: float) -> tuple[Floats, Pose]:
    """Decompose a projection matrix (3, 4) of any scale and sign into camera matrix and pose. Raises `InputError`."""
    if not np.linalg.cond(projection[:, :3]) < 1e12:
        raise InputError(f"{place}: the projection matrix {shortened(projection.tolist())} is not that of a camera")
    projection = projection * np.sign(np.linalg.det(projection[:, :3]))
    triangle, R = rq(projection[:, :3])
    signs = np.sign(np.diag(triangle))
    triangle, R = triangle * signs, R * signs[:, None]
    with np.errstate(over="ignore", invalid="ignore"):  # `read_rig_as` refuses a pose that is not finite
        t = metres * np.linalg.solve(triangle, projection[:, 3])
    matrix = triangle / triangle[2, 2]
    if abs(matrix[0, 1]) < LEAST_SKEW_PX:
        matrix[0, 1] = 0.0
    return matrix, Pose(np.asarray(R, dtype=np.float64), np.asarray(t, dtype=np.float64))


def _lens(place: str, size: tuple[int, int], matrix: Floats) -> Lens:
    try:
        return Lens(size, matrix, np.zeros(0))
    except InputError as error:
        raise InputError(f"{place}: {error}") from None


def _rig(place: Path, cameras: list[Camera]) -> Rig:
    if not cameras:
        raise InputError(f"{place}: holds no camera: is it another kind of file?")
    try:
        return Rig(tuple(cameras))
    except InputError as error:
        raise InputError(f"{place}: {error}") from None


def _recognises_mv3dt(sample: FileSample) -> bool:
    return bool({"projectionMatrix_3x4_w2p", "projectionMatrix_3x4"} & sample.table.keys())


def _recognises_amc(sample: FileSample) -> bool:
    return sample.suffix == ".json" and isinstance(sample.table.get("sensors"), list) and "calibrationType" in sample.table


FORMATS: Mapping[str, Format] = {
    "mv3dt": Format(
        name="mv3dt",
        title="DeepStream MV3DT camera files, and the map of their viewer",
        tools=("NVIDIA DeepStream",),
        target="folder",
        conventions="camInfo: projection matrices from the world to pixels (3 x 4), metres; pinhole without distortion. For a "
        "lens with distortion, dewarper/NAME.txt is a configuration of Gst-nvdewarper (k1 k2 k3 p1 p2): the matrix is of its "
        "output, so put that plugin before the stream muxer. map.png and transforms.yml: a plan of the ground with the "
        "cameras, and the matrix from metres to its pixels.",
        companions=frozenset({MAP, TRANSFORMS}),
        write=_write_mv3dt,
        read=_read_mv3dt,
        recognises=_recognises_mv3dt,
    ),
    "amc": Format(
        name="amc",
        title="calibration.json of AutoMagicCalib and Metropolis",
        tools=("NVIDIA AutoMagicCalib", "NVIDIA Metropolis"),
        target="file",
        suffixes=(".json",),
        conventions="World to camera (3 x 4), OpenCV's axes and pixels, metres; pinhole without distortion, so rectify "
        "videos first.",
        write=_write_amc,
        read=_read_amc,
        recognises=_recognises_amc,
    ),
}
