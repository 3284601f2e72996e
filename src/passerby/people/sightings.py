"""The table of sightings: people seen by cameras, as rays to the ends of their bodies. All modules on people use it."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from passerby.common.arrays import UNFILLED, Bools, Columns, Floats, Ints
from passerby.core.cameras import Camera, Lens, Rig
from passerby.core.observations import UNKNOWN, CameraObservations, Clock, Observations, find_inside_picture
from passerby.people.model import HEIGHT_PER_CENTRE, Noise
from passerby.people.segments import upright_segments

CUT_TIMES = 10.0
"""Factor on the sigmas of a box that the picture's border cuts off: a part of the body is missing from it."""
NOISE = Noise(floor_px=0.7)
"""Noise of a body's middle and of its size in `gather_sightings`: the solver's own noise."""
EVERY_S = 0.4
"""Least time between time steps, seconds; others are left out. Errors of a body's box are alike for seconds, so that more time
steps would add little information."""


@dataclass(frozen=True, eq=False)
class Sightings(Columns):
    """N sightings: one person seen by one camera at one time step each.

    A *block* is one person at one time step: its rows, by several cameras, show one body. Rays are unit vectors in the frame of
    the camera, and after `in_world` in the frame of the world. Each function that makes a table fills the first three columns
    and those that its callers need; all others are None. Pixels are those of the camera's picture, lengths are metres, angles
    radians.
    """

    camera: Ints
    """(N,) number of the camera in its rig, or row of `names`."""
    step: Ints
    """(N,) time step common to all cameras, or the camera's own frame number."""
    identity: Ints
    """(N,) person, or tracklet of this camera; -1 where unknown."""
    block: Ints = UNFILLED
    """(N,) number of the block, from 0; ascending where blocks are read (`n_blocks`, `block_identity`, `block_seconds`)."""
    seconds: Floats = UNFILLED
    """(N,) time by the clock that `step` belongs to."""
    row: Ints = UNFILLED
    """(N,) row among the camera's boxes or, where `has_foot` is 0, among its sets of joints."""
    ltwh: Floats = UNFILLED
    """(N, 4) left, top, width, height of the box, pixels."""
    top: Floats = UNFILLED
    """(N, 3) ray to the highest point; NaN where the lens gives none."""
    bottom: Floats = UNFILLED
    """(N, 3) ray to the lowest point."""
    middle: Floats = UNFILLED
    """(N, 3) ray to the point halfway between both."""
    top_tangent: Floats = UNFILLED
    """(N, 2, 3) tangents of the highest point, from `Lens.tangents`."""
    bottom_tangent: Floats = UNFILLED
    """(N, 2, 3) the same of the lowest point."""
    middle_tangent: Floats = UNFILLED
    """(N, 2, 3) the same of the middle."""
    top_fraction: Floats = UNFILLED
    """(N,) height of the highest point on the body, as a share of the body's height: 1 for a box."""
    bottom_fraction: Floats = UNFILLED
    """(N,) the same of the lowest point: 0 for a box."""
    has_foot: Floats = UNFILLED
    """(N,) 1 for a box: its lowest point is the visible foot, nearer to the camera than the body's axis. 0 for joints."""
    extent_px: Floats = UNFILLED
    """(N,) distance of highest and lowest point in the picture, pixels."""
    size: Floats = UNFILLED
    """(N,) angle between the rays of both, radians."""
    middle_sd_px: Floats = UNFILLED
    """(N,) one sigma of the middle in each direction, pixels."""
    centre_sd: Floats = UNFILLED
    """(N,) the same as an angle, radians."""
    size_sd: Floats = UNFILLED
    """(N,) one sigma of `size`, radians."""
    origin: Floats = UNFILLED
    """(N, 3) origin of the rays, metres, world: the camera's centre. Where it is filled, the rays are in the world's frame."""
    velocity: Floats | None = None
    """(N, 2) velocity of the middle in the picture, pixels a second; None where clocks are taken to be right."""
    pixels: Floats | None = None
    """(N, 2, 2) pixels of highest and lowest point; this, `lens_at` and `by_lens` are None where lenses are not refined."""
    lens_at: Floats | None = None
    """(N, L) the camera's lens, as `AdjustmentState.lens`, that the rays were made with."""
    by_lens: Floats | None = None
    """(N, 2, 2, L) derivatives of the two points' pixels by the lens."""
    names: tuple[str, ...] = ()
    """The C cameras that `camera` numbers, where a table is of other cameras than its rig."""

    def __len__(self) -> int:
        return len(self.camera)

    @property
    def known(self) -> Bools:
        """(N,) whether the lens gives both rays."""
        return np.asarray(np.isfinite(self.size))

    @property
    def from_joints(self) -> Bools:
        """(N,) whether each sighting is of joints, which end at the ankles, not of a box, which ends at the nearer foot."""
        return np.asarray(self.has_foot == 0)

    @property
    def middle_fraction(self) -> Floats:
        """(N,) height of the middle on the body, as a share of the body's height."""
        return 0.5 * (self.top_fraction + self.bottom_fraction)

    @cached_property
    def block_rows(self) -> Ints:
        """(G,) first row of each block."""
        return np.flatnonzero(np.diff(self.block, prepend=-1))

    @property
    def n_blocks(self) -> int:
        """Number of blocks, G."""
        return len(self.block_rows)

    @property
    def block_identity(self) -> Ints:
        """(G,) person of each block."""
        return self.identity[self.block_rows]

    @property
    def block_seconds(self) -> Floats:
        """(G,) time of each block."""
        return self.seconds[self.block_rows]

    def numbered(self, rows: Ints) -> Sightings:
        """Return some rows (in order), with their blocks renumbered."""
        return replace(self.take(rows), block=np.unique(self.block[rows], return_inverse=True)[1].ravel())

    def of_blocks(self, wanted: Bools) -> Sightings:
        """Return the sightings of the blocks marked in `wanted` (G,), with the blocks renumbered."""
        return self.numbered(np.flatnonzero(wanted[self.block]))

    def between(self, from_s: float, until_s: float) -> Sightings:
        """Return the sightings at times in [from, until), with the blocks renumbered."""
        return self.numbered(np.flatnonzero((self.seconds >= from_s) & (self.seconds < until_s)))

    def without(self, cameras: Bools) -> Sightings:
        """Return the sightings by all cameras except those marked (C,), with the blocks renumbered."""
        return self.numbered(np.flatnonzero(~cameras[self.camera]))

    def of_cameras(self, names: tuple[str, ...], rows: Ints) -> Sightings:
        """Return some rows (in order), all of them by the named cameras. The result has these cameras only."""
        number = np.full(len(self.names), UNKNOWN)
        number[[self.names.index(name) for name in names]] = np.arange(len(names))
        part = self.numbered(rows)
        return replace(part, names=names, camera=number[part.camera])

    def in_world(self, rotation: Floats, centre: Floats) -> Sightings:
        """Return the same sightings with the rays of both ends in the world's frame.

        Args:
            rotation: (C, 3, 3) world to camera.
            centre: (C, 3) of the cameras, metres, world.
        """
        to_world = rotation[self.camera].transpose(0, 2, 1)
        top, bottom = ((to_world @ ray[:, :, None])[:, :, 0] for ray in (self.top, self.bottom))
        return replace(self, top=top, bottom=bottom, origin=centre[self.camera])


def upright_sightings(seen: CameraObservations, lens: Lens, clock: Clock, lean: float = 0.0) -> Sightings:
    """Return the people of one camera whose top and bottom are both in the picture, in the order of their frames.

    Where boxes and joints show the same person at the same frame, the box is taken.

    Args:
        seen: boxes and joints; identities are tracklet numbers of this camera or -1.
        lens: the camera's lens.
        clock: from frames to seconds.
        lean: lean of people in their boxes, radians clockwise from the image's vertical.
    """
    ends = upright_segments(seen, lens, lean)
    top, bottom = lens.bearings(ends.top), lens.bearings(ends.bottom)
    found = Sightings(
        np.zeros(len(top), np.int64), ends.frame, ends.identity, seconds=clock.seconds(ends.frame), row=ends.row, top=top,
        bottom=bottom, top_tangent=lens.tangents(top), extent_px=np.linalg.norm(ends.bottom - ends.top, axis=1),
        top_fraction=ends.top_fraction, bottom_fraction=ends.bottom_fraction, has_foot=ends.has_foot,
    )  # fmt: skip
    found = found.take(np.isfinite(np.concatenate([top, bottom], axis=1)).all(axis=1))
    return found.take(np.argsort(found.step, kind="stable"))


def box_sightings(
    camera: Camera, number: int, step: Ints, identity: Ints, ltwh: Floats, noise: Noise | None = None
) -> Sightings:
    """Return the boxes of a camera with a pose, cut ones included, in their order, as rays in the world's frame.

    Args:
        camera: camera with a pose.
        number: its number, for the column `camera`.
        step: (N,) time steps.
        identity: (N,) people.
        ltwh: (N, 4) pixels.
        noise: noise of the boxes; `Noise()` where None.
    """
    noise = noise or Noise()
    assert camera.pose is not None
    x, y, w, h = ltwh.T
    n, middle = len(x), x + w / 2
    top = camera.lens.bearings(np.column_stack([middle, y])) @ camera.pose.R_cw
    bottom = camera.lens.bearings(np.column_stack([middle, y + h])) @ camera.pose.R_cw
    size = angle_between(top, bottom)
    floor = size * noise.floor_px / h
    less = np.where(find_inside_picture(ltwh, camera.lens.size), 1.0, CUT_TIMES)
    return Sightings(
        np.full(n, number), step, identity, top=top, bottom=bottom, top_fraction=np.ones(n), bottom_fraction=np.zeros(n),
        has_foot=np.ones(n), size=size, centre_sd=less * np.hypot(floor, noise.centre * size),
        size_sd=less * np.hypot(floor, noise.height * size), origin=np.tile(camera.pose.centre, (n, 1)),
    )  # fmt: skip


def gather_sightings(rig: Rig, observations: Observations, *, every_s: float = EVERY_S, fps: float = 1.0) -> Sightings:
    """Gather the sightings by the cameras with poses (`names`), block after block, with rays in the cameras' frames.

    Args:
        rig: lenses; cameras without a pose are left out.
        observations: people with identities over all cameras, at common time steps; bodies that the border cuts are left out.
        every_s: least time between time steps, seconds; others are left out.
        fps: frame rate of the frame numbers, where the observations do not state it.
    """
    posed = rig.posed()
    clock = next(iter(observations.clocks.values()), None) or Clock(observations.fps or fps)
    kept = _kept_frames(observations, posed.names, clock.fps, every_s)
    parts = [_no_sightings()]
    for number, camera in enumerate(posed):
        if camera.name not in observations.cameras:
            continue
        seen = upright_sightings(_at(observations[camera.name], kept), camera.lens, clock)
        seen = seen.take(seen.identity != UNKNOWN)
        size = angle_between(seen.top, seen.bottom)
        whole = size / np.maximum(seen.top_fraction - seen.bottom_fraction, 0.2)
        floor = size * NOISE.floor_px / seen.extent_px
        parts.append(
            Sightings(
                np.full(len(seen), number), seen.step, seen.identity, seconds=seen.seconds, top=seen.top, bottom=seen.bottom,
                top_fraction=seen.top_fraction, bottom_fraction=seen.bottom_fraction, has_foot=seen.has_foot, size=size,
                centre_sd=np.hypot(floor, NOISE.centre * whole),
                size_sd=np.hypot(HEIGHT_PER_CENTRE * floor, NOISE.height * whole),
            )
        )  # fmt: skip
    joined = Sightings.joined(parts)
    block = np.unique(np.column_stack([joined.step, joined.identity]), axis=0, return_inverse=True)[1].ravel()
    return replace(joined, block=block, names=posed.names).take(np.argsort(block, kind="stable"))


def angle_between(top: Floats, bottom: Floats) -> Floats:
    """Return the angles (N,) between unit vectors (N, 3) and (N, 3), radians, at least 2e-5."""
    return np.asarray(2 * np.arcsin(np.clip(np.linalg.norm(top - bottom, axis=1) / 2, 1e-5, 1.0)))


def poses_of(rig: Rig, names: tuple[str, ...]) -> tuple[Floats, Floats]:
    """Return the rotations (C, 3, 3), world to camera, and the centres (C, 3) of the named cameras."""
    poses = [rig[name].pose for name in names]
    assert all(pose is not None for pose in poses)
    rotation = np.array([pose.R_cw for pose in poses if pose is not None]).reshape(-1, 3, 3)
    return rotation, np.array([pose.centre for pose in poses if pose is not None]).reshape(-1, 3)


def _kept_frames(observations: Observations, names: tuple[str, ...], fps: float, every_s: float) -> Ints:
    """Return the frames to use, ascending: none sooner than `every_s` after the frame before."""
    seen = [observations[name] for name in names if name in observations.cameras]
    frames = np.unique(np.concatenate([np.zeros(0, np.int64), *(p.frame for s in seen for p in (s.boxes, s.keypoints))]))
    step = max(1, int(np.ceil(every_s * fps - 1e-9)))
    return frames if step == 1 else frames[frames % step == frames[:1] % step]


def _at(seen: CameraObservations, frames: Ints) -> CameraObservations:
    """Return the boxes and joints in some frames."""
    boxes, joints = seen.boxes, seen.keypoints
    return CameraObservations(boxes.take(np.isin(boxes.frame, frames)), joints.take(np.isin(joints.frame, frames)))


def _no_sightings() -> Sightings:
    none, whole, rays = np.zeros(0), np.zeros(0, np.int64), np.zeros((0, 3))
    return Sightings(
        whole, whole, whole, seconds=none, top=rays, bottom=rays, top_fraction=none, bottom_fraction=none, has_foot=none,
        size=none, centre_sd=none, size_sd=none,
    )  # fmt: skip
