"""Physical meaning of the world's z axis, and its uncertainty relative to gravity.

Feet on the ground determine z far better than bodies do: z is the normal of the ground that people walk on. A floor is level, a
yard slopes for drainage, and a ramp slopes; people stand along gravity on all of them. Trunks show gravity if there are
keypoints; boxes do not.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from passerby.common.arrays import Floats
from passerby.common.text import list_names
from passerby.core.cameras import Rig
from passerby.core.figures import AdjustedFigures, UpFigures
from passerby.core.observations import Observations
from passerby.core.solution import Solution
from passerby.findings.finding import Finding, notice
from passerby.solver.body_segments import Bodies, bodies_in_space
from passerby.solver.body_vertical import body_vertical

GROUND_SLOPE_DEG = 1.0
"""One sigma of the slope of an unknown ground. Floors are level; paved ways slope by up to 1.2 degrees across (1 in 48) and
ramps by up to 4.8 (1 in 12): the limits of the ADA Standards for Accessible Design of 2010, 403.3 and 405.2."""
LEAST_BODIES = 8
"""Least number of trunks of one person."""
LEAST_PEOPLE = 5
"""Least number of people with trunks: their differences give the uncertainty of the mean."""
COMMON_LEAN_DEG = 0.5
"""One sigma of the lean that the trunks of all people share: people who walk in one direction lean forwards by some degrees."""
LEAST_TILT_DEG, TILT_SIGMAS = 1.0, 3.0
"""A ground is reported if its tilt relative to bodies exceeds this angle, and this number of sigmas: one in 90 level ones by
chance."""


def up_figures(solution: Solution, instants: Observations, rng: np.random.Generator) -> UpFigures | None:
    """Return the meaning of z, and its sigma relative to gravity; None without a known up direction.

    Args:
        solution: the solution in its own world, whose z is the up direction that it found.
        instants: the people that it was made from, at common time steps.
        rng: random numbers to sample bodies if there are many.
    """
    figures = solution.figures
    if not isinstance(figures, AdjustedFigures) or not np.isfinite(figures.vertical_sigma_deg or np.nan):
        return None
    assert figures.vertical_sigma_deg is not None
    if not any(camera.sightings for camera in figures.cameras):
        direction = list_names(_upright_parts(solution, instants, rng)) or "trunks"
        return UpFigures(direction=direction, gravity_sigma_deg=figures.vertical_sigma_deg)
    found = _mean_tilt(_bodies(solution, instants, rng))
    if found is None:
        sigma = float(np.hypot(figures.vertical_sigma_deg, GROUND_SLOPE_DEG))
        return UpFigures(direction="ground normal", gravity_sigma_deg=sigma)
    tilt, measured = found
    measured = measured + 0.5 * figures.vertical_sigma_deg**2 * np.eye(2)
    size = float(np.linalg.norm(tilt))
    along = tilt / max(size, 1e-12)
    # The tilt about each of two axes has a prior around 0: the posterior mean and covariance.
    prior = 0.5 * GROUND_SLOPE_DEG**2 * np.eye(2)
    gain = prior @ np.linalg.inv(prior + measured)
    left = float(np.linalg.norm(gain @ tilt))
    sigma = float(np.sqrt(left**2 + np.trace(gain @ measured)))
    along_sigma = float(np.sqrt(along @ measured @ along))
    return UpFigures(direction="ground normal", gravity_sigma_deg=sigma, tilt_deg=size, tilt_sigma_deg=along_sigma)


def _bodies(solution: Solution, instants: Observations, rng: np.random.Generator) -> Bodies | None:
    """Return bodies in the world of a solution; None without any."""
    rig = solution.rig.posed()
    R, centre = (np.array([getattr(camera.pose, name) for camera in rig]) for name in ("R_cw", "centre"))
    return bodies_in_space(rig, R, centre, instants, rng)


def _upright_parts(solution: Solution, instants: Observations, rng: np.random.Generator) -> tuple[str, ...]:
    """Return the parts of the body that show the up direction."""
    bodies = _bodies(solution, instants, rng)
    vertical = None if bodies is None else body_vertical(bodies)
    return () if vertical is None else vertical.parts


def _mean_tilt(bodies: Bodies | None) -> tuple[Floats, Floats] | None:
    """Return the mean tilt (2,) of trunks from z along x and y, degrees, and its covariance (2, 2); None for too few people.

    The covariance is that of the mean of independent people, from their differences, with the factor of Student's distribution.
    """
    if bodies is None:
        return None
    trunks = np.isfinite(bodies.at("shoulders") - bodies.at("hips")).all(axis=1)
    tilts = []
    for identity in np.unique(bodies.identity):
        own = trunks & (bodies.identity == identity)
        if np.count_nonzero(own) < LEAST_BODIES:
            continue
        vertical = body_vertical(
            replace(bodies, identity=bodies.identity[own], frame=bodies.frame[own], points=bodies.points[own])
        )
        if vertical is not None and vertical.up[2] > 0:
            tilts.append(np.degrees(vertical.up[:2] / vertical.up[2]))
    count = len(tilts)
    if count < LEAST_PEOPLE:
        return None
    spread = np.cov(np.array(tilts).T) / count * (count - 1) / (count - 3)
    return np.mean(tilts, axis=0), spread + 0.5 * COMMON_LEAN_DEG**2 * np.eye(2)


def find_tilted_ground(up: UpFigures | None, *, up_stated: bool) -> tuple[Finding, ...]:
    """Return a notice if the ground is tilted relative to the people who walk on it, unless `[world]` sets the up direction."""
    if up is None or up.tilt_deg is None or up.tilt_sigma_deg is None or up_stated:
        return ()
    if up.tilt_deg <= max(LEAST_TILT_DEG, TILT_SIGMAS * up.tilt_sigma_deg):
        return ()
    return (notice("ground_tilted", tilt_deg=up.tilt_deg, sigma_deg=up.tilt_sigma_deg),)


def with_up(rig: Rig, up: UpFigures | None) -> Rig:
    """Add the meaning of z to the metadata of a rig."""
    if up is None:
        return rig
    text = f"{up.direction}; gravity within {up.gravity_sigma_deg:.1f} degrees (1 sigma)"
    return replace(rig, metadata=dict(rig.metadata) | {"up": text})
