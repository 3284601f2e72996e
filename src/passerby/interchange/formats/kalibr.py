"""Kalibr: a camera chain (camchain.yaml), with tables `cam0`, `cam1` and so on.

Each has `camera_model`, `intrinsics`, `distortion_model`, `distortion_coeffs`, `resolution` [width, height], `rostopic` and,
but for `cam0`, `T_cn_cnm1`: 4 x 4, from the previous camera's frame to its own, `x_n = T x_(n-1)`, OpenCV's axes (x right,
y down, z forward), metres. `pinhole` has intrinsics [fu, fv, pu, pv]; `radtan` has k1 k2 p1 p2 of OpenCV's pinhole,
`equidistant` k1 k2 k3 k4 of OpenCV's fisheye. Pixels are OpenCV's: 0 is the middle of the first one.

Sources: github.com/ethz-asl/kalibr/wiki/yaml-formats; `CameraParameters` and `CameraChainParameters` in its
kalibr_common/ConfigReader.py; RadialTangentialDistortion.hpp and EquidistantDistortion.hpp of its aslam_cameras. From there,
too: focal lengths and principal points must be floating-point numbers; every key at the top counts as a camera; a pinhole
with `distortion_model: none` gets no geometry, so a lens without distortion is written as radtan with zeros.

Kalibr has no world. `T_cam_world` in `cam0`, an extra key that Kalibr does not look at, holds world to camera, 4 x 4, named
as its T_cam_imu is. Without it, a chain's world is the frame of cam0: z forward, not up. Cameras' names mean nothing to
Kalibr; the extra key `camera_name` keeps them, and `rostopic` has them as ROS allows.

Kalibr's models omni, ds, eucm and pinhole with fov are only read, and fitted by OpenCV's fisheye or pinhole: a loss.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from passerby.common.arrays import Floats
from passerby.common.errors import InputError
from passerby.core.cameras import Camera, Lens, Pose, Rig
from passerby.interchange.formats.format import Export, Format, Given
from passerby.interchange.formats.kalibr_models import INTRINSICS, projection
from passerby.interchange.formats.lens_models import FISHEYE, RADTAN_4, RADTAN_5, express_lens, how_far, nearest_lens
from passerby.interchange.formats.lens_rays import Rays
from passerby.interchange.formats.losses import Losses
from passerby.interchange.formats.names import LETTER, tame_names
from passerby.interchange.formats.recognition import FileSample
from passerby.interchange.formats.values import (
    dump_yaml,
    homogeneous,
    load_yaml,
    numbers,
    padded,
    rigid,
    table,
    whole,
)

CAMERA_KEY = re.compile(r"cam(\d+)")
FORBIDDEN_IN_ROS = re.compile(r"[^A-Za-z0-9_]")
COEFFICIENTS = {"radtan": 4, "equidistant": 4, "fov": 1, "none": 0}
READ = (
    "camera_model", "distortion_coeffs", "distortion_model", "intrinsics", "resolution", "rostopic", "camera_name", "T_cn_cnm1",
    "T_cam_world",
)  # fmt: skip
"""Keys of a camera. The topic is where its images come from."""
MODELS = ("pinhole", "omni", "ds", "eucm")


def write(export: Export, losses: Losses) -> Mapping[str, bytes]:
    """The chain, in the rig's order."""
    rig = export.posed(losses)
    topics = tame_names(rig.names, FORBIDDEN_IN_ROS, LETTER)
    chain: dict[str, Any] = {}
    previous: Floats | None = None
    for index, camera in enumerate(rig):
        assert camera.pose is not None
        lens, _ = express_lens(camera, (RADTAN_4, FISHEYE), losses)
        world_to_camera = homogeneous(camera.pose)
        if previous is None:
            place = {"T_cam_world": world_to_camera.tolist()}
        else:
            place = {"T_cn_cnm1": (world_to_camera @ np.linalg.inv(previous)).tolist()}
        previous = world_to_camera
        m = lens.matrix
        chain[f"cam{index}"] = {
            **place,
            "camera_model": "pinhole",
            "distortion_coeffs": padded(lens.distortions, 4),
            "distortion_model": "equidistant" if lens.fisheye else "radtan",
            "intrinsics": [float(m[0, 0]), float(m[1, 1]), float(m[0, 2]), float(m[1, 2])],
            "resolution": list(lens.size),
            "rostopic": f"/{topics[camera.name]}/image_raw",
            "camera_name": camera.name,
        }
    return {"": dump_yaml(chain)}


def read(path: Path, given: Given) -> Rig:
    """The cameras of a chain, in its order."""
    content = table(str(path), load_yaml(path, "a camera chain of Kalibr"), "camera chain")
    found = {int(match[1]): content[key] for key in content if (match := CAMERA_KEY.fullmatch(str(key)))}
    if not found:
        raise InputError(f"{path}: has no table cam0: is it another kind of file?")
    given.unread.keys(content, [key for key in content if CAMERA_KEY.fullmatch(str(key))])
    cameras: list[Camera] = []
    pose: Pose | None = None
    for index in sorted(found):
        place = f"{path}: cam{index}"
        values = table(place, found[index], "camera")
        given.unread.keys(values, READ)
        start = Pose(np.eye(3), np.zeros(3)) if index == 0 and len(found) > 1 else None
        pose = _pose(place, values, pose if index - 1 in found else None, given.metres_per_unit or 1.0) or start
        name = values.get("camera_name", f"cam{index}")
        cameras.append(
            Camera(name if isinstance(name, str) and name else f"cam{index}", _lens(place, values, given.losses), pose)
        )
    try:
        return Rig(tuple(cameras))
    except InputError as error:
        raise InputError(f"{path}: {error}") from None


def _pose(place: str, values: dict[Any, Any], previous: Pose | None, metres: float) -> Pose | None:
    """World to camera: as stated, else after the previous camera; None where the file states neither."""
    if values.get("T_cam_world") is not None:
        return rigid(f"{place}: T_cam_world", numbers(place, values, "T_cam_world", (4, 4)), metres)
    if values.get("T_cn_cnm1") is None:
        return None
    step = rigid(f"{place}: T_cn_cnm1", numbers(place, values, "T_cn_cnm1", (4, 4)), metres)
    if previous is None:
        raise InputError(
            f"{place}: T_cn_cnm1 is there, but no camera before it that has a pose: is a camera missing in the chain?"
        )
    return Pose(step.R_cw @ previous.R_cw, step.R_cw @ previous.t_cw + step.t_cw)


def _lens(place: str, values: dict[Any, Any], losses: Losses) -> Lens:
    """A camera's lens; one of a model that OpenCV does not have is fitted."""
    model, distortion = str(values.get("camera_model")), str(values.get("distortion_model", "none"))
    if model not in MODELS or distortion not in COEFFICIENTS:
        raise InputError(
            f"{place}: camera_model {model} with distortion_model {distortion}: known are {', '.join(MODELS)} with "
            f"{', '.join(COEFFICIENTS)}"
        )
    width, height = (
        whole(place, {"resolution": side}, "resolution") for side in numbers(place, values, "resolution", (2,)).tolist()
    )
    intrinsics = numbers(place, values, "intrinsics", (INTRINSICS[model],))
    count = COEFFICIENTS[distortion]
    coefficients = numbers(place, values, "distortion_coeffs", (count,)) if count else np.zeros(0)
    fx, fy, cx, cy = intrinsics[-4:].tolist()
    matrix = np.array([[fx, 0.0, cx], [0.0, fy, cy], [0.0, 0.0, 1.0]])
    size = (width, height)
    try:
        if model == "pinhole" and distortion != "fov":
            return Lens(size, matrix, coefficients, distortion == "equidistant")
        start = Lens(size, matrix, np.zeros(0), fisheye=True)
        rays = Rays.of_projection(projection(place, model, intrinsics, distortion, coefficients), size)
        lens, fitted = nearest_lens(rays, (FISHEYE, RADTAN_5), start, place)
    except InputError as error:
        raise InputError(str(error) if str(error).startswith(place) else f"{place}: {error}") from None
    losses.add(
        f"camera {place.rpartition(' ')[2]}: {model} with {distortion} is fitted by {fitted.name}, {how_far(rays, lens)}"
    )
    return lens


def _recognises(sample: FileSample) -> bool:
    first = sample.table.get("cam0")
    return isinstance(first, dict) and "camera_model" in first and "intrinsics" in first


FORMAT = Format(
    name="kalibr",
    title="Kalibr's camera chain",
    tools=("Kalibr",),
    target="file",
    suffixes=(".yaml", ".yml"),
    conventions="From camera to camera (4 x 4), OpenCV's axes and pixels, metres; pinhole with k1 k2 p1 p2 (radtan) or "
    "OpenCV's fisheye (equidistant); the world in the extra key T_cam_world.",
    write=write,
    read=read,
    recognises=_recognises,
)
