"""Ground position of the person in each box of a rig's cameras, with its covariance.

A box is a ray to a body's middle. Across the ray the position is known to a fraction of a body's width. Along the ray it is
estimated from the middle's height above the ground and from the body's size in the picture, weighted by their information.
Boxes of all cameras at one instant become Gaussians on the ground plane, to be compared with each other.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from passerby.common.arrays import Floats, Ints
from passerby.core.cameras import Camera, Rig
from passerby.core.observations import UNKNOWN, Boxes, Clock, find_inside_picture
from passerby.core.stature import PERSON_HEIGHT_M
from passerby.geometry.groups import least_of_groups

STEP_S = 0.2
"""Time between instants, seconds; longer where a camera is slower. A walking person moves 0.3 m in this time."""
ACROSS_M, ACROSS_RAD = 0.1, 0.002
"""One sigma across the ray: boxes jitter by 2 to 3 % of a body's height and bodies lean; plus two pixels of a usual lens."""
MIDDLE_M = 0.12
"""One sigma of a middle's height above the ground: people's own heights, a crouch, a part of the body that the box misses."""
SIZE = 0.15
"""One sigma of the logarithm of a body's size in the picture: people differ by 5 %, bend, and are half hidden."""
CUT_TIMES = 3.0
"""Factor on the sigmas along the ray of a box that the picture's border cuts off."""
SPEED_GAP_S = 0.7
"""Rows of an identity that are closer together than this give its speed."""
FASTEST_M_S, UNKNOWN_SPEED_M_S = 8.0, 1.0
"""Largest speed that is believed. A box of unknown speed (without identity) has a sigma of the second times the time to the
instant."""


@dataclass(frozen=True, eq=False)
class Places:
    """N boxes at common instants, sorted by instant, then by camera. World: z up, ground at z = 0."""

    step: Ints
    """(N,) instants: the rig's time is `start_s + step * step_s`."""
    camera: Ints
    """(N,) rows of the rig's cameras."""
    row: Ints
    """(N,) rows of that camera's boxes."""
    identity: Ints
    """(N,) -1 where unknown."""
    place: Floats
    """(N, 2) ground position, metres."""
    covariance: Floats
    """(N, 2, 2) square metres."""
    whole: NDArray[np.bool_]
    """(N,) whether the box is not cut off by the picture's border."""
    ltwh: Floats
    """(N, 4) the boxes, pixels."""
    step_s: float
    centre: Floats
    """(C, 3) the cameras' centres, metres."""
    start_s: float = 0.0
    """The rig's time of instant 0."""

    def __len__(self) -> int:
        return len(self.step)

    def take(self, rows: NDArray[np.generic]) -> Places:
        """Return the boxes of the given rows (indices or a mask)."""
        return Places(
            **{name: getattr(self, name)[rows] for name in COLUMNS},
            step_s=self.step_s,
            centre=self.centre,
            start_s=self.start_s,
        )


COLUMNS = ("step", "camera", "row", "identity", "place", "covariance", "whole", "ltwh")


def places_of(
    rig: Rig, boxes: Mapping[str, Boxes], clocks: Mapping[str, Clock], person_height_m: float = PERSON_HEIGHT_M
) -> Places:
    """Compute the ground positions of all boxes at common instants, for each camera from the picture nearest in time.

    Args:
        rig: cameras, all with poses.
        boxes: boxes by the name of the camera.
        clocks: clocks by the name of the camera.
        person_height_m: typical standing height, metres.
    """
    step_s = max([STEP_S, *(_interval(boxes[camera.name], clocks[camera.name]) for camera in rig)])
    start_s = min((float(clocks[name].seconds(seen.frame.min())) for name, seen in boxes.items() if len(seen)), default=0.0)
    parts = [
        _camera_places(camera, number, boxes[camera.name], clocks[camera.name], start_s, step_s, person_height_m)
        for number, camera in enumerate(rig)
    ]
    centres = np.array([camera.centre for camera in rig])
    joined = {name: np.concatenate([getattr(part, name) for part in parts]) for name in COLUMNS}
    found = Places(**joined, step_s=step_s, centre=centres, start_s=start_s)
    return found.take(np.lexsort((found.row, found.camera, found.step)))


def _interval(boxes: Boxes, clock: Clock) -> float:
    """Return the usual time between a camera's pictures, seconds."""
    gaps = np.diff(np.unique(boxes.frame))
    return float(np.median(gaps)) / clock.fps if len(gaps) else STEP_S


def _camera_places(
    camera: Camera, number: int, boxes: Boxes, clock: Clock, start_s: float, step_s: float, person_height_m: float
) -> Places:
    """Compute the ground positions of one camera's boxes at the instants."""
    frames = np.unique(boxes.frame)
    seconds = clock.seconds(frames)
    nearest = np.round((seconds - start_s) / step_s).astype(np.int64)
    off = np.abs(seconds - start_s - nearest * step_s)
    chosen = least_of_groups(nearest, off)  # if several pictures are near one instant, the nearest in time is used
    picture = np.searchsorted(frames, boxes.frame)
    is_chosen = np.zeros(len(frames), dtype=np.bool_)
    is_chosen[chosen] = True
    place, covariance, whole = ground_places(camera, boxes.ltwh, person_height_m)
    velocity = _velocity(boxes, clock, place)
    late = (nearest * step_s + start_s - seconds)[picture]  # time from the picture to the instant
    known: NDArray[np.bool_] = np.asarray(np.isfinite(velocity).all(axis=1))
    drift = np.abs(late) * np.where(known, 0.5 * UNKNOWN_SPEED_M_S, UNKNOWN_SPEED_M_S)
    place = place + np.where(known[:, None], velocity, 0.0) * late[:, None]
    covariance = covariance + np.multiply.outer(drift**2, np.eye(2))
    use = np.flatnonzero(is_chosen[picture] & np.isfinite(place).all(axis=1))
    return Places(
        nearest[picture][use], np.full(len(use), number), use, boxes.identity[use], place[use], covariance[use], whole[use],
        boxes.ltwh[use], step_s, np.array([camera.centre]),
    )  # fmt: skip


def ground_places(camera: Camera, ltwh: Floats, person_height_m: float) -> tuple[Floats, Floats, NDArray[np.bool_]]:
    """Return positions (N, 2) of boxes (N, 4) on the ground, metres; covariances (N, 2, 2); and (N,) whether a box is whole.

    Positions are NaN for boxes whose rays the lens model does not give.
    """
    assert camera.pose is not None
    x, y, w, h = ltwh.T
    middle = x + w / 2
    top = camera.lens.bearings(np.column_stack([middle, y]))
    bottom = camera.lens.bearings(np.column_stack([middle, y + h]))
    ray = (top + bottom) @ camera.pose.R_cw
    ray /= np.linalg.norm(ray, axis=1, keepdims=True)
    level = np.maximum(np.hypot(ray[:, 0], ray[:, 1]), 1e-6)
    forward = ray[:, :2] / level[:, None]
    fall = -ray[:, 2] / level  # descent of the ray per metre forward
    size = np.maximum(np.arccos(np.clip(np.einsum("ni,ni->n", top, bottom), -1, 1)), 1e-4)
    whole = find_inside_picture(ltwh, camera.lens.size)
    less = np.where(whole, 1.0, CUT_TIMES)
    # Seen from above a body looks shorter by the cosine; its distance is longer than that along the ground by the same factor.
    by_size = person_height_m * level**2 / size
    centre = camera.pose.centre
    with np.errstate(divide="ignore", invalid="ignore"):
        by_level = (centre[2] - 0.5 * person_height_m) / fall
        weight_level = np.where(by_level > 0, (fall / (MIDDLE_M * less)) ** 2, 0.0)
    weight_size = 1.0 / (SIZE * less * by_size) ** 2
    reach = (np.where(by_level > 0, by_level, 0.0) * weight_level + by_size * weight_size) / (weight_level + weight_size)
    along = 1.0 / np.sqrt(weight_level + weight_size)
    across = np.hypot(ACROSS_M * np.where(whole, 1.0, 2.0), ACROSS_RAD * reach)
    along = np.hypot(along, across)
    outer = forward[:, :, None] * forward[:, None, :]
    covariance = across[:, None, None] ** 2 * (np.eye(2) - outer) + along[:, None, None] ** 2 * outer
    return centre[:2] + reach[:, None] * forward, covariance, whole


def _velocity(boxes: Boxes, clock: Clock, place: Floats) -> Floats:
    """Compute velocities (N, 2), metres a second, from neighbouring rows of the same identity; NaN where none is usable."""
    order = np.lexsort((boxes.frame, boxes.identity))
    seconds = clock.seconds(boxes.frame[order])
    before = np.maximum(np.arange(len(order)) - 1, 0)
    after = np.minimum(np.arange(len(order)) + 1, len(order) - 1)
    identity = boxes.identity[order]
    own = np.arange(len(order))
    before = np.where((identity[before] == identity) & (seconds - seconds[before] < SPEED_GAP_S), before, own)
    after = np.where((identity[after] == identity) & (seconds[after] - seconds < SPEED_GAP_S), after, own)
    span = seconds[after] - seconds[before]
    with np.errstate(divide="ignore", invalid="ignore"):
        rate = (place[order][after] - place[order][before]) / span[:, None]
        good = (span > 0) & (identity != UNKNOWN) & (np.linalg.norm(rate, axis=1) < FASTEST_M_S)
    velocity = np.full_like(place, np.nan)
    velocity[order[good]] = rate[good]
    return velocity
