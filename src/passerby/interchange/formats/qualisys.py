"""Qualisys Track Manager's calibration, `.qca.txt` (XML).

    <calibration><cameras><camera serial model active calibrated viewrotation video_resolution>
      <fov_video left top right bottom/>                 the part of the sensor that the video shows, pixels, both ends included
      <transform x y z r11 r12 ... r33/>
      <intrinsic focalLengthU focalLengthV centerPointU centerPointV skew sensorMinU sensorMaxU ...
                 radialDistortion1 radialDistortion2 radialDistortion3 tangentalDistortion1 tangentalDistortion2/>

x, y, z is the camera's centre in the world, millimetres. Row i of r is the camera's axis i in the world: x right, y *up*, z
*backward* (the camera looks along -z), so OpenCV's rotation from world to camera is diag(1, -1, -1) r. Focal lengths, centre
and skew are in 1/64 of a pixel from the sensor's first pixel. The file does not state the position of the origin in a pixel:
the pixel's centre is assumed, as in Pose2Sim; if it were the edge, all points would move by half a pixel
together. Distortions are OpenCV's k1, k2, k3, p1, p2 of normalised coordinates and have no unit. Pose2Sim divides them by 64
as well, which removes nearly all of a distortion that moves corners by seven pixels.

The world's z is up in the usual configuration of QTM; the file does not state it. Where `viewrotation` is not 0, the camera is
mounted turned; its calibration is that of the sensor's picture, which is not turned.
"""

from __future__ import annotations

import math
import re
from functools import partial
from pathlib import Path
from xml.etree import ElementTree

import numpy as np

from passerby.common.arrays import Floats
from passerby.common.errors import InputError
from passerby.common.text import shortened, shortened_text
from passerby.core.cameras import Camera, Lens, Pose, Rig
from passerby.interchange.formats.format import FileSample, Format, Given
from passerby.interchange.numbers import gather_rig
from passerby.interchange.storage.safe_parsing import NotParsed, parse_xml, read_text

METRES = 1e-3
SUBPIXELS = 64.0
"""Units per pixel of focal lengths and centres."""
QTM_TO_CV = np.diag([1.0, -1.0, -1.0])
ROTATION_TOLERANCE = 1e-3
"""Largest difference of a matrix's singular values from 1: files have six decimals."""
READ = ("active", "calibrated", "serial", "video_resolution", "viewrotation", "fov_video", "transform", "intrinsic")
SHAPE_TOLERANCE = 0.02
SMALLEST_SKEW_PX = 0.01


def read(path: Path, given: Given) -> Rig:
    """Read the cameras. Their names are their serial numbers. Cameras that are not active or not calibrated have no pose.

    Videos of another size than the sensor's (`given.size`) are assumed to show the same view, edge to edge. Skew is a loss.
    """
    text = read_text(path, "a calibration of Qualisys Track Manager (.qca.txt)")
    try:
        root = parse_xml(text)
    except NotParsed as error:
        raise InputError(f"{path}: is not XML: {error}: export the calibration from QTM again") from None
    elements = root.findall(".//cameras/camera")
    if not elements:
        raise InputError(f"{path}: holds no <camera>: a calibration of Qualisys Track Manager (.qca.txt) is needed here")
    given.unread.keys((child.tag for child in root), ("cameras",))
    names = [element.get("serial") or str(number) for number, element in enumerate(elements, start=1)]
    return gather_rig(
        path,
        (
            (f"camera {shortened_text(name)}", partial(_camera, name, element, given))
            for name, element in zip(names, elements, strict=True)
        ),
    )


def _camera(name: str, element: ElementTree.Element, given: Given) -> Camera:
    """Read the camera of an element. Raises `InputError` without the place."""
    given.unread.keys([*element.attrib, *(child.tag for child in element)], READ)
    lens = _lens(name, element, given)
    idle = element.get("active", "1") == "0" or element.get("calibrated", "true").lower() == "false"
    return Camera(name, lens, None if idle else _pose(element, given.metres_per_unit or METRES))


def _pose(element: ElementTree.Element, metres: float) -> Pose:
    axes = _numbers(element, "transform", [f"r{i}{j}" for i in (1, 2, 3) for j in (1, 2, 3)]).reshape(3, 3)
    u, stretch, vt = np.linalg.svd(axes)
    if np.abs(stretch - 1).max() > ROTATION_TOLERANCE or np.linalg.det(axes) < 0:
        raise InputError(f"<transform> r11 to r33 are {axes.ravel().tolist()}, which is not a rotation: export the file again")
    centre = metres * _numbers(element, "transform", ["x", "y", "z"])
    return Pose.from_centre(QTM_TO_CV @ u @ vt, centre)


def _lens(name: str, element: ElementTree.Element, given: Given) -> Lens:
    left, top, right, bottom = _field(element).tolist()
    focal_u, focal_v, centre_u, centre_v = _numbers(
        element, "intrinsic", ["focalLengthU", "focalLengthV", "centerPointU", "centerPointV"]
    ) / SUBPIXELS  # fmt: skip
    k1, k2, k3, p1, p2 = _numbers(
        element, "intrinsic",
        ["radialDistortion1", "radialDistortion2", "radialDistortion3", "tangentalDistortion1", "tangentalDistortion2"], 0.0,
    )  # fmt: skip
    (skew,) = _numbers(element, "intrinsic", ["skew"], 0.0) / SUBPIXELS
    if abs(skew) > SMALLEST_SKEW_PX:
        given.losses.add(f"camera {name}: its skew of {skew:.3g} px is left out: OpenCV's camera model has none")
    width, height = right - left + 1, bottom - top + 1
    across, down = _scales(element, (width, height), given.size)
    size = given.size or (round(width), round(height))
    matrix = np.array([
        [across * focal_u, 0.0, across * (centre_u - left + 0.5) - 0.5],
        [0.0, down * focal_v, down * (centre_v - top + 0.5) - 0.5],
        [0.0, 0.0, 1.0],
    ])  # fmt: skip
    return Lens(size, matrix, np.array([k1, k2, p1, p2, k3]))


def _field(element: ElementTree.Element) -> Floats:
    """Read left, top, right, bottom (4,) of the part of the sensor that the video shows, pixels, both ends included."""
    if element.find("fov_video") is not None:
        left, top, right, bottom = _numbers(element, "fov_video", ["left", "top", "right", "bottom"])
    else:
        ends = _numbers(element, "intrinsic", ["sensorMinU", "sensorMinV", "sensorMaxU", "sensorMaxV"])
        left, top, right, bottom = np.floor(ends / SUBPIXELS)
    if right <= left or bottom <= top:
        raise InputError(f"<fov_video> from {left:g}, {top:g} to {right:g}, {bottom:g} is not an image: export the file again")
    return np.array([left, top, right, bottom])


def _scales(element: ElementTree.Element, field: tuple[float, float], size: tuple[int, int] | None) -> tuple[float, float]:
    """Compute the pixels of the video per pixel of the sensor, across and down."""
    lines = re.fullmatch(r"(\d{1,9})p", element.get("video_resolution", ""))
    if size is None:
        if lines and int(lines[1]) < 0.9 * min(field):
            raise InputError(
                f"calibrates {field[0]:.0f} x {field[1]:.0f} pixels, but its videos are {lines[0]}: give their size with --size"
            )
        return 1.0, 1.0
    across, down = size[0] / field[0], size[1] / field[1]
    if abs(across / down - 1) > SHAPE_TOLERANCE:
        raise InputError(
            f"calibrates images of {field[0]:.0f} x {field[1]:.0f}, but --size is {size[0]} x {size[1]}, which is another "
            "shape: give the size of videos as the sensor has them, not turned"
        )
    return across, down


def _numbers(element: ElementTree.Element, tag: str, names: list[str], missing: float | None = None) -> Floats:
    """Read finite attributes of one of the camera's elements; each is `missing`, if not None, where it is not stated."""
    found = element.find(tag)
    if found is None:
        raise InputError(f"<{tag}> is missing: a camera has <fov_video>, <transform> and <intrinsic>")
    values = []
    for name in names:
        text = found.get(name)
        if text is None and missing is None:
            raise InputError(f"<{tag}> has no {name}: export the file from QTM again")
        try:
            value = missing if text is None else float(text)
        except ValueError:
            value = math.nan
        if value is None or not math.isfinite(value):
            raise InputError(f"<{tag}> {name} is {shortened(text)}: a finite number is needed")
        values.append(value)
    return np.array(values)


def _recognises(sample: FileSample) -> bool:
    return sample.has_elements(".//cameras/camera/intrinsic")


FORMAT = Format(
    name="qualisys",
    title="Calibration of Qualisys Track Manager (.qca.txt)",
    tools=("Qualisys Track Manager", "Theia3D", "Pose2Sim"),
    target="file",
    suffixes=(".qca.txt", ".txt", ".xml"),
    conventions=(
        "Read only. x, y, z is the camera's centre in millimetres; the rows of r are its axes in the world: x right, y up, z "
        "backward. Focal lengths and centre are in 1/64 pixel from the centre of the sensor's first pixel; distortions are "
        "OpenCV's k1, k2, k3, p1, p2. The video shows <fov_video>; give --size if it is smaller. Cameras that are not "
        "active or not calibrated have a lens and no pose; skew is a loss. The lens is that of the image as the sensor has "
        "it, also where viewrotation is not 0."
    ),
    read=read,
    recognises=_recognises,
)
