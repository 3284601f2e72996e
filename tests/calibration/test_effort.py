"""How much of the videos is watched."""

import pytest

from passerby.calibration.effort import Effort, Step, foresee, is_enough, note_of_effort, sizes

AIMED = Effort(target_m=0.05)


def step(used_s, points_m=0.03, ground_m=0.2, verdict="accepted", ended_s=10.0):
    return Step(used_s, ended_s, verdict, points_m, ground_m)


def test_each_step_is_twice_as_long_to_the_end():
    assert [list(sizes(count)) for count in (0, 1, 11)] == [[0], [1], [1, 2, 4, 8, 11]]


@pytest.mark.parametrize(
    ("steps", "enough"),
    [
        ([step(30, 0.01, 0.01)], False),
        ([step(30, 0.04), step(60, 0.03, 0.2)], True),
        ([step(30, 0.10, 0.04), step(60, 0.07, 0.03)], False),
        ([step(30, 0.10, 0.04), step(60, 0.095, 0.03)], False),
        ([step(120, 0.10, 0.04), step(240, 0.095, 0.03)], True),
        ([step(30, 0.04, verdict="doubtful"), step(60, 0.03)], False),
        ([step(120, 0.04, verdict="doubtful"), step(240, 0.03, verdict="doubtful")], False),
        ([step(120, 0.04, verdict="doubtful"), step(240, 0.039, verdict="doubtful")], True),
        ([step(30, None, None, "refused"), step(60, None, None, "refused")], False),
        ([step(60, 0.04, verdict="doubtful"), step(120, 0.039, verdict="doubtful")], False),
    ],
    ids=["not confirmed", "target", "still better", "too little for a missed target", "barely better", "verdict changes",
         "doubt, better", "doubt, settled", "none", "too little for a doubt"],
)  # fmt: skip
def test_it_ends_where_the_target_is_reached_or_more_would_barely_help(steps, enough):
    assert is_enough(steps, AIMED) is enough
    assert not is_enough(steps, Effort(target_m=None))


def test_no_step_is_begun_that_would_take_longer_than_there_is():
    steps = [step(30, None, None, "refused", ended_s=20.0)]
    assert not is_enough(steps, Effort(budget_s=60.0))
    assert is_enough(steps, Effort(budget_s=59.0))


def test_what_more_would_bring_is_foreseen():
    # A constant of 3 cm, and 4 cm after a minute that fall with the time.
    steps = [step(60, 0.05, None), step(240, (0.03**2 + 0.02**2) ** 0.5, None)]
    points, ground = foresee(steps, 960.0)
    assert points == pytest.approx((0.03**2 + 0.01**2) ** 0.5)
    assert ground is None
    note = note_of_effort(steps, 960.0)
    assert (note.values["used_s"], note.values["recorded_s"]) == (240, 960.0)
    assert (note.values["now_points_m"], note.values["points_m"]) == (steps[-1].points_m, points)
    assert note_of_effort(steps, 240.0) is None
