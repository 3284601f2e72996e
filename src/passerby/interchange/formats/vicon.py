"""Vicon's calibration, `.xcp` (XML).

    <Cameras><Camera DEVICEID NAME USERID TYPE SENSOR_SIZE="width height" PIXEL_ASPECT_RATIO SKEW>
      <KeyFrames><KeyFrame FRAME FOCAL_LENGTH PRINCIPAL_POINT="x y" ORIENTATION="x y z w" POSITION="x y z"
                           VICON_RADIAL2="Vicon3Parameter cx cy k1 k2 k3" or VICON_RADIAL="k1 k2"/></KeyFrames></Camera>

FOCAL_LENGTH and PRINCIPAL_POINT are pixels. ORIENTATION is the rotation from world to camera as a quaternion, its real part
last; POSITION is the camera's centre in the world, millimetres; the camera's axes are OpenCV's. The distortion maps from the
image to the pinhole, opposite to OpenCV's. Let d be the vector from the centre of distortion to the point in the image, pixels.
The point in the pinhole image is centre + d (1 + k1 |d|^2 + k2 |d|^4 + k3 |d|^6). The centre is cx, cy, and the principal point
for VICON_RADIAL. OpenCV's coefficients are fitted over the whole image.

Sources: "About calibration data (XCP) files" of Vicon's documentation (documentation.vicon.com, CaraPost); the readers of
Pose2Sim, AvialSync and MAMMA agree on the rotation and the direction of the distortion. No source states the position of the
origin in a pixel: OpenCV's pixels are assumed. Distortions with other names are not documented: they are losses.
"""

from __future__ import annotations

from functools import partial
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
from scipy.spatial.transform import Rotation

from passerby.common.arrays import Floats
from passerby.common.errors import InputError
from passerby.common.text import shortened, shortened_text
from passerby.core.cameras import Camera, Lens, Pose, Rig
from passerby.interchange.formats.format import FileSample, Format, Given
from passerby.interchange.formats.lens_models import RADTAN_5, RATIONAL_8, Rays, find_nearest_lens, how_far
from passerby.interchange.formats.tsai import WORST_PX
from passerby.interchange.formats.values import attribute_numbers, load_xml
from passerby.interchange.numbers import gather_rig

METRES = 1e-3
SUFFIX = ".xcp"
MODEL = "Vicon3Parameter"
UNIT_TOLERANCE = 1e-2
"""Largest difference of a quaternion's length from one: files have six decimals."""
STEPS = 30
"""Steps of Newton's method for the radius in the image; typical lenses need six."""
CAMERA_KEYS = ("DEVICEID", "NAME", "SENSOR_SIZE", "PIXEL_ASPECT_RATIO", "SKEW", "KeyFrames")
FRAME_KEYS = (
    "FRAME", "FOCAL_LENGTH", "PRINCIPAL_POINT", "ORIENTATION", "POSITION", "VICON_RADIAL", "VICON_RADIAL2",
)  # fmt: skip


def read(path: Path, given: Given) -> Rig:
    """Read all calibrated cameras. They have their NAME, or their DEVICEID if a name is empty or occurs twice."""
    root = load_xml(path, f"a calibration of Vicon ({SUFFIX})")
    elements = root.findall("Camera")
    if not elements:
        raise InputError(f"{path}: holds no <Camera>: a calibration of Vicon ({SUFFIX}) is needed here")
    titles = [element.get("NAME", "").strip() for element in elements]
    by_name = all(titles) and len(set(titles)) == len(titles)
    cameras = []
    for number, (element, title) in enumerate(zip(elements, titles, strict=True), start=1):
        name = title if by_name else element.get("DEVICEID") or str(number)
        given.unread.keys([*element.attrib, *(child.tag for child in element)], CAMERA_KEYS)
        if element.find("KeyFrames/KeyFrame") is None:
            given.unread.add(f"camera {shortened_text(name)}, which is not calibrated (no KeyFrame)")
        else:
            cameras.append((f"camera {shortened_text(name)}", partial(_camera, name, element, given)))
    if not cameras:
        raise InputError(f"{path}: none of its {len(elements)} cameras has a KeyFrame: calibrate them in Vicon first")
    return gather_rig(path, cameras)


def _camera(name: str, element: ElementTree.Element, given: Given) -> Camera:
    """Read the camera of an element. Raises `InputError` without the place."""
    frames = element.findall("KeyFrames/KeyFrame")
    if len(frames) > 1:
        given.losses.add(f"camera {name}: moves: of its {len(frames)} calibrations (KeyFrame) the first is read")
    given.unread.keys(frames[0].attrib, FRAME_KEYS)
    quaternion = attribute_numbers(frames[0], "ORIENTATION", 4)
    if abs(np.linalg.norm(quaternion) - 1) > UNIT_TOLERANCE:
        raise InputError(f"ORIENTATION is {quaternion.tolist()}: a unit quaternion x y z w is needed")
    centre = (given.metres_per_unit or METRES) * attribute_numbers(frames[0], "POSITION", 3)
    pose = Pose.from_centre(Rotation.from_quat(quaternion).as_matrix(), centre)
    return Camera(name, _lens(name, element, frames[0], given), pose)


def _lens(name: str, element: ElementTree.Element, frame: ElementTree.Element, given: Given) -> Lens:
    """Fit OpenCV's lens. An error above `WORST_PX`, and a distortion that is left out, are losses."""
    width, height = attribute_numbers(element, "SENSOR_SIZE", 2)
    if min(width, height) < 1 or (width, height) != (int(width), int(height)):
        raise InputError(f"SENSOR_SIZE is {width:g} {height:g}: whole numbers of pixels are needed")
    for key, usual in (("PIXEL_ASPECT_RATIO", 1.0), ("SKEW", 0.0)):
        (value,) = attribute_numbers(element, key, 1, usual)
        if value != usual:
            given.losses.add(f"camera {name}: its {key} of {value:g} is left out: {usual:g} is used")
    (focal,) = attribute_numbers(frame, "FOCAL_LENGTH", 1)
    principal = attribute_numbers(frame, "PRINCIPAL_POINT", 2)
    size = (int(width), int(height))
    plain = Lens(size, np.array([[focal, 0, principal[0]], [0, focal, principal[1]], [0, 0, 1]]), np.zeros(0))
    radial = _radial(name, frame, principal, given)
    if radial is None or not radial[1].any():
        return plain
    rays = Rays.of_projection(partial(_project, plain, *radial), size)
    lens, model = find_nearest_lens(rays, (RADTAN_5, RATIONAL_8), plain, "its distortion")
    if not rays.narrow.largest_error(lens) <= WORST_PX or len(rays.narrow.pixels) < len(rays.pixels):
        given.losses.add(f"camera {name}: its distortion is fitted by {model.name}, {how_far(rays, lens)}")
    return lens


def _radial(name: str, frame: ElementTree.Element, principal: Floats, given: Given) -> tuple[Floats, Floats] | None:
    """Read centre (2,) and coefficients (3,) of the distortion; None for an unknown distortion, which is a loss."""
    if frame.get("VICON_RADIAL2") is not None:
        model, *words = frame.get("VICON_RADIAL2", "").split() or [""]
        inner = ElementTree.Element(frame.tag, {"VICON_RADIAL2": " ".join(words)})
        if model == MODEL:
            values = attribute_numbers(inner, "VICON_RADIAL2", 5)
            return values[:2], values[2:]
        given.losses.add(f"camera {name}: its distortion {shortened(model)} is left out: only {MODEL} is known")
        return None
    return principal, np.append(attribute_numbers(frame, "VICON_RADIAL", 2, 0.0), 0.0)


def _project(plain: Lens, centre: Floats, k: Floats, rays: Floats) -> Floats:
    """Project directions (N, 3) to distorted pixels (N, 2); NaN where no point of the image shows a direction."""
    with np.errstate(all="ignore"):
        offset = plain.project_rays(rays) - centre
        wanted = np.linalg.norm(offset, axis=1)
        radius = wanted.copy()
        for _ in range(STEPS):
            radius -= (_undistort(radius, k) - wanted) / _slope(radius, k)
        turned = np.zeros(len(radius), dtype=bool)
        for share in np.linspace(0.0, 1.0, 20):  # the polynomial must be monotonic, or two points share a pixel
            turned |= ~(_slope(share * radius, k) > 0)
        solved = np.abs(_undistort(radius, k) - wanted) < 1e-9 * (1 + wanted)
        pixels = centre + offset * np.where(wanted > 0, radius / np.where(wanted > 0, wanted, 1.0), 1.0)[:, None]
        return np.asarray(np.where((solved & ~turned & (radius >= 0))[:, None], pixels, np.nan))


def _undistort(radius: Floats, k: Floats) -> Floats:
    square = radius**2
    return np.asarray(radius * (1 + square * (k[0] + square * (k[1] + square * k[2]))))


def _slope(radius: Floats, k: Floats) -> Floats:
    square = radius**2
    return np.asarray(1 + square * (3 * k[0] + square * (5 * k[1] + square * 7 * k[2])))


def _recognises(sample: FileSample) -> bool:
    return sample.suffix == SUFFIX or (sample.tag == "Cameras" and sample.has_elements("Camera/KeyFrames"))


FORMAT = Format(
    name="vicon",
    title="Calibration of Vicon (.xcp)",
    tools=("Vicon Nexus", "Vicon Shogun", "Pose2Sim"),
    target="file",
    suffixes=(SUFFIX,),
    conventions=(
        "Read only. World to camera (quaternion x, y, z, w) and the camera's centre, millimetres; OpenCV's axes and pixels. "
        "VICON_RADIAL and Vicon3Parameter undistort pixels about their centre; OpenCV's coefficients are fitted over the "
        "whole image, and a fit that is off by more than 0.1 px is a loss. Other distortions, skew and pixels that are not "
        "square are losses. Cameras without a KeyFrame are not read."
    ),
    read=read,
    recognises=_recognises,
)
