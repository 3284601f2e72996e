"""Hours of footage that cost a second: bodies reduced to the boxes around them, with errors that last.

The full simulator moves every limb and takes minutes for an hour. Here people come and go, walk between places and rest; each
camera sees the body's highest and lowest point through its true lens. A box then errs as real ones do: its middle lies to one
side of the body's axis (arms, a bag), which looks different from every side; gait and the detector add errors that last for
seconds, 2 % of the height, and 1 % that does not; people bend, and for a few seconds now and then something hides their legs.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from scipy.signal import lfilter

from passerby.common.arrays import Floats, Ints
from passerby.core.cameras import Camera, Pose, PoseSigma, Rig
from passerby.core.observations import Boxes, CameraObservations, Observations
from passerby.geometry.rotations import exp_rotation
from passerby.simulation.lenses import place_cameras
from passerby.simulation.options import PRESETS

VISIT_S = (40.0, 240.0)
"""How long somebody stays."""
LASTING_S = 2.0
"""Correlation time of what boxes err by for seconds."""
LASTING, FLEETING = 0.02, 0.01
"""One sigma of both kinds of error of an edge, as shares of the box's height."""
BAG_M = 0.04
"""One sigma of how far to its right a body's box is off."""
NEAR_FOOT = 0.08


@dataclass(frozen=True, eq=False)
class Visit:
    """One person's stay at K instants."""

    person: int
    frame: Ints
    xy: Floats
    heading: Floats
    top: Floats
    """(K,) height of the highest point, metres."""
    bag_m: float


@dataclass(frozen=True)
class Move:
    """A camera that is knocked: from `seconds` on its pose is another."""

    camera: str
    seconds: float
    turn_deg: tuple[float, float, float] = (0.0, 0.0, 0.0)
    """Rotation vector, camera frame."""
    shift_m: tuple[float, float, float] = (0.0, 0.0, 0.0)

    def after(self, pose: Pose) -> Pose:
        """The pose after the knock."""
        turned = exp_rotation(np.radians(self.turn_deg)) @ pose.R_cw
        return Pose.from_centre(turned, pose.centre + np.array(self.shift_m))


def true_rig(preset: str, cameras: int, rng: np.random.Generator) -> Rig:
    """Cameras around the preset's area."""
    chosen = PRESETS[preset]
    return place_cameras(cameras, chosen.area_m, chosen.standoff_m, chosen.camera_height_m, chosen.picture, rng)


def calibrated(rig: Rig, rng: np.random.Generator, *, position_m: tuple[float, float] = (0.01, 0.03), turn_deg: float = 0.1,
               scale: float = 0.01) -> Rig:  # fmt: skip
    """The rig as a calibration would have found it: every pose off by its stated sigma, and all of it too large or small.

    Args:
        rig: the true one.
        rng: draws the errors.
        position_m: least and largest sigma of a camera's place (root of the trace).
        turn_deg: sigma of a camera's orientation (root of the trace).
        scale: of lengths, one sigma.
    """
    factor = 1 + scale * rng.standard_normal()
    found = []
    for camera in rig:
        assert camera.pose is not None
        place_sd = rng.uniform(*position_m) / np.sqrt(3)
        turn_sd = np.radians(turn_deg) / np.sqrt(3)
        turned = exp_rotation(turn_sd * rng.standard_normal(3)) @ camera.pose.R_cw
        pose = Pose.from_centre(turned, factor * (camera.pose.centre + place_sd * rng.standard_normal(3)))
        covariance = np.diag(np.repeat([place_sd**2, turn_sd**2], 3))
        found.append(replace(camera, pose=pose, sigma=PoseSigma(place_sd * np.sqrt(3), turn_deg, covariance)))
    return replace(rig, cameras=tuple(found))


def footage(
    preset: str, rig: Rig, seconds: float, present: float, rng: np.random.Generator, *, fps: float = 2.0,
    moves: tuple[Move, ...] = (),
) -> Observations:  # fmt: skip
    """Boxes of `present` people on average, with identities, at `fps` instants a second."""
    count = rng.poisson(present * seconds / np.mean(VISIT_S)) + max(1, round(present))
    visits = [_visit(preset, number, seconds, fps, number <= round(present), rng) for number in range(1, count + 1)]
    seen = {}
    for camera, own in zip(rig, rng.spawn(len(rig)), strict=True):
        knocks = sorted((move for move in moves if move.camera == camera.name), key=lambda move: move.seconds)
        seen[camera.name] = CameraObservations(_joined([_boxes(camera, knocks, visit, fps, own) for visit in visits]))
    return Observations(seen, fps)


def _visit(preset: str, person: int, seconds: float, fps: float, at_once: bool, rng: np.random.Generator) -> Visit:
    """Somebody walks from place to place at a pace of his own, rests, bends, and leaves."""
    half = np.asarray(PRESETS[preset].area_m) / 2 - 0.3
    stay = rng.uniform(*VISIT_S)
    begin = rng.uniform(-stay / 2, 0) if at_once else rng.uniform(0, seconds)
    height, pace = 1.72 + 0.09 * np.clip(rng.standard_normal(), -2.5, 2.5), rng.uniform(0.8, 1.5)
    places = rng.uniform(-1, 1, (int(stay) + 2, 2)) * half
    legs = np.linalg.norm(np.diff(places, axis=0), axis=1) / pace
    rests = np.where(rng.uniform(size=len(legs)) < 0.3, rng.uniform(2, 10, len(legs)), 0.0)
    ends = np.cumsum(legs + rests)
    knots = np.column_stack([ends - rests, ends]).ravel()
    frame = np.arange(max(0, np.ceil(begin * fps)), min(seconds, begin + stay) * fps, dtype=np.int64)
    at = frame / fps - begin
    knots = np.append(0.0, knots)
    nodes = np.concatenate([places[:1], np.repeat(places[1:], 2, axis=0)])
    xy = np.column_stack([np.interp(at, knots, nodes[:, k]) for k in (0, 1)])
    leg = np.minimum(np.searchsorted(ends, at), len(legs) - 1)
    heading = np.arctan2(*(places[leg + 1] - places[leg]).T[::-1])
    bent = rng.uniform(size=int(stay / 5) + 2) < 0.06
    top = height * np.where(bent[(at / 5).astype(int)], 0.78, 1.0) * (1 + 0.01 * _lasting(len(at), 1, 0.5, fps, rng)[:, 0])
    return Visit(person, frame + 1, xy, heading, top, BAG_M * float(rng.standard_normal()))


def _lasting(n: int, columns: int, seconds: float, fps: float, rng: np.random.Generator) -> Floats:
    """(n, columns) of unit variance whose correlation dies away in `seconds`."""
    keep = np.exp(-1 / (fps * seconds))
    noise = rng.standard_normal((n, columns))
    noise[1:] *= np.sqrt(1 - keep**2)
    return np.asarray(lfilter([1.0], [1.0, -keep], noise, axis=0))


def _boxes(camera: Camera, knocks: list[Move], visit: Visit, fps: float, rng: np.random.Generator) -> Boxes:
    """What one camera makes of a visit."""
    n = len(visit.frame)
    if not n:
        return Boxes.empty()
    assert camera.pose is not None
    pose, edges = camera.pose, np.zeros((n, 4))
    seconds = (visit.frame - 1) / fps
    for move in (None, *knocks):
        pose = pose if move is None else move.after(pose)
        rows = np.flatnonzero(seconds >= (-1.0 if move is None else move.seconds))
        edges[rows] = _edges(replace(camera, pose=pose), visit, rows)
    height = edges[:, 3] - edges[:, 1]
    error = LASTING * _lasting(n, 4, LASTING_S, fps, rng) + FLEETING * rng.standard_normal((n, 4))
    edges = edges + error * height[:, None]
    hidden = rng.uniform(size=int(n / fps / 4) + 2) < 0.04
    edges[:, 3] -= np.where(hidden[(np.arange(n) / fps / 4).astype(int)], 0.25 * height, 0.0)
    width, tall = camera.lens.size
    inside = np.isfinite(edges).all(axis=1) & (height > 8) & (rng.uniform(size=n) > 0.05)
    middle = (edges[:, :2] + edges[:, 2:]) / 2
    inside &= (middle > 0).all(axis=1) & (middle < (width, tall)).all(axis=1)
    edges = np.clip(edges[inside], 0.0, (width, tall, width, tall))
    ltwh = np.column_stack([edges[:, :2], edges[:, 2:] - edges[:, :2]])
    return Boxes(visit.frame[inside], np.full(len(edges), visit.person), ltwh, np.ones(len(edges)))


def _edges(camera: Camera, visit: Visit, rows: Ints) -> Floats:
    """(K, 4) left, top, right, bottom without any error; NaN behind the camera."""
    xy, top = visit.xy[rows], visit.top[rows]
    right = np.column_stack([np.sin(visit.heading[rows]), -np.cos(visit.heading[rows])])
    toward = camera.centre[:2] - xy
    toward /= np.maximum(np.linalg.norm(toward, axis=1, keepdims=True), 0.3)
    axis = xy + visit.bag_m * right
    high = camera.project(np.column_stack([axis, top]))
    low = camera.project(np.column_stack([axis + NEAR_FOOT * top[:, None] * toward, np.zeros(len(rows))]))
    middle, half = (high[:, 0] + low[:, 0]) / 2, 0.18 * (low[:, 1] - high[:, 1])
    return np.column_stack([middle - half, high[:, 1], middle + half, low[:, 1]])


def _joined(parts: list[Boxes]) -> Boxes:
    """In the order of the frames."""
    columns = {name: np.concatenate([getattr(part, name) for part in parts]) for name in ("frame", "identity", "ltwh", "score")}
    order = np.lexsort((columns["identity"], columns["frame"]))
    order = order[(columns["ltwh"][order, 2:] > 1).all(axis=1)]
    return Boxes(**{name: values[order] for name, values in columns.items()})


def unit(rng: np.random.Generator) -> tuple[float, float, float]:
    """A random direction."""
    vector = rng.standard_normal(3)
    x, y, z = (vector / np.linalg.norm(vector)).tolist()
    return x, y, z
