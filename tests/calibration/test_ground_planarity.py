"""What is told of people's ground that is no plane: a doubt where it makes the rig wrong, a notice where it does not."""

from __future__ import annotations

import pytest

from passerby.calibration.diagnostics.ground_planarity import HARMFUL_M, ground_figures, told_of_ground
from passerby.people.ground_shape import GroundShape


def shape(rise_m: float, chance_sigmas: float = 30.0) -> GroundShape:
    return GroundShape(rise_m, 0.01, (1.0, 2.0), (3.0, 4.0), chance_sigmas)


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
