"""Tsai's XML: cameras of PETS 2009, EPFL and others, one a file, several in a file, or a folder of files.

Tsai's frame: world to camera, camera x right, y down, z forward; lengths are millimetres unless the user states another unit
(the sensor's lengths always are millimetres).

    <Camera>
      <Geometry width height ncx nfx dx dy dpx dpy/>
      <Intrinsic focal kappa1 cx cy sx/>
      <Extrinsic tx ty tz rx ry rz/>
    </Camera>

Lengths in millimetres, angles in radians. A point X of the world (millimetres, z up in these sets) is seen at

    x = Rz(rz) Ry(ry) Rx(rx) X + (tx, ty, tz)              camera frame: x right, y down, z forward
    u = focal (x_1, x_2) / x_3                             on the sensor, without distortion, mm
    u = d (1 + kappa1 |d|^2)                               d: on the sensor, as the lens draws it, mm
    pixel = (cx + sx d_1 / dpx, cy + d_2 / dpy)            the centre of the first pixel is (0, 0), as in OpenCV

R. Y. Tsai, "A versatile camera calibration technique for high-accuracy 3D machine vision metrology using off-the-shelf TV
cameras and lenses", IEEE Journal of Robotics and Automation, 1987. Tsai's polynomial maps from the picture to the pinhole,
OpenCV's in the opposite direction. Therefore OpenCV's coefficients are fitted over the whole picture; if the error is more than
a tenth of a pixel, the file is refused. Neither Tsai's text nor the sets state the position of the origin in a pixel. If it
were the pixel's corner, all points would move by half a pixel together.
"""

from __future__ import annotations

import math
import re
from dataclasses import dataclass
from pathlib import Path
from xml.etree import ElementTree

import numpy as np

from passerby.common.arrays import Floats
from passerby.common.errors import InputError
from passerby.common.text import shortened, shortened_text
from passerby.core.cameras import Camera, Lens, Pose, Rig
from passerby.interchange.formats.format import FileSample, Format, Given
from passerby.interchange.storage.safe_parsing import NotParsed, parse_xml, read_text

METRES = 1e-3
"""The files' unit of length."""
WORST_PX = 0.1
"""Largest error of a fitted lens anywhere in the picture. A lens with a larger error is refused."""
WANTED_PX = 0.01
"""More coefficients are used only if the fit is worse than this: a lens with few coefficients is better outside the picture."""
BEYOND = 1.05
"""Largest radius of the fit, as a multiple of the radius of the picture's farthest corner."""
FAR = 6.0
"""Radius in focal lengths (80 degrees off the axis) up to which the projected radius should increase, so that no person outside
the view is projected into the picture. Polynomials of three coefficients fitted to EPFL's lenses turn back at 48 degrees."""
MOST_KAPPA, MOST_RADIUS = 1e6, 1e3
"""Limits of a distortion, and of a picture's half diagonal, both in focal lengths: about 1 and 2 in real lenses."""
MOST = 1e9
"""Largest number of pixels, millimetres or times; the squares of larger numbers would overflow."""
_SAMPLES = 400
_ATTRIBUTES = {
    "Geometry": ("width", "height", "dpx", "dpy"),
    "Intrinsic": ("focal", "kappa1", "cx", "cy", "sx"),
    "Extrinsic": ("tx", "ty", "tz", "rx", "ry", "rz"),
}
_LEAST = {
    "Geometry.width": 1.0, "Geometry.height": 1.0, "Geometry.dpx": 1e-9, "Geometry.dpy": 1e-9, "Intrinsic.focal": 1e-9,
    "Intrinsic.sx": 1e-9,
}  # fmt: skip
"""Least values of attributes that are above 0 in every camera."""


def read(path: Path, given: Given) -> Rig:
    """Read the cameras of a file, or of all files of a folder, in the order of the files' names.

    Pictures of another size than the calibrated ones (`given.size`) are assumed to show the same view, edge to edge.
    """
    files = (
        sorted(file for file in path.iterdir() if file.suffix.lower() == ".xml" and is_tsai(file)) if path.is_dir() else [path]
    )
    if not files:
        raise InputError(f"{path}: holds no XML file with a <Camera>: give the folder of the calibrations, or one of them")
    if path.is_dir():
        others = sorted(file.name for file in path.iterdir() if file.suffix.lower() == ".xml" and file not in files)
        given.unread.keys((f"{name}, which has no <Camera>" for name in others), ())
    scale = (given.metres_per_unit or METRES) / METRES
    cameras: dict[str, Camera] = {}
    for file in files:
        for name, found in read_tsai_cameras(file).items():
            if name in cameras:
                raise InputError(
                    f"{file}: camera {shortened_text(name)} is in another file of {path} too: give one of them another name"
                )
            pose = found.pose
            cameras[name] = Camera(name, found.camera(name, given.size).lens, Pose(pose.R_cw, scale * pose.t_cw))
    return Rig(tuple(cameras.values()))


def _recognises(sample: FileSample) -> bool:
    return sample.suffix == ".xml" and sample.has_elements(".//Geometry") and sample.has_elements(".//Extrinsic")


@dataclass(frozen=True)
class TsaiCamera:
    """A camera as its file describes it. Lengths are mm, angles are radians, pixels are those of a picture of `size`."""

    path: Path
    size: tuple[int, int]
    dpx: float
    dpy: float
    focal: float
    kappa1: float
    cx: float
    cy: float
    sx: float
    translation: tuple[float, float, float]
    angles: tuple[float, float, float]
    """rx, ry, rz, radians."""

    @property
    def pose(self) -> Pose:
        """Pose, world to camera, metres."""
        (sa, sb, sg), (ca, cb, cg) = np.sin(self.angles), np.cos(self.angles)
        turn_x = np.array([[1, 0, 0], [0, ca, -sa], [0, sa, ca]])
        turn_y = np.array([[cb, 0, sb], [0, 1, 0], [-sb, 0, cb]])
        turn_z = np.array([[cg, -sg, 0], [sg, cg, 0], [0, 0, 1]])
        return Pose(turn_z @ turn_y @ turn_x, METRES * np.array(self.translation))

    def lens(self, size: tuple[int, int] | None = None) -> Lens:
        """Fit OpenCV's lens.

        Args:
            size: (width, height) of the pictures in use, which may be smaller than those that were calibrated (EPFL's videos
                are half as large). The calibrated picture then covers them edge to edge.

        Raises:
            InputError: no lens of OpenCV is within `WORST_PX` of Tsai's over the whole picture, Tsai's polynomial turns back
                inside the picture, or the pictures have another aspect ratio.
        """
        width, height = size or self.size
        across, down = width / self.size[0], height / self.size[1]
        if abs(across / down - 1) > 0.02:
            raise InputError(
                f"{self.path}: calibrates images of {self.size[0]} x {self.size[1]}, but they are {width} x {height}, "
                "which is another shape: is it the file of another sequence?"
            )
        fx, fy = across * self.focal * self.sx / self.dpx, down * self.focal / self.dpy
        cx, cy = across * (self.cx + 0.5) - 0.5, down * (self.cy + 0.5) - 0.5
        corners = np.array([[x, y] for x in (-0.5, width - 0.5) for y in (-0.5, height - 0.5)])
        radius = float(np.hypot((corners[:, 0] - cx) / fx, (corners[:, 1] - cy) / fy).max())
        distortions, miss = fit_distortions(self.kappa1 * self.focal**2, BEYOND * radius, max(fx, fy), str(self.path))
        if miss > WORST_PX:
            raise InputError(
                f"{self.path}: kappa1 {self.kappa1:g} is a distortion that OpenCV's model misses by {miss:.2f} px "
                f"({WORST_PX} px are allowed): is it kappa1 per square millimetre, and focal in millimetres?"
            )
        return Lens((width, height), np.array([[fx, 0, cx], [0, fy, cy], [0, 0, 1.0]]), distortions)

    def camera(self, name: str, size: tuple[int, int] | None = None) -> Camera:
        """Return the camera in metres, with OpenCV's lens. Raises `InputError` as `lens` does."""
        try:
            return Camera(name, self.lens(size), self.pose)
        except InputError as error:
            raise InputError(f"camera {shortened_text(name)}: {error}") from None


def fit_distortions(kappa: float, radius: float, focal_px: float, place: str = "lens") -> tuple[Floats, float]:
    """Fit OpenCV's radial coefficients to a lens with `u = d (1 + kappa d^2)`, d and u in units of the focal length.

    Args:
        kappa: Tsai's kappa1 times the square of the focal length in mm.
        radius: largest d.
        focal_px: pixels per unit of d.
        place: beginning of messages.

    Returns:
        The coefficients (k1, k2, 0, 0[, k3[, k4, k5, k6]]), none for a lens without distortion, and the largest error over
        all radii, pixels. They are the fewest coefficients with an error of at most `WANTED_PX`, or else the best.

    Raises:
        InputError: the polynomial turns back before `radius`, so that two rays have one pixel; or a number is out of range.
    """
    if kappa == 0:
        return np.zeros(0), 0.0
    if not (abs(kappa) < MOST_KAPPA and 0 < radius < MOST_RADIUS and math.isfinite(focal_px)):
        raise InputError(
            f"{place}: its numbers do not describe a lens: are focal, dpx and dpy in millimetres, and cx and cy in pixels?"
        )
    if 1 + 3 * kappa * radius**2 <= 0:
        raise InputError(
            f"{place}: kappa1 is so far below 0 that the distortion turns back inside the image: is the sign right, "
            "and are focal, dpx and dpy in millimetres?"
        )
    drawn = np.linspace(0, radius, _SAMPLES + 1)[1:]
    pinhole = drawn * (1 + kappa * drawn**2)
    fits = (_polynomial_fit(drawn, pinhole, 2), _polynomial_fit(drawn, pinhole, 3), _rational_fit(drawn, pinhole))
    missed = [focal_px * float(np.abs(_distort_radii(pinhole, k) - drawn).max()) for k in fits]

    def rank(index: int) -> tuple[bool, bool, bool, float]:
        k, miss = fits[index], missed[index]
        fine = miss <= WANTED_PX
        return not (miss <= WORST_PX and _grows(k, pinhole[-1])), not _grows(k, FAR), not fine, index if fine else miss

    best = min(range(len(fits)), key=rank)
    return fits[best], missed[best] if _grows(fits[best], pinhole[-1]) else math.inf


def _polynomial_fit(drawn: Floats, pinhole: Floats, order: int) -> Floats:
    """Fit k1 to k_order by least squares of the radii. Return them in OpenCV's order."""
    powers = pinhole[:, None] ** (2 * np.arange(1, order + 1) + 1)
    k = np.linalg.lstsq(powers, drawn - pinhole, rcond=None)[0]
    return np.array([k[0], k[1], 0.0, 0.0, *k[2:]])


def _rational_fit(drawn: Floats, pinhole: Floats) -> Floats:
    """Fit k1 to k6 of `d = u (1 + k1 u^2 + ...) / (1 + k4 u^2 + ...)`.

    This is linear least squares of the equation times its denominator. The weight is the inverse of the previous round's
    denominator, so that the errors of the radii are minimised.
    """
    powers = pinhole[:, None] ** (2 * np.arange(1, 4))
    below = np.ones_like(drawn)
    k: Floats = np.zeros(6)
    for _ in range(10):
        system = np.hstack([powers * pinhole[:, None], -powers * drawn[:, None]]) / below[:, None]
        k = np.asarray(np.linalg.lstsq(system, (drawn - pinhole) / below, rcond=None)[0], dtype=np.float64)
        below = 1 + powers @ k[3:]
        if (below < 1e-3).any():
            break
    return np.array([k[0], k[1], 0.0, 0.0, *k[2:]])


def _distort_radii(pinhole: Floats, k: Floats) -> Floats:
    """Distort undistorted radii by OpenCV's model."""
    full = np.concatenate([k, np.zeros(8 - len(k))])
    u2 = pinhole**2
    above = 1 + u2 * (full[0] + u2 * (full[1] + u2 * full[4]))
    return np.asarray(pinhole * above / (1 + u2 * (full[5] + u2 * (full[6] + u2 * full[7]))))


def _grows(k: Floats, last: float) -> bool:
    """Check whether the distorted radius increases with the undistorted radius, up to `last`."""
    return bool((np.diff(_distort_radii(np.linspace(0, last, 4 * _SAMPLES), k)) > 0).all())


def is_tsai(path: Path) -> bool:
    """Check whether the beginning of an XML file is that of a calibration by Tsai's method."""
    try:
        head = path.read_text(encoding="utf-8", errors="replace")[:4000]
    except OSError:
        return False
    return bool(re.search(r"<Camera\b|<Geometry\b", head))


def read_tsai_cameras(path: str | Path) -> dict[str, TsaiCamera]:
    """Read all cameras of a file by their names.

    A camera's name is its `<Camera name="">`, or else that of the file without its ending, with the number of the camera from 1
    if the file has several cameras.

    Raises:
        InputError: as `read_tsai`, and two cameras with the same name.
    """
    path = Path(path)
    text = read_text(path, "a camera calibrated by Tsai's method (XML)")
    try:
        root = parse_xml(text)
    except NotParsed as error:
        raise InputError(f"{path}: is not XML: {error}: fetch the file again") from None
    elements = list(root.iter("Camera"))
    if not elements:
        raise InputError(f"{path}: holds no <Camera>: a calibration by Tsai's method is needed here")
    cameras: dict[str, TsaiCamera] = {}
    for number, element in enumerate(elements, start=1):
        name = element.get("name") or (path.stem if len(elements) == 1 else f"{path.stem}_{number}")
        if name in cameras:
            raise InputError(f"{path}: two cameras are called {shortened_text(name)}: give them different names")
        cameras[name] = _tsai_camera(path, element)
    return cameras


def _tsai_camera(path: Path, camera: ElementTree.Element) -> TsaiCamera:
    """Read the camera that an element describes. Raises `InputError`."""
    value = {
        f"{element}.{name}": _number(path, camera, element, name) for element, names in _ATTRIBUTES.items() for name in names
    }
    for key, least in _LEAST.items():
        if not least <= value[key] <= MOST:
            raise InputError(
                f"{path}: <{key.replace('.', '> ')} is {value[key]:g}: a number from {least:g} to {MOST:g} is needed"
            )
    return TsaiCamera(
        path,
        (round(value["Geometry.width"]), round(value["Geometry.height"])),
        dpx=value["Geometry.dpx"],
        dpy=value["Geometry.dpy"],
        focal=value["Intrinsic.focal"],
        kappa1=value["Intrinsic.kappa1"],
        cx=value["Intrinsic.cx"],
        cy=value["Intrinsic.cy"],
        sx=value["Intrinsic.sx"],
        translation=(value["Extrinsic.tx"], value["Extrinsic.ty"], value["Extrinsic.tz"]),
        angles=(value["Extrinsic.rx"], value["Extrinsic.ry"], value["Extrinsic.rz"]),
    )


def _number(path: Path, camera: ElementTree.Element, element: str, name: str) -> float:
    """Read a finite attribute of one of the camera's elements. Raises `InputError`."""
    found = camera.find(f".//{element}")
    if found is None:
        raise InputError(f"{path}: <{element}> is missing: a camera has <{'>, <'.join(_ATTRIBUTES)}>")
    text = found.get(name)
    if text is None:
        raise InputError(f"{path}: <{element}> has no {name}: it needs {', '.join(_ATTRIBUTES[element])}")
    try:
        number = float(text)
    except ValueError:
        number = math.nan
    if not math.isfinite(number):
        raise InputError(f"{path}: <{element}> {name} is {shortened(text)}: a finite number is needed")
    return number


FORMAT = Format(
    name="tsai",
    title="Cameras calibrated by Tsai's method (XML)",
    tools=("PETS 2009", "EPFL's multi-camera sets", "Etiseo"),
    target="file",
    suffixes=(".xml",),
    conventions=(
        "Read only: one file, or a folder of them. x_c = R X + t with OpenCV's axes, R = Rz Ry Rx of angles in radians; "
        "millimetres unless stated otherwise; the first pixel's centre is (0, 0). kappa1 becomes OpenCV's radial coefficients, "
        "fitted over the whole image to within 0.1 px. A camera is named after its <Camera name>, or else after its file."
    ),
    read=read,
    recognises=_recognises,
)


def read_tsai(path: str | Path) -> TsaiCamera:
    """Read the first camera of a file.

    Raises:
        InputError: the file is missing, not XML, lacks an element or attribute, or has a value that no camera can have.
    """
    return next(iter(read_tsai_cameras(path).values()))
