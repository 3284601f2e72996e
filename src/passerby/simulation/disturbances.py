"""Scenes that are not as a calibration takes them to be: a camera that is moved or zooms, a ground that is no level plane."""

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
"""From places (..., 2) to heights (...), metres."""


@dataclass(frozen=True)
class Move:
    """A camera that is bumped or turned while it films."""

    camera: str
    from_s: float
    """Seconds of the camera's own recording."""
    turn_deg: tuple[float, float, float] = (0.0, 0.0, 0.0)
    """Rotation vector in the camera's own frame, OpenCV's axes: tilt, pan, roll."""
    shift_m: tuple[float, float, float] = (0.0, 0.0, 0.0)
    """Along the world's axes."""
    until_s: float = np.inf
    """When it is back where it was."""

    def moved(self, camera: Camera) -> Camera:
        """The camera where it is after the move."""
        assert camera.pose is not None
        turn = Rotation.from_rotvec(np.radians(self.turn_deg)).as_matrix()
        return replace(camera, pose=Pose.from_centre(turn @ camera.pose.R_cw, camera.pose.centre + np.array(self.shift_m)))


@dataclass(frozen=True)
class Zoom:
    """A camera whose focal length changes while it films, at once; `gradual_zoom` makes one that takes its time."""

    camera: str
    from_s: float
    """Seconds of the camera's own recording."""
    factor: float
    """Of both focal lengths; above 1 the camera zooms in. The distortion's coefficients stay."""
    until_s: float = np.inf
    """When it has its first focal length again."""

    def moved(self, camera: Camera) -> Camera:
        """The camera after the zoom."""
        assert camera.lens.focal_sd is None
        matrix = np.array(camera.lens.matrix)
        matrix[:2, :2] *= self.factor
        return replace(camera, lens=replace(camera.lens, matrix=matrix))


Disturbance = Move | Zoom


def gradual_zoom(camera: str, from_s: float, to_s: float, factor: float, step_s: float = 0.2) -> tuple[Zoom, ...]:
    """A zoom in equal ratios between two times, as steps of `step_s` seconds: as long as one frame, nothing of them is seen."""
    steps = max(1, round((to_s - from_s) / step_s))
    return tuple(Zoom(camera, from_s + k * step_s, factor ** ((k + 1) / steps)) for k in range(steps))


def level(places: Floats) -> Floats:
    """The ground that scenes have by default."""
    return np.zeros(places.shape[:-1])


def film_disturbed(options: SimulationOptions, moves: Sequence[Disturbance] = (), ground: Ground = level) -> Filmed:
    """What `film` makes of the options with cameras that are moved or zoom, and on another ground; of several disturbances of
    one camera at one time the last one counts.

    The rig of the result holds the cameras as they are before. Raises `InputError` for a camera that is not there.
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
    """The rig when all moves are done."""
    for move in moves:
        rig = Rig(tuple(move.moved(camera) if camera.name == move.camera else camera for camera in rig))
    return rig


def _observe_disturbed(filmed: Filmed, index: int, moves: Sequence[Disturbance], ground: Ground) -> View:
    """What one camera sees, in stretches of one pose and one lens each."""
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
