"""Were people found in pictures of another size than the lens is for? Then they fill only the upper left part of it.

A second stream of half the width shows people at half the pixels, so that they lie in a quarter of the picture. That alone is
no proof: people may keep to a corner. But only one of the two sizes lets all cameras agree on bodies of one shape, so the rig
is solved with both, and the errors of the boxes' heights are compared. What else is wrong may still be so with the right size.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from passerby.association.result import Association
from passerby.calibration.run import CalibrationRun
from passerby.calibration.scene_solver import solve_scene
from passerby.core.cameras import Rig
from passerby.core.figures import adjusted
from passerby.core.observations import Observations
from passerby.core.solution import Solution
from passerby.findings.finding import Finding, doubt
from passerby.hypotheses.readings import possible_share, smaller

BETTER = 1.4
"""The errors with the stated sizes over those with smaller ones: 1.6 to 5 where the smaller ones are right, and 0.05 to 0.5
where people keep to a corner of the stated ones (16 simulated scenes, one camera or all)."""
AS_GOOD = 1.1
"""A camera whose own stated size makes no larger difference is not named."""


def doubts_of_smaller_pictures(
    run: CalibrationRun, rig: Rig, observations: Observations, solution: Solution, association: Association
) -> list[Finding]:
    """A doubt about each of the cameras whose people were found in smaller pictures than the lens is for.

    Args:
        run: the scene and its options.
        rig: the lenses as stated; a focal length that was corrected may be that of smaller pictures.
        observations: people in the cameras' own pixels.
        solution: the rig as it was estimated, with corrected lenses where there are any.
        association: of that rig; its people are solved with other lenses.
    """
    shares = {
        camera.name: share
        for camera in rig
        if (share := possible_share(observations[camera.name], camera.lens.size)) is not None
    }
    if not shares or solution.method != "people":
        return []
    error, without = misfit(solution), _solve_smaller(run, with_shares(rig, shares), association)
    if not np.isfinite(misfit(without)) or error < BETTER * misfit(without):
        return []
    for name in [name for name in shares if len(shares) > 1]:
        fewer = {other: share for other, share in shares.items() if other != name}
        if fewer and misfit(tried := _solve_smaller(run, with_shares(rig, fewer), association)) < AS_GOOD * misfit(without):
            shares, without = fewer, tried
    out = []
    for name, share in shares.items():
        size, small = rig[name].lens.size, smaller(rig[name].lens, share).size
        out.append(doubt("smaller_image_fits", name, seen_size=list(small), size=list(size), cut=None))
    return out


def _solve_smaller(run: CalibrationRun, rig: Rig, association: Association) -> Solution:
    """The same people solved with other lenses."""
    return solve_scene(run, rig, association.instants, run.rng(), known=association.known_heights)


def with_shares(rig: Rig, shares: Mapping[str, float]) -> Rig:
    """The rig with the lenses of some cameras for smaller pictures, without poses."""
    return Rig(
        tuple(
            replace(camera, pose=None, sigma=None, lens=smaller(camera.lens, shares.get(camera.name, 1.0)))
            if camera.name in shares
            else replace(camera, pose=None, sigma=None)
            for camera in rig
        )
    )


def misfit(solution: Solution) -> float:
    """Errors of the boxes' heights as a share of them, with the share of broken edges; infinite where a camera has no pose."""
    noise = adjusted(solution.figures).noise
    if noise is None or len(solution.rig.posed()) < len(solution.rig):
        return float("inf")
    return noise.height + noise.broken_edges
