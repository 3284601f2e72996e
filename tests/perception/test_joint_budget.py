"""Whose keypoints are measured: everybody who is seen well, at few times, the same in all cameras."""

import numpy as np
import pytest

from passerby.perception.plan import (
    CROPS_AT_LEAST,
    CROPS_PER_S,
    MIN_HEIGHT_PX,
    MIN_SCORE,
    SLOT_S,
    JointBudget,
    choose_for_keypoints,
)

SIZE = (640, 480)
FPS = 5.0


def people(count: int) -> np.ndarray:
    """So many people side by side."""
    return np.array([[20.0 + 60 * k, 100, 40, 120] for k in range(count)]).reshape(-1, 4)


def chosen(count: int, images: int = 1500, *, fps: float = FPS, known: bool = True, from_s: float = 0.0) -> dict[float, int]:
    """Time -> how many people are chosen there, of so many who are always there."""
    budget = JointBudget(CROPS_PER_S, fps, images if known else None)
    ltwh, score = people(count), np.ones(count)
    times = (from_s + np.arange(images) / fps).tolist()
    return {at: len(rows) for at in times if len(rows := budget.choose(at, ltwh, score, SIZE))}


@pytest.mark.parametrize("count", [1, 3, 9])
@pytest.mark.parametrize("known", [True, False])
def test_the_budget_is_spent_and_not_overdrawn(count: int, known: bool) -> None:
    images = 3000
    allowed = CROPS_PER_S * images / FPS
    spent = sum(chosen(count, images, known=known).values())
    assert spent <= allowed + CROPS_AT_LEAST
    assert spent >= 0.75 * min(allowed, count * images)


def steps_of(times: dict[float, int]) -> list[int]:
    return np.round(np.array(list(times)) * FPS).astype(int).tolist()


def test_the_times_are_spread_over_the_recording_and_neighbouring_images_are_chosen_together() -> None:
    """Between the two, a camera whose clock differs by part of a step is interpolated."""
    steps = steps_of(chosen(6))
    parts = np.histogram(steps, bins=10, range=(0.0, 1500.0))[0]
    assert parts.min() > 0.3 * parts.mean()
    assert SLOT_S * FPS == 2
    assert sum(not {step - 1, step + 1} & set(steps) for step in steps) < 0.1 * len(steps)


def test_a_short_recording_has_keypoints_at_all_times() -> None:
    assert len(chosen(1, 100, fps=60.0)) == 100
    assert len(chosen(6, 10)) > 5
    assert chosen(0, 10) == {}


def test_cameras_with_more_people_choose_among_the_times_of_those_with_fewer() -> None:
    """The first and last seconds aside, where the estimate of how many people there are differs; nobody is left out then."""
    few, many = chosen(3), chosen(9)
    assert (set(few.values()), set(many.values())) == ({3}, {9})
    assert len(set(many) - set(few)) < 0.1 * len(many)


def test_clocks_that_differ_have_times_in_common_whatever_the_difference() -> None:
    first = set(steps_of(chosen(4, 3000)))
    common = [len(first & {step + shift for step in first}) for shift in range(1, 40)]
    assert min(common) > 0.3 * len(first) ** 2 / 3000


@pytest.mark.parametrize(
    ("second", "score", "worth"),
    [
        ([300.0, 100, 40, 120], 1.0, [True, True]),
        ([300.0, 100, 15, MIN_HEIGHT_PX - 1], 1.0, [True, False]),
        ([300.0, 100, 40, 120], MIN_SCORE - 0.01, [True, False]),
        ([600.0, 100, 40, 120], 1.0, [True, False]),  # cut off at the right
        ([25.0, 90, 40, 120], 1.0, [True, False]),  # behind the first, whose feet are lower
        ([25.0, 110, 40, 120], 1.0, [False, True]),  # in front of the first
        ([55.0, 110, 40, 120], 1.0, [True, True]),  # a little of the first is covered
    ],
)
def test_who_is_worth_it(second: list[float], score: float, worth: list[bool]) -> None:
    ltwh = np.vstack([people(1), [second]])
    assert choose_for_keypoints(ltwh, np.array([1.0, score]), SIZE).tolist() == worth


def test_people_who_are_cut_off_count_where_nobody_is_whole() -> None:
    cut = np.array([[100.0, 200, 100, 280]])
    assert choose_for_keypoints(cut, np.ones(1), SIZE).tolist() == [True]
    assert choose_for_keypoints(np.vstack([cut, people(1)]), np.ones(2), SIZE).tolist() == [False, True]
