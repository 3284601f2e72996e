"""Tsai's XML: cameras of PETS 2009, EPFL and others, one a file, several in a file, or a folder of files.

The formulas are in `passerby.interchange.tsai`: world to camera, camera x right, y down, z forward; lengths in millimetres
unless the user says otherwise (the sensor's always are). Tsai's distortion goes from the picture to the pinhole, OpenCV's the
other way: OpenCV's coefficients are fitted over the whole picture, to within a tenth of a pixel, or the file is refused.
"""

from __future__ import annotations

from pathlib import Path

from passerby.common.errors import InputError
from passerby.common.text import shortened_text
from passerby.core.cameras import Camera, Pose, Rig
from passerby.interchange.formats.format import Format, Given
from passerby.interchange.formats.recognition import FileSample
from passerby.interchange.tsai import METRES, is_tsai, read_tsai_cameras


def read(path: Path, given: Given) -> Rig:
    """The cameras of a file, or of all files of a folder, in the order of the files' names.

    Pictures of another size than the calibrated ones (`given.size`) are taken to show the same, edge to edge.
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
