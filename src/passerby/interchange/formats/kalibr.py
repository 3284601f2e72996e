"""Kalibr: a camera chain (camchain.yaml), with tables `cam0`, `cam1` and so on.

Each has `camera_model`, `intrinsics`, `distortion_model`, `distortion_coeffs`, `resolution` [width, height], `rostopic` and,
except `cam0`, `T_cn_cnm1`: 4 x 4, from the previous camera's frame to its own, `x_n = T x_(n-1)`, OpenCV's axes (x right,
y down, z forward), metres. `pinhole` has intrinsics [fu, fv, pu, pv]; `radtan` has k1 k2 p1 p2 of OpenCV's pinhole,
`equidistant` k1 k2 k3 k4 of OpenCV's fisheye. Pixels are OpenCV's: 0 is the centre of the first one.

Sources: github.com/ethz-asl/kalibr/wiki/yaml-formats; `CameraParameters` and `CameraChainParameters` in its
kalibr_common/ConfigReader.py; RadialTangentialDistortion.hpp and EquidistantDistortion.hpp of its aslam_cameras. By the same
sources, focal lengths and principal points must be floating-point numbers; every key at the top level is a camera; a pinhole
with `distortion_model: none` gets no geometry, so a lens without distortion is written as radtan with zeros.

Kalibr has no world. `T_cam_world` in `cam0`, an extra key that Kalibr ignores, holds world to camera, 4 x 4; the name follows
Kalibr's T_cam_imu. Without it, a chain's world is the frame of cam0: z forward, not up. Kalibr does not use names of cameras;
the extra key `camera_name` keeps them, and `rostopic` has them in the characters that ROS permits.

Kalibr's models omni, ds, eucm and pinhole with fov are only read, and fitted by OpenCV's fisheye or pinhole: a loss.

Sources of the projections that OpenCV's pinhole and fisheye do not have:
aslam_cameras of github.com/ethz-asl/kalibr: OmniProjection.hpp (C. Mei and P. Rives, Single View Point Omnidirectional
Camera Calibration from Planar Grids, ICRA 2007), DoubleSphereProjection.hpp (V. Usenko et al., The Double Sphere Camera Model,
3DV 2018), ExtendedUnifiedProjection.hpp (B. Khomutenko et al., An Enhanced Unified Camera Model, RA-L 2016) and
FovDistortion.hpp (F. Devernay and O. Faugeras, Straight lines have to be straight, MVA 2001).
"""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from passerby.common.arrays import Floats
from passerby.common.errors import InputError
from passerby.core.cameras import Camera, Lens, Pose, Rig
from passerby.interchange.formats.format import Export, FileSample, Format, Given, Losses
from passerby.interchange.formats.lens_models import FISHEYE, RADTAN_4, RADTAN_5, Rays, express_lens, find_nearest_lens, how_far
from passerby.interchange.formats.values import (
    LETTER,
    dump_yaml,
    homogeneous,
    load_yaml,
    numbers,
    padded,
    read_count,
    rigid,
    table,
    tame_names,
)

CAMERA_KEY = re.compile(r"cam(\d+)")
FORBIDDEN_IN_ROS = re.compile(r"[^A-Za-z0-9_]")
COEFFICIENTS = {"radtan": 4, "equidistant": 4, "fov": 1, "none": 0}
READ = (
    "camera_model", "distortion_coeffs", "distortion_model", "intrinsics", "resolution", "rostopic", "camera_name", "T_cn_cnm1",
    "T_cam_world",
)  # fmt: skip
"""Keys of a camera that are known. `rostopic` is the ROS topic of its images."""
MODELS = ("pinhole", "omni", "ds", "eucm")
INTRINSICS = {"pinhole": 4, "omni": 5, "ds": 6, "eucm": 6}
"""Model -> number of its intrinsics; the last four are fu, fv, pu, pv."""


def write(export: Export, losses: Losses) -> Mapping[str, bytes]:
    """Write the cameras as a chain, in the rig's order."""
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
    """Read the cameras of a chain, in its order."""
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
    """Read the pose, world to camera: as stated, else relative to the previous camera; None if the file states neither."""
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
    """Read a camera's lens. A lens of a model that OpenCV does not have is fitted."""
    model, distortion = str(values.get("camera_model")), str(values.get("distortion_model", "none"))
    if model not in MODELS or distortion not in COEFFICIENTS:
        raise InputError(
            f"{place}: camera_model {model} with distortion_model {distortion}: known are {', '.join(MODELS)} with "
            f"{', '.join(COEFFICIENTS)}"
        )
    width, height = (
        read_count(place, {"resolution": side}, "resolution") for side in numbers(place, values, "resolution", (2,)).tolist()
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
        lens, fitted = find_nearest_lens(rays, (FISHEYE, RADTAN_5), start, place)
    except InputError as error:
        raise InputError(str(error) if str(error).startswith(place) else f"{place}: {error}") from None
    losses.add(
        f"camera {place.rpartition(' ')[2]}: {model} with {distortion} is fitted by {fitted.name}, {how_far(rays, lens)}"
    )
    return lens


def _recognises(sample: FileSample) -> bool:
    first = sample.table.get("cam0")
    return isinstance(first, dict) and "camera_model" in first and "intrinsics" in first


def projection(place: str, model: str, intrinsics: Floats, distortion: str, coefficients: Floats) -> Callable[[Floats], Floats]:
    """Return the function from points (N, 3) in the camera's frame to pixels (N, 2), NaN where the model has none.

    Raises `InputError`, which begins with `place`, for a combination of models that Kalibr does not have.
    """
    own = intrinsics[:-4].tolist()
    fx, fy, cx, cy = intrinsics[-4:].tolist()
    models: dict[tuple[str, str], Callable[[Floats], Floats]] = {
        ("pinhole", "fov"): lambda points: _fov(points, float(coefficients[0])),
        ("omni", "none"): lambda points: _omni(points, *own),
        ("omni", "radtan"): lambda points: _radtan(_omni(points, *own), coefficients),
        ("ds", "none"): lambda points: _project_double_sphere(points, *own),
        ("eucm", "none"): lambda points: _unified(points, *own),
    }
    if (model, distortion) not in models:
        raise InputError(f"{place}: camera_model {model} with distortion_model {distortion} does not exist")
    plane = models[model, distortion]

    def project(points: Floats) -> Floats:
        with np.errstate(all="ignore"):
            return np.asarray(plane(np.asarray(points, dtype=np.float64)) * (fx, fy) + (cx, cy), dtype=np.float64)

    return project


def _divide_by_depth(points: Floats, depth: Floats, valid: NDArray[np.bool_]) -> Floats:
    """Divide x and y (N, 2) by a depth; NaN where the depth is not valid or not positive."""
    return np.where((valid & (depth > 0))[:, None], points[:, :2] / depth[:, None], np.nan)


def _omni(points: Floats, xi: float) -> Floats:
    """Project onto the unit sphere, then from a point xi behind its centre onto the plane."""
    length = np.linalg.norm(points, axis=1)
    limit = xi if xi <= 1 else 1 / xi
    return _divide_by_depth(points, points[:, 2] + xi * length, points[:, 2] > -limit * length)


def _project_double_sphere(points: Floats, xi: float, alpha: float) -> Floats:
    """Project through two unit spheres whose centres are xi apart."""
    length = np.linalg.norm(points, axis=1)
    shifted = xi * length + points[:, 2]
    second = np.hypot(np.hypot(points[:, 0], points[:, 1]), shifted)
    w1 = alpha / (1 - alpha) if alpha <= 0.5 else (1 - alpha) / alpha
    w2 = (w1 + xi) / np.sqrt(2 * w1 * xi + xi * xi + 1)
    return _divide_by_depth(points, alpha * second + (1 - alpha) * shifted, points[:, 2] > -w2 * length)


def _unified(points: Floats, alpha: float, beta: float) -> Floats:
    """Project through an ellipsoid (extended unified camera model)."""
    length = np.sqrt(beta * (points[:, 0] ** 2 + points[:, 1] ** 2) + points[:, 2] ** 2)
    limit = alpha / (1 - alpha) if alpha <= 0.5 else (1 - alpha) / alpha
    return _divide_by_depth(points, alpha * length + (1 - alpha) * points[:, 2], points[:, 2] > -limit * length)


def _fov(points: Floats, w: float) -> Floats:
    """Project by a pinhole whose distorted radius is an angle: r_d = atan(2 r tan(w / 2)) / w."""
    plane = _divide_by_depth(points, points[:, 2], points[:, 2] > 0)
    radius = np.linalg.norm(plane, axis=1)
    scale = np.where(radius > 1e-9, np.arctan(2 * radius * np.tan(w / 2)) / (w * radius), 2 * np.tan(w / 2) / w)
    return np.asarray(plane * scale[:, None])


def _radtan(plane: Floats, coefficients: Floats) -> Floats:
    """Distort points (N, 2) on the plane by OpenCV's k1 k2 p1 p2."""
    k1, k2, p1, p2 = coefficients.tolist()
    x, y = plane.T
    r2 = x * x + y * y
    radial = 1 + r2 * (k1 + r2 * k2)
    return np.column_stack([
        x * radial + 2 * p1 * x * y + p2 * (r2 + 2 * x * x), y * radial + 2 * p2 * x * y + p1 * (r2 + 2 * y * y),
    ])  # fmt: skip


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
