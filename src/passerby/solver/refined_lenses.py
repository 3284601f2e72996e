"""What became of the lenses that were refined: figures and findings."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from passerby.common.arrays import Floats
from passerby.core.cameras import Lens, Rig
from passerby.core.figures import DistortionFigures, FocalFigures, LensFigures, PrincipalPointFigures
from passerby.findings.finding import Finding, doubt, notice
from passerby.solver.lens_check import size_drift
from passerby.solver.lens_sigmas import by_boxes, lens_evidence, refined_sigmas
from passerby.solver.lens_unknowns import LensUnknowns
from passerby.solver.people_state import AdjustmentState
from passerby.solver.person_model import PeopleProblem

# A lens that moved by more than so many standard deviations of one that was never calibrated is another one, or nobody fits it.
_FAR_SIGMAS = 3.0
# A focal length that nobody stated and that is known no better than this makes the rig doubtful.
KNOWN_FOCAL = 0.04
# People tell nothing of a lens that they know no better than this share of what one that was never calibrated is off by.
_UNTOLD_SHARE = 0.8


@dataclass(frozen=True, eq=False)
class RefinedLenses:
    """How sure the refined lenses are, (C, L) each."""

    unknowns: LensUnknowns
    sigma: Floats
    """One sigma of the unknowns."""
    by_people: Floats
    """The same by the sightings alone, whatever is stated."""


def decide_refined_lenses(
    unknowns: LensUnknowns, stated: Rig, problem: PeopleProblem, state: AdjustmentState, inflation: float
) -> RefinedLenses | None:
    """How sure the lenses are; None where none is refined.

    Sightings of joints fix a focal length by geometry alone; that of a camera with boxes alone follows how tall people seem
    near and far.

    Args:
        unknowns: what is refined.
        stated: lenses as stated.
        problem: the person model.
        state: its optimum.
        inflation: how many times less the sightings tell than as many independent ones would.
    """
    if not unknowns.parts:
        return None
    core = unknowns.core(stated)
    drift = np.zeros_like(core)
    # Where several views hold a focal length that nobody stated, people who grow with depth move it by what `lens_evidence`
    # knows of them; beside a stated one their growth is all that boxes tell.
    if "distortion" not in unknowns.parts:
        drift[:, unknowns.columns_of("focal")] = (size_drift(problem, state) * by_boxes(problem))[:, None]
    seen = lens_evidence(problem, state, inflation)
    sigma = refined_sigmas(seen, drift, core, state.lens, normal=problem.lens_normal)
    return RefinedLenses(unknowns, sigma, np.hypot(seen.sd, drift))


def lens_figures(lenses: RefinedLenses | None, stated: Rig, refined: Rig) -> dict[str, LensFigures]:
    """By camera, each refined part as stated and as refined, its sigma, and the sigma that people alone would give; empty where
    nothing is refined.

    Args:
        lenses: how sure they are.
        stated: lenses as stated.
        refined: as refined, in the same order.
    """
    if lenses is None:
        return {}
    usual = lenses.unknowns.uncalibrated_sd(stated)
    held = "distortion" in lenses.unknowns.parts
    return {
        before.name: _parts(lenses.unknowns, before.lens, after.lens, lenses.sigma[c], lenses.by_people[c], usual[c])
        for c, (before, after) in enumerate(zip(stated, refined, strict=True))
        if not held or before.lens.uncalibrated
    }


def _parts(unknowns: LensUnknowns, stated: Lens, refined: Lens, sigma: Floats, alone: Floats, usual: Floats) -> LensFigures:
    """The parts of one camera's lens; (L,) sigmas."""
    focal, point = None, None
    if "focal" in unknowns.parts:
        column = unknowns.columns_of("focal").start
        change = float(np.log(refined.focal / stated.focal))
        focal = FocalFigures(
            stated_px=stated.focal, refined_px=refined.focal, sigma_px=float(sigma[column] * refined.focal),
            people_sigma_px=float(alone[column] * refined.focal),
            far=bool(abs(change) > _FAR_SIGMAS * usual[column]),
            told=bool(alone[column] < _UNTOLD_SHARE * usual[column]),
        )  # fmt: skip
    if "principal_point" in unknowns.parts:
        columns = unknowns.columns_of("principal_point")
        moved = np.abs(refined.matrix[:2, 2] - stated.matrix[:2, 2])
        point = PrincipalPointFigures(
            stated_px=_xy(stated.matrix[:2, 2]), refined_px=_xy(refined.matrix[:2, 2]), sigma_px=_xy(sigma[columns]),
            people_sigma_px=_xy(alone[columns]),
            far=bool((moved > _FAR_SIGMAS * usual[columns]).any()),
            told=bool((alone[columns] < _UNTOLD_SHARE * usual[columns]).all()),
        )  # fmt: skip
    distortion = None
    if "distortion" in unknowns.parts:
        (error,) = sigma[unknowns.columns_of("distortion")]
        distortion = DistortionFigures(refined=float(refined.distortions[0]), sigma=float(error))
    return LensFigures(focal=focal, principal_point=point, distortion=distortion)


def _xy(values: Floats) -> tuple[float, float]:
    """A vector (2,) as plain numbers."""
    x, y = map(float, values)
    return x, y


def lens_notes(lenses: Mapping[str, LensFigures]) -> list[Finding]:
    """What was refined, one finding for each camera and part of its lens.

    Args:
        lenses: by camera, as of `lens_figures`.
    """
    out = []
    for name, parts in lenses.items():
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


def far_lenses(lenses: Mapping[str, LensFigures]) -> list[Finding]:
    """The cameras whose lens ended farther from the stated one than stated lenses are off; `lenses` as of `lens_figures`."""
    assumed = [name for name, parts in lenses.items() if parts.distortion]
    out = [doubt("principal_points_assumed", *assumed)] if assumed else []
    for name, parts in lenses.items():
        if parts.distortion and (focal := parts.focal) and focal.sigma_px > KNOWN_FOCAL * focal.refined_px:
            out.append(doubt("focal_undetermined", name, sigma_percent=100 * focal.sigma_px / focal.refined_px))
        if (focal := parts.focal) and focal.far:
            change = 100 * (focal.refined_px / focal.stated_px - 1)
            out.append(doubt("focal_refined_far", name, change_percent=change))
        if (point := parts.principal_point) and point.far:
            moved = float(np.linalg.norm(np.subtract(point.refined_px, point.stated_px)))
            out.append(doubt("principal_point_refined_far", name, moved_px=moved))
    return out
