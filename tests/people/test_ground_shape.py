"""People on stairs, on a slope and on level ground."""

import numpy as np
import pytest

import passerby
from passerby.calibration.calibration import Calibration
from passerby.evaluation.metrics import compare
from passerby.people.body_centres import TriangulatedPeople
from passerby.people.ground_shape import GroundShape, ground_shape
from passerby.simulation import SimulatedScene, SimulationOptions, simulate
from passerby.simulation.disturbances import Ground, film_disturbed, level

OPTIONS = SimulationOptions(seconds=30.0, people=6, box_noise=0.02, seed=4)


def calibrated(ground: Ground) -> tuple[SimulatedScene, Calibration]:
    simulated = simulate(OPTIONS, film_disturbed(OPTIONS, ground=ground))
    boxes = {name: simulated.observations[name].boxes for name in simulated.rig.names}
    return simulated, passerby.calibrate_observations(simulated.rig, boxes, fps=5.0, association={"mode": "given"})


@pytest.mark.system
def test_a_step_is_reported_and_the_cameras_stand_right_to_each_other():
    simulated, calibration = calibrated(lambda xy: np.where(xy[..., 0] > 0, 1.0, 0.0))
    flat = calibrated(level)[1].figures.measuring.ground
    assert "ground_uneven" in [one.code for one in calibration.notices]
    assert not any("lens" in one.code for one in calibration.diagnostics), "a step looks like a wrong principal point"
    # Positions on it are as uncertain as it is uneven.
    assert calibration.figures.measuring.ground.median_mm > 1.5 * flat.median_mm
    assert compare(calibration.rig, simulated.rig).similarity.mean_position_mm < 30  # measured 13, and 6 on level ground
    assert calibration.figures.ground.chance_sigmas > 8


@pytest.mark.system
@pytest.mark.parametrize("ground", [level, lambda xy: 0.1 * xy[..., 1]], ids=["level", "10 % slope"])
def test_level_ground_and_an_even_slope_are_planes(ground):
    simulated, calibration = calibrated(ground)
    assert calibration.verdict == "accepted", calibration.reasons
    assert compare(calibration.rig, simulated.rig).similarity.mean_position_mm < 20  # measured 6 and 10
    assert calibration.figures.ground.rise_m < 0.1


def shape_of(height: np.ndarray, places: np.ndarray) -> GroundShape | None:
    """By people at these places, four at a time, two seconds apart: who is elsewhere each time walks."""
    n, place = len(places), np.column_stack([places, height])
    spread = np.tile(np.diag([0.01, 0.01, 0.02]) ** 2, (n, 1, 1))
    return ground_shape(TriangulatedPeople(np.arange(n) // 4, np.arange(n) % 4, place, spread), 0.5)


def test_heights_of_people_and_work_near_the_ground_are_no_shape_of_it():
    """Tall people stay on one side."""
    n, rng = 4000, np.random.default_rng(0)
    who = np.arange(n) % 4
    places = rng.uniform(-5, 5, (n, 2)) + np.column_stack([2.0 * (who - 1.5), np.zeros(n)])
    by_stature = shape_of(0.8 + 0.04 * who + rng.normal(0, 0.02, n), places)
    rng, low = np.random.default_rng(0), np.zeros(n, dtype=bool)
    places = rng.uniform(-5, 5, (n, 2))
    low[400:600] = low[1200:1500] = True
    places[low] = [3.0, -3.0]
    by_work = shape_of(np.where(low, 0.4, 0.86) + rng.normal(0, 0.03, n), places)
    for shape in (by_stature, by_work):
        assert not shape.sure
        assert shape.rise_m < 0.05
    assert shape_of(np.full(30, 0.86), np.zeros((30, 2))) is None, "too few places tell nothing"


def test_a_ridge_is_measured():
    rng = np.random.default_rng(0)
    places = rng.uniform(-5, 5, (4000, 2))
    ridge = 0.6 * (1 - np.abs(places[:, 0]) / 5)
    shape = shape_of(0.86 + ridge + rng.normal(0, 0.03, 4000), places)
    assert shape.sure
    assert shape.rise_m == pytest.approx(0.5, abs=0.1)
    assert abs(shape.high[0]) < 2 < abs(shape.low[0])


def test_people_who_each_keep_to_a_level_slope_against_the_plane_through_both():
    """Two on a stage of 0.5 m, in a world whose ground goes through the middle of either half: each one's way slopes."""
    rng = np.random.default_rng(1)
    n, slope = 4000, 0.06
    who = np.arange(n) % 4
    places = rng.uniform(-2, 2, (n, 2)) + np.column_stack([np.where(who < 2, -2.5, 2.5), np.zeros(n)])
    height = 0.8 + 0.05 * who + np.where(who < 2, 0.0, 0.5) - slope * places[:, 0] + rng.normal(0, 0.02, n)
    shape = shape_of(height, places)
    assert shape.slope_deg == pytest.approx(np.degrees(np.arctan(slope)), abs=3 * shape.slope_sigma_deg)
    assert shape.slope_sigma_deg < 0.2
    level = shape_of(height + slope * places[:, 0], places)
    assert level.slope_deg < 3 * level.slope_sigma_deg
