"""OptiTrack Motive's calibration, `.mcal` (XML in UTF-16), as Motive 3 saves it.

    <calibrationProfile><Calibration><Cameras><Camera Serial><Properties CameraID/>
      <Attributes ImagerPixelWidth ImagerPixelHeight/>
      <IntrinsicStandardCameraModel HorizontalFocalLength VerticalFocalLength LensCenterX LensCenterY k1 k2 k3 TangentialX
                                    TangentialY/>
      <Intrinsic .../>
      <Extrinsic X Y Z OrientMatrix0 ... OrientMatrix8/></Camera>

`IntrinsicStandardCameraModel` has OpenCV's distortion, k1 k2 p1 p2 k3 in this order: k1, k2, TangentialX, TangentialY, k3;
`Intrinsic` is Motive's own model, which is not documented. X, Y, Z is the camera's centre, metres. OrientMatrix is the rotation
from camera to world, row by row; the camera's axes are x right, y up, z backward. Motive's world has y up: (x, y, z) becomes
(x, -z, y) here.

Motive before 3 saves `.cal`, a binary file that only Motive's own library reads. It is recognised, and the message states what
to save instead.

Sources: the readers of .mcal in public repositories (optitrack_motive among them), which agree; one checked the axes with
images. No source states the position of the origin in a pixel: OpenCV's pixels are assumed.
"""

from __future__ import annotations

from functools import partial
from pathlib import Path
from xml.etree import ElementTree

import numpy as np

from passerby.common.errors import InputError
from passerby.common.text import shortened_text
from passerby.core.cameras import Camera, Lens, Pose, Rig
from passerby.interchange.formats.format import FileSample, Format, Given
from passerby.interchange.formats.values import attribute_numbers, load_xml, rotation
from passerby.interchange.numbers import gather_rig
from passerby.interchange.storage.safe_parsing import file_bytes

SUFFIX, BINARY_SUFFIX = ".mcal", ".cal"
STANDARD, OWN = "IntrinsicStandardCameraModel", "Intrinsic"
Y_UP_TO_CV = np.diag([1.0, -1.0, -1.0])
"""Conversion from camera axes with y up and z backward to OpenCV's."""
TO_Z_UP = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, -1.0], [0.0, 1.0, 0.0]])
FOCAL = ("HorizontalFocalLength", "VerticalFocalLength", "LensCenterX", "LensCenterY")
COEFFICIENTS = ("k1", "k2", "TangentialX", "TangentialY", "k3")
READ = ("Attributes", STANDARD, OWN, "Extrinsic")


def read(path: Path, given: Given) -> Rig:
    """Read all cameras into a world with z up. Their names are their serial numbers."""
    content = file_bytes(path, f"a calibration of Motive ({SUFFIX})")
    root = load_xml(path, f"a calibration of Motive ({SUFFIX})", decode(path, content))
    elements = root.findall("Calibration/Cameras/Camera")
    if not elements:
        raise InputError(f"{path}: holds no Calibration/Cameras/Camera: save the calibration in Motive again")
    given.unread.keys((child.tag for child in root), ("Calibration",))
    for part in root.findall("Calibration"):
        given.unread.keys((child.tag for child in part), ("Cameras",))
    names = [element.get("Serial") or str(number) for number, element in enumerate(elements, start=1)]
    return gather_rig(
        path,
        (
            (f"camera {shortened_text(name)}", partial(_camera, name, element, given))
            for name, element in zip(names, elements, strict=True)
        ),
    )


def decode(path: Path, content: bytes) -> str:
    """Decode the text of a file, UTF-16 or UTF-8. Raises `InputError`, which states what to save instead, for a binary file."""
    wide = content.startswith((b"\xff\xfe", b"\xfe\xff")) or content[1:2] == b"\0"
    try:
        text = content.decode(
            "utf-16" if content.startswith((b"\xff\xfe", b"\xfe\xff")) else "utf-16-le" if wide else "utf-8-sig"
        )
    except UnicodeDecodeError:
        text = ""
    if "<" not in text:
        raise InputError(
            f"{path}: is a binary calibration, as OptiTrack Motive before version 3 saves it ({BINARY_SUFFIX}), which only "
            f"Motive reads: open it in Motive 3 and save it as {SUFFIX}"
        )
    return text


def _camera(name: str, element: ElementTree.Element, given: Given) -> Camera:
    """Read the camera of an element. Raises `InputError` without the place."""
    given.unread.keys((child.tag for child in element), READ)
    lens, extrinsic = _lens(name, element, given), element.find("Extrinsic")
    if extrinsic is None:
        return Camera(name, lens)
    centre = np.array([float(attribute_numbers(extrinsic, axis, 1)[0]) for axis in ("X", "Y", "Z")])
    axes = np.array([float(attribute_numbers(extrinsic, f"OrientMatrix{index}", 1)[0]) for index in range(9)]).reshape(3, 3)
    R = Y_UP_TO_CV @ rotation("OrientMatrix", axes).T @ TO_Z_UP.T
    return Camera(name, lens, Pose.from_centre(R, (given.metres_per_unit or 1.0) * (TO_Z_UP @ centre)))


def _lens(name: str, element: ElementTree.Element, given: Given) -> Lens:
    """Read the lens of an element. The distortion of Motive's own model is a loss."""
    attributes, intrinsic = element.find("Attributes"), element.find(STANDARD)
    standard = intrinsic is not None
    intrinsic = intrinsic if intrinsic is not None else element.find(OWN)
    if attributes is None or intrinsic is None:
        missing = "Attributes" if attributes is None else STANDARD
        raise InputError(f"<{missing}> is missing: save the calibration in Motive again")
    width, height = (float(attribute_numbers(attributes, f"ImagerPixel{side}", 1)[0]) for side in ("Width", "Height"))
    if min(width, height) < 1 or (width, height) != (int(width), int(height)):
        raise InputError(f"its image is {width:g} x {height:g}: whole numbers of pixels are needed")
    fx, fy, cx, cy = (float(attribute_numbers(intrinsic, key, 1)[0]) for key in FOCAL)
    coefficients = np.array([float(attribute_numbers(intrinsic, key, 1, 0.0)[0]) for key in COEFFICIENTS])
    if not standard and coefficients.any():
        given.losses.add(f"camera {name}: the distortion of Motive's own model is left out: it has no {STANDARD}")
        coefficients = np.zeros(5)
    return Lens((int(width), int(height)), np.array([[fx, 0, cx], [0, fy, cy], [0, 0, 1]]), coefficients)


def _recognises(sample: FileSample) -> bool:
    return sample.suffix == SUFFIX or (sample.suffix == BINARY_SUFFIX and _is_binary(sample.data))


def _is_binary(data: bytes) -> bool:
    """Check whether bytes are not text: other tools also write text files with the ending .cal."""
    try:
        return "\0" in data.decode()
    except UnicodeDecodeError:
        return True


FORMAT = Format(
    name="motive",
    title="Calibration of OptiTrack Motive (.mcal)",
    tools=("OptiTrack Motive",),
    target="file",
    suffixes=(SUFFIX, BINARY_SUFFIX),
    conventions=(
        "Read only. Camera to world (3 x 3) and the camera's centre, metres, x right, y up, z backward; Motive's world has y "
        "up and is turned so that z is up: (x, y, z) becomes (x, -z, y). IntrinsicStandardCameraModel has OpenCV's "
        "distortion; that of Motive's own model alone is a loss. The binary .cal of Motive before version 3 is recognised but"
        " cannot be read: save it as .mcal in Motive 3."
    ),
    read=read,
    recognises=_recognises,
)
