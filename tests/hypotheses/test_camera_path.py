"""A camera over time: derivatives of what it sees, the best stretch of time, and a search without identities."""

import numpy as np
import pytest

from passerby.core.cameras import Pose
from passerby.geometry.rotations import angle_between, exp_rotation
from passerby.hypotheses.camera_path import CameraPath, Knots, Stretches, _stepped, fit_path, residuals_along
from passerby.hypotheses.case import blocks_of
from passerby.hypotheses.changes import PoseChange, measure_step
from passerby.hypotheses.stretches import LEAST_TOGETHER, _searched, best_stretches, is_suspicious
from support.scenes.sightings_of_places import MOVED, PEOPLE, POSE, seen

CHANGE = np.array([[0.02, -0.05, 0.01, 0.1, -0.2, 0.05, 0.1]])
FREE = np.arange(7)


def test_derivatives_along_a_path_are_those_of_the_residuals() -> None:
    """By the path's own unknowns, and by a change in a stretch of time; a focal length to first order in the residual."""
    m, step = seen(MOVED, count=40, noise=0.0), 1e-6
    path = CameraPath(MOVED, -0.1, (0.3, 0.01), 5.0, Stretches(((-np.inf, np.inf),)), CHANGE)
    path = fit_path(m, path, tuple(FREE))
    own, there = residuals_along(m, path).by_change()
    for unknown in range(16):
        by_own, by_change = np.split(np.eye(16)[unknown], [9])
        ends = [
            residuals_along(m, _stepped(path, sign * step * by_own, sign * step * by_change[None], FREE)).found.residual
            for sign in (-1.0, 1.0)
        ]
        of_focal = unknown in (6, 15)
        found = own[:, unknown] if unknown < 9 else there[:, unknown - 9]
        np.testing.assert_allclose(
            found, (ends[1] - ends[0]) / (2 * step), rtol=0.05 if of_focal else 1e-4, atol=0.1 if of_focal else 0.01
        )


def test_the_basis_of_a_drift_is_0_on_the_mean_and_the_stretch_and_the_rest_can_be_exchanged() -> None:
    instants = np.array([0, 1, 2, 7, 9, 20])
    np.testing.assert_allclose(Knots.even(instants, 4).at(instants).mean(axis=0), 0.0, atol=1e-12)
    back = CameraPath(POSE, 0.1, times=Stretches(((3, 9),)), change=CHANGE).exchanged().exchanged()
    np.testing.assert_allclose(back.pose.R_cw, POSE.R_cw, atol=1e-12)
    np.testing.assert_allclose(back.pose.centre, POSE.centre, atol=1e-12)
    np.testing.assert_allclose(back.coefficients, CHANGE)


def test_a_camera_that_was_turned_is_found_by_the_trajectory_of_one_tracklet_whatever_its_number() -> None:
    far = Pose.from_centre(exp_rotation(np.array([0.1, 0.5, 0.1])) @ POSE.R_cw, POSE.centre)
    for number in (0, 7):
        part = seen(POSE, count=PEOPLE * 3 * LEAST_TOGETHER, noise=0.2, tracklet={2: number})
        found = [one.pose.R_cw for one in _searched(part, CameraPath(far))]
        assert min(np.degrees(angle_between(one, POSE.R_cw)) for one in found) < 0.5


def brute_stretch(costs: np.ndarray, middle: bool) -> float:
    """Least cost over all pairs of views and all stretches of a kind."""
    n, count = costs.shape
    best = float(costs.sum(axis=1).min())
    for a in range(n):
        for b in range(n):
            for first in range(count if a != b else 0):
                for last in range(first + 1, count + 1):
                    if (first > 0 and last < count) == middle and last - first < count:
                        best = min(best, costs[a].sum() + (costs[b] - costs[a])[first:last].sum())
    return float(best)


@pytest.mark.parametrize("middle", [False, True])
@pytest.mark.parametrize("seed", range(8))
def test_the_stretch_is_the_best_of_all_pairs_of_views_and_all_stretches(seed: int, middle: bool) -> None:
    rng = np.random.default_rng(seed)
    costs = rng.uniform(0.0, 25.0, (3, 24))
    begin, end = sorted(rng.choice(25, 2, replace=False).tolist())
    costs[1, begin:end] *= 0.2
    best = best_stretches(costs, 2 if middle else 1)
    found = costs.sum(axis=1).min()
    if best is not None:
        found = np.where(best.inside, costs[best.other], costs[best.main]).sum()
    assert found == pytest.approx(brute_stretch(costs, middle))


@pytest.mark.parametrize("seed", range(8))
def test_any_number_of_stretches_is_the_best_of_all_with_a_price_for_each_switch(seed: int) -> None:
    rng = np.random.default_rng(seed)
    costs = rng.uniform(0.0, 6.0, (3, 12))
    costs[1, 2:4] = costs[1, 6:9] = 0.0
    least = min(
        np.where(inside, costs[other], costs[main]).sum() + np.log(12) * np.count_nonzero(np.diff(inside))
        for bits in range(1 << 12)
        for inside in [np.array([bits >> row & 1 for row in range(12)], dtype=bool)]
        for main in range(3)
        for other in range(3)
    )
    best = best_stretches(costs, None)
    if best is None:  # fewer than three switches are best
        fewer = [costs.sum(axis=1).min()]
        for switches in (1, 2):
            one = best_stretches(costs, switches)
            if one is not None:
                fewer.append(np.where(one.inside, costs[one.other], costs[one.main]).sum() + switches * np.log(12))
        assert min(fewer) == pytest.approx(least)
    else:
        switched = np.count_nonzero(np.diff(best.inside))
        assert switched >= 3
        found = np.where(best.inside, costs[best.other], costs[best.main]).sum()
        assert found + switched * np.log(12) == pytest.approx(least)


def test_stretches_are_the_runs_of_the_instants_inside() -> None:
    instants = np.array([0, 2, 2, 5, 9, 12])
    stretches = Stretches.of(instants, np.array([True, False, False, True, True, False]))
    assert stretches == Stretches(((-np.inf, 0.0), (5.0, 9.0)))
    assert stretches.switches == 3
    np.testing.assert_array_equal(stretches.at(instants)[:, 0], [1, 0, 0, 1, 1, 0])
    assert Stretches(()).switches == 0


def suspicious(zoom: float | np.ndarray, seed: int) -> bool:
    m = seen(POSE, zoom, count=400, seed=seed)
    whole = fit_path(m, CameraPath(POSE))
    return is_suspicious(m, whole, blocks_of(m.own.step, m.own.identity, 0.5)[0], np.log(0.05 / 4))


def test_a_change_is_searched_for_only_where_it_predicts_people_who_were_held_out() -> None:
    """The noise of a few people seems to move every camera a little, on the people that it is fitted to."""
    row = np.arange(400)
    assert not any(suspicious(1.0, seed) for seed in range(20))
    for inside in (row > 250, (row > 100) & (row < 220)):
        assert all(suspicious(np.where(inside, 1.06, 1.0), seed) for seed in range(20))


def change(other: Pose, zoom: float = 1.0) -> PoseChange:
    """As found by a rig that the change has bent."""
    return PoseChange(((10, 40),), False, True, POSE, other, 99.0, 5.0, 0.1, zoom)


@pytest.mark.parametrize("zoom", [0.7, 1.4])
def test_a_zoom_is_measured_where_the_camera_stays(zoom: float) -> None:
    found = measure_step(seen(POSE, zoom, noise=0.3), POSE, change(POSE), 0.5, 4)
    assert found.zoom == pytest.approx(zoom, rel=0.02)
    assert (found.metres, found.degrees) == (pytest.approx(0.0, abs=1e-9), pytest.approx(0.0, abs=1e-4))


@pytest.mark.parametrize(("zoom", "noise", "within_m"), [(0.8, 0.2, 0.15), (1.3, 0.2, 0.15), (1.0, 0.3, 0.1)])
def test_a_camera_that_was_moved_is_measured_with_its_zoom_if_any(zoom: float, noise: float, within_m: float) -> None:
    found = measure_step(seen(MOVED, zoom, noise=noise), POSE, change(MOVED, zoom), 0.5, 4)
    assert found.zoom == (pytest.approx(zoom, rel=0.03) if zoom != 1.0 else 1.0)
    np.testing.assert_allclose(found.other.centre, MOVED.centre, atol=within_m)
