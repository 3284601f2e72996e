"""Known lengths, distances and heights as residuals on the unknowns of the person model."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from passerby.common.arrays import Floats, Ints
from passerby.geometry.rotations import log_rotation
from passerby.geometry.triangulation import POSE_SIZE, PointObservations, pose_jacobian, project_near
from passerby.solver.optimizer.least_squares import Cauchy, Layout, Term
from passerby.solver.people_state import AdjustmentState
from passerby.solver.plan_rows import PlanRows

LENGTH = 2
"""Family of the blocks of known lengths: the six coordinates of the two ends (see `person_model.UPRIGHT` and `JOINT`)."""
MARK_LOSS = 3.0
"""Scale in sigmas of the Cauchy loss of a mark of an end, and of one of several measurements of a length: it may be wrong."""


@dataclass(frozen=True, eq=False)
class WorldRows:
    """Knowledge of the world frame of a whole rig, as rows on the motions of its cameras since they were placed in it."""

    R: Floats
    """(C, 3, 3) world to camera, as placed."""
    centre: Floats
    """(C, 3) camera centres, as placed, metres."""
    rows: Floats
    """(K, 6 C) derivatives by centre, then rotation vector in the camera's frame, each row over its standard deviation. The
    first row is that of the scale, where `trunk_m` is known."""
    along_scale: Floats
    """(6 C,) derivative of the logarithm of the scale."""
    trunk_m: tuple[float, float] | None = None
    """Usual length of a trunk and one sigma of it, metres, where segments of bodies give the scale."""
    people: int = 0
    """Number of people whose segments give the scale."""
    scale_off: float = 0.0
    """Logarithm of the scale from segments minus that of the scale as placed; not 0 where a measured length placed it."""
    ground_sd_m: float | None = None
    """One sigma of the ground, where only the heights of bodies give it, metres."""
    segments: tuple[str, ...] = ()
    """Names of the segments that give the scale."""
    upright: tuple[str, ...] = ()
    """Names of the parts of the body that give the up direction, the most frequent first."""
    ground_by: str | None = None
    """Name of the part of the body that gives the ground; None where `ground_sd_m` is None."""

    def moved(self, state: AdjustmentState) -> Floats:
        """Return the motions (6 C,) of the cameras since they were placed: centre, then rotation vector."""
        turned = log_rotation(state.R @ self.R.transpose(0, 2, 1))
        return np.concatenate([state.centre - self.centre, turned], axis=1).ravel()

    def factor(self, state: AdjustmentState) -> float:
        """Return the ratio of the lengths of body segments in a state to their expected lengths."""
        return float(np.exp(self.along_scale @ self.moved(state) - self.scale_off))

    def term(self, state: AdjustmentState, layout: Layout) -> Term:
        """Return the rows as residuals on the shared unknowns."""
        n = len(self.R)
        J = np.zeros((len(self.rows), 1, layout.n_shared))
        columns = (np.arange(n)[:, None] * layout.camera_size + np.array([3, 4, 5, 0, 1, 2])).ravel()
        J[:, 0, columns] = self.rows
        off = self.rows @ self.moved(state)
        if self.trunk_m is not None:
            off[0] -= self.scale_off * self.trunk_m[0] / self.trunk_m[1]
        return Term(off[:, None], by_shared=J)


@dataclass(frozen=True, eq=False)
class CueRows:
    """Scale cues as rows of the problem: marked points, known lengths, distances and heights of cameras."""

    marks: PointObservations | None = None
    """Sightings of the ends of lengths, sorted by camera; the two ends of length i are points 2i and 2i + 1."""
    lengths: Floats = field(default_factory=lambda: np.zeros((0, 2)))
    """(K, 2) length and standard deviation, metres. For an object that is measured n times, the standard deviation is
    multiplied by the root of n: its error is the same each time, and all n together know the scale as well as it is stated."""
    length_cue: Ints = field(default_factory=lambda: np.zeros(0, dtype=np.int64))
    """(K,) number of the cue of each length, from 0, ascending: one object may be measured at many times."""
    distance_between: Ints = field(default_factory=lambda: np.zeros((0, 2), dtype=np.int64))
    distances: Floats = field(default_factory=lambda: np.zeros((0, 2)))
    height_of: Ints = field(default_factory=lambda: np.zeros(0, dtype=np.int64))
    heights: Floats = field(default_factory=lambda: np.zeros((0, 2)))
    names: tuple[str, ...] = ()
    """Name of each cue in reports: lengths, then distances, then heights."""
    plan: PlanRows | None = None
    """A floor plan on which cameras or points were placed."""
    world: WorldRows | None = None
    """Knowledge of the world frame from bodies, if no person is seen whole."""
    longer_m: Floats | None = None
    """(K,) mean increase of each length under a rig due to the noise of its marks, metres; 0 when None."""

    def count_of_cue(self) -> Ints:
        """Return the number of measurements (L,) of each of the L cues about lengths."""
        return np.bincount(self.length_cue)

    @property
    def kinds(self) -> tuple[str, ...]:
        """Kind of each cue except the plan: `length`, `distance` or `camera_height`."""
        counts = {"length": len(self.count_of_cue()), "distance": len(self.distances), "camera_height": len(self.heights)}
        return tuple(kind for kind, count in counts.items() for _ in range(count))

    def terms(self, state: AdjustmentState, layout: Layout) -> list[Term]:
        """Return the cues' residuals with dense Jacobians; there are few of them."""
        out = []
        if len(self.distances):
            a, b = self.distance_between.T
            apart = state.centre[a] - state.centre[b]
            norm = np.linalg.norm(apart, axis=1)
            J = np.zeros((len(a), 1, layout.n_shared))
            for axis in range(3):
                value = apart[:, axis] / norm / self.distances[:, 1]
                J[np.arange(len(a)), 0, a * layout.camera_size + 3 + axis] += value
                J[np.arange(len(a)), 0, b * layout.camera_size + 3 + axis] -= value
            out.append(Term(((norm - self.distances[:, 0]) / self.distances[:, 1])[:, None], by_shared=J))
        if len(self.heights):
            J = np.zeros((len(self.heights), 1, layout.n_shared))
            J[np.arange(len(self.heights)), 0, self.height_of * layout.camera_size + 5] = 1 / self.heights[:, 1]
            residual = (state.centre[self.height_of, 2] - self.heights[:, 0]) / self.heights[:, 1]
            out.append(Term(residual[:, None], by_shared=J))
        if self.world is not None and len(self.world.rows):
            out.append(self.world.term(state, layout))
        if self.plan is not None:
            out += self.plan.terms(state, layout)
        if self.marks is not None and len(self.lengths):
            out += self._length_terms(state, layout)
        return out

    def _length_terms(self, state: AdjustmentState, layout: Layout) -> list[Term]:
        assert self.marks is not None
        o, points = self.marks, state.lengths.reshape(-1, 3)
        R = state.R[o.camera]
        d = (R @ (points[o.point] - state.centre[o.camera])[:, :, None])[:, :, 0]
        residual, by_d = project_near(o.bearing, o.tangent, d)
        by_pose, by_point = pose_jacobian(by_d / o.sigma_px[:, None, None], d, R)
        rows, n = np.arange(len(d)), len(self.lengths)
        by_camera = np.zeros((len(d), 2, layout.camera_size))
        by_camera[:, :, :POSE_SIZE] = by_pose
        if o.by_lens is not None and o.lens_at is not None:
            residual = residual + (o.by_lens @ (state.lens[o.camera] - o.lens_at)[:, :, None])[:, :, 0]
            by_camera[:, :, layout.camera_size - o.by_lens.shape[2] :] = o.by_lens / o.sigma_px[:, None, None]
        by_ends = np.zeros((len(d), 2, 2, 3))
        by_ends[rows, :, o.point % 2] = by_point
        residual = residual / o.sigma_px[:, None]
        # One term for each end: a camera sees both ends of a length, but may occur only once per block in a term.
        terms = [
            Term(residual[own], Cauchy(MARK_LOSS), camera=o.camera[own], by_camera=by_camera[own], family=LENGTH,
                 block=o.point[own] // 2, by_block=by_ends[own].reshape(-1, 2, 6))
            for own in (o.point % 2 == 0, o.point % 2 == 1)
        ]  # fmt: skip
        apart = points[0::2] - points[1::2]
        norm = np.maximum(np.linalg.norm(apart, axis=1, keepdims=True), 1e-9)
        longer = 0.0 if self.longer_m is None else self.longer_m[:, None]
        off = (norm - self.lengths[:, :1] - longer) / self.lengths[:, 1:]
        by_block = np.concatenate([apart, -apart], axis=1)[:, None] / (norm * self.lengths[:, 1:])[:, :, None]
        several = self.count_of_cue()[self.length_cue] > 1
        for own, loss in ((~several, None), (several, Cauchy(MARK_LOSS))):
            if own.any():
                block = np.arange(n)[own]
                terms.append(Term(off[own], loss, family=LENGTH, block=block, by_block=by_block[own]))
        return terms
