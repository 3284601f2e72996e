"""Configuration files of DeepStream's Gst-nvdewarper, which removes a lens's distortion before anything else sees the picture.

One file for each camera with distortion, `[property]` and `[surface0]` in GLib's key file syntax. `projection-type` 3 maps
perspective to perspective; `focal-length`, `src-x0` and `src-y0` are those of the source, `dst-focal-length` and
`dst-principal-point` those of the result, here the same, so that the pinhole of the camera matrix remains. `distortion` has
OpenCV's coefficients in the order k1, k2, k3, p1, p2.

Source: docs.nvidia.com/metropolis/deepstream/dev-guide/text/DS_plugin_gst-nvdewarper.html ("Configuration File Parameters")
and nvdewarper_property_parser.h of its API reference.
"""

from __future__ import annotations

import configparser
from pathlib import Path

import numpy as np

from passerby.common.errors import InputError
from passerby.common.text import shortened
from passerby.core.cameras import Lens
from passerby.interchange.storage.faults import read_text

PERSPECTIVE = "3"
_KEYS = ("focal-length", "src-x0", "src-y0", "distortion")


def dewarper_config(lens: Lens) -> bytes:
    """The file for a pinhole with k1, k2, p1, p2 and k3 at most, without skew."""
    (width, height), matrix = lens.size, lens.matrix
    k1, k2, p1, p2, k3 = (*lens.distortions, 0.0, 0.0, 0.0, 0.0, 0.0)[:5]
    focal, centre = _list(matrix[0, 0], matrix[1, 1]), _list(matrix[0, 2], matrix[1, 2])
    lines = (
        "[property]", f"output-width={width}", f"output-height={height}", "num-batch-buffers=1", "",
        "[surface0]", f"projection-type={PERSPECTIVE}", "surface-index=0", f"width={width}", f"height={height}",
        f"focal-length={focal}", f"src-x0={float(matrix[0, 2])!r}", f"src-y0={float(matrix[1, 2])!r}",
        f"distortion={_list(k1, k2, k3, p1, p2)}", f"dst-focal-length={focal}", f"dst-principal-point={centre}", "",
    )  # fmt: skip
    return "\n".join(lines).encode("ascii")


def read_dewarper(path: Path, size: tuple[int, int]) -> Lens:
    """The lens of the videos before their distortion is removed.

    Args:
        path: the configuration file of one camera.
        size: width and height of its pictures, pixels.

    Raises:
        InputError: no perspective surface, a key is missing, or a value is no number.
    """
    parser = configparser.ConfigParser(interpolation=None)
    try:
        parser.read_string(read_text(path, "a configuration file of Gst-nvdewarper"))
    except configparser.Error as error:
        raise InputError(f"{path}: is no configuration file of Gst-nvdewarper: {shortened(error.message)}") from None
    surface = dict(parser["surface0"]) if parser.has_section("surface0") else {}
    if surface.get("projection-type") != PERSPECTIVE:
        told = shortened(surface.get("projection-type"))
        raise InputError(f"{path}: [surface0] projection-type is {told}: only {PERSPECTIVE}, perspective, can be read")
    focal, x0, y0, distortion = (_numbers(path, key, surface.get(key)) for key in _KEYS)
    if len(focal) not in (1, 2) or len(x0) != 1 or len(y0) != 1 or len(distortion) > 5:
        raise InputError(
            f"{path}: [surface0]: one or two focal lengths, one src-x0 and src-y0 and up to 5 distortions are needed"
        )
    k1, k2, k3, p1, p2 = (*distortion, 0.0, 0.0, 0.0, 0.0, 0.0)[:5]
    matrix = np.array([[focal[0], 0.0, x0[0]], [0.0, focal[-1], y0[0]], [0.0, 0.0, 1.0]])
    try:
        return Lens(size, matrix, np.array([k1, k2, p1, p2, k3]))
    except InputError as error:
        raise InputError(f"{path}: {error}") from None


def _list(*values: float) -> str:
    return ";".join(repr(float(value)) for value in values)


def _numbers(path: Path, key: str, text: str | None) -> list[float]:
    """The numbers of a list. Raises `InputError`."""
    try:
        found = [float(part) for part in (text or "").split(";") if part.strip()]
    except ValueError:
        found = []
    if not found or not np.isfinite(found).all():
        raise InputError(f"{path}: [surface0] {key} is {shortened(text)}: finite numbers with ; between are needed")
    return found
