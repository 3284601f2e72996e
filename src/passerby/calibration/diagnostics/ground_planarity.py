"""The people's ground, as far as it is no plane: what is told of it."""

from __future__ import annotations

from passerby.core.figures import GroundFigures
from passerby.core.observations import Observations
from passerby.core.solution import Solution
from passerby.core.synchronisation import USUAL_FPS
from passerby.findings.finding import Finding, doubt, notice
from passerby.people.body_centres import identified_body_centres, triangulate_people
from passerby.people.ground_shape import GroundShape, ground_shape

HARMFUL_M = 0.22
"""A rise that is larger speaks against the rig. PETS2009's lawn and kerbs rise by 0.20 m, which costs the vertical 0.3 deg.
In simulated scenes (docs/results/limits.md) one right ordinary rig of 80 has 0.25 m, two wrong ones 0.33 and 0.35 m."""
STEEP_DEG, STEEP_SIGMAS = 1.0, 5.0
"""Ground below people's own ways that slopes so much, and by so many sigmas, is not the ground that the rig stands on
(docs/results/limits.md)."""


def shape_of(solution: Solution, instants: Observations, person_height_m: float) -> GroundShape | None:
    """The shape of the ground by a rig and the people that it was made from; None where too few places tell."""
    if len(solution.rig.posed()) < 2:
        return None
    middles = identified_body_centres(solution.rig, instants)
    people = triangulate_people(solution.rig, middles, person_height_m)
    return ground_shape(people, instants.fps or USUAL_FPS)


def ground_figures(shape: GroundShape | None) -> GroundFigures | None:
    """For reports."""
    if shape is None:
        return None
    return GroundFigures(
        rise_m=shape.rise_m, sigma_m=shape.sigma_m, low=shape.low, high=shape.high, chance_sigmas=shape.chance_sigmas,
        slope_deg=shape.slope_deg, slope_sigma_deg=shape.slope_sigma_deg,
    )  # fmt: skip


def told_of_ground(
    shape: GroundShape | None, *, placed: bool = False, tilt_known: bool = False
) -> tuple[tuple[Finding, ...], tuple[Finding, ...]]:
    """What speaks against the rig, and what does not: where known points tell what is up, the ground need not.

    Args:
        shape: from `shape_of`.
        placed: whether the world is another than the solver's, in which places have other coordinates.
        tilt_known: whether `[world]` sets the vertical.
    """
    if shape is None:
        return (), ()
    found = []
    if shape.sure:
        values = {"rise_m": shape.rise_m, "at": None if placed else [list(shape.low), list(shape.high)]}
        found.append((notice if tilt_known or shape.rise_m < HARMFUL_M else doubt)("ground_uneven", **values))
    if shape.slope_deg > max(STEEP_DEG, STEEP_SIGMAS * shape.slope_sigma_deg):
        slope = {"slope_deg": shape.slope_deg, "sigma_deg": shape.slope_sigma_deg}
        found.append((notice if tilt_known else doubt)("people_on_levels", **slope))
    doubts, notices = (tuple(one for one in found if one.severity == severity) for severity in ("doubt", "notice"))
    return doubts, notices
