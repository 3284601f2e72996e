"""Images turned by quarter turns: pixels, boxes, keypoints, lenses and poses of a camera that is mounted on its side.

Files and public values refer to the images as filmed. The methods expect upright people: they work on the turned images, and
the results are turned back. `Lens.rotate` is the angle by which a camera's images still have to be turned.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np

from passerby.common.arrays import Floats
from passerby.common.errors import InputError
from passerby.core.cameras import Camera, Lens, Pose, PoseSigma, Rig
from passerby.core.observations import Boxes, CameraObservations, Keypoints, Observations
from passerby.core.scale_cues import ScaleCues

Size = tuple[int, int]


def turn_size(size: Size, degrees: int) -> Size:
    """Return (width, height) of an image after it is turned clockwise by a multiple of 90 degrees."""
    return size if degrees % 180 == 0 else (size[1], size[0])


def turn_pixels(pixels: Floats, size: Size, degrees: int) -> Floats:
    """Turn pixels of an image clockwise.

    Args:
        pixels: (..., 2), the origin in the middle of the first pixel.
        size: (width, height) of the image before.
        degrees: a multiple of 90.

    Returns:
        (..., 2) pixels of the turned image.
    """
    u, v = np.moveaxis(np.asarray(pixels, dtype=np.float64), -1, 0)
    right, low = size[0] - 1.0, size[1] - 1.0
    turned = {0: (u, v), 90: (low - v, u), 180: (right - u, low - v), 270: (v, right - u)}[degrees % 360]
    return np.stack(turned, axis=-1)


def turn_boxes(boxes: Boxes, size: Size, degrees: int) -> Boxes:
    """Turn boxes of an image of a size (width, height) clockwise by a multiple of 90 degrees."""
    if degrees % 360 == 0:
        return boxes
    first, last = boxes.ltwh[:, :2], boxes.ltwh[:, :2] + boxes.ltwh[:, 2:]
    corners = np.stack([turn_pixels(first, size, degrees), turn_pixels(last, size, degrees)])
    extent = boxes.ltwh[:, 2:] if degrees % 180 == 0 else boxes.ltwh[:, :1:-1]
    return replace(boxes, ltwh=np.concatenate([corners.min(axis=0), extent], axis=1))


def turn_keypoints(keypoints: Keypoints, size: Size, degrees: int) -> Keypoints:
    """Turn keypoints of an image of a size (width, height) clockwise by a multiple of 90 degrees."""
    if degrees % 360 == 0:
        return keypoints
    return replace(keypoints, xy=turn_pixels(keypoints.xy, size, degrees))


def turn_seen(seen: CameraObservations, size: Size, degrees: int) -> CameraObservations:
    """Turn all observations of a camera with images of a size (width, height) clockwise."""
    joints, wands = (turn_keypoints(points, size, degrees) for points in (seen.keypoints, seen.wands))
    return CameraObservations(turn_boxes(seen.boxes, size, degrees), joints, wands)


def axes_turn(degrees: int) -> Floats:
    """Return the rotation (3, 3) from a camera's frame to that of the camera whose images are turned clockwise."""
    right, down = {0: (1, 0), 90: (0, 1), 180: (-1, 0), 270: (0, -1)}[degrees % 360]
    return np.array([[right, -down, 0.0], [down, right, 0.0], [0.0, 0.0, 1.0]])


def turn_lens(lens: Lens, degrees: int) -> Lens:
    """Return the lens of the images after these are turned clockwise; its `rotate` is the angle that remains.

    Args:
        lens: lens of the images before.
        degrees: a multiple of 90.

    Raises:
        InputError: a skew, or a tilted sensor, which no lens model can express after a quarter turn.
    """
    if degrees % 360 == 0:
        return lens
    quarter = degrees % 180 != 0
    K = lens.matrix
    if quarter and (K[0, 1] != 0 or lens.distortions[12:].any()):
        raise InputError("a lens with a skew or a tilted sensor (14 distortions) cannot be turned by 90 degrees")
    focal = (K[1, 1], K[0, 0]) if quarter else (K[0, 0], K[1, 1])
    centre = turn_pixels(K[:2, 2], lens.size, degrees)
    matrix = np.array([[focal[0], K[0, 1], centre[0]], [0.0, focal[1], centre[1]], [0.0, 0.0, 1.0]])
    distortions = lens.distortions if lens.fisheye else _turn_distortions(lens.distortions, axes_turn(degrees)[:2, :2])
    rotate = (lens.rotate - degrees) % 360
    return replace(lens, size=turn_size(lens.size, degrees), matrix=matrix, distortions=distortions, rotate=rotate)


def _turn_distortions(distortions: Floats, turn: Floats) -> Floats:
    """Turn pinhole coefficients by a rotation (2, 2): the tangential and the thin-prism ones are vectors in the image plane.

    In OpenCV's model the decentring of x is p2 (r² + 2x²) + 2 p1 x y: the vector is (p2, p1). The thin prism adds
    (s1, s3) r² + (s2, s4) r⁴. A half turn changes the signs of the tilt.
    """
    turned = np.array(distortions, dtype=np.float64)
    for x, y in ((3, 2), (8, 10), (9, 11)):
        if max(x, y) < turned.size:
            turned[[x, y]] = turn @ turned[[x, y]]
    turned[12:] *= turn[0, 0]
    return turned + 0.0  # no -0


def turn_pose(pose: Pose, degrees: int) -> Pose:
    """Return the pose of the camera whose images are turned clockwise by a multiple of 90 degrees."""
    turn = axes_turn(degrees)
    return Pose(turn @ pose.R_cw, turn @ pose.t_cw)


def turn_sigma(sigma: PoseSigma, degrees: int) -> PoseSigma:
    """Turn the uncertainty of a camera: rotation vector and principal point are in the camera's frame and turn with it."""
    if sigma.covariance is None:
        return sigma
    turn, block = axes_turn(degrees), np.eye(10)
    block[3:6, 3:6], block[7:9, 7:9] = turn, turn[:2, :2]
    complete = None if sigma.complete is None else block @ sigma.complete @ block.T
    return replace(sigma, covariance=block[:6, :6] @ sigma.covariance @ block[:6, :6].T, complete=complete)


def turn_camera(camera: Camera, degrees: int) -> Camera:
    """Return the camera of the images after these are turned clockwise: lens, pose, covariance. Raises as `turn_lens`."""
    if degrees % 360 == 0:
        return camera
    try:
        lens = turn_lens(camera.lens, degrees)
    except InputError as error:
        raise InputError(f"camera {camera.name}: {error}") from None
    pose = None if camera.pose is None else turn_pose(camera.pose, degrees)
    return Camera(camera.name, lens, pose, None if camera.sigma is None else turn_sigma(camera.sigma, degrees))


def turns_of(rig: Rig) -> dict[str, int]:
    """Return the degrees clockwise (`Lens.rotate`) by camera, for the cameras whose images are to be turned."""
    return {camera.name: camera.lens.rotate for camera in rig if camera.lens.rotate}


def turn_rig(rig: Rig, degrees: dict[str, int]) -> Rig:
    """Return the rig after the images of some cameras are turned clockwise. Raises as `turn_lens`."""
    if not degrees:
        return rig
    return replace(rig, cameras=tuple(turn_camera(camera, degrees.get(camera.name, 0)) for camera in rig))


def turn_observations(seen: Observations, rig: Rig, degrees: dict[str, int]) -> Observations:
    """Turn the observations of some cameras clockwise; `rig` has the sizes of the images before."""
    if not degrees:
        return seen
    turned = {
        name: turn_seen(one, rig[name].lens.size, degrees[name]) if name in degrees else one
        for name, one in seen.cameras.items()
    }
    return replace(seen, cameras=turned)


def undone(degrees: dict[str, int]) -> dict[str, int]:
    """Return the turns by camera that undo the given ones."""
    return {name: -turn % 360 for name, turn in degrees.items()}


def turn_cues(cues: ScaleCues, rig: Rig, degrees: dict[str, int]) -> ScaleCues:
    """Turn the pixels of some cameras in scale cues clockwise; `rig` is that of the turned images."""
    if not degrees:
        return cues

    def turned(pixels: Mapping[str, Any]) -> dict[str, Floats]:
        sizes = {name: turn_size(rig[name].lens.size, turn) for name, turn in degrees.items() if name in rig.names}
        return {
            name: turn_pixels(at, sizes[name], degrees[name]) if name in sizes else np.asarray(at, dtype=np.float64)
            for name, at in pixels.items()
        }

    plan = cues.plan
    if plan is not None:
        points = [
            replace(one, pixels={k: (float(u), float(v)) for k, (u, v) in turned(one.pixels).items()}) for one in plan.points
        ]
        plan = replace(plan, points=tuple(points))
    return replace(cues, lengths=tuple(replace(cue, points=turned(cue.points)) for cue in cues.lengths), plan=plan)
