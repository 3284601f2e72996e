"""The plan of an MV3DT data set: `map.png`, on which its viewer draws people, and `transforms.yml`, how to get there.

`T_ov2px` has the 9 numbers of a 3 x 3 matrix, row by row: it maps a point of the world's ground (x, y, 1), metres, to a pixel
(u, v, 1) of the map. The map that Passerby draws has the world's x to the right and its y upwards, a grid, and the cameras with
their directions and names. Any other picture can take its place, with a matrix of its own.

Source: `load_map_and_transforms` of deepstream-tracker-3d-multi-view/utils/kafka_bev_visualizer.py in
github.com/NVIDIA-AI-IOT/deepstream_reference_apps.
"""

from __future__ import annotations

from collections.abc import Mapping

import cv2
import numpy as np
import yaml

from passerby.common.arrays import Floats
from passerby.interchange.formats.drawing import Drawing

MAP, TRANSFORMS = "map.png", "transforms.yml"
LARGEST_PX, MOST_PX_PER_M = 1600, 100.0
"""Longer side of the map; pixels a metre of a small one."""
MARGIN_PX = 30
PAPER, GRID, INK = (255, 255, 255), (225, 225, 225), (60, 60, 60)
ARROW_PX = 28


def map_files(drawing: Drawing, names: Mapping[str, str]) -> dict[str, bytes]:
    """The two files, by name.

    Args:
        drawing: the rig, with the ground's grid.
        names: what each camera is called on the map; ASCII, as OpenCV draws no other letters.
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
    """Whole pixels of points (N, 2 or more), of which x and y count."""
    seen = points[:, :2] @ to_map[:2, :2].T + to_map[:2, 2]
    return [(round(float(u)), round(float(v))) for u, v in seen]
