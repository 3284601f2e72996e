"""A rig that is known, adjusted again to other footage: the relative poses of the cameras by what people show there.

The same rounds as a calibration's last stage, boxes and joints alike, from the rig's poses instead of a first guess.
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
"""Noise and tolerance of the first descents: cameras that were turned by some degrees see people far from where they are."""
_COARSE = Stopping(15, 1e-4)


@dataclass(frozen=True, eq=False)
class Readjustment:
    """C cameras where footage has them, in a world of its own: z up, ground at z = 0, as large as people are on the mean."""

    R: Floats
    """(C, 3, 3) world to camera."""
    centre: Floats
    """(C, 3) metres."""
    covariance: Floats
    """(6 C, 6 C) after the best similarity: centre (metres), then rotation vector (radians, camera frame)."""
    loose: tuple[int, ...]
    """Cameras that nothing ties to the others."""
    stretches: Ints
    """(C,) people over some seconds whom a camera and another one saw alike."""


def readjust(
    rig: Rig, observations: Observations, rng: np.random.Generator, *, stretch_s: float, options: PeopleOptions | None = None
) -> Readjustment | None:
    """Adjust a rig to footage.

    Args:
        rig: cameras with poses, the ground at about z = 0; where the adjustment begins.
        observations: people with identities over all cameras, at common time steps; their frame rate is known.
        rng: draws among too many observations.
        stretch_s: seconds of a person that count as one stretch.
        options: limits and rounds; lenses and clocks are held.

    Returns:
        The cameras; None where no two of them saw a person at once.
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
    """What is known before the first descent: no pairs and no verticals are guessed at."""
    mean, sd = expected_heights(ScaleCues(), evidence.identities)
    none = np.zeros((len(rig), 0))
    return Initialisation(
        rig, evidence, [None] * len(rig), [], PriorKnowledge(mean, sd, usual_priors(evidence)), rig, LensUnknowns(), none
    )  # fmt: skip


def _rough(start: Initialisation, options: PeopleOptions, rng: np.random.Generator) -> RigState | None:
    """The rig after tolerant descents on a part of the evidence; None where nothing agrees."""
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
    """Of the adjusted cameras; their scale is no concern here."""
    problem, state = fit.model.problem, fit.result.state
    terms = problem.terms(state, jacobians=True)
    inflation = design_effect(fit.model, evidence, terms)
    return rig_covariance(add_learnt_stance(terms, fit.result.normal), problem, state, inflation, POPULATION_BIAS)


def _stretches(fit: Fit, evidence: Evidence, steps: float) -> Ints:
    """(C,) stretches of so many time steps of a person that are in the adjustment, and that another camera has as well."""
    sightings = fit.model.problem.sightings
    several = np.bincount(sightings.block, minlength=len(fit.model.blocks))[sightings.block] > 1
    blocks = fit.model.blocks[sightings.block[several]]
    part = np.floor(evidence.frame[blocks] / max(steps, 1.0)).astype(np.int64)
    key = np.unique(np.column_stack([sightings.camera[several], evidence.person[blocks], part]), axis=0)
    return np.bincount(key[:, 0], minlength=evidence.n_cameras)
