"""Directions of the cameras' unknowns that no evidence constrains: the rank of the gauge.

The world may be turned about the vertical and moved along the ground: this placement is a choice. All else must be determined
by observations or stated values. Joints alone determine the relative poses of the cameras, but neither the scale, nor the
vertical, nor the height of the ground. A camera that shares nothing with the others is completely free.

When the placement is held, an unconstrained direction is a null vector of the reduced normal matrix. The null vectors are
split into motions of single cameras and common motions of all others, which are similarities.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from passerby.common.arrays import Floats, Ints
from passerby.common.symmetric import null_vectors, pseudo_inverse
from passerby.solver.people_state import AdjustmentState

NULL_SHARE = 1e-10
"""Eigenvalues of the scaled normal matrix below this share of the largest one are zero.

The reduction adds 1e-14 of its diagonal to each block, and rounds by as much. Rays that meet at a few degrees give blocks with
a condition of 100 to 1000, which enlarges both. Null vectors had eigenvalues of 1e-16 to 3e-13 in 23 simulated scenes without
ankles, knees or heads (2 and 4 cameras, 3 presets, lenses and clocks refined or not). Constrained directions had 5e-8 or more
in 23 scenes with a sound vertical (boxes, joints, one person, ankles in 3 instants only), and 4e-10 to 2e-8 in scenes without
ankles whose world depended on the heights of cameras and was doubtful in any case. Between these are lengths stated with a
sigma of half their value or more, which determine the scale no better than by a factor of six.
"""

NULL_SHARE_CAMERAS, LEAST_NULL_SHARE = 50, 1e-12
"""Number of cameras up to which `NULL_SHARE` holds, and lower limit of the share, which falls with the third power of their
number.

A common motion of all cameras of a long rig moves each of them far, in units of its own sigmas. Along corridors of 20, 75, 150
and 300 cameras, the smallest eigenvalue, that of the scale, was at a share of 5.8e-8, 1.5e-9, 1.8e-10 and 2.3e-11, and at
1.3e-14 to 1.8e-14 where people's heights did not determine it (`benchmarks/sites/corridors.py`, seed 804).
"""

MOVED = 1e-3
"""Smallest part of a unit null vector that counts as a motion: rounding leaves 1e-4 at an eigenvalue next to `NULL_SHARE`, and
usually 1e-8."""

VAGUE = 1.0
"""A scale (relative) or a vertical (radians) with a larger sigma counts as unknown: the linearisation is not valid there."""

X, Y, Z, TILT_X, TILT_Y, YAW, SCALE = range(7)


@dataclass(frozen=True)
class Free:
    """Parts of the solution that no evidence constrains."""

    scale: bool = False
    vertical: bool = False
    ground: bool = False
    """The height of the ground."""
    cameras: tuple[int, ...] = ()
    """Cameras whose pose relative to the others is not constrained."""

    def __bool__(self) -> bool:
        return self.scale or self.vertical or self.ground or bool(self.cameras)

    def position(self, camera: int) -> bool:
        """Return whether a camera's position in the metric world is unknown."""
        return self.scale or self.vertical or self.ground or camera in self.cameras

    def orientation(self, camera: int) -> bool:
        """Return whether a camera's orientation in the metric world is unknown."""
        return self.vertical or camera in self.cameras


@dataclass(frozen=True, eq=False)
class Freedoms:
    """The seven freedoms of a similarity: along x, y, z, about x, y, z, and the logarithm of the scale."""

    moves: Floats
    """(6 C, 7) motion of the cameras for each freedom: centre, then rotation vector in the camera's frame."""
    parts: Floats
    """(6 C, 7) the unknowns that determine each: centres for place and scale, rotations for turns (the chordal mean)."""

    @property
    def along(self) -> Floats:
        """(7, 6 C) maps a motion of the cameras to its amount along each freedom."""
        return np.asarray(np.linalg.inv(self.parts.T @ self.moves) @ self.parts.T)


def similarity_moves(R: Floats, centre: Floats, about: Floats) -> Floats:
    """Return the motion (C, 6, 7) of cameras for each freedom of a similarity: centre, then rotation vector in its frame.

    Args:
        R: (C, 3, 3) world to camera.
        centre: (C, 3) metres.
        about: (3,) fixed point of the turns and the scale, metres.
    """
    spread = centre - about
    moves = np.zeros((len(R), 6, 7))
    moves[:, :3, :3] = np.eye(3)
    for axis in range(3):
        turn = np.eye(3)[axis]
        moves[:, :3, TILT_X + axis] = np.cross(turn, spread)
        moves[:, 3:, TILT_X + axis] = -R @ turn
    moves[:, :3, SCALE] = spread
    return moves


def similarity_freedoms(state: AdjustmentState, fixed: Ints | None = None) -> Freedoms:
    """Return the freedoms about the mean centre of the cameras `fixed` (all when None); these alone give the amounts."""
    n_cameras = len(state.R)
    fixed = np.arange(n_cameras) if fixed is None else fixed
    moves = similarity_moves(state.R, state.centre, state.centre[fixed].mean(axis=0))
    parts = moves.copy()
    parts[:, 3:, :3] = parts[:, 3:, SCALE:] = 0.0
    parts[:, :3, TILT_X:SCALE] = 0.0
    parts[np.setdiff1d(np.arange(n_cameras), fixed)] = 0.0
    return Freedoms(moves.reshape(-1, 7), parts.reshape(-1, 7))


def placement_freedoms(state: AdjustmentState, n: int, camera_size: int) -> Floats:
    """Return the directions (n, 3) of the shared unknowns that change no residual: along x, along y, about z."""
    out = np.zeros((n, 3))
    up = np.array([0.0, 0.0, 1.0])
    for c in range(len(state.R)):
        first = c * camera_size
        out[first + 3, 0] = out[first + 4, 1] = 1.0
        # A turn of the world about z by w moves a centre by w z x C, and turns the camera by -R z w in its own frame.
        out[first : first + 3, 2] = -state.R[c] @ up
        out[first + 3 : first + 6, 2] = np.cross(up, state.centre[c])
    return out


@dataclass(frozen=True, eq=False)
class HeldSystem:
    """The reduced normal matrix H of the shared unknowns, with its placement held by the centres of some cameras."""

    matrix: Floats
    """(n, n), with each unknown in units (`scale`) of its own sigma given all others."""
    scale: Floats
    """(n,) units of the unknowns."""
    constraint: Floats
    """(n, 3) rows that hold the placement."""
    own: Ints
    """(6 C,) indices of the unknowns of the poses, camera by camera: centre, then rotation vector."""
    fixed: Ints
    """The cameras that hold the placement."""

    @property
    def null_share(self) -> float:
        """Share of the largest eigenvalue of the matrix below which eigenvalues count as zero."""
        cameras = len(self.own) // 6
        return max(NULL_SHARE * min(1.0, (NULL_SHARE_CAMERAS / cameras) ** 3), LEAST_NULL_SHARE)

    @classmethod
    def of(cls, H: Floats, placement: Floats, n_cameras: int, camera_size: int, fixed: Ints) -> HeldSystem:
        """Hold the `placement` (n, 3) freedoms by the centres of the cameras `fixed`."""
        diagonal = np.diag(H)
        scale = 1.0 / np.sqrt(np.where(diagonal > 1e-12, diagonal, 1.0))
        on_centres = np.zeros_like(placement)
        for c in fixed:
            rows = slice(c * camera_size + 3, c * camera_size + 6)
            on_centres[rows] = placement[rows]
        B = on_centres / np.linalg.norm(on_centres * scale[:, None], axis=0)
        matrix = H * scale[:, None] * scale + (B * scale[:, None]) @ (B * scale[:, None]).T
        own = (np.arange(n_cameras)[:, None] * camera_size + np.array([3, 4, 5, 0, 1, 2])).ravel()
        return cls(matrix, scale, B, own, fixed)

    def inverse(self) -> Floats:
        """Return the inverse (n, n) in the unknowns' own units; along null vectors it is 0, the true variance is infinite."""
        return pseudo_inverse(self.matrix, self.null_share) * self.scale[:, None] * self.scale

    def null_vectors(self) -> Floats:
        """Return the directions (n, k) that no evidence constrains, orthonormal, in units of `scale`."""
        return null_vectors(self.matrix, self.null_share)


def held_system(H: Floats, state: AdjustmentState, camera_size: int) -> tuple[HeldSystem, Free]:
    """Return the normal matrix (n, n) of the shared unknowns, with the placement held by cameras that evidence connects, and
    the parts of the solution that stay free.
    """
    n = len(state.R)
    placement = placement_freedoms(state, len(H), camera_size)
    fixed = np.arange(n)
    while True:
        system = HeldSystem.of(H, placement, n, camera_size, fixed)
        null = system.null_vectors()
        if not null.shape[1]:
            break
        loose = _loosest(system, null, similarity_freedoms(state, fixed), _extent(state, fixed))
        if loose is None:
            break
        if len(fixed) == 2:  # evidence does not connect even these two
            return HeldSystem.of(H, placement, n, camera_size, np.arange(n)), Free(True, True, True, tuple(range(n)))
        fixed = np.delete(fixed, loose)
    apart = tuple(int(c) for c in np.setdiff1d(np.arange(n), fixed))
    return system, _similarities(system, null, similarity_freedoms(state, fixed), _extent(state, fixed), apart)


def _extent(state: AdjustmentState, fixed: Ints) -> float:
    """Return the distance from the middle of the cameras to the farthest one, metres, at least a centimetre."""
    centre = state.centre[fixed]
    return max(float(np.max(np.linalg.norm(centre - centre.mean(axis=0), axis=1))), 0.01)


def _rows(fixed: Ints) -> Ints:
    """Return the rows of some cameras among those of all poses."""
    return np.asarray((fixed[:, None] * 6 + np.arange(6)).ravel())


def _loosest(system: HeldSystem, null: Floats, freedoms: Freedoms, extent: float) -> int | None:
    """Return the place in `system.fixed` of the camera that null vectors move most relative to the others.

    None where they move all cameras together.
    """
    rows, units = _rows(system.fixed), system.scale[system.own]
    moved = null[system.own] * units[:, None]
    against = (moved - freedoms.moves @ (freedoms.along @ moved))[rows]
    _, size, mix = np.linalg.svd(against / units[rows, None], full_matrices=False)
    mix = mix[size > MOVED]
    if not len(mix):
        return None
    physical = np.tile(np.repeat([1.0 / extent, 1.0], 3), len(system.fixed))
    basis = np.linalg.svd((against @ mix.T) * physical[:, None], full_matrices=False)[0]
    share = np.round((basis**2).sum(axis=1).reshape(-1, 6).sum(axis=1), 6)
    return int(len(share) - 1 - np.argmax(share[::-1]))  # the last one of several


def _similarities(system: HeldSystem, null: Floats, freedoms: Freedoms, extent: float, apart: tuple[int, ...]) -> Free:
    """Return which freedoms of a similarity the null vectors contain."""
    rows = _rows(system.fixed)
    _, size, mix = np.linalg.svd(null[system.own][rows], full_matrices=False)
    mix = mix[size > MOVED]
    if not len(mix):
        return Free(cameras=apart)
    along = freedoms.along @ (null[system.own] * system.scale[system.own, None]) @ mix.T
    along[[X, Y, Z]] /= extent
    # Motions of the placement (x, y, yaw) only accompany the others: they do not show which parts are free.
    basis, size, _ = np.linalg.svd(along[[Z, TILT_X, TILT_Y, SCALE]], full_matrices=False)
    part = np.linalg.norm(basis[:, size > 1e-9 * size[0]], axis=1) > MOVED
    return Free(bool(part[3]), bool(part[1] or part[2]), bool(part[0]), apart)
