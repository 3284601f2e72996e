"""COLMAP's sparse models, as text and as binary files.

A pose is world to camera, x_c = R X_w + t, its rotation as a quaternion w, x, y, z; the camera's axes are OpenCV's (x right,
y down, z forward). The world is Passerby's, in metres; COLMAP itself has no unit. Pixels are counted from the corner of the
first one: the principal point is half a pixel more than OpenCV's in both directions. Every camera is a camera of COLMAP with
one image, NAME.png, without points. People's positions, if there are any, are points that no image sees.

Lenses are written in the first of these camera models that holds the lens: PINHOLE, OPENCV (k1, k2, p1, p2), FULL_OPENCV (k1,
k2, p1, p2, k3 to k6) and OPENCV_FISHEYE. The reader also accepts the models with one focal length or fewer coefficients, and
all models whose tangential and thin prism terms are zero. FOV, DIVISION, EUCM and thin prisms on a fisheye are fitted, which is
a loss.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from passerby.common.arrays import Floats
from passerby.common.errors import InputError
from passerby.common.text import shortened, shortened_text
from passerby.core.cameras import Camera, Lens, Pose, Rig
from passerby.interchange.formats.colmap_files import (
    ColmapCamera,
    ColmapImage,
    read_model,
    write_binary_model,
    write_text_model,
)
from passerby.interchange.formats.colmap_models import MODELS, WRITTEN, express_in_opencv, lens_of, parameters_of
from passerby.interchange.formats.format import Export, FileSample, Format, Given, Losses
from passerby.interchange.formats.lens_models import express_lens
from passerby.interchange.formats.values import tame_names

LEAST_QUATERNION, MOST_QUATERNION = 0.25, 1e6
"""Limits of the largest component of a quaternion, whose length should be one. Others are no rotation, or damaged bytes."""
MOST_POINTS = 100_000
"""Largest number of people's positions. More are thinned evenly: COLMAP's viewer shows no more at a usable rate."""
IMAGE_ENDING = ".png"
PICTURE_ENDINGS = (".png", ".jpg", ".jpeg", ".tif", ".tiff", ".bmp", ".webp")

_NOT_IN_NAMES = re.compile(r"[^\w.+@-]")
"""Characters that are not in names of images. A space would end the name in COLMAP's text files."""


def _parts(export: Export, losses: Losses) -> tuple[list[ColmapCamera], list[ColmapImage], Floats]:
    """Return the cameras, images and points (N, 3) of the model."""
    rig = export.posed(losses)
    cameras, images = [], []
    names = tame_names(rig.names, _NOT_IN_NAMES)
    for number, camera in enumerate(rig, start=1):
        assert camera.pose is not None
        lens, model = express_lens(camera, tuple(WRITTEN), losses)
        cameras.append(ColmapCamera(number, WRITTEN[model], lens.size, tuple(parameters_of(lens, model))))
        x, y, z, w = Rotation.from_matrix(np.array(camera.pose.R_cw)).as_quat(canonical=True).tolist()
        translation = tuple(camera.pose.t_cw.tolist())
        images.append(ColmapImage(number, (w, x, y, z), translation, number, names[camera.name] + IMAGE_ENDING))
    points = np.zeros((0, 3)) if export.trajectories is None else np.asarray(export.trajectories.xyz, dtype=np.float64)
    return cameras, images, points[:: max(1, -(-len(points) // MOST_POINTS))]


def _write_text(export: Export, losses: Losses) -> Mapping[str, bytes]:
    return write_text_model(*_parts(export, losses))


def _write_binary(export: Export, losses: Losses) -> Mapping[str, bytes]:
    return write_binary_model(*_parts(export, losses))


def _read_text(path: Path, given: Given) -> Rig:
    return _read(path, given, binary_first=False)


def _read_binary(path: Path, given: Given) -> Rig:
    return _read(path, given, binary_first=True)


def _read(path: Path, given: Given, binary_first: bool) -> Rig:
    """Read one camera for each image, and one without a pose for each camera of COLMAP that has no image."""
    folder = path if path.is_dir() else path.parent
    files = read_model(folder, binary_first)
    for name in files.others:
        given.unread.add(name)
    if any(image.points for image in files.images):
        given.unread.add("2D points of the images")
    known = {camera.number: camera for camera in files.cameras}
    images = sorted(files.images, key=lambda image: image.number)
    for image in images:
        if image.camera not in known:
            name = shortened_text(image.name)
            raise InputError(f"{folder}: image {name} is of camera {image.camera}, which is not in its cameras")
    posed = [(image.camera, _pose(image, given.metres_per_unit or 1.0, folder)) for image in images]
    unseen = [(number, None) for number in sorted(known.keys() - {image.camera for image in images})]
    names = _names([image.name for image in images], [number for number, _ in unseen])
    lenses: dict[int, Lens | None] = {}
    cameras = []
    for name, (number, pose) in zip(names, [*posed, *unseen], strict=True):
        if number not in lenses:
            lenses[number] = _lens(known[number], given, f"{folder}: camera {shortened_text(name)}", name)
        lens = lenses[number]
        if lens is not None:
            cameras.append(Camera(name, lens, pose))
    if not cameras:
        raise InputError(f"{folder}: holds no camera with a lens")
    try:
        return Rig(tuple(cameras))
    except InputError as error:
        raise InputError(f"{folder}: {error}") from None


def _names(images: list[str], unseen: list[int]) -> list[str]:
    """Return the cameras' names: those of their images, without the ending if they still differ then."""
    short = [name[: -len(ending)] if (ending := _ending(name)) else name for name in images]
    names = short if len(set(short)) == len(short) else images
    names = [*names, *(f"camera{number}" for number in unseen)]
    tame = tame_names(names)
    return [tame[name] for name in names]


def _ending(name: str) -> str:
    """Return the ending of a picture's name; empty if it has none of the known ones."""
    return next((ending for ending in PICTURE_ENDINGS if name.lower().endswith(ending) and len(name) > len(ending)), "")


def _pose(image: ColmapImage, metres_per_unit: float, folder: Path) -> Pose:
    w, x, y, z = image.quaternion
    if not LEAST_QUATERNION < max(map(abs, image.quaternion)) < MOST_QUATERNION:
        raise InputError(
            f"{folder}: image {shortened(image.name)}: the quaternion {shortened(list(image.quaternion))} is not a rotation"
        )
    return Pose(Rotation.from_quat([x, y, z, w]).as_matrix(), metres_per_unit * np.array(image.translation))


def _lens(camera: ColmapCamera, given: Given, place: str, name: str) -> Lens | None:
    """Return the lens of a camera; None, which is a loss, for the model EQUIRECTANGULAR."""
    if camera.model == "EQUIRECTANGULAR":
        given.losses.add(f"camera {name}: COLMAP's model EQUIRECTANGULAR is not supported and is left out")
        return None
    if camera.model not in MODELS:
        raise InputError(f"{place}: COLMAP's model {shortened(camera.model)} is not known: there are {', '.join(MODELS)}")
    model = MODELS[camera.model]
    try:
        lens = lens_of(model, camera.parameters, camera.size)
    except InputError as error:
        raise InputError(f"{place}: {error}") from None
    if lens is None:
        lens, off = express_in_opencv(model, camera.parameters, camera.size, place)
        given.losses.add(f"camera {name}: COLMAP's model {model.name} is none of OpenCV's and is fitted, {off}")
    return lens


def _recognises_text(sample: FileSample) -> bool:
    return sample.name == "cameras.txt" and sample.path.with_name("images.txt").is_file()


def _recognises_binary(sample: FileSample) -> bool:
    return sample.name == "cameras.bin" and sample.path.with_name("images.bin").is_file()


_CONVENTIONS = (
    "Poses are world to camera (quaternion w, x, y, z and translation), OpenCV's axes. Written in metres; COLMAP has no unit, "
    "so what is read counts as metres unless --units states another. Pixels from the corner of the first one, half a pixel "
    "more than OpenCV's. One camera and one image NAME.png each; people's positions are points. Writes PINHOLE, OPENCV, "
    "FULL_OPENCV and OPENCV_FISHEYE; reads all models except EQUIRECTANGULAR; models beyond OpenCV's need --lossy."
)

FORMATS: Mapping[str, Format] = {
    "colmap": Format(
        "colmap",
        "COLMAP's sparse model, text files",
        ("COLMAP", "GLOMAP", "pycolmap", "3D Gaussian splatting"),
        "folder",
        conventions=_CONVENTIONS,
        write=_write_text,
        read=_read_text,
        recognises=_recognises_text,
    ),
    "colmap-bin": Format(
        "colmap-bin",
        "COLMAP's sparse model, binary files",
        ("COLMAP", "GLOMAP", "pycolmap", "3D Gaussian splatting"),
        "folder",
        conventions=_CONVENTIONS,
        write=_write_binary,
        read=_read_binary,
        recognises=_recognises_binary,
    ),
}
