"""Measurement of a known distance or camera height by a rig as if it had not been stated, at a fixed scale.

A stated length pulls its own cameras: 10 % too much for the height of one camera moves this camera up, and of the 10 % only 3
remain in the residual. Without the row, the residual is 1 / (1 - leverage) times as large (Cook and Weisberg 1982, *Residuals
and Influence in Regression*). The scale is held, because the cues may disagree about it.
"""

from __future__ import annotations

import numpy as np

from passerby.common.arrays import Floats
from passerby.solver.cue_terms import CueRows
from passerby.solver.gauge import SCALE, held_system, similarity_freedoms
from passerby.solver.optimizer.least_squares import Layout
from passerby.solver.optimizer.normal_equations import NormalEquations
from passerby.solver.people_state import AdjustmentState

MOST_LEVERAGE = 0.99
"""Leverage above which only the row itself determines the stated value."""


def freed_measurements(
    rows: CueRows, state: AdjustmentState, layout: Layout, normal: NormalEquations, inflation: float
) -> Floats:
    """Return for each distance, then each camera height, its value by all other evidence and one sigma, metres (D + H, 2).

    The sigma is infinite where no other evidence determines the value.

    Args:
        rows: the cues.
        state: the optimum.
        layout: sizes of the unknowns.
        normal: the normal equations at the optimum.
        inflation: design effect of the sightings: factor on the covariance because they are not independent.
    """
    sd = np.concatenate([rows.distances[:, 1], rows.heights[:, 1]])
    stated = np.concatenate([rows.distances[:, 0], rows.heights[:, 0]])
    if not len(sd):
        return np.zeros((0, 2))
    terms = CueRows(
        distance_between=rows.distance_between, distances=rows.distances, height_of=rows.height_of, heights=rows.heights
    ).terms(state, layout)
    J = np.concatenate([np.asarray(term.by_shared)[:, 0] for term in terms])
    residual = np.concatenate([term.residual[:, 0] for term in terms])
    system, _ = held_system(normal.reduce().H, state, layout.camera_size)
    covariance = system.inverse()
    scale = np.zeros(len(covariance))
    scale[system.own] = similarity_freedoms(state, system.fixed).along[SCALE]
    moved = covariance @ scale
    covariance = covariance - np.outer(moved, moved) / max(float(scale @ moved), 1e-300)
    leverage = np.clip(np.einsum("ki,ij,kj->k", J, covariance, J), 0.0, 1.0)
    left = np.maximum(1.0 - leverage, 1.0 - MOST_LEVERAGE)
    spread = np.where(leverage < MOST_LEVERAGE, sd * np.sqrt(inflation * leverage / left), np.inf)
    return np.column_stack([stated + sd * residual / left, spread])
