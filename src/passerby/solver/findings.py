"""Quality of a solved rig: findings, and the figures of every stage."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from passerby.common.arrays import Floats, Ints
from passerby.core.cameras import Rig
from passerby.core.figures import (
    AdjustedFigures,
    ClockCorrection,
    CueFigures,
    DistanceFigures,
    LevelFigures,
    NoiseFigures,
    PairFigures,
    PeopleFigures,
    ScaleFigures,
    SolvedCamera,
)
from passerby.core.lens_figures import LensFigures
from passerby.findings.finding import Finding, notice
from passerby.people.model import HEIGHT_PER_CENTRE
from passerby.solver.evidence import Evidence
from passerby.solver.gauge import Free
from passerby.solver.initialisation import Initialisation, InitialRig
from passerby.solver.pose_graph import cycle_consistency
from passerby.solver.refinement import Fit
from passerby.solver.uncertainty import RigCovariance

_MIN_SIGHTINGS = 20
# Relative noise of boxes' heights above which the rig is biased: noise of +-50 px on boxes of 60 to 130 px (shares of 0.3 to
# 0.7) costs 15 to 50 % of the scale and 1 to 5 degrees, +-20 px (0.15 to 0.27) at most 8 % and 0.35 degrees.
_MAX_HEIGHT_NOISE = 0.3
# Lower quartile of the absolute value of a normal deviate.
_NORMAL_QUARTILE = 0.3186


def find_separate_groups(rig: Rig, groups: list[list[int]]) -> list[Finding]:
    """Return a notice for each group of cameras that no person connects to the largest group."""
    main, *others = ([rig.names[c] for c in group] for group in groups)
    return [notice("cameras_disconnected", *names, main=main) for names in others]


def notices_about(start: Initialisation, fit: Fit) -> list[Finding]:
    """Return notices about causes of uncertainty of an optimum.

    The sigmas include them; `core.usability` decides whether the sigmas are small enough for use.

    Args:
        start: the start from which the optimum was computed.
        fit: the optimum.
    """
    agreeing = _agreeing(fit, len(start.rig))
    out = [
        notice("few_observations", camera.name, agreeing=int(count))
        for camera, count in zip(start.rig, agreeing, strict=True)
        if count < _MIN_SIGHTINGS
    ]
    cues = fit.model.problem.cues
    if cues is not None and cues.world is not None and cues.world.ground_sd_m is not None:
        world = cues.world
        out.append(
            notice(
                "ground_by_hips",
                sigma_m=world.ground_sd_m,
                by=world.ground_by,
                up=list(world.upright),
                scale=list(world.segments),
            )
        )
    noise = height_noise(fit, start.evidence)
    if noise > _MAX_HEIGHT_NOISE:
        out.append(notice("boxes_noisy", noise_percent=100 * noise))
    if not fit.result.converged:
        out.append(notice("adjustment_not_converged"))
    return out


def _lacks(free: Free) -> list[str]:
    """Return the names of the freedoms of the world as a whole that nothing constrains."""
    named = {"scale": free.scale, "vertical": free.vertical, "height of the ground": free.ground}
    return [name for name, lacking in named.items() if lacking]


def _agreeing(fit: Fit, cameras: int) -> Ints:
    """Return the number (C,) of observations of each camera, of people and of joints, that agree with the rig."""
    problem = fit.model.problem
    return sum(
        (np.bincount(seen.camera, minlength=cameras) for seen in (problem.sightings, problem.joints)), np.zeros(cameras, int)
    )


def height_noise(fit: Fit, evidence: Evidence) -> float:
    """Return the median standard deviation of the boxes' heights, as a share of them; 0 without boxes.

    It is the larger of two: that of the residuals, and that of changes from one instant of a tracklet to the next. Enough boxes
    agree by chance with a wrong rig, so that its residuals alone are too small.
    """
    problem, s = fit.model.problem, evidence.sightings
    box = problem.sightings.has_foot > 0
    if not box.any():
        return 0.0
    sigma = np.hypot(HEIGHT_PER_CENTRE * problem.noise.box_px / problem.scale_px[box], problem.noise.height)
    order = np.lexsort((evidence.frame[s.block], evidence.person[s.block], s.camera))
    order = order[s.has_foot[order] > 0]
    same = (np.diff(s.camera[order]) == 0) & (np.diff(evidence.person[s.block[order]]) == 0)
    change = np.abs(np.diff(np.log(s.extent_px[order])))[same]
    if len(change) < _MIN_SIGHTINGS:
        return float(np.median(sigma))
    # The lower quartile is used because half of the changes are between two people where identities are swapped.
    flicker = float(np.quantile(change, 0.25)) / (_NORMAL_QUARTILE * np.sqrt(2))
    return float(max(np.median(sigma), flicker))


def _finite(value: float) -> float | None:
    """Return a figure, or None where it is infinite or NaN."""
    return float(value) if np.isfinite(value) else None


def figures_of(
    start: Initialisation, choice: InitialRig, fit: Fit, covariance: RigCovariance, cues: Sequence[CueFigures],
    lenses: Mapping[str, LensFigures],
) -> AdjustedFigures:  # fmt: skip
    """Return the figures of every stage."""
    state, model, rig = fit.result.state, fit.model, start.rig
    names = rig.names
    support = cycle_consistency(start.hypotheses, len(rig))
    noise, seen = fit.noise, np.unique(model.problem.person)
    unusual = () if start.knowledge.unusual is None else start.evidence.identities[seen][start.knowledge.unusual[seen]].tolist()
    return AdjustedFigures(
        cameras=_cameras(start, fit, covariance),
        pairs=tuple(
            PairFigures(
                cameras=(names[h.a], names[h.b]), route=h.route, inliers=h.inliers, matches=h.matches,
                support=float(agreement),
            )
            for h, agreement in zip(start.hypotheses, support, strict=True)
        ),
        trees=choice.candidates, tree=choice.tree, rounds=fit.rounds,
        noise=NoiseFigures(
            floor_px=noise.floor_px, box_px=noise.box_px, centre=noise.centre, height=noise.height, joint=noise.joint,
            broken_edges=noise.broken,
        ),
        people=PeopleFigures(
            identities=len(seen), instants=len(model.problem.person),
            standing=float(np.mean(fit.stance[model.blocks])) if len(model.blocks) else None,
            heights_m={str(start.evidence.identities[p]): float(state.heights[p]) for p in seen},
            unusual=tuple(unusual) or None,
        ),
        foot_shift=float(state.globals[0]), scale=ScaleFigures(relative_sigma=_finite(covariance.scale), cues=tuple(cues)),
        vertical_sigma_deg=_finite(covariance.vertical_deg), covariance_inflation=covariance.inflation,
        distances=tuple(
            DistanceFigures(
                cameras=(names[a], names[b]), metres=float(np.linalg.norm(state.centre[a] - state.centre[b])),
                sigma_m=_finite(covariance.distances[a, b]),
            )
            for a in range(len(rig)) for b in range(a + 1, len(rig))
        ),
        clocks=_clocks(rig, state.time, covariance.time_s), undetermined=_undetermined(rig, covariance.free), lenses=lenses,
    )  # fmt: skip


def _cameras(start: Initialisation, fit: Fit, covariance: RigCovariance) -> tuple[SolvedCamera, ...]:
    """Return the figures of each camera."""
    state, model = fit.result.state, fit.model
    sightings = model.problem.sightings
    terms = model.problem.terms(state, jacobians=False)
    residual_px = np.linalg.norm(terms[0].residual, axis=1) * model.problem.centre_sigma() if len(sightings) else np.zeros(0)
    cameras = []
    for c, camera in enumerate(start.rig):
        own, level, within = sightings.camera == c, start.levels[c], covariance.shape_sigma(c)
        cameras.append(
            SolvedCamera(
                name=camera.name, sightings=int(np.count_nonzero(start.evidence.sightings.camera == c)),
                agreeing=int(np.count_nonzero(own)),
                joints=int(np.count_nonzero(model.problem.joints.camera == c)),
                median_residual_px=float(np.median(residual_px[own])) if own.any() else None,
                slack=float(state.slack[c]),
                shape_position_sigma_mm=_finite(1000 * within.position_m),
                shape_orientation_sigma_deg=_finite(within.orientation_deg),
                own_level=None if level is None else LevelFigures(height_m=level.height, residual=level.residual),
            )
        )  # fmt: skip
    return tuple(cameras)


def _undetermined(rig: Rig, free: Free) -> tuple[str, ...] | None:
    """Return the names of the parts that no evidence constrains; None where all are constrained."""
    return (*_lacks(free), *(f"camera {rig.names[c]}" for c in free.cameras)) or None


def _clocks(rig: Rig, time: Floats, sigma: Floats | None) -> dict[str, ClockCorrection]:
    """Return the correction to add to each camera's clock offset so that it agrees with the first camera's, which is kept.

    Empty where the clocks were not refined.
    """
    if sigma is None:
        return {}
    correction = time - time[0]
    return {
        name: ClockCorrection(correction_s=float(correction[c]), sigma_s=float(sigma[c])) for c, name in enumerate(rig.names)
    }
