"""How sure the adjusted cameras are: their covariance from the reduced system.

The world may be turned about the vertical and moved along the ground without any residual noticing. The covariance is that of the rig
after the best such placement on the camera centres (inner constraints: Teunissen 1985, *Generalized Inverses, Adjustment, the Datum
Problem and S-Transformations*), so that no camera is special.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from passerby.cameras import PoseSigma
from passerby.solver.evidence import Evidence
from passerby.solver.least_squares import NormalEquations, Term
from passerby.solver.person_model import CAMERA_SIZE, PeopleState
from passerby.solver.refinement import Model

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

CHUNK_INSTANTS = 40
"""Residuals of one person in one camera count as independent over stretches of so many instants."""


@dataclass(frozen=True, eq=False)
class RigCovariance:
    """Uncertainty of the cameras."""

    cameras: Floats
    """(C, 6, 6): centre (metres, world), then rotation vector (radians, camera frame)."""
    inflation: float
    """Factor on the covariance for residuals that are alike from one instant to the next."""

    def sigma(self, camera: int) -> PoseSigma:
        """One camera's one-sigma figures."""
        block = self.cameras[camera]
        return PoseSigma(
            float(np.sqrt(max(np.trace(block[:3, :3]), 0.0))),
            float(np.degrees(np.sqrt(max(np.trace(block[3:, 3:]), 0.0)))),
            block,
        )


def rig_covariance(normal: NormalEquations, state: PeopleState, inflation: float, scale_sigma: float) -> RigCovariance:
    """The covariance of all cameras.

    Args:
        normal: undamped normal equations at the optimum, residuals in units of their true noise.
        state: the optimum.
        inflation: from `correlation_inflation`.
        scale_sigma: relative standard deviation of the scale beyond what the system knows.
    """
    H = normal.reduce().H
    n = len(H)
    constraint = _placement_freedoms(state, n)
    centres_only = _only_centres(constraint, len(state.R))
    scale = 1.0 / np.sqrt(np.maximum(np.diag(H), 1e-12))
    B = centres_only / np.linalg.norm(centres_only * scale[:, None], axis=0)
    system = H * scale[:, None] * scale + (B * scale[:, None]) @ (B * scale[:, None]).T
    inverse = np.linalg.pinv(system, rcond=1e-13, hermitian=True) * scale[:, None] * scale
    freedom = np.linalg.inv(B.T @ constraint)
    # What the constraint itself adds along the freedoms (see the module's source) is not the cameras' uncertainty.
    covariance = (inverse - constraint @ (freedom @ freedom.T) @ constraint.T) * inflation
    spread = state.centre - state.centre.mean(axis=0)
    blocks = np.zeros((len(state.R), 6, 6))
    order = np.array([3, 4, 5, 0, 1, 2])
    for c in range(len(state.R)):
        own = c * CAMERA_SIZE + order
        blocks[c] = covariance[np.ix_(own, own)]
        blocks[c, :3, :3] += scale_sigma**2 * np.outer(spread[c], spread[c])
    return RigCovariance(blocks, inflation)


def _placement_freedoms(state: PeopleState, n: int) -> Floats:
    """(n, 3) directions of the shared unknowns that no residual notices: along x, along y, about z."""
    out = np.zeros((n, 3))
    up = np.array([0.0, 0.0, 1.0])
    for c in range(len(state.R)):
        first = c * CAMERA_SIZE
        out[first + 3, 0] = out[first + 4, 1] = 1.0
        # A turn of the world about z by w moves a centre by w z x C, and turns the camera by -R z w in its own frame.
        out[first : first + 3, 2] = -state.R[c] @ up
        out[first + 3 : first + 6, 2] = np.cross(up, state.centre[c])
    first = len(state.R) * CAMERA_SIZE + 1
    for point in range((len(state.globals) - 1) // 3):
        at = state.globals[1 + 3 * point : 4 + 3 * point]
        out[first + 3 * point, 0] = out[first + 3 * point + 1, 1] = 1.0
        out[first + 3 * point : first + 3 * point + 3, 2] = np.cross(up, at)
    return out


def _only_centres(freedoms: Floats, n_cameras: int) -> Floats:
    """The freedoms as constraints on the camera centres alone."""
    out = np.zeros_like(freedoms)
    for c in range(n_cameras):
        rows = slice(c * CAMERA_SIZE + 3, c * CAMERA_SIZE + 6)
        out[rows] = freedoms[rows]
    return out


def correlation_inflation(model: Model, evidence: Evidence, terms: list[Term]) -> float:
    """How many times less the residuals tell than as many independent ones would (the design effect).

    A person's gait, clothes and posture shift the boxes of one camera alike for a while. The variance of the sums over such stretches, against
    that of single residuals, measures it (Kish 1965); 1 where all are independent.
    """
    s = model.problem.sightings
    if len(s) == 0:
        return _joint_inflation(model)
    instant = np.unique(evidence.frame, return_inverse=True)[1]
    blocks = model.blocks[s.block]
    stretch = instant[blocks] // CHUNK_INSTANTS
    key = np.column_stack([s.camera, evidence.person[blocks], stretch])
    return max(1.0, max(_design_effect(term, key) for term in terms[:2]))


def _joint_inflation(model: Model) -> float:
    """Without uprights: joints of one kind in one camera count as one stretch."""
    return float(max(1, len(model.problem.joints.camera) // 2000))


def _design_effect(term: Term, key: Ints) -> float:
    squared = np.einsum("mk,mk->m", term.residual, term.residual)
    weight = term.loss.weight(squared) if term.loss is not None else np.ones(len(squared))
    weighted = term.residual * weight[:, None]
    _, group = np.unique(key, axis=0, return_inverse=True)
    sums = np.array([np.bincount(group.ravel(), column) for column in weighted.T])
    return float((sums**2).sum() / max((weighted**2).sum(), 1e-12))
