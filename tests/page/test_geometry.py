"""What the page says by a rig, against the rig's own projections."""

import numpy as np
import pytest

from passerby.calibration.alignment.lengths import measure_length
from passerby.common.errors import EvidenceError, InputError
from passerby.core.cameras import Lens
from passerby.page.geometry import BAND_SIGMAS, epipolar_lines, ground_point, measure_axis
from support.scenes.people_and_rigs import ring, without_poses

BENT = Lens((1280, 720), np.array([[700.0, 0, 640], [0, 700.0, 360], [0, 0, 1]]), np.array([-0.25, 0.06, 0.0, 0.0]))
POINTS = np.array([[1.0, 0.5, 0.0], [-1.5, 2.0, 1.2]])


@pytest.fixture
def rig():
    return ring(4, lens=BENT)


def test_the_epipolar_line_leads_through_the_point_bent_as_the_lens_bends_it(rig):
    first, *others = rig.names
    for point in POINTS:
        at = tuple(rig[first].project(point)[0])
        lines = {one.camera: one.line for one in epipolar_lines(rig, first, at)}
        assert sorted(lines) == sorted(others)
        for name, line in lines.items():
            pixels = np.array([pixel for pixel, _ in line])
            assert _distance(pixels, rig[name].project(point)[0]) < 0.2


@pytest.mark.slow
def test_the_band_holds_the_clicks_of_a_noisy_hand():
    """Two pixels of noise in both coordinates: the band of two sigma holds 95 %."""
    rng, rig = np.random.default_rng(3), ring(2, lens=BENT)
    first, second = rig.names[:2]
    at, true = rig[first].project(POINTS[0])[0], rig[second].project(POINTS[0])[0]
    inside = []
    for _ in range(60):
        line = next(
            one.line for one in epipolar_lines(rig, first, tuple(at + rng.normal(scale=2.0, size=2))) if one.camera == second
        )
        pixels, width = np.array([pixel for pixel, _ in line]), np.array([wide for _, wide in line])
        nearest = int(np.argmin(np.linalg.norm(pixels - true, axis=1)))
        inside.append(_distance(pixels, true) <= width[nearest])
    assert np.mean(inside) >= 0.85
    assert width[nearest] < 4 * BAND_SIGMAS * 2.0


def test_a_length_and_its_sigma_are_those_of_noisy_clicks(rig):
    rng = np.random.default_rng(4)
    names = rig.names[:2]
    true = float(np.linalg.norm(POINTS[1] - POINTS[0]))
    exact = measure_length(rig, {name: rig[name].project(POINTS) for name in names})
    assert exact.metres == pytest.approx(true, abs=1e-6)
    assert exact.residual_px < 1e-6
    noisy = []
    for _ in range(200):
        ends = rig.triangulate({name: rig[name].project(POINTS) + rng.normal(scale=2.0, size=(2, 2)) for name in names})
        noisy.append(np.linalg.norm(ends[1] - ends[0]))
    assert np.std(noisy) == pytest.approx(exact.sigma_m, rel=0.25)


def test_a_pixel_of_the_ground_is_where_it_is_on_the_ground(rig):
    name = rig.names[0]
    assert ground_point(rig, name, tuple(rig[name].project(POINTS[0])[0])) == pytest.approx(POINTS[0], abs=1e-6)
    with pytest.raises(InputError, match="above the horizon"):
        ground_point(rig, name, (640.0, 0.0))
    with pytest.raises(EvidenceError, match="no pose yet"):
        epipolar_lines(without_poses(rig), name, (1.0, 1.0))


def test_the_heading_of_an_axis_and_its_sigma_are_those_of_noisy_clicks(rig):
    rng, name = np.random.default_rng(6), rig.names[0]
    ends = np.array([[1.0, 0.5, 0.0], [-1.5, 2.0, 0.0]])
    found = measure_axis(rig, [(name, tuple(pixel)) for pixel in rig[name].project(ends)])
    assert found.metres == pytest.approx(np.linalg.norm(ends[1] - ends[0]), abs=1e-6)
    headings = []
    for _ in range(200):
        clicks = rig[name].project(ends) + rng.normal(scale=2.0, size=(2, 2))
        along = np.diff([ground_point(rig, name, tuple(at)) for at in clicks], axis=0)[0]
        headings.append(np.degrees(np.arctan2(along[1], along[0])))
    assert np.std(headings) == pytest.approx(found.heading_sigma_deg, rel=0.2)


def _distance(curve, at):
    """From a point to a curve of pixels."""
    start, step = curve[:-1], np.diff(curve, axis=0)
    along = np.clip(((at - start) * step).sum(axis=1) / np.maximum((step**2).sum(axis=1), 1e-12), 0, 1)
    return float(np.linalg.norm(start + along[:, None] * step - at, axis=1).min())
