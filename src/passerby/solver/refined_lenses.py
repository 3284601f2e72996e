"""Figures and findings about refined lenses."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from passerby.common.arrays import Floats
from passerby.core.cameras import Lens, Rig
from passerby.core.figures import AdjustedFigures
from passerby.core.lens_figures import DistortionFigures, FocalFigures, LensFigures, PrincipalPointFigures
from passerby.findings.finding import Finding, doubt, notice
from passerby.solver.lens_sigmas import lens_evidence, refined_sigmas
from passerby.solver.lens_unknowns import FAR_SIGMAS, NORMAL_HALF, LensUnknowns
from passerby.solver.people_state import AdjustmentState
from passerby.solver.person_model import PeopleProblem
from passerby.solver.systematic import ConsiderParameters

KNOWN_FOCAL = 0.04
"""Relative sigma from which a focal length without intrinsics is shown as uncertain."""
# Share of the usual error of a lens that was never calibrated; if the sigma from people alone is larger, they do not constrain
# the lens.
_UNTOLD_SHARE = 0.8


@dataclass(frozen=True, eq=False)
class RefinedLenses:
    """The uncertainty of the refined lenses, (C, L) each."""

    unknowns: LensUnknowns
    sigma: Floats
    """One sigma of the unknowns."""
    by_people: Floats
    """One sigma from the sightings alone, without priors."""


def decide_refined_lenses(
    unknowns: LensUnknowns, stated: Rig, problem: PeopleProblem, state: AdjustmentState, inflation: float,
    of_joints: float | None, held: ConsiderParameters,
) -> RefinedLenses | None:  # fmt: skip
    """Compute the uncertainty of the lenses; None where none is refined.

    Args:
        unknowns: the refined parts.
        stated: lenses as stated.
        problem: the person model.
        state: its optimum.
        inflation: design effect of the sightings: factor on the covariance because they are not independent.
        of_joints: the same of joints; None without joints.
        held: the parts of the lenses that are not refined.
    """
    if not unknowns.parts:
        return None
    core = unknowns.core(stated)
    seen = lens_evidence(problem, state, inflation, of_joints, held)
    sigma = refined_sigmas(seen, core, state.lens, problem.lens_far, normal=problem.lens_normal)
    return RefinedLenses(unknowns, sigma, seen.sd)


def lens_figures(lenses: RefinedLenses | None, stated: Rig, refined: Rig) -> dict[str, LensFigures]:
    """Return for each camera each part as stated and as refined, with its sigma, its prior, and its sigma from people alone.

    Empty where nothing is refined.

    Args:
        lenses: uncertainty of the lenses; None where none is refined.
        stated: lenses as stated.
        refined: lenses as refined, in the same order.
    """
    if lenses is None:
        return {}
    unknowns = lenses.unknowns
    usual, core = unknowns.uncalibrated_sd(stated), unknowns.core(stated)
    held = "distortion" in unknowns.parts
    prior = core if held else core / NORMAL_HALF
    return {
        before.name: _parts(
            unknowns, before.lens, after.lens, _LensSigmas(lenses.sigma[c], lenses.by_people[c], prior[c], usual[c])
        )
        for c, (before, after) in enumerate(zip(stated, refined, strict=True))
        if not held or before.lens.uncalibrated
    }


@dataclass(frozen=True, eq=False)
class _LensSigmas:
    """Standard deviations of one camera's unknowns, (L,) each."""

    found: Floats
    """From people and priors."""
    people: Floats
    """From people alone."""
    prior: Floats
    """From the prior alone; for a Cauchy distribution, that of a normal one with the same probability near the stated value."""
    usual: Floats
    """Of the errors of lenses that were never calibrated."""

    @property
    def people_share(self) -> Floats:
        """(L,) share of people in the information: the posterior's variance over theirs."""
        return np.asarray(np.clip((self.found / self.people) ** 2, 0.0, 1.0))


def _parts(unknowns: LensUnknowns, stated: Lens, refined: Lens, sigmas: _LensSigmas) -> LensFigures:
    """Return the figures of the parts of one camera's lens."""
    focal = _focal(unknowns.columns_of("focal").start, stated, refined, sigmas) if "focal" in unknowns.parts else None
    point, distortion = None, None
    if "principal_point" in unknowns.parts:
        point = _principal_point(unknowns.columns_of("principal_point"), stated, refined, sigmas)
    if "distortion" in unknowns.parts:
        distortion = _distortion(unknowns.columns_of("distortion").start, stated, refined, sigmas)
    return LensFigures(focal=focal, principal_point=point, distortion=distortion)


def _focal(column: int, stated: Lens, refined: Lens, sigmas: _LensSigmas) -> FocalFigures:
    """Return the figures of the focal length; its unknown is the logarithm of the factor on it."""
    change, alone, usual = np.log(refined.focal / stated.focal), sigmas.people[column], sigmas.usual[column]
    return FocalFigures(
        stated_px=stated.focal, refined_px=refined.focal, sigma_px=float(sigmas.found[column] * refined.focal),
        people_sigma_px=_finite(alone * refined.focal), far=bool(abs(change) > FAR_SIGMAS * usual),
        told=bool(alone < _UNTOLD_SHARE * usual), prior_sigma_px=float(sigmas.prior[column] * stated.focal),
        people_share=float(sigmas.people_share[column]),
    )  # fmt: skip


def _principal_point(columns: slice, stated: Lens, refined: Lens, sigmas: _LensSigmas) -> PrincipalPointFigures:
    """Return the figures of the principal point, pixels."""
    moved, alone, usual = np.abs((refined.matrix - stated.matrix)[:2, 2]), sigmas.people[columns], sigmas.usual[columns]
    return PrincipalPointFigures(
        stated_px=_xy(stated.matrix[:2, 2]), refined_px=_xy(refined.matrix[:2, 2]), sigma_px=_xy(sigmas.found[columns]),
        people_sigma_px=(_finite(alone[0]), _finite(alone[1])), far=bool((moved > FAR_SIGMAS * usual).any()),
        told=bool((alone < _UNTOLD_SHARE * usual).all()), prior_sigma_px=_xy(sigmas.prior[columns]),
        people_share=_xy(sigmas.people_share[columns]),
    )  # fmt: skip


def _distortion(column: int, stated: Lens, refined: Lens, sigmas: _LensSigmas) -> DistortionFigures:
    """Return the figures of the first distortion coefficient."""
    return DistortionFigures(
        refined=float(refined.distortions[0]), sigma=float(sigmas.found[column]),
        stated=float(stated.distortions[0]) if len(stated.distortions) else 0.0, prior_sigma=float(sigmas.prior[column]),
        people_sigma=_finite(sigmas.people[column]), people_share=float(sigmas.people_share[column]),
    )  # fmt: skip


def _finite(value: float) -> float | None:
    """Return a figure, or None where it is infinite or NaN."""
    return float(value) if np.isfinite(value) else None


def _xy(values: Floats) -> tuple[float, float]:
    """Return a vector (2,) as plain numbers."""
    x, y = map(float, values)
    return x, y


def lens_notes(figures: AdjustedFigures) -> list[Finding]:
    """Return notices about lenses: one for each camera and refined part, one for parts that stay as stated, and one for the
    uncertainty from the principal points of lenses without intrinsics.
    """
    out, refinement = _assumed_points(figures), figures.refinement
    if refinement is not None and refinement.why is not None:
        dropped = [part for part in refinement.asked if part not in refinement.kept]
        out.append(notice("refinement_dropped", parts=dropped, why=refinement.why))
    for name, parts in figures.lenses.items():
        if parts.distortion and parts.focal and parts.principal_point:
            out.append(
                notice(
                    "intrinsics_estimated", name, focal_px=parts.focal.refined_px,
                    sigma_percent=100 * parts.focal.sigma_px / parts.focal.refined_px,
                    point_px=list(parts.principal_point.refined_px), point_sigma_px=max(parts.principal_point.sigma_px),
                    distortion=parts.distortion.refined, distortion_sigma=parts.distortion.sigma,
                )
            )  # fmt: skip
            continue
        if focal := parts.focal:
            change, sigma = focal.refined_px / focal.stated_px - 1, focal.sigma_px / focal.refined_px
            out.append(
                notice(
                    "focal_refined", name, refined_px=focal.refined_px, stated_px=focal.stated_px,
                    change_percent=100 * change, sigma_percent=100 * sigma, constrained=focal.told,
                )
            )  # fmt: skip
        if point := parts.principal_point:
            out.append(
                notice(
                    "principal_point_refined", name, refined_px=list(point.refined_px), stated_px=list(point.stated_px),
                    sigma_px=max(point.sigma_px), constrained=point.told,
                )
            )  # fmt: skip
    return out


def _assumed_points(figures: AdjustedFigures) -> list[Finding]:
    """Return a notice about the accuracy of a rig without intrinsics: principal points and rotations compensate each other."""
    assumed = [name for name, parts in figures.lenses.items() if parts.distortion]
    turns = [one.shape_orientation_sigma_deg for one in figures.cameras if one.name in assumed]
    known, measuring = [turn for turn in turns if turn is not None], figures.measuring
    if not known or measuring is None:
        return []
    ground_mm = None if measuring.ground is None else measuring.ground.median_mm
    values = {"orientation_deg": float(np.median(known)), "ground_mm": ground_mm, "points_mm": measuring.points.median_mm}
    return [notice("principal_points_assumed", *assumed, **values)]


def far_lenses(lenses: Mapping[str, LensFigures]) -> list[Finding]:
    """Return a doubt for each lens without intrinsics that is too far from the prior; `lenses` as from `lens_figures`."""
    out = []
    for name, parts in lenses.items():
        if parts.distortion and parts.focal and parts.principal_point and (parts.focal.far or parts.principal_point.far):
            change = 100 * (parts.focal.refined_px / parts.focal.stated_px - 1)
            moved = float(np.linalg.norm(np.subtract(parts.principal_point.refined_px, parts.principal_point.stated_px)))
            out.append(doubt("lens_doubtful", name, why="unusual", change_percent=change, moved_px=moved))
    return out
