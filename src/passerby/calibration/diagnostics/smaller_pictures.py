"""Check whether people were detected in smaller pictures than the lens is for; then they fill only the upper left part of it.

In a second stream of half the width, people have half the pixel coordinates, so that they lie in a quarter of the picture. This
alone is no proof: people may keep to a corner. But only with the right size do all cameras agree on bodies of one shape. So the
rig is solved with both sizes, and the errors of the boxes' heights are compared. Other faults may remain with the right size.
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
"""Least ratio of the errors with the stated sizes to those with smaller ones. It is 1.6 to 5 where the smaller ones are right,
and 0.05 to 0.5 where people keep to a corner of the stated ones (16 simulated scenes, one camera or all)."""
AS_GOOD = 1.1
"""A camera is not reported if its stated size changes the errors by less than this factor."""


def doubts_of_smaller_pictures(
    run: CalibrationRun, rig: Rig, observations: Observations, solution: Solution, association: Association
) -> list[Finding]:
    """Return a doubt about each camera whose people were detected in smaller pictures than the lens is for.

    Args:
        run: the scene and its options.
        rig: the lenses as stated; a corrected focal length may be that of smaller pictures.
        observations: people in the cameras' own pixels.
        solution: the estimated rig, with corrected lenses if there are any.
        association: association of that rig; its people are solved with other lenses.
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
    """Solve the same people with other lenses."""
    return solve_scene(run, rig, association.instants, run.rng(), known=association.known_heights)


def with_shares(rig: Rig, shares: Mapping[str, float]) -> Rig:
    """Return the rig without poses, with the lenses of some cameras for smaller pictures, by shares of the size."""
    return Rig(
        tuple(
            replace(camera, pose=None, sigma=None, lens=smaller(camera.lens, shares.get(camera.name, 1.0)))
            if camera.name in shares
            else replace(camera, pose=None, sigma=None)
            for camera in rig
        )
    )


def misfit(solution: Solution) -> float:
    """Return the relative errors of the boxes' heights plus the share of broken edges; infinite if a camera has no pose."""
    noise = adjusted(solution.figures).noise
    if noise is None or len(solution.rig.posed()) < len(solution.rig):
        return float("inf")
    return noise.height + noise.broken_edges
