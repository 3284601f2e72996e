"""A floor plan in the adjustment: one residual, the ratio of the rig's size to the plan's."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from passerby.common.arrays import Bools, Floats, Ints
from passerby.common.errors import InputError
from passerby.core.cameras import Rig
from passerby.core.scale_cues import FloorPlan, WrongUnit, find_wrong_unit
from passerby.geometry.plan_fit import Choice, Placements, PlanFit, ScalePrior, choose_placements, fit_plan, fits_mirrored
from passerby.geometry.rotations import skew
from passerby.geometry.triangulation import PointObservations
from passerby.solver.optimizer.least_squares import Layout, Term
from passerby.solver.people_state import AdjustmentState

MEETS_GROUND = 0.02
"""A ray that falls by less than a fiftieth of its length fixes no place on the ground: a pixel there is metres."""
ANGLE_SD = 1e-3
"""One sigma of a camera's direction, radians: 0.06 degrees, as in simulated scenes with boxes."""


@dataclass(frozen=True, eq=False)
class Settled:
    """The placements that are used, with their weights under a rig; they stay fixed until the next rig."""

    fit: PlanFit
    used: Bools
    """(M,) whether each row of the placements is used."""
    suspects: tuple[int, ...]
    """Groups that contradict each other."""
    span_m: float
    """Largest distance between two used placements by the plan, metres."""
    is_mirrored: bool
    """Whether the placements agree on the plan's mirror image only."""
    wrong_unit: WrongUnit | None
    """Unit of the plan, if people's heights show that it is not the metre; else None."""


@dataclass(frozen=True, eq=False)
class PlanRows:
    """A plan with the placements that a rig's cameras can use. Rows of placements: cameras first, then rays to points."""

    name: str
    unit_sd: float
    """Relative standard deviation of the plan's unit."""
    camera: Ints
    """(K,) cameras that are placed on the plan."""
    camera_target: Floats
    """(K, 2) positions of these cameras on the plan, metres."""
    camera_sd: Floats
    """(K,) standard deviations of these positions, metres."""
    rays: PointObservations
    """N rays to points of the ground, points numbered from 0; `sigma_px` is the standard deviation of the click."""
    ray_target: Floats
    """(N, 2) positions of the rays' points on the plan, metres."""
    ray_sd: Floats
    """(N,) standard deviations of these positions, metres on the plan."""
    point_names: tuple[str, ...]
    """Names of the points."""
    camera_names: tuple[str, ...]
    """Names of all cameras of the rig."""
    settled: Settled | None = None

    def settle(self, R: Floats, centre: Floats, prior: ScalePrior) -> PlanRows:
        """Return the same plan with the placements that agree under a rig; with none if they determine no scale."""
        placements = self.placements(R, centre)
        choice = choose_placements(placements, prior)
        try:
            fit = fit_plan(placements.take(choice.used))
        except ValueError:
            return replace(self, settled=None)
        return replace(self, settled=_settled(placements, choice, fit, prior))

    def placements(self, R: Floats, centre: Floats) -> Placements:
        """Return the placements under a rig: `R` (C, 3, 3) world to camera, `centre` (C, 3) metres."""
        o = self.rays
        place, by_ray, along = _on_ground(R, centre, o)
        inverse = np.linalg.pinv(o.tangent) if len(o.tangent) else np.zeros((0, 3, 2))
        across = np.eye(3) - o.bearing[:, :, None] * o.bearing[:, None, :]
        spread = (o.sigma_px**2)[:, None, None] * (inverse @ inverse.transpose(0, 2, 1)) + ANGLE_SD**2 * across
        by_bearing = by_ray @ R[o.camera].transpose(0, 2, 1)
        k = len(self.camera)
        return Placements(
            target=np.concatenate([self.camera_target, self.ray_target]),
            place=np.concatenate([centre[self.camera, :2], place]),
            group=np.concatenate([np.arange(k), k + o.point]),
            target_sd=np.concatenate([self.camera_sd, self.ray_sd]),
            covariance=np.concatenate([np.zeros((k, 2, 2)), by_bearing @ spread @ by_bearing.transpose(0, 2, 1)]),
            along=np.concatenate([np.zeros((k, 2)), along]),
        )

    @property
    def sigma(self) -> float:
        """Relative standard deviation of the scale from the plan; infinite where the plan gives no scale."""
        if self.settled is None or self.settled.wrong_unit is not None:
            return np.inf
        return float(np.hypot(self.settled.fit.scale_sd * self.settled.fit.factor, self.unit_sd))

    def span(self, R: Floats, centre: Floats) -> tuple[float, float] | None:
        """Return the plan's span by the rig and by the plan, metres; None where the placements determine no scale."""
        if self.settled is None or self.settled.wrong_unit is not None:
            return None
        place = np.concatenate([centre[self.camera, :2], _on_ground(R, centre, self.rays, held=True)[0]])[self.settled.used]
        scale = float(np.linalg.norm(self.settled.fit.by_place @ place.ravel()))
        return scale * self.settled.span_m, self.settled.span_m

    def terms(self, state: AdjustmentState, layout: Layout) -> list[Term]:
        """Return the logarithm of the scale over its sigma, with its Jacobian; no derivatives by lenses.

        Rays are computed again with changed lenses from one round to the next.
        """
        if self.settled is None or self.settled.wrong_unit is not None:
            return []
        used, sigma = self.settled.used, self.sigma
        place, by_ray, _ = _on_ground(state.R, state.centre, self.rays, held=True)
        k, size, o = len(self.camera), layout.camera_size, self.rays
        places = np.concatenate([state.centre[self.camera, :2], place])
        c = self.settled.fit.by_place @ places[used].ravel()
        by_place = np.zeros((len(used), 2))
        by_place[used] = (c @ self.settled.fit.by_place / (c @ c)).reshape(-1, 2)
        J = np.zeros((1, 1, layout.n_shared))
        for row, camera in enumerate(self.camera.tolist()):
            J[0, 0, camera * size + 3 : camera * size + 5] += by_place[row]
        for row in np.flatnonzero(used[k:]).tolist():
            camera = int(o.camera[int(row)])
            R = state.R[camera]
            ray = R.T @ o.bearing[row]
            # A ray rotates with its camera: R' = exp(w) R.
            by_turn = by_ray[row] @ R.T @ skew(o.bearing[row][None])[0]
            by_centre = np.column_stack([np.eye(2), -ray[:2] / min(ray[2], -MEETS_GROUND)])
            J[0, 0, camera * size : camera * size + 3] += by_place[k + row] @ by_turn
            J[0, 0, camera * size + 3 : camera * size + 6] += by_place[k + row] @ by_centre
        return [Term(np.array([[0.5 * np.log(c @ c) / sigma]]), by_shared=J / sigma)]


def plan_rows(plan: FloorPlan | None, rig: Rig) -> PlanRows | None:
    """Return a plan for a rig's cameras; None where fewer than two of its placements are by cameras of the rig.

    Raises `InputError` for a pixel outside the range of the lens.
    """
    if plan is None:
        return None
    index = {name: number for number, name in enumerate(rig.names)}
    cameras = [known for known in plan.cameras if known.camera in index]
    points = [point for point in plan.points if any(name in index for name in point.pixels)]
    if len(cameras) + len(points) < 2:
        return None
    rows = [(index[name], number, np.array([pixel])) for number, point in enumerate(points)
            for name, pixel in point.pixels.items() if name in index]  # fmt: skip
    rows.sort(key=lambda row: row[0])
    camera, point = (np.array([row[column] for row in rows], dtype=np.int64) for column in (0, 1))
    bearing = np.array([rig[rig.names[c]].lens.bearings(pixel)[0] for c, _, pixel in rows]).reshape(-1, 3)
    for (c, number, pixel), ray in zip(rows, bearing, strict=True):
        if not np.isfinite(ray).all():
            raise InputError(
                f"world.plan: point {points[number].name} in camera {rig.names[c]}: {pixel[0].tolist()} lies outside what its "
                "lens can see"
            )
    tangent = np.array([rig[rig.names[c]].lens.tangents(ray[None])[0] for c, ray in zip(camera, bearing, strict=True)])
    targets = plan.metres(np.array([*(one.at for one in cameras), *(one.at for one in points)]))
    sd = np.array([*(one.sd_m for one in cameras), *(one.sd_m for one in points)])
    k = len(cameras)
    return PlanRows(
        plan.name, plan.unit_sd, np.array([index[one.camera] for one in cameras], dtype=np.int64), targets[:k], sd[:k],
        PointObservations(camera, point, bearing, tangent.reshape(-1, 2, 3), np.full(len(rows), plan.click_sd_px)),
        targets[k + point], sd[k + point], tuple(one.name for one in points), rig.names,
    )  # fmt: skip


def _on_ground(R: Floats, centre: Floats, o: PointObservations, *, held: bool = False) -> tuple[Floats, Floats, Floats]:
    """Return where rays meet the ground (N, 2), its derivatives by the ray in the world (N, 2, 3) and by its height (N, 2).

    NaN for rays that do not meet the ground. With `held` no NaN: such rays are taken to fall by `MEETS_GROUND`.
    """
    ray = np.einsum("nij,ni->nj", R[o.camera], o.bearing)
    from_centre = centre[o.camera]
    down = np.minimum(ray[:, 2], -MEETS_GROUND)
    length = -from_centre[:, 2] / down
    if not held:
        length = np.where((ray[:, 2] < -MEETS_GROUND) & (length > 0), length, np.nan)
    along = ray[:, :2] / down[:, None]
    by_ray = np.zeros((len(ray), 2, 3))
    by_ray[:, 0, 0] = by_ray[:, 1, 1] = length
    by_ray[:, :, 2] = -length[:, None] * along
    return from_centre[:, :2] + length[:, None] * ray[:, :2], by_ray, along


def _settled(placements: Placements, choice: Choice, fit: PlanFit, prior: ScalePrior) -> Settled:
    target = placements.target[choice.used]
    span = float(np.linalg.norm(target[:, None] - target[None], axis=-1).max())
    times = -float(np.log(placements.scale) + prior.log_growth)
    wrong = find_wrong_unit(times, float(np.hypot(fit.scale_sd, prior.sd))) if prior.is_known else None
    return Settled(fit, choice.used, choice.suspects, span, fits_mirrored(placements, choice, prior), wrong)
