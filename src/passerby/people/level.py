"""The vertical and the height of one camera from its own people, for any roll of the camera."""

from __future__ import annotations

from copy import deepcopy
from functools import cache

import numpy as np

from passerby.common.arrays import Bools
from passerby.core.cameras import Lens
from passerby.core.observations import CameraObservations, Clock
from passerby.geometry.single_view import Level, level_camera
from passerby.people.sightings import Sightings, upright_sightings

LEANS = tuple(np.deg2rad([-45.0, -30.0, -15.0, 15.0, 30.0, 45.0]).tolist())
REFINED = tuple(np.deg2rad([7.5, 3.75]).tolist())
"""Leans of people in the image that are tried, and steps of refinement about the best one, radians. Images of cameras with a
larger roll have to be rotated first (`rotate`)."""
CLEARLY_BETTER = 0.8
"""Ratio of the misfit with a lean to that of upright boxes, below which people lean. On simulated terraces and basketball
courts with 2 % noise of the boxes no lean was below it for 24 cameras without roll; for 24 cameras with a roll of 18 degrees or
more the ratio was 0.63 at most."""
FITS_UPRIGHT = 0.1
"""Misfit of upright boxes below which no lean is tried. For 24 simulated cameras (three presets, seeds 40 and 41, 2 % noise of
the boxes) it is 0.031 to 0.073 without roll, 0.073 to 0.190 at 10 degrees and 0.124 or more from 18 degrees on."""
TRIED_BOXES = 150
"""Number of boxes used to compare leans. The best lean is then compared with upright boxes on all boxes."""
MOVING_SHARE = 0.25
"""Distance between the tenth and the ninetieth percentile of a tracklet's feet, as a share of the person's extent. A standing
person shifts by less than a tenth; a walking person exceeds this share within half a second."""


def level_from_people(bodies: Sightings, person_height_m: float, rng: np.random.Generator) -> Level | None:
    """Compute the camera's vertical and height from its own people, `person_height_m` tall; return None for too few people.

    Only people in a tracklet are used where there are 50 or more: single detections are more often false.
    """
    tracked = bodies.identity >= 0
    use = bodies.take(tracked) if np.count_nonzero(tracked) >= 50 else bodies
    span, foot = person_height_m * (use.top_fraction - use.bottom_fraction), person_height_m * use.bottom_fraction
    return level_camera(use.top, use.bottom, use.top_tangent, use.extent_px, span, foot, rng)


def levelled_people(
    seen: CameraObservations, lens: Lens, clock: Clock, person_height_m: float, rng: np.random.Generator
) -> tuple[Sightings, Level | None]:
    """Find the people of a camera and its level, for any roll of the camera about its viewing direction.

    A box does not show how the person in it leans. But people who are farther away look smaller and stand nearer to the
    horizon. With the right lean all people fit one ground; with a wrong lean they do not. So the leans of `LEANS` are compared
    by the misfit of their levels, and the best one is refined. Boxes are taken as upright unless a lean fits clearly better.

    Args:
        seen: boxes and joints; identities are tracklet numbers of this camera or -1.
        lens: the camera's lens.
        clock: from frames to seconds.
        person_height_m: expected standing height, metres.
        rng: draws the people that the level is fitted to.

    Returns:
        The people, with the lean that was found, and the level. The level is None where there are too few people.
    """
    draws = deepcopy(rng)
    upright = upright_sightings(seen, lens, clock)
    level = level_from_people(upright, person_height_m, rng)
    if level is None or level.residual < FITS_UPRIGHT or not len(seen.boxes):
        return upright, level
    thinned = np.unique(np.linspace(0, len(seen.boxes) - 1, TRIED_BOXES).round().astype(np.int64))
    few = CameraObservations(seen.boxes.take(thinned))

    @cache
    def misfit(lean: float) -> float:
        found = level_from_people(upright_sightings(few, lens, clock, lean), person_height_m, deepcopy(draws))
        return np.inf if found is None else found.residual

    best = min(LEANS, key=misfit)
    for step in REFINED:
        best = min((best - step, best, best + step), key=misfit)
    if misfit(best) >= misfit(0.0):
        return upright, level
    bodies = upright_sightings(seen, lens, clock, best)
    leaning = level_from_people(bodies, person_height_m, deepcopy(draws))
    clearly = leaning is not None and leaning.residual < CLEARLY_BETTER * level.residual
    return (bodies, leaning) if clearly else (upright, level)


def of_moving_tracklets(bodies: Sightings) -> Bools:
    """Return a mask (N,) of sightings in tracklets whose lowest point moves by `MOVING_SHARE` of the extent or more.

    It leaves out people who sit, and false detections where the background has changed.
    """
    moving = np.zeros(len(bodies), dtype=np.bool_)
    if not len(bodies):
        return moving
    by_tracklet = np.argsort(bodies.identity, kind="stable")
    numbers, first = np.unique(bodies.identity[by_tracklet], return_index=True)
    extent = np.linalg.norm(bodies.top - bodies.bottom, axis=1)
    for number, rows in zip(numbers.tolist(), np.split(by_tracklet, first[1:]), strict=True):
        low, high = np.quantile(bodies.bottom[rows], (0.1, 0.9), axis=0)
        moving[rows] = number >= 0 and float(np.linalg.norm(high - low)) >= MOVING_SHARE * float(np.median(extent[rows]))
    return moving
