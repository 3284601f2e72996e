"""Cross-validation of a rig by people who are held out of its adjustment.

The residuals of the fitted people do not show the accuracy of a rig. So the rig is adjusted again without the people of every
fifth stretch of time. Then the residuals of these people are computed: the distance between a person as one camera sees it
and its position by the other cameras. Identities, clocks and lenses are those of the whole recording; only poses, people and
the noise are estimated again. The rig that is written is the one from all the evidence.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from passerby.calibration.run import Estimate
from passerby.common.arrays import Floats, Ints
from passerby.core.cameras import Pose, Rig
from passerby.core.figures import HeldOutFigures, ResidualFigures
from passerby.core.observations import CameraObservations, Observations
from passerby.core.synchronisation import USUAL_FPS
from passerby.people.one_against_others import CameraDisagreements, disagreements
from passerby.solver.initialisation import PeopleOptions
from passerby.solver.readjustment import readjust

STRETCH_S = 10.0
"""Length of a stretch of time, seconds; a fifth of the recording, if it is shorter than five of these."""
EVERY, FIRST = 5, 2
"""One stretch in `EVERY` is held out, the first one with number `FIRST`, from 0: neither the first nor the last of five."""
LEAST_STRETCH_S = 1.0
"""Least length of a stretch, seconds: in less time people move too little to be independent evidence."""
SIGHTINGS = 8000
"""Largest number of sightings in the adjustment without the held-out people. It takes a part of the time of a solve, and moves
the rig by less than the noise of the boxes."""
TOLERANCE = 1e-5
FEWEST = 50
"""Least number of observations, held out and fitted, for a useful median."""


@dataclass(frozen=True, eq=False)
class HeldOut:
    """A rig that was adjusted without the held-out people."""

    rig: Rig
    """The cameras that still have a pose, in a world of its own: z up, the ground at z = 0, metres."""
    figures: HeldOutFigures | None
    """None if too few people are held out or fitted."""


def hold_out(rig: Rig, instants: Observations, person_height_m: float, seed: int) -> HeldOut | None:
    """Adjust the rig without the held-out people, and compute the residuals of these and of the fitted people.

    Args:
        rig: the solved rig; world z up, the ground at z = 0.
        instants: people at common time steps, with identities over all cameras.
        person_height_m: typical standing height.
        seed: seed of the random sample where there are too many observations.

    Returns:
        None if the recording is too short, or if fewer than two cameras are left.
    """
    posed = rig.posed()
    steps = _time_steps(posed, instants)
    if len(posed) < 2 or not len(steps):
        return None
    fps = instants.fps or USUAL_FPS
    stretch_s = min(STRETCH_S, (int(steps[-1] - steps[0]) + 1) / fps / EVERY)
    if stretch_s < LEAST_STRETCH_S:
        return None
    fitted = _where(instants, lambda step: ~is_held_out(step, posed, instants, stretch_s))
    options = PeopleOptions(max_sightings=SIGHTINGS, max_joints=SIGHTINGS, tolerance=TOLERANCE)
    found = readjust(posed, replace(fitted, fps=fps), np.random.default_rng(seed), stretch_s=stretch_s, options=options)
    if found is None or len(posed) - len(found.loose) < 2:
        return None
    poses = [Pose.from_centre(R, centre) for R, centre in zip(found.R, found.centre, strict=True)]
    tied = [c for c in range(len(posed)) if c not in found.loose]
    anew = Rig(tuple(replace(posed.cameras[c], pose=poses[c], sigma=None) for c in tied))
    every = [one for one in disagreements(anew, instants, person_height_m).values() if len(one)]
    sides = [is_held_out(one.step, posed, instants, stretch_s) for one in every]
    held = _residuals([one.take(rows) for one, rows in zip(every, sides, strict=True)])
    fit = _residuals([one.take(~rows) for one, rows in zip(every, sides, strict=True)])
    if held is None or fit is None:
        return HeldOut(anew, None)
    numbers = [(one.step - steps[0]) // (stretch_s * fps) for one in every]
    stretches = np.unique((steps[is_held_out(steps, posed, instants, stretch_s)] - steps[0]) // (stretch_s * fps))
    by_stretch = [
        _residuals([one.take(of == stretch) for one, of in zip(every, numbers, strict=True)]) for stretch in stretches
    ]
    counted = [one.median_share for one in by_stretch if one is not None]
    shares = [share for share in counted if share is not None]
    figures = HeldOutFigures(
        stretches=len(counted) or len(stretches),
        stretch_s=stretch_s,
        held_out=held,
        fit=fit,
        least_share=min(shares, default=held.median_share),
    )
    return HeldOut(anew, figures)


def is_worse(after: Estimate, before: Estimate, person_height_m: float, seed: int) -> bool:
    """Check whether an estimate lost cameras, or its held-out people have larger residuals; arguments as of `hold_out`."""
    if after.solution.verdict == "refused" or after.solution.rig.posed().names != before.solution.rig.posed().names:
        return True
    new, old = (_disagreement(one, person_height_m, seed) for one in (after, before))
    return new is not None and old is not None and new > old


def _disagreement(estimate: Estimate, person_height_m: float, seed: int) -> float | None:
    """Return the median residual of held-out people in an estimate, as a share of their size; None if they are too few."""
    if estimate.solution.method != "people":
        return None
    found = hold_out(estimate.solution.rig, estimate.association.instants, person_height_m, seed)
    return None if found is None or found.figures is None else found.figures.held_out.median_share


def is_held_out(step: Ints, rig: Rig, instants: Observations, stretch_s: float) -> NDArray[np.bool_]:
    """Check whether each time step (N,) lies in a held-out stretch; the first stretch begins when a person is seen first."""
    first = int(_time_steps(rig.posed(), instants)[0])
    return np.asarray((step - first) // (stretch_s * (instants.fps or USUAL_FPS)) % EVERY == FIRST)


def _residuals(found: Sequence[CameraDisagreements]) -> ResidualFigures | None:
    """Return the residual figures of all cameras together; None for too few observations."""
    every = CameraDisagreements.joined(found)
    if len(every) < FEWEST:
        return None
    return ResidualFigures(
        sightings=len(every),
        median_px=_within(every.pixels, 50),
        p90_px=_within(every.pixels, 90),
        median_share=_within(every.pixels / every.extent_px, 50),
        ground_50_m=_within(every.metres, 50),
        ground_90_m=_within(every.metres, 90),
    )


def _within(values: Floats, percent: float) -> float | None:
    """Return a percentile of the values; None if it is infinite."""
    found = float(np.percentile(values, percent, method="inverted_cdf"))  # without interpolation, infinite values give no NaN
    return found if np.isfinite(found) else None


def _time_steps(rig: Rig, instants: Observations) -> Ints:
    """Return all time steps at which a person was seen."""
    frames = [part.frame for name in rig.names for part in (instants[name].boxes, instants[name].keypoints)]
    return np.unique(np.concatenate(frames)) if frames else np.zeros(0, np.int64)


def _where(instants: Observations, wanted: Callable[[Ints], NDArray[np.bool_]]) -> Observations:
    """Return the boxes and joints at the wanted time steps."""
    cameras = {
        name: CameraObservations(
            seen.boxes.take(np.flatnonzero(wanted(seen.boxes.frame))),
            seen.keypoints.take(np.flatnonzero(wanted(seen.keypoints.frame))),
        )
        for name, seen in instants.cameras.items()
    }
    return replace(instants, cameras=cameras)
