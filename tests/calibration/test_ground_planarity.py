"""What is told of people's ground that is no plane: a doubt where it makes the rig wrong, a notice where it does not."""

from __future__ import annotations

from dataclasses import replace

import pytest

from passerby.calibration.diagnostics.ground_planarity import (
    HARMFUL_M,
    STEEP_DEG,
    STEEP_SIGMAS,
    ground_figures,
    shape_of,
    told_of_ground,
)
from passerby.core.cameras import Rig
from passerby.core.solution import Solution
from passerby.people.ground_shape import GroundShape
from support.scenes.people_and_rigs import simulated


def shape(rise_m: float, chance_sigmas: float = 30.0, slope: tuple[float, float] = (0.1, 0.1)) -> GroundShape:
    return GroundShape(rise_m, 0.01, (1.0, 2.0), (3.0, 4.0), chance_sigmas, *slope)


@pytest.mark.parametrize(("tilt_known", "severity"), [(False, "doubt"), (True, "notice")])
def test_ways_that_slope_are_told_where_they_do_beyond_chance(tilt_known: bool, severity: str) -> None:
    steep = shape(0.001, slope=(1.1 * STEEP_DEG, 0.9 * STEEP_DEG / STEEP_SIGMAS))
    ((told,),) = [found for found in told_of_ground(steep, tilt_known=tilt_known) if found]
    assert (told.code, told.severity) == ("people_on_levels", severity)
    assert told.values == {"slope_deg": steep.slope_deg, "sigma_deg": steep.slope_sigma_deg}


@pytest.mark.parametrize("slope", [(0.9 * STEEP_DEG, 0.01), (2.0 * STEEP_DEG, 2.1 * STEEP_DEG / STEEP_SIGMAS)])
def test_ways_that_slope_a_little_or_by_chance_are_level(slope: tuple[float, float]) -> None:
    assert told_of_ground(shape(0.001, slope=slope)) == ((), ())


def test_a_rise_that_makes_the_rig_wrong_is_a_doubt_with_its_places() -> None:
    ((doubt,), notices) = told_of_ground(shape(1.5 * HARMFUL_M))
    assert (doubt.code, doubt.severity, notices) == ("ground_uneven", "doubt", ())
    assert doubt.values == {"rise_m": 1.5 * HARMFUL_M, "at": [[1.0, 2.0], [3.0, 4.0]]}


@pytest.mark.parametrize(("rise_m", "tilt_known"), [(0.8 * HARMFUL_M, False), (3 * HARMFUL_M, True)])
def test_a_smaller_one_or_one_beside_a_known_vertical_is_a_notice(rise_m: float, tilt_known: bool) -> None:
    (doubts, (notice,)) = told_of_ground(shape(rise_m), tilt_known=tilt_known)
    assert (doubts, notice.code, notice.severity) == ((), "ground_uneven", "notice")


def test_in_a_world_of_known_places_the_solvers_coordinates_are_not_told() -> None:
    ((doubt,), _) = told_of_ground(shape(2 * HARMFUL_M), placed=True)
    assert doubt.values["at"] is None


@pytest.mark.parametrize("none", [None, shape(0.001), shape(2 * HARMFUL_M, chance_sigmas=0.5)])
def test_nothing_is_told_of_a_plane_or_of_what_chance_makes(none: GroundShape | None) -> None:
    assert told_of_ground(none) == ((), ())


def test_the_figures_of_a_report() -> None:
    assert ground_figures(None) is None
    figures = ground_figures(shape(0.4))
    assert figures is not None
    assert (figures.rise_m, figures.low, figures.high, figures.chance_sigmas) == (0.4, (1.0, 2.0), (3.0, 4.0), 30.0)
    assert (figures.slope_deg, figures.slope_sigma_deg) == (0.1, 0.1)


def test_two_cameras_tell_the_shape_of_the_ground_and_one_does_not() -> None:
    """People who walk on a plane, seen by true cameras."""
    scene = simulated("terrace", 20.0, 0)
    posed = [Rig(tuple(c if n < count else replace(c, pose=None) for n, c in enumerate(scene.rig))) for count in (1, 2, 4)]
    one, two, all_four = (shape_of(Solution("people", rig, "accepted"), scene.observations, 1.72) for rig in posed)
    assert one is None
    for found in (two, all_four):
        assert found is not None
        assert not found.sure
        assert told_of_ground(found) == ((), ())
