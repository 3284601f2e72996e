"""The person model: upright people on a ground plane, seen by cameras, as a least-squares problem.

World: z up, ground z = 0. The unknowns are: the cameras' poses; for each camera one slack factor (the ratio of its boxes'
heights to the people's), and errors of its clock and its lens where these are refined; the foot shift (the distance by which
the lowest visible point of a body is nearer to the camera than the body's axis); each person's height; for each person and
instant a ground position (x, y), the height of the lowest and of the highest point; and 3D joints.

A box enters by two residuals with different weights, since a detector's slack and the model's bias move the two edges in
opposite directions: its *centre* with a small sigma, and its *height* with a large one. The heights determine vertical, ground
and scale, the centres the shape of the rig.

The fits with held cameras use the equations of `people.upright_body.linearise_bodies`. The residuals here share only the
ends of the body with them: these are in pixels and depend on the camera's lens, clock and slack, for which equations in angles
have no columns.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from passerby.common.arrays import Floats, Ints
from passerby.geometry.triangulation import POSE_SIZE, PointObservations, pose_jacobian, project_near, retract_poses
from passerby.people.model import GAIT_SHARE, HEIGHT_PER_CENTRE, Noise, Priors
from passerby.people.sightings import Sightings
from passerby.people.upright_body import HIGH, LOW, body_ends, by_low_and_high
from passerby.solver.cue_terms import LENGTH, CueRows
from passerby.solver.lens_unknowns import LensModel
from passerby.solver.optimizer.least_squares import Cauchy, Family, Layout, Step, Term
from passerby.solver.people_state import AdjustmentState

CAMERA_SIZE = POSE_SIZE + 1
SLACK = POSE_SIZE
# Index of a camera's time offset where clocks are refined. The unknowns of the lens, where it is refined, come last.
TIME = POSE_SIZE + 1
UPRIGHT, JOINT = 0, 1
FOOT_SHIFT = 0


# Wide prior (mean and sigma) of the visible length of a person who is not upright, as a share of the standing height.
CROUCHED, CROUCHED_SD = 0.75, 0.3


UNIT_FOCAL, UNIT_DISTORTION = 1e-3, 2e-3
"""Sigma between cameras of one model: of the focal length, as a share, and of the first distortion coefficient."""

# Two means over all cameras are not observable in images. These sigmas hold them at 0: slack (a logarithm), clocks (seconds).
MEAN_SLACK_SD = 1e-4
MEAN_TIME_SD = 1e-4


@dataclass(frozen=True, eq=False)
class PeopleProblem:
    """The person model of given sightings, as a problem for the least-squares solver."""

    n_cameras: int
    sightings: Sightings
    joints: PointObservations
    person: Ints
    """(N,) the person of each person-instant."""
    n_joints: int
    height_mean: Floats
    """(P,) prior of each person's standing height, metres."""
    height_sd: Floats
    """(P,) standard deviation of that prior, metres."""
    stance_weight: Floats
    """(N,) 1 where the person may be standing; with 0, the height of the highest point is free."""
    noise: Noise = field(default_factory=Noise)
    priors: Priors = field(default_factory=Priors)
    cues: CueRows | None = None
    whole: Floats | None = None
    """(M,) probability that each sighting shows a whole person; all 1 when None."""
    expected_px: Floats | None = None
    """(M,) expected extent of the person of each sighting, pixels; the observed extent when None. The observed extent is noisy:
    with weights from it, boxes that are too small by chance would count more than those that are too large."""
    lens_core: Floats | None = None
    """(C, L) scales of the Cauchy distributions of the lenses' unknowns around 0, or standard deviations (`lens_normal`); None
    where they are not refined."""
    lens_weight: Floats = field(default_factory=lambda: np.ones(()))
    """(C, L), or one for all: factor on the weight of those priors. Errors of successive sightings are correlated, so that they
    hold less information than as many independent ones. Without the factor they would overrule priors that are right."""
    lens_normal: bool = False
    """Whether those priors are normal distributions: for lenses whose parameters are not stated."""
    lens_groups: tuple[tuple[int, ...], ...] = ()
    """Cameras of one model: their focal lengths and distortions differ by `UNIT_FOCAL` and `UNIT_DISTORTION` only. Used with
    normal priors."""
    lens_common: Floats | None = None
    """(L,) standard deviation of an error that all lenses share, in addition to their own. Used with normal priors."""
    lens_far: Floats | None = None
    """(C, L) standard deviations of additional normal priors, which limit the wide tails of the Cauchy distributions."""
    lens_model: LensModel | None = None
    """The lenses whose unknowns these are; None where they are not refined."""
    groups: tuple[tuple[int, ...], ...] = ()
    """Groups of cameras that were separate rigs before: the scale of each is that of its people, and its mean slack near 0."""
    group_weight: float = 1.0
    """Factor on the weight of the prior on the mean slack of each group."""

    @property
    def timed(self) -> bool:
        """Whether the clocks' errors are unknowns."""
        return self.sightings.velocity is not None

    @property
    def camera_size(self) -> int:
        """Number of unknowns per camera."""
        return CAMERA_SIZE + self.timed + self.n_lens

    @property
    def n_lens(self) -> int:
        """Number of unknowns of a camera's lens; they are the last ones of the camera."""
        return 0 if self.lens_core is None else self.lens_core.shape[1]

    @property
    def layout(self) -> Layout:
        """Sizes of the three levels of unknowns."""
        n_lengths = 0 if self.cues is None else len(self.cues.lengths)
        families = (Family(len(self.person), 4, self.person), Family(self.n_joints, 3), Family(n_lengths, 6))
        return Layout(self.n_cameras, self.camera_size, 1, len(self.height_mean), families)

    @property
    def scale_px(self) -> Floats:
        """(M,) extent in pixels that the shares in the noise refer to."""
        return self.sightings.extent_px if self.expected_px is None else self.expected_px

    def centre_sigma(self) -> Floats:
        """Return the sigma (M,) of the sightings' centres in each direction, pixels; large where the person is not whole."""
        box = self.sightings.has_foot > 0
        share = np.where(box, self.noise.centre, max(self.noise.lean, self.noise.centre))
        return self._where_whole(np.hypot(np.where(box, self.noise.box_px, self.noise.floor_px), share * self.scale_px))

    def height_sigma(self) -> Floats:
        """Return the sigma (M,) of the sightings' extents as shares of `scale_px`; large where the person is not whole."""
        floor = np.where(self.sightings.has_foot > 0, HEIGHT_PER_CENTRE * self.noise.box_px, self.noise.floor_px)
        return self._where_whole(np.hypot(floor / self.scale_px, self.noise.height))

    def _where_whole(self, sigma: Floats) -> Floats:
        """Enlarge the standard deviations (M,) of sightings that probably show only a part of the person."""
        return np.asarray(sigma if self.whole is None else sigma / np.sqrt(self.whole))

    def terms(self, state: AdjustmentState, *, jacobians: bool) -> list[Term]:
        """Return the residuals at a state: sightings, joints, stance, heights, slack, foot shift and scale cues."""
        out = []
        if len(self.sightings):
            out += self._sighting_terms(state, jacobians)
            out += self._stance_terms(state)
        if self.n_joints:
            out.append(self._joint_term(state, jacobians))
        out += self._shared_priors(state)
        if self.cues is not None:
            out += self.cues.terms(state, self.layout)
        return out

    def scale_terms(self, state: AdjustmentState) -> list[Term]:
        """Return the residuals that a scaled world changes (`AdjustmentState.scaled`): people's heights, and scale cues."""
        return [self._height_prior(state), *([] if self.cues is None else self.cues.terms(state, self.layout))]

    def _sighting_terms(self, state: AdjustmentState, jacobians: bool) -> list[Term]:
        s, shift = self.sightings, state.globals[FOOT_SHIFT]
        R, C, body = state.R[s.camera], state.centre[s.camera], state.people[s.block]
        person = self.person[s.block]
        height_of = state.heights[person]
        moved = (shift * s.has_foot * height_of)[:, None]
        top, bottom, toward, distance = body_ends(C, body, moved, s.top_fraction, s.bottom_fraction)
        d_top = (R @ (top - C)[:, :, None])[:, :, 0]
        d_bottom = (R @ (bottom - C)[:, :, None])[:, :, 0]
        (r_top, top_by_d, top_by_lens), (r_bottom, bottom_by_d, bottom_by_lens) = (
            self._seen(
                state, s.camera, ray, tangent, None if s.pixels is None else s.pixels[:, end], d, s.lens_at,
                None if s.by_lens is None else s.by_lens[:, end],
            )
            for end, (ray, tangent, d) in enumerate(
                ((s.top, s.top_tangent, d_top), (s.bottom, s.bottom_tangent, d_bottom))
            )
        )  # fmt: skip
        centre_weight = 0.5 / self.centre_sigma()
        height_weight = 1.0 / self.height_sigma()
        centre = (r_top + r_bottom) * centre_weight[:, None]
        if s.velocity is not None:
            # The sighting shows the person that much later than its clock says. The change of the extent in this time is far
            # below its noise.
            by_time = s.velocity * (2 * centre_weight)[:, None]
            centre = centre + by_time * state.time[s.camera, None]
        # The noise refers to the extent expected beforehand, so that neither a small world nor a large slack reduces it. The
        # residual is not a difference of logarithms: the logarithm of a noisy extent is too small on average.
        predicted = (s.extent_px + (r_bottom - r_top)[:, 1]) * np.exp(state.slack[s.camera])
        height_weight = height_weight / self.scale_px
        height = (predicted - s.extent_px) * height_weight
        loss = Cauchy(self.noise.loss)
        if not jacobians:
            return [Term(centre, loss), Term(height[:, None], loss)]
        top_by_pose, top_by_point = pose_jacobian(top_by_d, d_top, R)
        bottom_by_pose, bottom_by_point = pose_jacobian(bottom_by_d, d_bottom, R)
        # The visible foot is shifted toward the camera, so it moves with both the camera and the person.
        turn = (moved / distance[:, None])[:, :, None] * (np.eye(2) - toward[:, :, None] * toward[:, None, :])
        lean = bottom_by_point[:, :, :2] @ turn
        bottom_by_pose[:, :, 3:5] += lean
        top_by_block = by_low_and_high(top_by_point, s.top_fraction)
        bottom_by_block = by_low_and_high(bottom_by_point, s.bottom_fraction)
        bottom_by_block[:, :, :2] -= lean
        bottom_by_reach = (bottom_by_point[:, :, :2] @ toward[:, :, None]) * s.has_foot[:, None, None]
        n, n_globals = len(s), len(state.globals)
        taller = np.exp(state.slack[s.camera])

        def rows(by_top: Floats, by_bottom: Floats, k: int) -> Floats:
            """Return the derivatives of the centre (k = 2) or of the height (k = 1)."""
            if k == 2:
                return np.asarray((by_top + by_bottom) * centre_weight[:, None, None])
            return np.asarray((by_bottom - by_top)[:, 1:] * (height_weight * taller)[:, None, None])

        terms = []
        for k, residual in ((2, centre), (1, height[:, None])):
            by_camera = np.zeros((n, k, self.camera_size))
            by_camera[:, :, :POSE_SIZE] = rows(top_by_pose, bottom_by_pose, k)
            if top_by_lens is not None and bottom_by_lens is not None:
                by_camera[:, :, self.camera_size - self.n_lens :] = rows(top_by_lens, bottom_by_lens, k)
            by_globals = np.zeros((n, k, n_globals))
            by_reach = rows(np.zeros((n, 2, 1)), bottom_by_reach, k)[:, :, 0]
            by_globals[:, :, FOOT_SHIFT] = by_reach * height_of[:, None]
            if k == 1:
                by_camera[:, 0, SLACK] = predicted * height_weight
            elif s.velocity is not None:
                by_camera[:, :, TIME] = by_time
            terms.append(
                Term(residual, loss, camera=s.camera, by_camera=by_camera, family=UPRIGHT, block=s.block,
                     by_block=rows(top_by_block, bottom_by_block, k), by_globals=by_globals, group=person,
                     by_group=by_reach * shift)
            )  # fmt: skip
        return terms

    def _seen(
        self, state: AdjustmentState, camera: Ints, bearing: Floats, tangent: Floats, pixels: Floats | None, d: Floats,
        lens_at: Floats | None, by_lens: Floats | None,
    ) -> tuple[Floats, Floats, Floats | None]:  # fmt: skip
        """Return the residuals (M, 2) in pixels of points `d` (M, 3) in the cameras' frames, and their derivatives by the
        points (M, 2, 3) and by the lenses (M, 2, L); None where lenses are not refined.
        """
        residual, by_d = project_near(bearing, tangent, d)
        if by_lens is None or lens_at is None:
            return residual, by_d, None
        by_lens = by_lens.copy()
        residual += (by_lens @ (state.lens[camera] - lens_at)[:, :, None])[:, :, 0]
        if self.lens_model is not None and pixels is not None:
            self.lens_model.make_exact(state.lens, camera, pixels, d, residual, by_d, by_lens)
        return residual, by_d, by_lens

    def _stance_terms(self, state: AdjustmentState) -> list[Term]:
        """Return residuals for feet on the ground, and the highest point at standing height, weighted by `stance_weight`.

        All are shares of the person's height: in metres, a smaller world would have a lower cost.
        """
        loss = Cauchy(self.priors.stance_loss)
        n = len(self.person)
        height = np.maximum(state.heights[self.person], 0.05)
        low, high = state.people[:, LOW] / height, state.people[:, HIGH] / height
        root = np.sqrt(self.stance_weight) / self.priors.high
        # The length of a person who is not standing gets a weak prior, so that the free end does not diverge. It does not apply
        # to standing people: it would make all of them 1 % taller.
        down = np.sqrt(1 - self.stance_weight) / CROUCHED_SD
        rows = (
            (low / self.priors.low, loss, 1 / self.priors.low * np.ones(n), 0.0),
            ((high - GAIT_SHARE) * root, loss, 0.0, root),
            ((high - low - CROUCHED) * down, None, -down, down),
        )
        terms = []
        for residual, row_loss, by_low, by_high in rows:
            by_block = np.zeros((n, 1, 4))
            by_block[:, 0, LOW], by_block[:, 0, HIGH] = by_low / height, by_high / height
            by_group = (-(by_low * low + by_high * high) / height)[:, None]
            terms.append(
                Term(residual[:, None], row_loss, family=UPRIGHT, block=np.arange(n), by_block=by_block, group=self.person,
                     by_group=by_group)
            )  # fmt: skip
        return terms

    def _joint_term(self, state: AdjustmentState, jacobians: bool) -> Term:
        o, loss = self.joints, Cauchy(self.noise.loss)
        R = state.R[o.camera]
        d = (R @ (state.joints[o.point] - state.centre[o.camera])[:, :, None])[:, :, 0]
        residual, by_d, by_lens = self._seen(state, o.camera, o.bearing, o.tangent, o.pixels, d, o.lens_at, o.by_lens)
        residual = residual / o.sigma_px[:, None]
        if o.velocity is not None:
            residual = residual + (o.velocity / o.sigma_px[:, None]) * state.time[o.camera, None]
        if not jacobians:
            return Term(residual, loss, family=JOINT, block=o.point)
        by_pose, by_point = pose_jacobian(by_d / o.sigma_px[:, None, None], d, R)
        by_camera = np.concatenate([by_pose, np.zeros((len(d), 2, self.camera_size - POSE_SIZE))], axis=2)
        if o.velocity is not None:
            by_camera[:, :, TIME] = o.velocity / o.sigma_px[:, None]
        if by_lens is not None:
            by_camera[:, :, self.camera_size - self.n_lens :] = by_lens / o.sigma_px[:, None, None]
        return Term(residual, loss, camera=o.camera, by_camera=by_camera, family=JOINT, block=o.point, by_block=by_point)

    def _shared_priors(self, state: AdjustmentState) -> list[Term]:
        # A slack common to all cameras is equivalent to a scale: images do not distinguish them. The mean slack is therefore
        # held at 0, and its uncertainty goes into the scale's sigma instead.
        slack = self._mean_held(state.slack, SLACK, self.priors.slack, MEAN_SLACK_SD)
        # A time offset common to all cameras is not observable either: it only shifts the time of all events.
        time = [self._mean_held(state.time, TIME, self.priors.time, MEAN_TIME_SD)] if self.timed else []
        by_shift = np.zeros((1, 1, self.layout.n_shared))
        by_shift[0, 0, self.n_cameras * self.camera_size + FOOT_SHIFT] = 1 / self.priors.foot_shift_sd
        shift = (state.globals[FOOT_SHIFT] - self.priors.foot_shift) / self.priors.foot_shift_sd
        return [
            slack,
            *self._group_priors(state),
            *time,
            *self._lens_priors(state),
            Term(np.array([[shift]]), by_shared=by_shift),
            self._height_prior(state),
        ]

    def _height_prior(self, state: AdjustmentState) -> Term:
        by_height = (1 / self.height_sd)[:, None]
        residual = ((state.heights - self.height_mean) / self.height_sd)[:, None]
        return Term(residual, group=np.arange(len(self.height_mean)), by_group=by_height)

    def _group_priors(self, state: AdjustmentState) -> list[Term]:
        """Return the priors that hold the mean slack of each group of cameras near 0."""
        out = []
        for cameras in self.groups:
            J = np.zeros((1, 1, self.layout.n_shared))
            sd = self.priors.group_slack / np.sqrt(self.group_weight)
            J[0, 0, np.array(cameras) * self.camera_size + SLACK] = 1 / (len(cameras) * sd)
            out.append(Term(np.array([[state.slack[list(cameras)].mean() / sd]]), by_shared=J))
        return out

    def _lens_priors(self, state: AdjustmentState) -> list[Term]:
        """Return the priors of the lenses around their stated values: Cauchy (a lens may be quite another one), or normal."""
        if self.lens_core is None:
            return []
        n, k = self.n_cameras, self.n_lens
        root = np.broadcast_to(np.sqrt(self.lens_weight), (n, k))
        of_camera, terms = np.arange(n), []
        for unknown in range(k):
            weight = np.diag(root[:, unknown] / self.lens_core[:, unknown])
            if unknown in (0, k - 1):
                for members in self.lens_groups:
                    weight = _of_one_model(weight, members, UNIT_FOCAL if unknown == 0 else UNIT_DISTORTION)
            if self.lens_common is not None and self.lens_common[unknown] > 0:
                common = self.lens_common[unknown] ** 2 / float(np.mean(root[:, unknown] ** 2))
                covariance = np.linalg.inv(weight.T @ weight) + common
                weight = np.linalg.cholesky(np.linalg.inv(covariance)).T
            J = np.zeros((n, 1, self.layout.n_shared))
            J[:, 0, (of_camera + 1) * self.camera_size - k + unknown] = weight
            loss = None if self.lens_normal else Cauchy(root[:, unknown])
            terms.append(Term((weight @ state.lens[:, unknown])[:, None], loss, by_shared=J))
            if self.lens_far is not None and not self.lens_normal:
                bound = (self.lens_core / self.lens_far)[:, unknown]
                residual = bound * np.diag(weight) * state.lens[:, unknown]
                terms.append(Term(residual[:, None], by_shared=J * bound[:, None, None]))
        return terms

    def _mean_held(self, values: Floats, unknown: int, sd: float, mean_sd: float) -> Term:
        """Return priors around 0 on one unknown (C,) of each camera, and on its mean."""
        n, of_camera = self.n_cameras, np.arange(self.n_cameras)
        J = np.zeros((n + 1, 1, self.layout.n_shared))
        J[of_camera, 0, of_camera * self.camera_size + unknown] = 1 / sd
        J[n, 0, of_camera * self.camera_size + unknown] = 1 / (n * mean_sd)
        return Term(np.concatenate([values / sd, [values.mean() / mean_sd]])[:, None], by_shared=J)

    def retract(self, state: AdjustmentState, step: Step) -> AdjustmentState:
        """Return the state moved by a step."""
        n_cameras = self.n_cameras * self.camera_size
        by_camera = step.shared[:n_cameras].reshape(-1, self.camera_size)
        R, centre = retract_poses(state.R, state.centre, by_camera[:, :POSE_SIZE])
        return AdjustmentState(
            R, centre, state.slack + by_camera[:, SLACK], state.globals + step.shared[n_cameras:],
            state.heights + step.groups, state.people + step.blocks[UPRIGHT], state.joints + step.blocks[JOINT],
            state.time + by_camera[:, TIME] if self.timed else state.time,
            state.lens + by_camera[:, self.camera_size - self.n_lens :] if self.n_lens else state.lens,
            state.lengths + step.blocks[LENGTH],
        )  # fmt: skip


def _of_one_model(weight: Floats, members: Sequence[int], unit_sd: float) -> Floats:
    """Return the whitening (C, C) of priors on one unknown of each camera, where `members` differ in it by `unit_sd` only.

    The covariance among them has a common part, as large as the mean of their own priors, and a separate part of each camera.
    """
    of = np.ix_(members, members)
    common = 1 / np.mean(np.diag(weight)[list(members)] ** 2)
    covariance = common * np.ones((len(members), len(members))) + unit_sd**2 * np.eye(len(members))
    out = weight.copy()
    out[of] = np.linalg.cholesky(np.linalg.inv(covariance)).T
    return out
