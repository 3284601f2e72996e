"""OpenCV's own files (cv2.FileStorage): a folder with one YAML file a camera, as programs made with OpenCV read them, or one
file with a map for each camera.

OpenCV defines the format of matrices, but no layout for a rig. Each file has the keys that OpenCV's own calibration sample
(`samples/cpp/calibration.cpp`, and the tutorial's `camera_calibration.cpp`) writes for a camera, `image_width`, `image_height`,
`camera_matrix`, `distortion_coefficients` and `fisheye_model`, and those of its stereo sample (`stereo_calib.cpp`) for a pose,
`R` (3 x 3) and `T` (3 x 1): x_c = R X_w + T, metres, OpenCV's axes, pixels and distortions. `camera_name`, `camera_number`
(the rig's order) and `units` are additions; a camera without a pose has no R and T. A fisheye's skew stays in its matrix, as
in `cv2.fisheye.calibrate` (`cv2.fisheye.projectPoints` takes it as `alpha`); OpenCV's pinhole has no skew.

The reader accepts such files, one or a folder of them, in YAML, XML or JSON, also with the other keys that are in common use.
It also accepts the pair `intrinsics.yml` (M1, D1, M2, D2) and `extrinsics.yml` (R, T: first camera to second) of the stereo
sample, whose first camera becomes the world; and the single file of the multi-view sample
(`samples/python/multiview_calibration.py`: Ks, distortions, rvecs, Ts, is_fisheye, image_sizes, cam_ids). No sample states the
unit of T.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from passerby.common.arrays import Floats
from passerby.common.errors import InputError
from passerby.common.text import natural_key
from passerby.core.cameras import Camera, Lens, Pose, Rig
from passerby.interchange.formats.format import Export, FileSample, Format, Given, Losses
from passerby.interchange.formats.lens_models import FISHEYE_SKEWED, OPENCV, express_lens, trim_coefficients
from passerby.interchange.formats.values import tame_names
from passerby.interchange.numbers import rotation_of
from passerby.interchange.opencv_lens import (
    DEEPEST,
    ENDINGS,
    LARGEST_BYTES,
    LENS_NAMES,
    find_first_value,
    lens_in,
    numbers_of,
    read_values,
    simplify_keys,
)
from passerby.interchange.rig_toml import METRES_PER_UNIT
from passerby.interchange.storage.safe_parsing import FileFaults, faults_of

ENDING = ".yml"

_NAME = ("cameraname", "name", "camname", "camera", "serial")
_ROTATION = ("r", "rotation", "rotationmatrix", "rmat", "rvec", "rvector", "rotationvector", "rodrigues", "rot")
_TRANSLATION = ("t", "translation", "translationvector", "tvec", "tvector", "trans")
_READ = frozenset({*LENS_NAMES, *_NAME, *_ROTATION, *_TRANSLATION, "units", "cameranumber"})
_CERTAIN = ("cameramatrix", "intrinsicmatrix", "intrinsicsmatrix", "cammatrix", "mtx")
"""Keys of a camera matrix that have no other meaning."""
_STEREO = ("m1", "d1", "m2", "d2")
_MULTIVIEW = ("ks", "distortions", "rvecs", "ts", "isfisheye", "imagesizes")


def _write(export: Export, losses: Losses) -> Mapping[str, bytes]:
    """Write one file for each camera."""
    rig = export.with_lenses(losses)
    files = tame_names(rig.names)
    contents = {}
    for number, camera in enumerate(rig, start=1):
        with _storage() as (storage, text):
            _put_camera(storage, camera, number, losses)
        contents[files[camera.name] + ENDING] = text[0].encode()
    return contents


def _write_one(export: Export, losses: Losses) -> bytes:
    """Write all cameras into one file, with one map each."""
    with _storage() as (storage, text):
        for number, camera in enumerate(export.with_lenses(losses), start=1):
            storage.startWriteStruct(f"camera{number}", cv2.FileNode_MAP)
            _put_camera(storage, camera, number, losses)
            storage.endWriteStruct()
    return text[0].encode()


@contextmanager
def _storage() -> Iterator[tuple[cv2.FileStorage, list[str]]]:
    """Open a storage in memory. Also return a list that receives the text when the block ends."""
    storage = cv2.FileStorage(ENDING, cv2.FileStorage_WRITE | cv2.FileStorage_MEMORY)
    text: list[str] = []
    try:
        yield storage, text
        text.append(str(storage.releaseAndGetString()))
    finally:
        storage.release()


def _put_camera(storage: cv2.FileStorage, camera: Camera, number: int, losses: Losses) -> None:
    """Write a camera into a storage; `number` is its place in the rig, from 1."""
    lens, _ = express_lens(camera, (FISHEYE_SKEWED,) if camera.lens.fisheye else OPENCV, losses)
    if _survives_reading(camera.name):
        storage.write("camera_name", camera.name)
    storage.write("camera_number", number)
    storage.write("image_width", lens.size[0])
    storage.write("image_height", lens.size[1])
    storage.write("camera_matrix", np.array(lens.matrix))
    storage.write(
        "distortion_coefficients", trim_coefficients(lens.distortions, lens.fisheye, 4 if lens.fisheye else 5)[:, None]
    )
    storage.write("fisheye_model", int(lens.fisheye))
    if camera.pose is not None:
        storage.write("R", np.array(camera.pose.R_cw))
        storage.write("T", np.array(camera.pose.t_cw)[:, None])
        storage.write("units", "m")


def _survives_reading(text: str) -> bool:
    """Check whether OpenCV reads a text back unchanged. It does not for `true` and for texts with quotation marks."""
    try:
        storage = cv2.FileStorage(ENDING, cv2.FileStorage_WRITE | cv2.FileStorage_MEMORY)
        storage.write("text", text)
        reader = cv2.FileStorage(storage.releaseAndGetString(), cv2.FileStorage_READ | cv2.FileStorage_MEMORY)
        node = reader.getNode("text")
        return node.isString() and node.string() == text
    except (cv2.error, SystemError, UnicodeError):
        return False


def _read(path: Path, given: Given) -> Rig:
    """Read the cameras of a file, or of all files in a folder, ordered by their numbers, then by the files' names."""
    files = [path] if path.is_file() else _files_in(path)
    cameras: list[Camera] = []
    faults: list[str] = []
    contents: dict[Path, dict[str, Any]] = {}
    for file in files:
        try:
            contents[file] = read_values(file)
        except InputError as error:
            faults += faults_of(error)
    pairs = {key: value for content in contents.values() for key, value in content.items()}
    if all(key in pairs for key in (*_STEREO, "r", "t")):
        given.unread.keys(pairs, (*_STEREO, "r", "t"))
        return Rig(tuple(_stereo(path, pairs, given)))
    for file, content in sorted(contents.items(), key=lambda item: _number(item[1])):
        try:
            here = list(_cameras(file, content, given))
            cameras += here
            if not here:
                given.unread.add(f"{file.name}, which has no camera matrix")
        except InputError as error:
            faults += faults_of(error)
    if faults:
        raise FileFaults(faults)
    if not cameras:
        raise InputError(f"{path}: holds no camera: a camera_matrix and distortion_coefficients are needed")
    try:
        return Rig(tuple(cameras))
    except InputError as error:
        raise InputError(f"{path}: {error}") from None


def _number(content: Mapping[str, Any]) -> float:
    """Return the number of a file's camera in the rig; infinite, so that the file comes last, if there is none."""
    number = content.get("cameranumber")
    return number if isinstance(number, (int, float)) and number == number else float("inf")  # whole numbers may exceed floats


def _files_in(folder: Path) -> list[Path]:
    """List the files that may hold a camera. Larger files, of joints and other recordings, are left out."""
    found = [file for file in folder.iterdir() if file.suffix.lower() in ENDINGS and not file.name.startswith(".")]
    small = [file for file in found if file.is_file() and file.stat().st_size <= LARGEST_BYTES]
    if not small:
        raise InputError(f"{folder}: has no file of OpenCV ({', '.join(ENDINGS)})")
    return sorted(small, key=lambda file: natural_key(file.name))


def _cameras(path: Path, content: Mapping[str, Any], given: Given) -> Iterator[Camera]:
    """Generate the cameras of one file: those of the multi-view sample, or one camera, or one for each of its maps."""
    if all(key in content for key in _MULTIVIEW):
        given.unread.keys(content, (*_MULTIVIEW, "camids"))
        yield from _multiview(path, content, given)
        return
    if (camera := _camera(path, content, given, path.stem)) is not None:
        yield camera
        return
    others: dict[str, Any] = {}
    for key, value in content.items():
        if isinstance(value, dict) and "data" not in value and (camera := _camera(path, value, given, key)) is not None:
            yield camera
        else:
            others[key] = value
    if len(others) < len(content):
        given.unread.keys(others, ())


def _camera(path: Path, content: Mapping[str, Any], given: Given, name: str) -> Camera | None:
    """Read the camera that a file, or a map in it, describes; None where it holds no camera matrix."""
    stored = lens_in(path, content)
    if stored is None:
        return None
    given.unread.keys(content, _READ)
    named = find_first_value(content, _NAME)
    lens = stored.lens(stored.size or given.size_of(str(path)))
    return Camera(named if isinstance(named, str) and named else name, lens, _pose(path, content, given))


def _pose(path: Path, content: Mapping[str, Any], given: Given) -> Pose | None:
    """Read the pose in a file; None where it has neither rotation nor translation."""
    rotation, translation = find_first_value(content, _ROTATION), find_first_value(content, _TRANSLATION)
    if rotation is None and translation is None:
        return None
    if rotation is None or translation is None:
        missing = "rotation (R)" if rotation is None else "translation (T)"
        raise InputError(f"{path}: has no {missing}: give both, or neither for a camera without a pose")
    units = content.get("units")
    metres = given.metres_per_unit or METRES_PER_UNIT.get(units if isinstance(units, str) else "")
    return _read_pose(path, rotation, translation, _require_unit(path, metres))


def _require_unit(path: Path, metres_per_unit: float | None) -> float:
    """Return the unit of length in metres. Raises `InputError` if it is unknown."""
    if metres_per_unit is None:
        raise InputError(f"{path}: does not state the unit of its translation: give it, as in --units mm")
    return metres_per_unit


def _read_pose(path: Path, rotation: Any, translation: Any, metres_per_unit: float) -> Pose:
    turned, moved = numbers_of(path, "the rotation", rotation), numbers_of(path, "the translation", translation)
    if turned.size not in (3, 9) or moved.size != 3:
        raise InputError(
            f"{path}: the pose has {turned.size} and {moved.size} numbers: a 3 x 3 rotation, or a Rodrigues vector, and 3 of a "
            "translation are needed"
        )
    matrix = turned.reshape(3, 3) if turned.size == 9 else rotation_of(turned, f"{path}: ")
    if not np.allclose(matrix @ matrix.T, np.eye(3), atol=1e-4) or np.linalg.det(matrix) < 0:
        raise InputError(f"{path}: the rotation {matrix.tolist()} is none: orthogonal rows and no mirror image are needed")
    return Pose(matrix, metres_per_unit * moved)


def _stereo(path: Path, content: Mapping[str, Any], given: Given) -> list[Camera]:
    """Read the files of OpenCV's stereo sample. The first camera's frame is the world."""
    size = given.size_of(str(path))
    metres = _require_unit(path, given.metres_per_unit)
    poses = (Pose(np.eye(3), np.zeros(3)), _read_pose(path, content["r"], content["t"], metres))
    return [
        Camera(f"camera{number}", _lens(path, size, content[f"m{number}"], content[f"d{number}"], False), pose)
        for number, pose in enumerate(poses, start=1)
    ]


def _multiview(path: Path, content: Mapping[str, Any], given: Given) -> list[Camera]:
    """Read the file of OpenCV's multi-view sample."""
    sizes, matrices, distortions, rotations, translations, fisheye = (
        numbers_of(path, key, content[key]) for key in ("imagesizes", "ks", "distortions", "rvecs", "ts", "isfisheye")
    )
    count = fisheye.size
    if count < 1 or (sizes.size, matrices.size, rotations.size, translations.size) != (
        2 * count,
        9 * count,
        3 * count,
        3 * count,
    ):
        raise InputError(f"{path}: Ks, rvecs, Ts, image_sizes and is_fisheye have different numbers of cameras")
    names = str(content.get("camids") or "").split(",")
    names = names if len(names) == count else [str(number) for number in range(count)]
    metres = _require_unit(path, given.metres_per_unit)
    coefficients = distortions.reshape(count, -1)
    cameras = []
    for index, (name, flat) in enumerate(zip(names, fisheye.astype(bool).tolist(), strict=True)):
        size = int(sizes[2 * index]), int(sizes[2 * index + 1])
        used = coefficients[index][:4] if flat else coefficients[index]
        lens = _lens(path, size, matrices.reshape(-1, 9)[index].tolist(), used.tolist(), flat)
        pose = _read_pose(path, rotations.reshape(-1, 3)[index].tolist(), translations.reshape(-1, 3)[index].tolist(), metres)
        cameras.append(Camera(name, lens, pose))
    return cameras


def _lens(path: Path, size: tuple[int, int], matrix: Any, distortions: Any, fisheye: bool) -> Lens:
    numbers: Floats = numbers_of(path, "the camera matrix", matrix)
    if numbers.size != 9:
        raise InputError(f"{path}: the camera matrix has {numbers.size} numbers: 3 x 3 are needed")
    try:
        return Lens(size, numbers.reshape(3, 3), numbers_of(path, "the distortion", distortions), fisheye)
    except InputError as error:
        raise InputError(f"{path}: {error}") from None


def _recognises(sample: FileSample) -> bool:
    content = simplify_keys(sample.content, DEEPEST)
    if sample.tag == "opencv_storage":
        return True
    if not isinstance(content, dict) or sample.suffix not in ENDINGS or "projectionmatrix" in content:
        return False
    tables = [content, *(value for value in content.values() if isinstance(value, dict))]
    pair = all(key in content for key in _STEREO) or all(key in content for key in _MULTIVIEW)
    return pair or any(find_first_value(table, _CERTAIN) is not None for table in tables)


FORMAT = Format(
    "opencv",
    "OpenCV's files (FileStorage), one per camera or one for all",
    ("OpenCV", "programs made with OpenCV"),
    "folder",
    (".yml", ".yaml"),
    conventions=(
        "One NAME.yml per camera, or all cameras in one file if the target ends in .yml, one map each: image_width, "
        "image_height, camera_matrix, distortion_coefficients and fisheye_model as in OpenCV's calibration sample; R and T as "
        "in its stereo sample, world to camera, metres. Pinhole of up to 14 coefficients, fisheye; cameras without a pose are "
        "kept. Also reads the stereo sample's pair and the multi-view sample's file; --units states their unit."
    ),
    write=_write,
    read=_read,
    write_one=_write_one,
    recognises=_recognises,
)
