"""Rigs on plans and on the earth: similarities come back with honest sigmas, and wrong placements are found."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from passerby.geometry.alignment import SeenPoints
from passerby.geometry.geodesy import east_north_up, geodetic, mean_place
from passerby.geometry.plan_fit import Placements, ScalePrior, choose_placements, fit_plan, fits_mirrored
from passerby.geometry.rotations import Similarity

SPOTS = np.array([[0.0, 0.0], [12.0, 1.0], [10.0, 9.0], [1.0, 8.0], [6.0, 4.0]])
SD = 0.03


def placed(count: int, scale: float = 1.0, yaw: float = 0.3, shift: tuple[float, float] = (5.0, -2.0)) -> Placements:
    """Cameras on a plan, without any error."""
    turn = np.array([[np.cos(yaw), -np.sin(yaw)], [np.sin(yaw), np.cos(yaw)]])
    target = SPOTS[:count]
    return Placements(
        target, scale * target @ turn.T + shift, np.arange(count), np.full(count, SD), np.zeros((count, 2, 2)),
        np.zeros((count, 2)),
    )  # fmt: skip


def moved(placements: Placements, row: int, by: tuple[float, float]) -> Placements:
    place = placements.place.copy()
    place[row] += by
    return replace(placements, place=place)


@settings(max_examples=20, deadline=None)
@given(st.integers(2, 5), st.floats(0.5, 2.0), st.floats(-3.1, 3.1), st.tuples(st.floats(-300, 300), st.floats(-300, 300)))
def test_a_known_similarity_comes_back(count: int, scale: float, yaw: float, shift: tuple[float, float]) -> None:
    placements = placed(count, scale, yaw, shift)
    fit = fit_plan(placements)
    assert fit.scale == pytest.approx(scale)
    assert np.cos(fit.yaw - yaw) == pytest.approx(1)
    assert fit.chi_squared == pytest.approx(0, abs=1e-6)
    assert fit.freedom == 2 * count - 4
    np.testing.assert_allclose(fit.on_plan(placements.place), placements.target, atol=1e-6)


def test_the_scale_is_as_sure_as_stated_and_sound_placements_stay() -> None:
    rng, errors = np.random.default_rng(0), []
    for _ in range(300):
        noisy = replace(placed(3), place=placed(3).place + rng.normal(0, np.hypot(SD, 0.003 * 12), (3, 2)))
        fit = fit_plan(noisy)
        errors.append(np.log(fit.scale) / fit.scale_sd)
    assert float(np.std(errors)) == pytest.approx(1, abs=0.12)
    for _ in range(50):
        noisy = replace(placed(5), place=placed(5).place + rng.normal(0, SD, (5, 2)))
        assert choose_placements(noisy, ScalePrior()).used.all()


def test_one_wrong_placement_of_four_is_left_out_and_two_exchanged_ones_of_six_but_of_four_all_are_suspects() -> None:
    for wrong in range(4):
        choice = choose_placements(moved(placed(4), wrong, (0.7, 0.5)), ScalePrior())
        assert choice.used.tolist() == [row != wrong for row in range(4)]
        assert choice.suspects == ()
    for count in (4, 6):
        spots = np.concatenate([SPOTS, [[5.0, 12.0]]])[:count]
        sound = replace(placed(1).take(np.zeros(count, dtype=int)), target=spots, place=spots, group=np.arange(count))
        swapped = replace(sound, place=spots[[1, 0, *range(2, count)]])
        choice = choose_placements(swapped, ScalePrior(0.0, 0.03))
        assert choice.suspects == (tuple(range(4)) if count == 4 else ())
        assert choice.used.tolist() == [count == 4, count == 4, *[True] * (count - 2)]


def test_of_three_the_scale_of_people_decides_and_without_it_all_are_suspects() -> None:
    """Two more metres of twelve are 17 %, which people whose scale is known to 3 % exclude."""
    wrong = moved(placed(3, yaw=0.0), 1, (2.0, -2.0))
    assert choose_placements(wrong, ScalePrior(0.0, 0.03)).used.tolist() == [True, False, True]
    unsure = choose_placements(wrong, ScalePrior(0.0, 1.0))
    assert unsure.used.all()
    assert unsure.suspects == (0, 1, 2)


@pytest.mark.parametrize(("count", "recognised"), [(3, False), (4, True)])
def test_a_mirrored_plan_is_recognised_by_four_placements(count: int, recognised: bool) -> None:
    sound = placed(count)
    mirrored = sound.mirrored()
    assert fits_mirrored(mirrored, choose_placements(mirrored, ScalePrior()), ScalePrior()) == recognised
    assert not fits_mirrored(sound, choose_placements(sound, ScalePrior()), ScalePrior())


@pytest.mark.parametrize("scale", [1e-3, 1e3])
def test_a_wrong_unit_of_the_plan_makes_no_placement_less_sure(scale: float) -> None:
    """Sigmas in metres of the plan are as wrong as the plan: what they are as shares of it stays."""
    right, wrong = fit_plan(placed(4)), fit_plan(placed(4, scale))
    assert placed(4, scale).scale == pytest.approx(scale)
    assert wrong.scale_sd == pytest.approx(right.scale_sd)
    assert wrong.yaw_sd == pytest.approx(right.yaw_sd)


def test_rows_of_one_placement_share_the_error_of_the_plan_and_a_wrong_row_is_left_out_alone() -> None:
    """Seen by five cameras a point is not placed better on the plan than seen by one."""
    target = SPOTS[[0, 1, 1, 1]]
    place = target.copy()
    place[3] += (0.0, 1.5)
    covariance = np.tile(0.02**2 * np.eye(2), (4, 1, 1))
    placements = Placements(target, place, np.array([0, 1, 1, 1]), np.full(4, SD), covariance, np.zeros((4, 2)))
    assert choose_placements(placements, ScalePrior()).used.tolist() == [True, True, True, False]
    one, many = (
        fit_plan(Placements(SPOTS[r], SPOTS[r], r, np.full(len(r), SD), np.zeros((len(r), 2, 2)), np.zeros((len(r), 2))))
        for r in (np.arange(2), np.array([0, 1, 1, 1, 1, 1]))
    )
    assert many.scale_sd > 0.8 * one.scale_sd


@pytest.mark.parametrize("placements", [placed(2).take(np.array([0])), replace(placed(2), target=np.zeros((2, 2)))])
def test_too_few_or_all_on_one_spot_is_an_error(placements: Placements) -> None:
    with pytest.raises(ValueError, match="two placements that are apart"):
        fit_plan(placements)


def test_rays_meet_the_plane_of_their_points_in_front_of_the_camera_only() -> None:
    """A camera 2 m up that looks down at 45 degrees: at the ground, at its own height, above it, and along the ground."""
    down, along = np.array([1.0, 0.0, -1.0]) / np.sqrt(2), np.array([1.0, 0.0, -0.01])
    rays = np.array([down, down, down, along])
    targets = np.array([[0.0, 0.0, 0.0], [0.0, 0.0, 2.0], [0.0, 0.0, 3.0], [0.0, 0.0, 0.0]])
    seen = SeenPoints(np.tile([5.0, 1.0, 2.0], (4, 1)), rays, targets, np.arange(4), np.full(4, 0.01), np.full(4, 0.001))
    met = seen.on_plane(Similarity(1.0, np.eye(3), np.zeros(3)))
    np.testing.assert_allclose(met[0], [7.0, 1.0])
    assert np.isnan(met[1:]).all()


ORIGINS = [(52.52, 13.405, 36.0), (0.0, 0.0, 0.0), (-33.9, 151.2, 800.0), (89.9, -170.0, 10.0), (64.1, 180.0, -30.0)]


@pytest.mark.parametrize("origin", ORIGINS)
def test_metres_around_a_place_on_earth_come_back(origin):
    enu = np.random.default_rng(0).uniform(-10_000, 10_000, (500, 3)) * (1, 1, 0.05)
    places = geodetic(enu, np.array(origin))
    assert east_north_up(places, np.array(origin)) == pytest.approx(enu, abs=1e-6)
    assert (np.abs(places[:, 1]) <= 180).all()


def test_a_second_of_latitude_and_longitude() -> None:
    """52 degrees north, from the radii of curvature of WGS 84."""
    second = 1 / 3600
    moved = east_north_up(
        np.array([[52 + second, 13, 100], [52, 13 + second, 100], [52, 13, 107.0]]), np.array([52.0, 13.0, 100.0])
    )
    a, e2 = 6378137.0, 0.00669437999014
    w = np.sqrt(1 - e2 * np.sin(np.radians(52)) ** 2)
    meridian, across = a * (1 - e2) / w**3 + 100, (a / w + 100) * np.cos(np.radians(52))
    expected = [(0, meridian * np.radians(second), 0), (across * np.radians(second), 0, 0), (0, 0, 7)]
    np.testing.assert_allclose(moved, expected, atol=1e-3)
    assert moved[2] == pytest.approx((0, 0, 7), abs=1e-6)


def test_the_poles_and_the_date_line() -> None:
    pole = geodetic(np.zeros((1, 3)), np.array([90.0, 0.0, 25.0]))[0]
    assert pole[[0, 2]] == pytest.approx([90.0, 25.0], abs=1e-7)
    middle = mean_place(np.array([[1.0, 179.9, 0], [1, -179.9, 2]]))
    assert (middle[0], abs(middle[1]), middle[2]) == pytest.approx((1, 180, 1))
