"""Adjustment of a known rig to other footage: estimates the relative poses of the cameras from the people there.

The rounds are those of a calibration's last stage, with boxes and joints. They start from the rig's poses instead of an
initial rig.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from passerby.common.arrays import Floats, Ints
from passerby.core.cameras import Rig
from passerby.core.observations import Observations
from passerby.core.scale_cues import ScaleCues
from passerby.people.model import Noise
from passerby.solver.adjustment_problem import PriorKnowledge, RigState, build_problem, rig_of
from passerby.solver.cues import POPULATION_BIAS, expected_heights
from passerby.solver.evidence import Evidence, gather_evidence
from passerby.solver.initialisation import Initialisation, PeopleOptions, usual_priors
from passerby.solver.lens_unknowns import LensUnknowns
from passerby.solver.optimizer.least_squares import Stopping, minimise
from passerby.solver.refinement import Fit, refine_rig
from passerby.solver.uncertainty import RigCovariance, add_learnt_stance, design_effect, rig_covariance

_TOLERANT = ((Noise(loss=30.0), 0.4), (Noise(), 0.2))
"""Noise and tolerance of the first descents: with cameras turned by some degrees, people appear far from their true places."""
_COARSE = Stopping(15, 1e-4)


@dataclass(frozen=True, eq=False)
class Readjustment:
    """Poses of C cameras from footage, in a world of its own: z up, ground at z = 0, scale from the mean height of people."""

    R: Floats
    """(C, 3, 3) world to camera."""
    centre: Floats
    """(C, 3) metres."""
    covariance: Floats
    """(6 C, 6 C) covariance after the best similarity: centre (metres), then rotation vector (radians, camera frame)."""
    loose: tuple[int, ...]
    """Cameras that no evidence connects with the others."""
    stretches: Ints
    """(C,) number of stretches (one person during some seconds) that a camera and another one saw."""


def readjust(
    rig: Rig, observations: Observations, rng: np.random.Generator, *, stretch_s: float, options: PeopleOptions | None = None
) -> Readjustment | None:
    """Adjust a rig to footage.

    Args:
        rig: cameras with poses, the ground at about z = 0; start of the adjustment.
        observations: people with identities over all cameras, at common time steps; their frame rate is known.
        rng: draws a sample where there are too many observations.
        stretch_s: duration of a stretch of one person, seconds.
        options: limits and rounds; lenses and clocks are held.

    Returns:
        The cameras; None where no two of them saw a person at the same time.
    """
    options = options or PeopleOptions()
    evidence = gather_evidence(
        rig, observations, rng, max_sightings=options.max_sightings, max_joints=options.max_joints
    )  # fmt: skip
    if not len(evidence.sightings):
        return None
    start = _start(rig, evidence)
    state = _rough(start, options, rng)
    if state is None:
        return None
    fit = refine_rig(start, state, options, rng)
    if not len(fit.model.rows):
        return None
    covariance = _covariance(fit, evidence)
    found = fit.result.state
    steps = stretch_s * (observations.fps or 1.0)
    return Readjustment(found.R, found.centre, covariance.together, covariance.free.cameras, _stretches(fit, evidence, steps))


def _start(rig: Rig, evidence: Evidence) -> Initialisation:
    """Return the start of the first descent, without hypotheses of pairs and without levels."""
    mean, sd = expected_heights(ScaleCues(), evidence.identities)
    none = np.zeros((len(rig), 0))
    return Initialisation(
        rig, evidence, [None] * len(rig), [], PriorKnowledge(mean, sd, usual_priors(evidence)), rig, LensUnknowns(), none
    )  # fmt: skip


def _rough(start: Initialisation, options: PeopleOptions, rng: np.random.Generator) -> RigState | None:
    """Return the rig after descents with wide tolerances on a part of the evidence; None where no sighting agrees."""
    poses = [camera.pose for camera in start.rig]
    R = np.array([pose.R_cw for pose in poses if pose is not None])
    centre = np.array([pose.centre for pose in poses if pose is not None])
    evidence, knowledge = start.evidence, start.knowledge
    state = RigState.start(R, centre, knowledge.height_mean, knowledge.priors, np.zeros((0, 3)), start.lens)
    blocks = np.sort(rng.permutation(len(evidence.person))[: options.coarse_people])
    joints = np.sort(rng.permutation(evidence.n_joints)[: options.coarse_joints])
    for noise, share in _TOLERANT:
        model = build_problem(evidence, state, noise, knowledge, share=share, blocks=blocks, joints=joints)
        if not len(model.rows):
            return None
        state = rig_of(minimise(model.problem, model.state, _COARSE).state)
    return state


def _covariance(fit: Fit, evidence: Evidence) -> RigCovariance:
    """Compute the covariance of the adjusted cameras; their scale is not used here."""
    problem, state = fit.model.problem, fit.result.state
    terms = problem.terms(state, jacobians=True)
    inflation = design_effect(fit.model, evidence, terms)
    return rig_covariance(add_learnt_stance(terms, fit.result.normal), problem, state, inflation, POPULATION_BIAS)


def _stretches(fit: Fit, evidence: Evidence, steps: float) -> Ints:
    """Count per camera (C,) the stretches of one person, `steps` time steps each, that another camera saw too."""
    sightings = fit.model.problem.sightings
    several = np.bincount(sightings.block, minlength=len(fit.model.blocks))[sightings.block] > 1
    blocks = fit.model.blocks[sightings.block[several]]
    part = np.floor(evidence.frame[blocks] / max(steps, 1.0)).astype(np.int64)
    key = np.unique(np.column_stack([sightings.camera[several], evidence.person[blocks], part]), axis=0)
    return np.bincount(key[:, 0], minlength=evidence.n_cameras)
