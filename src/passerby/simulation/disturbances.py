"""Scenes that violate the assumptions of a calibration: a camera is moved or zooms, or the ground is not a level plane."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, fields, replace

import numpy as np
from scipy.spatial.transform import Rotation

from passerby.common.arrays import Floats
from passerby.common.errors import InputError
from passerby.core.cameras import Camera, Pose, Rig
from passerby.simulation.body import pose_joints
from passerby.simulation.observe import View, observe_camera
from passerby.simulation.options import SimulationOptions
from passerby.simulation.scene import BODIES_AT_ONCE, Filmed, film

Ground = Callable[[Floats], Floats]
"""Function from places (..., 2) to heights of the ground (...), metres."""


@dataclass(frozen=True)
class Move:
    """A camera that is bumped or turned while it films."""

    camera: str
    from_s: float
    """Time of the move, seconds of the camera's own recording."""
    turn_deg: tuple[float, float, float] = (0.0, 0.0, 0.0)
    """Rotation vector in the camera's own frame, OpenCV's axes: tilt, pan, roll."""
    shift_m: tuple[float, float, float] = (0.0, 0.0, 0.0)
    """Shift of the camera centre along the world's axes, metres."""
    until_s: float = np.inf
    """Time at which the camera is back in its first pose, seconds."""

    def moved(self, camera: Camera) -> Camera:
        """Return the camera with its pose after the move."""
        assert camera.pose is not None
        turn = Rotation.from_rotvec(np.radians(self.turn_deg)).as_matrix()
        return replace(camera, pose=Pose.from_centre(turn @ camera.pose.R_cw, camera.pose.centre + np.array(self.shift_m)))


@dataclass(frozen=True)
class Zoom:
    """A camera whose focal length jumps to another value while it films; `gradual_zoom` makes a slow zoom."""

    camera: str
    from_s: float
    """Time of the zoom, seconds of the camera's own recording."""
    factor: float
    """Factor of both focal lengths; above 1 the camera zooms in. The distortion coefficients stay."""
    until_s: float = np.inf
    """Time from which the camera has its first focal length again, seconds."""

    def moved(self, camera: Camera) -> Camera:
        """Return the camera with its lens after the zoom."""
        assert camera.lens.focal_sd is None
        matrix = np.array(camera.lens.matrix)
        matrix[:2, :2] *= self.factor
        return replace(camera, lens=replace(camera.lens, matrix=matrix))


Disturbance = Move | Zoom


def gradual_zoom(camera: str, from_s: float, to_s: float, factor: float, step_s: float = 0.2) -> tuple[Zoom, ...]:
    """Return a zoom in equal ratios between two times, as steps of `step_s` seconds; steps of one frame are not visible."""
    steps = max(1, round((to_s - from_s) / step_s))
    return tuple(Zoom(camera, from_s + k * step_s, factor ** ((k + 1) / steps)) for k in range(steps))


def level(places: Floats) -> Floats:
    """Return the heights of the default ground: 0 everywhere."""
    return np.zeros(places.shape[:-1])


def film_disturbed(options: SimulationOptions, moves: Sequence[Disturbance] = (), ground: Ground = level) -> Filmed:
    """Film a scene as `film` does, with cameras that are moved or zoom, and on another ground.

    If several disturbances of one camera overlap in time, the last one counts alone. The rig of the result holds the cameras
    before all disturbances. Raises `InputError` for a camera that the scene does not have.
    """
    filmed = film(options)
    for move in moves:
        if move.camera not in filmed.rig.names:
            raise InputError(f"camera {move.camera} is not in the scene: choose one of {', '.join(filmed.rig.names)}")
    disturbed = {move.camera for move in moves}
    views = [
        one
        if ground is level and camera.name not in disturbed
        else _observe_disturbed(filmed, index, [move for move in moves if move.camera == camera.name], ground)
        for index, (camera, one) in enumerate(zip(filmed.rig, filmed.views, strict=True))
    ]
    return replace(filmed, views=tuple(views))


def rig_after(rig: Rig, moves: Sequence[Disturbance]) -> Rig:
    """Return the rig with the pose and lens of each camera's last disturbance, as in its recording."""
    last = {move.camera: move for move in moves}
    return Rig(tuple(last[camera.name].moved(camera) if camera.name in last else camera for camera in rig))


def _observe_disturbed(filmed: Filmed, index: int, moves: Sequence[Disturbance], ground: Ground) -> View:
    """Compute the view of one camera, in stretches of one pose and one lens each."""
    camera, options = filmed.rig.cameras[index], filmed.options
    own = np.arange(len(filmed.views[index].hidden)) / options.frame_rates[index]
    number = np.zeros(len(own), dtype=np.int64)
    for k, move in enumerate(moves, start=1):
        number[(own >= move.from_s) & (own < move.until_s)] = k
    stretch = max(1, BODIES_AT_ONCE // len(filmed.heights))
    parts = []
    for rows in np.split(np.arange(len(own)), np.flatnonzero(np.diff(number)) + 1):
        k = number[rows[0]]
        there = camera if k == 0 else moves[k - 1].moved(camera)
        for start in range(0, len(rows), stretch):
            times = own[rows[start : start + stretch]] + filmed.clock_offsets[index]
            state, present = filmed.motion.at(times)
            joints = pose_joints(state, filmed.heights)
            joints[..., 2] += ground(state.xy)[..., None]
            parts.append(observe_camera(there, joints, filmed.heights, present, options.occlusion))
    return View(**{item.name: np.concatenate([getattr(part, item.name) for part in parts]) for item in fields(View)})
