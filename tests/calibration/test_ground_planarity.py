"""People's ground that is no plane: what is said of it, and how uncertain it makes positions on the ground."""

from dataclasses import replace

import numpy as np
import pytest

from passerby.calibration.diagnostics.ground_planarity import (
    STEEP_DEG,
    STEEP_SIGMAS,
    ground_figures,
    height_error_m,
    notices_of_ground,
    on_ground,
    shape_of,
)
from passerby.core.cameras import Rig
from passerby.core.figures import AdjustedFigures
from passerby.core.measuring import CameraMeasuring, MeasuringFigures, MeasuringSigma
from passerby.core.solution import Solution
from passerby.people.ground_shape import GroundShape
from support.scenes.people_and_rigs import simulated

FIGURES = AdjustedFigures()


def shape(rise_m: float, chance_sigmas: float = 30.0, slope: tuple[float, float] = (0.1, 0.1)) -> GroundShape:
    return GroundShape(rise_m, 0.01, (1.0, 2.0), (3.0, 4.0), chance_sigmas, *slope, 10.0)


def test_ways_that_slope_beyond_chance_are_a_notice() -> None:
    steep = shape(0.001, slope=(1.1 * STEEP_DEG, 0.9 * STEEP_DEG / STEEP_SIGMAS))
    (found,) = notices_of_ground(steep)
    assert (found.code, found.severity) == ("people_on_levels", "notice")
    assert found.values == {"slope_deg": steep.slope_deg, "sigma_deg": steep.slope_sigma_deg}


def test_a_rise_is_a_notice_with_its_places() -> None:
    (found,) = notices_of_ground(shape(0.3))
    assert (found.code, found.severity) == ("ground_uneven", "notice")
    assert found.values == {"rise_m": 0.3, "at": [[1.0, 2.0], [3.0, 4.0]]}
    (placed,) = notices_of_ground(shape(0.4), placed=True)
    assert placed.values["at"] is None, "the solver's coordinates say nothing in a world of known places"
    # Heights spread evenly between the lowest and the highest; their scatter is that of random draws.
    draws = np.random.default_rng(1).uniform(0.0, 0.6, 200_000)
    assert height_error_m(shape(0.6)) == pytest.approx(np.std(draws), rel=0.01)
    figures = ground_figures(shape(0.4))
    assert (figures.rise_m, figures.low, figures.high, figures.chance_sigmas) == (0.4, (1.0, 2.0), (3.0, 4.0), 30.0)


A_LITTLE, BY_CHANCE = (0.9 * STEEP_DEG, 0.01), (2.0 * STEEP_DEG, 2.1 * STEEP_DEG / STEEP_SIGMAS)


@pytest.mark.parametrize(
    "none", [None, shape(0.001), shape(0.4, chance_sigmas=0.5), shape(0.001, slope=A_LITTLE), shape(0.001, slope=BY_CHANCE)]
)
def test_nothing_is_said_of_a_plane_or_of_what_chance_makes(none: GroundShape | None) -> None:
    assert notices_of_ground(none) == ()
    assert none is None or height_error_m(none) == 0.0


def test_uneven_ground_makes_positions_on_it_uncertain_and_more_where_rays_are_flat() -> None:
    """Feet that are lifted are read where the rays through them meet z = 0."""
    scene = simulated("terrace", 20.0, 0)
    sigma = MeasuringSigma(median_mm=30.0, p90_mm=60.0)
    rise = shape(0.6)
    for camera in scene.rig:
        feet = scene.observations[camera.name].boxes.ltwh
        xy = camera.ground(feet[:, :2] + feet[:, 2:] * (0.5, 1.0)).xy
        lifted = camera.ground(camera.project(np.column_stack([xy, np.full(len(xy), 0.01)]))).xy
        moved = float(np.median(np.linalg.norm(lifted - xy, axis=1))) / 0.01
        reach = float(np.median(np.linalg.norm(xy - camera.centre[:2], axis=1)) / camera.centre[2])
        own = CameraMeasuring(points=sigma, across=sigma, ground=sigma, reach=reach)
        even = MeasuringFigures(places=10, points=sigma, ground=sigma, ground_height_mm=None, cameras={camera.name: own})
        found = on_ground(replace(FIGURES, measuring=even), rise).measuring
        assert found.points == sigma
        with_rise = found.cameras[camera.name].ground
        assert found.ground == with_rise
        assert with_rise.median_mm == pytest.approx(np.hypot(30.0, 1000 * height_error_m(rise) * moved), rel=0.02)
        assert found.cameras[camera.name].height_mm == pytest.approx(with_rise.median_mm / reach)
    assert on_ground(FIGURES, shape(0.001)) == FIGURES


def test_two_cameras_tell_the_shape_of_the_ground_and_one_does_not() -> None:
    scene = simulated("terrace", 20.0, 0)
    posed = [Rig(tuple(c if n < count else replace(c, pose=None) for n, c in enumerate(scene.rig))) for count in (1, 2, 4)]
    one, two, all_four = (shape_of(Solution("people", rig, "accepted"), scene.observations, 1.72) for rig in posed)
    assert one is None
    for found in (two, all_four):
        assert not found.sure
        assert notices_of_ground(found) == ()
