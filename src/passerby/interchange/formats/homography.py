"""Homographies from each camera's image to the ground, with the lens parameters that are needed to remove the distortion.

One JSON file. `cameras` has a table for each camera, by its name:

    image_size             [width, height], pixels
    lens_model             "pinhole" or "fisheye": OpenCV's model
    camera_matrix          3 x 3, without skew
    distortion             OpenCV's coefficients in their order; empty without distortion
    undistorted_to_ground  3 x 3: an undistorted pixel (u, v, 1) -> (x, y, 1) on the ground up to scale, metres
    ground_to_undistorted  3 x 3: its inverse

`cv2.undistortPoints(pixels, camera_matrix, distortion, P=camera_matrix)` computes the undistorted pixels, for a fisheye
`cv2.fisheye.undistortPoints`. Neither function uses a skew in the camera matrix. Therefore the homographies include the skew of
a lens without distortion; the skew of any other lens is a loss. Both homographies have unit norm. A pixel above the horizon
shows no ground and maps to a point behind the camera: the third component of `undistorted_to_ground @ (u, v, 1)` is positive
for pixels that show the ground, and negative above the horizon.

R. Hartley and A. Zisserman, "Multiple View Geometry in Computer Vision", 2nd edition, section 8.1.1: the map from the plane
z = 0 to the image is K [r1 r2 t].
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from passerby.core.cameras import Camera, Lens
from passerby.interchange.formats.format import Export, Format, Losses
from passerby.interchange.formats.lens_models import OPENCV, PINHOLE_SKEWED, express_lens
from passerby.interchange.storage.text_formats import to_json

LOWEST_M = 1e-6
"""Least height of a camera above or below the ground. A camera in the ground plane sees the ground as a line."""


def write(export: Export, losses: Losses) -> Mapping[str, bytes]:
    """Write the homographies as JSON. Losses: cameras without a pose or in the ground plane; skew of lenses with distortion."""
    cameras = {}
    for camera in export.posed(losses):
        if abs(camera.centre[2]) < LOWEST_M:
            losses.add(f"camera {camera.name} is at the height of the ground and is left out")
        else:
            cameras[camera.name] = _table(camera, _lens(camera, losses))
    return {"": to_json({"unit": "m", "cameras": cameras}).encode("utf-8")}


def _lens(camera: Camera, losses: Losses) -> Lens:
    """Return the camera's lens, with a skew only if it has no distortion."""
    if not camera.lens.matrix[0, 1]:
        return camera.lens
    return express_lens(camera, (PINHOLE_SKEWED, *OPENCV), losses)[0]


def _table(camera: Camera, lens: Lens) -> dict[str, Any]:
    """Return the table of a camera. The third component of the map to the image is a depth, positive in front of the camera."""
    assert camera.pose is not None
    to_image = lens.matrix @ np.column_stack([camera.pose.R_cw[:, :2], camera.pose.t_cw])
    to_ground = np.linalg.inv(to_image)
    return {
        "image_size": list(lens.size),
        "lens_model": "fisheye" if lens.fisheye else "pinhole",
        "camera_matrix": lens.matrix * [[1, 0, 1], [1, 1, 1], [1, 1, 1]],
        "distortion": lens.distortions if lens.distortions.any() else [],
        "undistorted_to_ground": to_ground / np.linalg.norm(to_ground),
        "ground_to_undistorted": to_image / np.linalg.norm(to_image),
    }


FORMAT = Format(
    name="homography",
    title="Homographies between images and the ground, with undistortion",
    tools=("OpenCV", "any program that reads JSON"),
    target="file",
    suffixes=(".json",),
    conventions="Undistorted OpenCV pixels to metres on the ground (3 x 3) and back; camera matrix and distortion are beside "
    "them, for cv2.undistortPoints.",
    write=write,
)
