"""Files beside NVIDIA's calibrations: the dewarper's configuration of each camera, and the map of an MV3DT data set.

The dewarper has one file for each camera with distortion, `[property]` and `[surface0]` in GLib's key file syntax.
`projection-type` 3 maps perspective to perspective; `focal-length`, `src-x0` and `src-y0` are those of the source,
`dst-focal-length` and `dst-principal-point` those of the result. Here they are equal, so that the result has the camera matrix
of the source. `distortion` has OpenCV's coefficients in the order k1, k2, k3, p1, p2.

Source: docs.nvidia.com/metropolis/deepstream/dev-guide/text/DS_plugin_gst-nvdewarper.html ("Configuration File Parameters")
and nvdewarper_property_parser.h of its API reference.

The plan of an MV3DT data set is `map.png`, on which its viewer draws people, and `transforms.yml`, the transform to its pixels.

`T_ov2px` has the 9 numbers of a 3 x 3 matrix, row by row: it maps a point of the world's ground (x, y, 1), metres, to a pixel
(u, v, 1) of the map. The map that Passerby draws has the world's x to the right and its y upwards, a grid, and the cameras with
their directions and names. Any other picture with its own matrix can replace it.

Source: `load_map_and_transforms` of deepstream-tracker-3d-multi-view/utils/kafka_bev_visualizer.py in
github.com/NVIDIA-AI-IOT/deepstream_reference_apps.
"""

from __future__ import annotations

import configparser
from collections.abc import Mapping
from pathlib import Path

import cv2
import numpy as np
import yaml

from passerby.common.arrays import Floats
from passerby.common.errors import InputError
from passerby.common.text import shortened
from passerby.core.cameras import Lens
from passerby.interchange.formats.drawing import Drawing
from passerby.interchange.storage.safe_parsing import read_text

PERSPECTIVE = "3"
_KEYS = ("focal-length", "src-x0", "src-y0", "distortion")
MAP, TRANSFORMS = "map.png", "transforms.yml"
LARGEST_PX, MOST_PX_PER_M = 1600, 100.0
"""Longer side of the map, pixels; largest scale of a small map, pixels per metre."""
MARGIN_PX = 30
PAPER, GRID, INK = (255, 255, 255), (225, 225, 225), (60, 60, 60)
ARROW_PX = 28


def dewarper_config(lens: Lens) -> bytes:
    """Write the configuration file for a pinhole with at most k1, k2, p1, p2 and k3, without skew."""
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
    """Read the lens of the original videos, before their distortion is removed.

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
    """Parse a list of numbers, separated by semicolons. Raises `InputError`."""
    try:
        found = [float(part) for part in (text or "").split(";") if part.strip()]
    except ValueError:
        found = []
    if not found or not np.isfinite(found).all():
        raise InputError(f"{path}: [surface0] {key} is {shortened(text)}: finite numbers with ; between are needed")
    return found


def map_files(drawing: Drawing, names: Mapping[str, str]) -> dict[str, bytes]:
    """Draw the map, and return `map.png` and `transforms.yml` by name.

    Args:
        drawing: the rig, with the ground's grid.
        names: name of each camera on the map; ASCII, because OpenCV draws no other letters.
    """
    low, high = drawing.ground[..., :2].min(axis=(0, 1)), drawing.ground[..., :2].max(axis=(0, 1))
    scale = min(MOST_PX_PER_M, (LARGEST_PX - 2 * MARGIN_PX) / float((high - low).max()))
    to_map = np.array([
        [scale, 0.0, MARGIN_PX - scale * low[0]], [0.0, -scale, MARGIN_PX + scale * high[1]], [0.0, 0.0, 1.0],
    ])  # fmt: skip
    width, height = (np.ceil(scale * (high - low)) + 2 * MARGIN_PX + 1).astype(int)
    picture = np.full((height, width, 3), PAPER, dtype=np.uint8)
    for line in drawing.ground:
        start, end = _pixels(to_map, line)
        cv2.line(picture, start, end, GRID, 1, cv2.LINE_AA)
    for frustum in drawing.frusta:
        axis = frustum.pose.R_cw[2, :2] / max(float(np.linalg.norm(frustum.pose.R_cw[2, :2])), 1e-9)
        place = frustum.pose.centre[:2]
        start, end = _pixels(to_map, np.array([place, place + ARROW_PX / scale * axis]))
        cv2.arrowedLine(picture, start, end, frustum.colour[::-1], 2, cv2.LINE_AA, tipLength=0.3)
        cv2.circle(picture, start, 5, frustum.colour[::-1], -1, cv2.LINE_AA)
        beside = start[0] + 8, start[1] - 8
        cv2.putText(picture, names[frustum.camera.name], beside, cv2.FONT_HERSHEY_SIMPLEX, 0.5, INK, 1, cv2.LINE_AA)
    encoded = cv2.imencode(".png", picture)[1].tobytes()
    content = {"T_ov2px": to_map.ravel().tolist()}
    return {MAP: encoded, TRANSFORMS: yaml.safe_dump(content, sort_keys=False).encode("utf-8")}


def _pixels(to_map: Floats, points: Floats) -> list[tuple[int, int]]:
    """Map points (N, 2 or more), of which only x and y are used, to whole pixels."""
    seen = points[:, :2] @ to_map[:2, :2].T + to_map[:2, 2]
    return [(round(float(u)), round(float(v))) for u, v in seen]
