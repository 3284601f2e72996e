"""Differences of the people's ground from a plane: figures and findings."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from passerby.core.figures import AdjustedFigures, GroundFigures
from passerby.core.observations import Observations
from passerby.core.solution import Solution
from passerby.core.synchronisation import USUAL_FPS
from passerby.findings.finding import Finding, notice
from passerby.people.body_centres import identified_body_centres, triangulate_people
from passerby.people.ground_shape import GroundShape, ground_shape

STEEP_DEG, STEEP_SIGMAS = 1.0, 5.0
"""If the ground below people's trajectories slopes by more degrees, and by more sigmas, it is not the plane of the rig's ground
(docs/results/limits.md)."""


def shape_of(solution: Solution, instants: Observations, person_height_m: float) -> GroundShape | None:
    """Estimate the shape of the ground by a rig and the people that it was made from; None for too few places."""
    if len(solution.rig.posed()) < 2:
        return None
    middles = identified_body_centres(solution.rig, instants)
    people = triangulate_people(solution.rig, middles, person_height_m)
    return ground_shape(people, instants.fps or USUAL_FPS)


def ground_figures(shape: GroundShape | None) -> GroundFigures | None:
    """Return the figures of the ground for reports; None without a shape."""
    if shape is None:
        return None
    return GroundFigures(
        rise_m=shape.rise_m, sigma_m=shape.sigma_m, low=shape.low, high=shape.high, chance_sigmas=shape.chance_sigmas,
        slope_deg=shape.slope_deg, slope_sigma_deg=shape.slope_sigma_deg,
    )  # fmt: skip


def height_error_m(shape: GroundShape) -> float:
    """Return one sigma of the height of people's ground over z = 0, metres.

    It combines a rise, whose heights are equally frequent, and a slope; each counts only if it is significant.
    """
    rise = shape.rise_m / np.sqrt(12.0) if shape.sure else 0.0
    return float(np.hypot(rise, np.tan(np.radians(shape.slope_deg)) * shape.extent_m if _steep(shape) else 0.0))


def on_ground(figures: AdjustedFigures, shape: GroundShape) -> AdjustedFigures:
    """Add the errors that the shape of the ground causes in positions on it to the figures of an adjustment."""
    height_m = height_error_m(shape)
    if not height_m or figures.measuring is None:
        return figures
    return replace(figures, measuring=figures.measuring.on_uneven_ground(height_m))


def _steep(shape: GroundShape) -> bool:
    return shape.slope_deg > max(STEEP_DEG, STEEP_SIGMAS * shape.slope_sigma_deg)


def notices_of_ground(shape: GroundShape | None, *, placed: bool = False) -> tuple[Finding, ...]:
    """Return notices on the differences of people's ground from one plane.

    Args:
        shape: result of `shape_of`.
        placed: whether the world frame is not the solver's, so that places have other coordinates.
    """
    if shape is None:
        return ()
    found = []
    if shape.sure:
        found.append(notice("ground_uneven", rise_m=shape.rise_m, at=None if placed else [list(shape.low), list(shape.high)]))
    if _steep(shape):
        found.append(notice("people_on_levels", slope_deg=shape.slope_deg, sigma_deg=shape.slope_sigma_deg))
    return tuple(found)
