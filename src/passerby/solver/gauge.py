"""Which directions of the cameras' unknowns no evidence constrains: the rank of the gauge.

The world may be turned about the vertical and moved along the ground: that is a choice, not a lack. All else has to be fixed
by something that was seen or stated. Joints alone determine the relative poses of the cameras, but neither the scale, nor the
vertical, nor the height of the ground; a camera that shares nothing with the others is free to go anywhere.

A direction that nothing constrains is a null vector of the reduced normal matrix once the placement is held. The null vectors
are split into motions of single cameras and motions of all others together, which are similarities.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from passerby.common.arrays import Floats, Ints
from passerby.common.symmetric import null_vectors, pseudo_inverse
from passerby.solver.people_state import AdjustmentState

NULL_SHARE = 1e-10
"""Eigenvalues of the scaled normal matrix below this share of the largest one are zero.

The reduction adds 1e-14 of its diagonal to each block, and rounds by as much. Rays that meet at a few degrees make blocks of a
condition of 100 to 1000 and raise both: null vectors came out at 1e-16 to 3e-13 in 23 simulated scenes without ankles, knees or
heads (2 and 4 cameras, 3 presets, lenses and clocks refined or not). What evidence fixes came out at 5e-8 or more in 23 scenes
with a sound vertical (boxes, joints, one person, ankles in 3 instants only), at 4e-10 to 2e-8 in scenes without ankles whose
world hung on the heights of cameras and was doubtful anyhow. Between lay lengths stated to half of themselves or worse, which
leave a scale that is known to no better than a factor of six.
"""

NULL_SHARE_CAMERAS, LEAST_NULL_SHARE = 50, 1e-12
"""Cameras up to which `NULL_SHARE` holds, and what it falls to with the third power of their number.

What moves all cameras of a long rig as one moves each of them far, in units of its own sigmas: along corridors of 20, 75, 150
and 300 cameras the smallest eigenvalue, that of the scale, came out at a share of 5.8e-8, 1.5e-9, 1.8e-10 and 2.3e-11, and at
1.3e-14 to 1.8e-14 where people's heights did not fix it (`benchmarks/sites/corridors.py`, seed 804).
"""

MOVED = 1e-3
"""A unit null vector whose part is below this does not move that part: rounding leaves 1e-4 at an eigenvalue next to
`NULL_SHARE`, 1e-8 ordinarily."""

VAGUE = 1.0
"""A scale (relative) or a vertical (radians) with a larger sigma is not known: beyond, the linearisation says nothing."""

X, Y, Z, TILT_X, TILT_Y, YAW, SCALE = range(7)


@dataclass(frozen=True)
class Free:
    """What no evidence constrains."""

    scale: bool = False
    vertical: bool = False
    ground: bool = False
    """How high the ground lies."""
    cameras: tuple[int, ...] = ()
    """Cameras whose pose among the others nothing fixes."""

    def __bool__(self) -> bool:
        return self.scale or self.vertical or self.ground or bool(self.cameras)

    def position(self, camera: int) -> bool:
        """Whether a camera's position in the metric world is unknown."""
        return self.scale or self.vertical or self.ground or camera in self.cameras

    def orientation(self, camera: int) -> bool:
        """Whether a camera's orientation in the metric world is unknown."""
        return self.vertical or camera in self.cameras


@dataclass(frozen=True, eq=False)
class Freedoms:
    """The seven freedoms of a similarity: along x, y, z, about x, y, z, and the logarithm of the scale."""

    moves: Floats
    """(6 C, 7) how each moves the cameras: centre, then rotation vector in the camera's frame."""
    parts: Floats
    """(6 C, 7) the unknowns that fix each: centres for place and scale, rotations for turns (the chordal mean)."""

    @property
    def along(self) -> Floats:
        """(7, 6 C) how far a motion of the cameras goes along each freedom."""
        return np.asarray(np.linalg.inv(self.parts.T @ self.moves) @ self.parts.T)


def similarity_moves(R: Floats, centre: Floats, about: Floats) -> Floats:
    """(C, 6, 7) how each freedom of a similarity moves cameras: centre, then rotation vector in the camera's frame.

    Args:
        R: (C, 3, 3) world to camera.
        centre: (C, 3) metres.
        about: (3,) what is turned and scaled about.
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
    """The freedoms about the mean of the centres of the cameras `fixed` (all when None), which alone tell how far each goes."""
    n_cameras = len(state.R)
    fixed = np.arange(n_cameras) if fixed is None else fixed
    moves = similarity_moves(state.R, state.centre, state.centre[fixed].mean(axis=0))
    parts = moves.copy()
    parts[:, 3:, :3] = parts[:, 3:, SCALE:] = 0.0
    parts[:, :3, TILT_X:SCALE] = 0.0
    parts[np.setdiff1d(np.arange(n_cameras), fixed)] = 0.0
    return Freedoms(moves.reshape(-1, 7), parts.reshape(-1, 7))


def placement_freedoms(state: AdjustmentState, n: int, camera_size: int) -> Floats:
    """(n, 3) directions of the shared unknowns that no residual notices: along x, along y, about z."""
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
    """The reduced normal matrix H of the shared unknowns, its placement held by the centres of some cameras."""

    matrix: Floats
    """(n, n), each unknown in units of its own sigma given all others: `scale`."""
    scale: Floats
    """(n,) units of the unknowns."""
    constraint: Floats
    """(n, 3) what holds the placement."""
    own: Ints
    """(6 C,) the unknowns of the poses, camera by camera: centre, then rotation vector."""
    fixed: Ints
    """The cameras that hold the placement."""

    @property
    def null_share(self) -> float:
        """Eigenvalues of the matrix below this share of the largest one are zero."""
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
        """(n, n) the inverse in the unknowns' own units; along null vectors, where the variance is infinite, 0."""
        return pseudo_inverse(self.matrix, self.null_share) * self.scale[:, None] * self.scale

    def null_vectors(self) -> Floats:
        """(n, k) orthonormal, in units of `scale`: what no evidence constrains."""
        return null_vectors(self.matrix, self.null_share)


def held_system(H: Floats, state: AdjustmentState, camera_size: int) -> tuple[HeldSystem, Free]:
    """The normal matrix (n, n) of the shared unknowns with its placement held by cameras that evidence ties together, and what
    it leaves free.
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
        if len(fixed) == 2:  # not even these two are tied together
            return HeldSystem.of(H, placement, n, camera_size, np.arange(n)), Free(True, True, True, tuple(range(n)))
        fixed = np.delete(fixed, loose)
    apart = tuple(int(c) for c in np.setdiff1d(np.arange(n), fixed))
    return system, _similarities(system, null, similarity_freedoms(state, fixed), _extent(state, fixed), apart)


def _extent(state: AdjustmentState, fixed: Ints) -> float:
    """Metres from the middle of the cameras to the farthest one, at least a centimetre."""
    centre = state.centre[fixed]
    return max(float(np.max(np.linalg.norm(centre - centre.mean(axis=0), axis=1))), 0.01)


def _rows(fixed: Ints) -> Ints:
    """The rows of cameras among those of all poses."""
    return np.asarray((fixed[:, None] * 6 + np.arange(6)).ravel())


def _loosest(system: HeldSystem, null: Floats, freedoms: Freedoms, extent: float) -> int | None:
    """Which of the cameras `system.fixed` null vectors move most against the others; None where they move all as one."""
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
    """Which freedoms of a similarity the null vectors have a part in."""
    rows = _rows(system.fixed)
    _, size, mix = np.linalg.svd(null[system.own][rows], full_matrices=False)
    mix = mix[size > MOVED]
    if not len(mix):
        return Free(cameras=apart)
    along = freedoms.along @ (null[system.own] * system.scale[system.own, None]) @ mix.T
    along[[X, Y, Z]] /= extent
    # The choice of the placement follows: it says nothing of what is free.
    basis, size, _ = np.linalg.svd(along[[Z, TILT_X, TILT_Y, SCALE]], full_matrices=False)
    part = np.linalg.norm(basis[:, size > 1e-9 * size[0]], axis=1) > MOVED
    return Free(bool(part[3]), bool(part[1] or part[2]), bool(part[0]), apart)
