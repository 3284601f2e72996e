"""The steps of the descent's rounds: what people are expected to look like, and what is learnt from residuals."""

from __future__ import annotations

import numpy as np
import pytest

from passerby.core.cameras import Rig
from passerby.people.model import HEIGHT_PER_CENTRE, Noise, Priors
from passerby.solver.people_state import UprightObservations
from passerby.solver.refinement import POSTURE_SD, RigState, _expected_extents
from support.scenes.people_and_rigs import ring

HEIGHTS = np.array([1.6, 1.9])
GROUND = np.array([[0.5, -0.4], [-1.0, 0.8], [0.2, 1.5]])
PERSON = np.array([0, 1, 1])


def state_of(rig: Rig) -> RigState:
    poses = [camera.pose for camera in rig if camera.pose is not None]
    R, centre = np.array([pose.R_cw for pose in poses]), np.array([pose.centre for pose in poses])
    return RigState.start(R, centre, HEIGHTS, Priors(), np.zeros((0, 3)), np.zeros((len(poses), 0)))


def standing(rig: Rig) -> UprightObservations:
    """What the cameras see of upright people without any error: head and foot of each in each camera."""
    tall = HEIGHTS[PERSON]
    feet, heads = (np.column_stack([GROUND, z]) for z in (np.zeros(len(tall)), tall))
    parts = []
    for camera in rig:
        top, bottom = camera.project(heads), camera.project(feet)
        rays = [camera.lens.bearings(pixels) for pixels in (top, bottom)]
        parts.append((*rays, *map(camera.lens.tangents, rays), np.linalg.norm(top - bottom, axis=1)))
    top, bottom, top_tangent, bottom_tangent, extent = (np.concatenate(column) for column in zip(*parts, strict=True))
    n, people = len(extent), len(tall)
    return UprightObservations(
        np.repeat(np.arange(len(rig)), people), np.tile(np.arange(people), len(rig)), top, bottom, top_tangent, bottom_tangent,
        extent, np.ones(n), np.zeros(n), np.ones(n),
    )  # fmt: skip


@pytest.mark.parametrize("bent", [1.0, 0.5])
def test_who_stands_where_rays_meet_is_expected_as_large_as_seen_or_as_the_body_is_long(bent: float) -> None:
    """Of noisy boxes the body counts, of sure ones what was seen, and between the mean of logarithms by their variances."""
    rig = ring(4)
    seen = standing(rig)
    upright = seen.extent_px.copy()
    shorter = UprightObservations(**{**vars(seen), "extent_px": bent * upright})
    middles = np.column_stack([GROUND, 0.5 * HEIGHTS[PERSON]])
    for share in (1e-6, POSTURE_SD, 1e6):
        found = _expected_extents(shorter, PERSON, state_of(rig), middles, Noise(box_px=0.0, height=share))
        by_posture = share**2 / (share**2 + POSTURE_SD**2)
        np.testing.assert_allclose(found, upright * bent ** (1 - by_posture), rtol=0.02)
    sure = _expected_extents(shorter, PERSON, state_of(rig), middles, Noise(box_px=1e-6, height=0.0))
    np.testing.assert_allclose(sure, bent * upright, rtol=1e-6)
    # Pixels that all boxes are off by count for more of a small box.
    pixels = Noise(box_px=POSTURE_SD * float(np.median(upright)) / HEIGHT_PER_CENTRE, height=0.0)
    if bent != 1:
        part = np.log(_expected_extents(shorter, PERSON, state_of(rig), middles, pixels) / shorter.extent_px)
        assert np.corrcoef(part, upright)[0, 1] < -0.9
