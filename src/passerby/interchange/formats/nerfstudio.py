"""nerfstudio: `transforms.json`, one frame a camera.

`transform_matrix` is camera to world, 4 x 4, with OpenGL's camera axes (x right, y up, z backward); the world has z up,
lengths are metres here. Each frame has its own `fl_x`, `fl_y`, `cx`, `cy`, `w`, `h` and distortion: OpenCV's k1 k2 k3 and
p1 p2 where `camera_model` is OPENCV, k1 k2 k3 k4 of OpenCV's fisheye where it is OPENCV_FISHEYE. nerfstudio counts pixels
from the corner of the first one: its centre is 0.5, so `cx` and `cy` are larger by a half than OpenCV's.

Sources: docs/quickstart/data_conventions.md, dataparsers/nerfstudio_dataparser.py, `Cameras.get_image_coords` (pixel offset
0.5) and `_undistort_image` in datamanagers/full_images_datamanager.py ("Only k1, k2, k3, p1, p2 can be non-zero", minus 0.5
for OpenCV) of github.com/nerfstudio-project/nerfstudio; its tracker, #3048. The data parser also determines the following. It
reads numbers in the frames only if they are missing at the top level. It reads `camera_model` only at the top level, so a rig
of pinhole and fisheye lenses is written with fisheyes, which is a loss. With `orientation_override: none` it does not turn the
world; with `--center-method none --auto-scale-poses False` it keeps position and scale.

`file_path` is `images/NAME.png`: the user puts a picture of each camera there. The extra key `camera_name`, which nerfstudio
ignores, keeps the true name. A frame without this key has the name of its picture.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path, PurePosixPath
from typing import Any

import numpy as np

from passerby.common.arrays import Floats
from passerby.common.errors import InputError
from passerby.common.text import shortened
from passerby.core.cameras import Camera, Lens, Pose, Rig
from passerby.interchange.formats.format import Export, FileSample, Format, Given, Losses
from passerby.interchange.formats.lens_models import FISHEYE, RADTAN_5, LensModel, express_lens
from passerby.interchange.formats.values import (
    load_json,
    numbers,
    padded,
    read_count,
    rotation,
    table,
    tame_names,
)
from passerby.interchange.storage.text_formats import to_json

HALF = 0.5
"""Offset of nerfstudio's pixel coordinates from OpenCV's."""
OPENGL = np.diag([1.0, -1.0, -1.0])
"""Conversion from OpenCV's camera axes to OpenGL's, and back."""
PINHOLES = ("OPENCV", "PINHOLE", "SIMPLE_PINHOLE", "SIMPLE_RADIAL", "RADIAL")
DISTORTIONS = ("k1", "k2", "k3", "k4", "p1", "p2")
LENS = ("camera_model", "fl_x", "fl_y", "cx", "cy", "w", "h", *DISTORTIONS)


def write(export: Export, losses: Losses) -> Mapping[str, bytes]:
    """Write the rig as nerfstudio's transforms.json."""
    rig = export.posed(losses)
    models = (FISHEYE,) if any(camera.lens.fisheye for camera in rig) else (RADTAN_5,)
    names = tame_names(rig.names)
    frames = [_frame(camera, names[camera.name], models, losses) for camera in rig]
    model = "OPENCV_FISHEYE" if models == (FISHEYE,) else "OPENCV"
    return {"": to_json({"camera_model": model, "orientation_override": "none", "frames": frames}).encode("utf-8")}


def _frame(camera: Camera, tame: str, models: tuple[LensModel, ...], losses: Losses) -> dict[str, Any]:
    """Return the frame of a camera."""
    assert camera.pose is not None
    lens, _ = express_lens(camera, models, losses)
    if lens.fisheye:
        distortion = dict(zip(("k1", "k2", "k3", "k4"), padded(lens.distortions, 4), strict=True)) | {"p1": 0.0, "p2": 0.0}
    else:
        distortion = dict(zip(("k1", "k2", "p1", "p2", "k3"), padded(lens.distortions, 5), strict=True)) | {"k4": 0.0}
    camera_to_world = np.eye(4)
    camera_to_world[:3, :3], camera_to_world[:3, 3] = camera.pose.R_cw.T @ OPENGL, camera.pose.centre
    return {
        "file_path": f"images/{tame}.png",
        "camera_name": camera.name,
        "w": lens.size[0],
        "h": lens.size[1],
        "fl_x": lens.matrix[0, 0],
        "fl_y": lens.matrix[1, 1],
        "cx": lens.matrix[0, 2] + HALF,
        "cy": lens.matrix[1, 2] + HALF,
        **distortion,
        "transform_matrix": camera_to_world,
    }


def read(path: Path, given: Given) -> Rig:
    """Read one camera for each frame. The path may also be the folder of `transforms.json`."""
    path = path / "transforms.json" if path.is_dir() else path
    content = table(str(path), load_json(path, "nerfstudio's transforms.json"), "table with `frames`")
    frames = content.get("frames")
    if not isinstance(frames, list) or not frames:
        raise InputError(f"{path}: has no list `frames`: is it another kind of file?")
    tables = [table(f"{path}: frames[{index}]", frame, "frame") for index, frame in enumerate(frames)]
    names = _names(tables)
    given.unread.keys(content, (*LENS, "frames", "orientation_override"))
    for frame in tables:
        given.unread.keys(frame, (*LENS, "file_path", "camera_name", "transform_matrix"))
    cameras = []
    for name, frame in zip(names, tables, strict=True):
        place = f"{path}: frame {shortened(name)}"
        cameras.append(Camera(name, _lens(place, content, frame, given), _pose(place, frame, given.metres_per_unit or 1.0)))
    try:
        return Rig(tuple(cameras))
    except InputError as error:
        raise InputError(f"{path}: {error}") from None


def _names(frames: list[dict[Any, Any]]) -> list[str]:
    """Return the cameras' names: as stated, else the pictures' names, or their paths if the names are not all different."""
    paths = [PurePosixPath(str(frame.get("file_path") or f"frame_{index:05d}")) for index, frame in enumerate(frames)]
    told = [name if isinstance(name := frame.get("camera_name"), str) and name else None for frame in frames]
    names: list[str] = []
    for short in (lambda path: path.stem, lambda path: str(path.parent / path.stem), str):
        names = [name or short(path) for name, path in zip(told, paths, strict=True)]
        if len(set(names)) == len(names):
            break
    return names


def _lens(place: str, content: dict[Any, Any], frame: dict[Any, Any], given: Given) -> Lens:
    """Read a frame's lens. As in nerfstudio, values at the top level apply to all frames; a frame may have a `camera_model`."""
    values = {**frame, **{key: content[key] for key in ("fl_x", "fl_y", "cx", "cy", "w", "h") if key in content}}
    distorted = content if any(key in content for key in DISTORTIONS) else frame
    k1, k2, k3, k4, p1, p2 = (
        float(numbers(place, distorted, key, ())) if distorted.get(key) is not None else 0.0 for key in DISTORTIONS
    )
    model = content.get("camera_model", frame.get("camera_model", "OPENCV"))
    if model == "OPENCV_FISHEYE":
        if p1 or p2:
            raise InputError(f"{place}: p1 = {p1:g}, p2 = {p2:g}: a fisheye has no tangential distortion: set both to 0")
        distortions = [k1, k2, k3, k4]
    elif model in PINHOLES:
        if k4:
            raise InputError(f"{place}: k4 = {k4:g}: OpenCV's pinhole has no such coefficient, and nerfstudio refuses it too")
        distortions = [k1, k2, p1, p2, k3]
    else:
        raise InputError(f"{place}: camera_model {shortened(model)} is not known: OPENCV and OPENCV_FISHEYE are")
    size = (read_count(place, values, "w"), read_count(place, values, "h")) if "w" in values else given.size_of(place)
    fx, fy, cx, cy = (float(numbers(place, values, key, ())) for key in ("fl_x", "fl_y", "cx", "cy"))
    try:
        matrix = np.array([[fx, 0.0, cx - HALF], [0.0, fy, cy - HALF], [0.0, 0.0, 1.0]])
        return Lens(size, matrix, np.array(distortions), model == "OPENCV_FISHEYE")
    except InputError as error:
        raise InputError(f"{place}: {error}") from None


def _pose(place: str, frame: dict[Any, Any], metres: float) -> Pose:
    """Read a frame's pose from its transform, camera to world with OpenGL's axes."""
    matrix: Floats = numbers(place, frame, "transform_matrix", (4, 4))
    R_wc = rotation(f"{place}: transform_matrix", matrix[:3, :3])
    return Pose.from_centre((R_wc @ OPENGL).T, metres * matrix[:3, 3])


def _recognises(sample: FileSample) -> bool:
    frames = sample.table.get("frames")
    return isinstance(frames, list) and any(isinstance(frame, dict) and "transform_matrix" in frame for frame in frames[:1])


FORMAT = Format(
    name="nerfstudio",
    title="nerfstudio's transforms.json",
    tools=("nerfstudio",),
    target="file",
    suffixes=(".json",),
    conventions="Camera to world (4 x 4), OpenGL's camera axes (y up, z backward), metres, the first pixel's middle is 0.5; "
    "k1 k2 k3 p1 p2, or OpenCV's fisheye for all cameras.",
    write=write,
    read=read,
    recognises=_recognises,
)
