"""A rig laid upon a plan: the similarity comes back, its sigma holds, and wrong placements are found."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from passerby.geometry.plan_fit import Placements, ScalePrior, choose_placements, fit_plan, fits_mirrored

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


def test_the_scale_is_as_sure_as_stated() -> None:
    rng = np.random.default_rng(0)
    errors = []
    for _ in range(300):
        placements = placed(3)
        noisy = replace(placements, place=placements.place + rng.normal(0, np.hypot(SD, 0.003 * 12), (3, 2)))
        fit = fit_plan(noisy)
        errors.append(np.log(fit.scale) / fit.scale_sd)
    assert float(np.std(errors)) == pytest.approx(1, abs=0.12)


@pytest.mark.parametrize("wrong", range(4))
def test_one_wrong_placement_of_four_is_left_out(wrong: int) -> None:
    choice = choose_placements(moved(placed(4), wrong, (0.7, 0.5)), ScalePrior())
    assert choice.used.tolist() == [row != wrong for row in range(4)]
    assert choice.suspects == ()


def test_of_four_two_exchanged_ones_make_all_suspects_and_of_six_they_are_left_out() -> None:
    for count in (4, 6):
        spots = np.concatenate([SPOTS, [[5.0, 12.0]]])[:count]
        sound = replace(placed(1).take(np.zeros(count, dtype=int)), target=spots, place=spots, group=np.arange(count))
        swapped = replace(sound, place=spots[[1, 0, *range(2, count)]])
        choice = choose_placements(swapped, ScalePrior(0.0, 0.03))
        assert choice.suspects == (tuple(range(4)) if count == 4 else ())
        assert choice.used.tolist() == [count == 4, count == 4, *[True] * (count - 2)]


def test_sound_placements_stay() -> None:
    rng = np.random.default_rng(1)
    for _ in range(50):
        placements = placed(5)
        noisy = replace(placements, place=placements.place + rng.normal(0, SD, (5, 2)))
        assert choose_placements(noisy, ScalePrior()).used.all()


def test_of_three_the_scale_of_people_decides_and_without_it_all_are_suspects() -> None:
    """Two more metres of twelve are 17 %, which people whose scale is known to 3 % exclude."""
    wrong = moved(placed(3, yaw=0.0), 1, (2.0, -2.0))
    assert choose_placements(wrong, ScalePrior(0.0, 0.03)).used.tolist() == [True, False, True]
    unsure = choose_placements(wrong, ScalePrior(0.0, 1.0))
    assert unsure.used.all()
    assert unsure.suspects == (0, 1, 2)


@pytest.mark.parametrize(("count", "told"), [(3, False), (4, True)])
def test_a_mirrored_plan_is_recognised_by_four_placements(count: int, told: bool) -> None:
    sound = placed(count)
    mirrored = sound.mirrored()
    assert fits_mirrored(mirrored, choose_placements(mirrored, ScalePrior()), ScalePrior()) == told
    assert not fits_mirrored(sound, choose_placements(sound, ScalePrior()), ScalePrior())


@pytest.mark.parametrize("scale", [1e-3, 1e3])
def test_a_wrong_unit_of_the_plan_makes_no_placement_less_sure(scale: float) -> None:
    """Sigmas in metres of the plan are as wrong as the plan: what they are as shares of it stays."""
    right, wrong = fit_plan(placed(4)), fit_plan(placed(4, scale))
    assert placed(4, scale).scale == pytest.approx(scale)
    assert wrong.scale_sd == pytest.approx(right.scale_sd)
    assert wrong.yaw_sd == pytest.approx(right.yaw_sd)


def test_one_wrong_row_of_a_placement_that_several_show_is_left_out_alone() -> None:
    target = SPOTS[[0, 1, 1, 1]]
    place = target.copy()
    place[3] += (0.0, 1.5)
    covariance = np.tile(0.02**2 * np.eye(2), (4, 1, 1))
    placements = Placements(target, place, np.array([0, 1, 1, 1]), np.full(4, SD), covariance, np.zeros((4, 2)))
    assert choose_placements(placements, ScalePrior()).used.tolist() == [True, True, True, False]


def test_rows_of_one_placement_share_the_error_of_the_plan() -> None:
    """Seen by five cameras a point is not placed better on the plan than seen by one."""
    one = Placements(SPOTS[:2], SPOTS[:2], np.arange(2), np.full(2, SD), np.zeros((2, 2, 2)), np.zeros((2, 2)))
    rows = np.array([0, 1, 1, 1, 1, 1])
    many = Placements(SPOTS[rows], SPOTS[rows], rows, np.full(6, SD), np.zeros((6, 2, 2)), np.zeros((6, 2)))
    assert fit_plan(many).scale_sd > 0.8 * fit_plan(one).scale_sd


@pytest.mark.parametrize("placements", [placed(2).take(np.array([0])), replace(placed(2), target=np.zeros((2, 2)))])
def test_too_few_or_all_on_one_spot_is_an_error(placements: Placements) -> None:
    with pytest.raises(ValueError, match="two placements that are apart"):
        fit_plan(placements)
