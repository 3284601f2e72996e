"""ROS: a folder with `camera_info/NAME.yaml` for each camera, `static_transforms.yaml` and `static_transforms.launch.py`.

`camera_info/NAME.yaml` is what camera_calibration_parsers reads and camera_info_manager loads: `image_width`,
`image_height`, `camera_name`, `camera_matrix`, `distortion_model` with `distortion_coefficients` (plumb_bob: k1 k2 p1 p2 k3
of OpenCV's pinhole; rational_polynomial: k1 k2 p1 p2 k3 k4 k5 k6; equidistant: k1 k2 k3 k4 of OpenCV's fisheye),
`rectification_matrix` (identity) and `projection_matrix`: the camera matrix with a column of zeros, so that a rectified
picture keeps focal length and principal point. Pixels are OpenCV's.

`static_transforms.yaml` is a tf2_msgs/TFMessage as `ros2 topic echo --once /tf_static` prints it: parent `world`, child
`NAME_optical_frame`; translation and rotation (quaternion x y z w) are camera to world. The world has z up, the optical frame
x right, y down, z forward, metres (REP 103). A camera without a pose has no transform. The launch file publishes the same
transforms with tf2_ros' static_transform_publisher (`ros2 launch ./static_transforms.launch.py`, ROS 2 Humble or newer).

Sources: parse_yml.cpp of camera_calibration_parsers (github.com/ros-perception/image_common), sensor_msgs/CameraInfo and
distortion_models.hpp (github.com/ros2/common_interfaces), static_transform_broadcaster_program.cpp of tf2_ros
(github.com/ros2/geometry2), REP 103 (ros.org/reps/rep-0103.html).

A ROS name has letters, digits and `_`, and begins with a letter. Other characters become `_`, `camera_` is put before a name
that does not begin with a letter, and a number after a name that is already used. If a name has to change, the extra key
`true_name` in `camera_info`, which ROS ignores, keeps the true name.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from passerby.common.arrays import Floats
from passerby.common.errors import InputError
from passerby.common.text import shortened
from passerby.core.cameras import Camera, Lens, Pose, Rig
from passerby.interchange.formats.format import Export, FileSample, Format, Given, Losses
from passerby.interchange.formats.lens_models import FISHEYE, RADTAN_5, RATIONAL_8, express_lens
from passerby.interchange.formats.values import (
    LETTER,
    dump_yaml,
    load_yaml,
    matrix_data,
    numbers,
    padded,
    read_count,
    table,
    tame_names,
)

FORBIDDEN = re.compile(r"[^A-Za-z0-9_]")
INFOS, TRANSFORMS, LAUNCH = "camera_info", "static_transforms.yaml", "static_transforms.launch.py"
WORLD = "world"
OPTICAL = ("_optical_frame", "_optical")
"""Endings of the names of frames whose z axis points forward; REP 103 requires `_optical`, drivers add `_frame`."""
READ = (
    "image_width", "image_height", "camera_name", "true_name", "camera_matrix", "distortion_model", "distortion_coefficients",
    "rectification_matrix", "projection_matrix",
)  # fmt: skip
"""Keys of a camera_info that are known. The last two are of the rectified image and follow from the others."""
DISTORTIONS = {"plumb_bob": (0, 4, 5), "rational_polynomial": (8,), "equidistant": (0, 4)}
"""Distortion model -> permitted numbers of coefficients."""

_LAUNCH = '''\
"""Places the cameras in the world: ros2 launch ./{file}"""

from launch import LaunchDescription
from launch_ros.actions import Node

# Camera, then x, y, z in metres and the quaternion x, y, z, w that place its optical frame in the frame {world}.
CAMERAS = {{
{cameras}
}}


def generate_launch_description():
    names = ("--x", "--y", "--z", "--qx", "--qy", "--qz", "--qw")
    return LaunchDescription(
        [
            Node(
                package="tf2_ros",
                executable="static_transform_publisher",
                name=f"static_transform_{{camera}}",
                arguments=[
                    *(text for pair in zip(names, map(repr, place)) for text in pair),
                    "--frame-id", "{world}", "--child-frame-id", f"{{camera}}_optical_frame",
                ],
            )
            for camera, place in CAMERAS.items()
        ]
    )
'''


def write(export: Export, losses: Losses) -> Mapping[str, bytes]:
    """Write all files of the folder."""
    rig = export.with_lenses(losses)
    names = tame_names(rig.names, FORBIDDEN, LETTER)
    files: dict[str, bytes] = {}
    places: dict[str, tuple[float, ...]] = {}
    for camera in rig:
        files[f"{INFOS}/{names[camera.name]}.yaml"] = dump_yaml(_info(camera, names[camera.name], losses))
        if camera.pose is not None:
            places[names[camera.name]] = (*camera.pose.centre.tolist(), *_quaternion(camera.pose).tolist())
    files[TRANSFORMS] = dump_yaml({"transforms": [_transform(name, place) for name, place in places.items()]})
    lines = "\n".join(f"    {name!r}: {place!r}," for name, place in places.items())
    files[LAUNCH] = _LAUNCH.format(file=LAUNCH, world=WORLD, cameras=lines).encode("utf-8")
    return files


def _info(camera: Camera, name: str, losses: Losses) -> dict[str, Any]:
    """Return the content of one camera's `camera_info`."""
    lens, model = express_lens(camera, (RADTAN_5, RATIONAL_8, FISHEYE), losses)
    kind = {RADTAN_5: "plumb_bob", RATIONAL_8: "rational_polynomial", FISHEYE: "equidistant"}[model]
    coefficients = padded(lens.distortions, DISTORTIONS[kind][-1])
    return {
        "image_width": lens.size[0],
        "image_height": lens.size[1],
        "camera_name": name,
        **({"true_name": camera.name} if name != camera.name else {}),
        "camera_matrix": _matrix(lens.matrix),
        "distortion_model": kind,
        "distortion_coefficients": _matrix(np.array([coefficients])),
        "rectification_matrix": _matrix(np.eye(3)),
        "projection_matrix": _matrix(np.column_stack([lens.matrix, np.zeros(3)])),
    }


def _matrix(values: Floats) -> dict[str, Any]:
    """Return a matrix in the form of camera_calibration_parsers."""
    return {"rows": values.shape[0], "cols": values.shape[1], "data": values.ravel().tolist()}


def _quaternion(pose: Pose) -> Floats:
    """Return the quaternion (4,) x y z w of camera to world, with w not below 0."""
    return np.asarray(Rotation.from_matrix(pose.R_cw.T).as_quat(canonical=True), dtype=np.float64)


def _transform(name: str, place: tuple[float, ...]) -> dict[str, Any]:
    """Return one geometry_msgs/TransformStamped."""
    return {
        "header": {"stamp": {"sec": 0, "nanosec": 0}, "frame_id": WORLD},
        "child_frame_id": f"{name}{OPTICAL[0]}",
        "transform": {
            "translation": dict(zip("xyz", place[:3], strict=True)),
            "rotation": dict(zip("xyzw", place[3:], strict=True)),
        },
    }


def read(path: Path, given: Given) -> Rig:
    """Read the cameras of a folder's `camera_info`, with poses from `static_transforms.yaml`, or a single `camera_info`."""
    infos = path / INFOS if (path / INFOS).is_dir() else path
    files = [path] if path.is_file() else sorted(file for file in infos.iterdir() if file.suffix in (".yaml", ".yml"))
    files = [file for file in files if file.name != TRANSFORMS]
    if not files:
        raise InputError(f"{infos}: holds no camera_info (.yaml): one file per camera is needed")
    transforms = path / TRANSFORMS
    poses = _poses(transforms, given.metres_per_unit or 1.0) if transforms.is_file() else {}
    cameras: list[Camera] = []
    roots: dict[str, str] = {}
    placed: set[str] = set()
    for file in files:
        values = table(str(file), load_yaml(file, "a camera_info of ROS"), "camera_info")
        given.unread.keys(values, READ)
        ros_name = str(values.get("camera_name") or file.stem)
        name = values.get("true_name", ros_name)
        root, pose = next((poses[ros_name + ending] for ending in OPTICAL if ros_name + ending in poses), ("", None))
        roots |= {root: file.name} if root else {}
        placed.update(ros_name + ending for ending in OPTICAL)
        if len(roots) > 1:
            (a, first), (b, second) = roots.items()
            raise InputError(f"{transforms}: {first} stands below frame {a}, {second} below {b}: one root for all is needed")
        cameras.append(Camera(name if isinstance(name, str) and name else ros_name, _lens(str(file), values), pose))
    given.unread.keys((f"the transform of {frame}" for frame in poses if frame.endswith(OPTICAL) and frame not in placed), ())
    try:
        return Rig(tuple(cameras))
    except InputError as error:
        raise InputError(f"{infos}: {error}") from None


def _lens(place: str, values: dict[Any, Any]) -> Lens:
    """Read the lens of a `camera_info` from the matrix and the distortion of its raw picture."""
    size = (read_count(place, values, "image_width"), read_count(place, values, "image_height"))
    matrix = numbers(place, {"camera_matrix": matrix_data(values, "camera_matrix")}, "camera_matrix", (3, 3))
    key = "distortion_coefficients"
    coefficients = numbers(place, {key: matrix_data(values, key)}, key, (-1,))
    model = str(values.get("distortion_model", "plumb_bob"))
    if model not in DISTORTIONS:
        raise InputError(f"{place}: distortion_model {shortened(model)} is not known: {', '.join(DISTORTIONS)} are")
    if coefficients.size not in DISTORTIONS[model]:
        raise InputError(f"{place}: {key} has {coefficients.size} values: {model} takes {DISTORTIONS[model][-1]}")
    try:
        return Lens(size, matrix, coefficients, model == "equidistant")
    except InputError as error:
        raise InputError(f"{place}: {error}") from None


def _poses(path: Path, metres: float) -> dict[str, tuple[str, Pose]]:
    """Read, for each frame, its root (a frame without a parent), and the transform from the root to the frame as a pose."""
    content = table(str(path), load_yaml(path, "static transforms of ROS"), "list `transforms`")
    listed = content.get("transforms")
    if not isinstance(listed, list):
        raise InputError(f"{path}: has no list `transforms`: is it another kind of file?")
    parents: dict[str, tuple[str, Floats]] = {}
    for index, item in enumerate(listed):
        place = f"{path}: transforms[{index}]"
        values = table(place, item, "transform")
        parent = str(table(place, values.get("header"), "header").get("frame_id", "")).lstrip("/")
        child = str(values.get("child_frame_id", "")).lstrip("/")
        if not parent or not child or child in parents:
            raise InputError(f"{place}: child_frame_id {shortened(child)} of {shortened(parent)}: each frame needs one parent")
        parents[child] = (parent, _child_to_parent(f"{place}: {child}", values, metres))
    poses = {}
    for frame in parents:
        to_root, at, seen = np.eye(4), frame, {frame}
        while at in parents:
            at, step = parents[at]
            to_root = step @ to_root
            if at in seen:
                raise InputError(f"{path}: frame {shortened(at)} is its own ancestor: transforms must not form a ring")
            seen.add(at)
        poses[frame] = at, Pose.from_centre(to_root[:3, :3].T, to_root[:3, 3])
    return poses


def _child_to_parent(place: str, values: dict[Any, Any], metres: float) -> Floats:
    """Read one transform (4, 4) from child to parent, metres."""
    inner = table(place, values.get("transform"), "transform")
    where = table(place, inner.get("translation"), "translation")
    turn = table(place, inner.get("rotation"), "rotation")
    quaternion = np.array([float(numbers(f"{place}: rotation", turn, axis, ())) for axis in "xyzw"])
    if abs(np.linalg.norm(quaternion) - 1) > 1e-3:
        raise InputError(f"{place}: rotation {quaternion.tolist()} is not a unit quaternion x y z w")
    matrix = np.eye(4)
    matrix[:3, :3] = Rotation.from_quat(quaternion).as_matrix()
    matrix[:3, 3] = [metres * float(numbers(f"{place}: translation", where, axis, ())) for axis in "xyz"]
    return matrix


def _recognises(sample: FileSample) -> bool:
    return {"image_width", "image_height", "camera_matrix", "projection_matrix"} <= sample.table.keys()


FORMAT = Format(
    name="ros",
    title="ROS camera_info and static transforms",
    tools=("ROS 2", "ROS 1"),
    target="folder",
    conventions="Camera to world (translation and quaternion x y z w), optical frames (z forward), metres, OpenCV's pixels; "
    "plumb_bob, rational_polynomial, equidistant.",
    write=write,
    read=read,
    recognises=_recognises,
)
