"""Scale cues, carried sticks among them: each pulls the scale to its value by its weight, and what contradicts is reported."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from passerby.calibration.diagnostics.verdict import find_unusual_heights
from passerby.common.errors import InputError
from passerby.core.figures import CueFigures
from passerby.core.observations import CameraObservations, Clock, Keypoints, Observations
from passerby.core.scale_cues import (
    MOST_STEPS,
    CameraDistance,
    CameraHeight,
    KnownLength,
    PersonHeight,
    PopulationHeight,
    ScaleCues,
    Wand,
    lengths_of_wands,
)
from passerby.core.solution import Solution
from passerby.core.synchronisation import resample_to_common_steps
from passerby.evaluation.metrics import compare
from passerby.solver.cues import (
    POPULATION_BIAS,
    cue_rows,
    expected_heights,
    initial_scale,
    measure_cues,
    population_spread,
    scale_cue_lengths,
    triangulate_marks,
    unexplained_spread,
    unusual_people,
)
from passerby.solver.people import PeopleOptions
from support.scenes.exact_sightings import poses_of
from support.scenes.people_and_rigs import part, simulated, solve
from support.scenes.wands import carried_wand, with_wands

TRUTH = simulated("terrace", seconds=8.0)
SEEN = part(TRUTH.observations)
QUICK = PeopleOptions(coarse_people=150)
# What the population says is wrong and little believed, so that a cue has to do it alone.
VAGUE = PopulationHeight(1.5, 0.5)
TRUE_DISTANCE = float(np.linalg.norm(TRUTH.rig["C1"].centre - TRUTH.rig["C3"].centre))
TRUE_HEIGHT = float(TRUTH.rig["C2"].centre[2])
ENDS = np.array([[-1.8, 0.5, 0.0], [1.8, 0.5, 0.0]])
POSES = poses_of(TRUTH.rig)
WAND = Wand(("tip", "grip"), 1.0, 0.002)


def length(metres: float, sd_m: float = 0.01, cameras: tuple[str, ...] = ("C1", "C2", "C3")) -> KnownLength:
    """3.6 m on the ground, marked to the pixel, whatever `metres` says of it."""
    return KnownLength(metres, sd_m, {name: np.round(TRUTH.rig[name].project(ENDS)) for name in cameras})


def solved(cues: ScaleCues, observations: Observations = SEEN) -> Solution:
    return solve(TRUTH.rig, observations, cues, QUICK)


def weighted(solution: Solution) -> list[CueFigures]:
    """The cues of the adjustment, without those that are only compared with them."""
    return [cue for cue in solution.figures.scale.cues if cue.share > 0]


def scale_of(solution: Solution) -> float:
    return compare(solution.rig, TRUTH.rig).scale_ratio


@cache
def vague_scale() -> float:
    return scale_of(solved(ScaleCues(VAGUE)))


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "cues", "tolerance"),
    [
        ("length", ScaleCues(VAGUE, lengths=(length(3.6 * 1.2),)), 0.01),
        ("distance", ScaleCues(VAGUE, distances=(CameraDistance(("C1", "C3"), TRUE_DISTANCE * 1.2, 0.01),)), 0.01),
        ("camera height", ScaleCues(VAGUE, camera_heights=(CameraHeight("C2", TRUE_HEIGHT * 1.2, 0.002),)), 0.02),
        ("height of one person", ScaleCues(VAGUE, (PersonHeight(2, TRUTH.heights[2] * 1.2, 0.002),)), 0.04),
    ],
)
def test_each_cue_pulls_the_scale_to_its_value(name: str, cues: ScaleCues, tolerance: float) -> None:
    """All lengths stated 20 % too long, so the world must come out 20 % too large."""
    assert abs(vague_scale() - 1.2) > 0.1
    solution = solved(cues)
    assert scale_of(solution) == pytest.approx(1.2, rel=tolerance)
    (item,) = [item for item in weighted(solution) if not item.cue.startswith("population")]
    assert abs(item.residual_sigmas) < 1.5
    assert item.share > 0.9
    assert name.split()[0] in item.cue


@pytest.mark.slow
def test_shares_sum_to_one_and_go_with_the_sigmas() -> None:
    """Two distances that contradict by a fifth, one known half as well: the scale lies at the weighted mean of the two."""
    stated = ((TRUE_DISTANCE, 0.02), (1.2 * TRUE_DISTANCE, 0.04))
    solution = solved(ScaleCues(VAGUE, distances=tuple(CameraDistance(("C1", "C3"), *one) for one in stated)))
    report = weighted(solution)
    assert sum(item.share for item in report) == pytest.approx(1)
    first, second = report[-2:]
    assert scale_of(solution) == pytest.approx(0.8 * 1.0 + 0.2 * 1.2, abs=0.01)
    assert first.share > 2 * second.share
    # Both are reported as contradicted: by 4 % of the distance in 2 cm, by 16 % in 4 cm.
    assert first.residual_sigmas == pytest.approx(0.04 * TRUE_DISTANCE / 0.02, rel=0.3)
    assert second.residual_sigmas == pytest.approx(-0.16 * TRUE_DISTANCE / 0.04, rel=0.3)


@pytest.mark.slow
def test_a_cue_against_precise_people_is_reported_with_its_residual() -> None:
    mean = float(np.mean(list(TRUTH.heights.values())))
    loose = ScaleCues(PopulationHeight(mean, 0.03), distances=(CameraDistance(("C1", "C3"), 1.6 * TRUE_DISTANCE, 2.7),))
    solution = solved(loose)
    population, distance = weighted(solution)
    assert population.cue.startswith("population of")
    assert abs(population.residual_sigmas) < 2
    assert distance.residual_sigmas < -2
    assert distance.share < 0.3
    assert distance.measured_m == pytest.approx(TRUE_DISTANCE, rel=0.06)
    assert distance.stated_m == pytest.approx(1.6 * TRUE_DISTANCE)


@pytest.mark.slow
def test_the_scales_sigma_shrinks_with_each_cue() -> None:
    heights = (CameraHeight("C2", TRUE_HEIGHT, 0.02),)
    every = (ScaleCues(), ScaleCues(camera_heights=heights), ScaleCues(camera_heights=heights, lengths=(length(3.6),)))
    sigmas = [solved(cues).figures.scale.relative_sigma for cues in every]
    assert 0.06 > sigmas[0] > sigmas[1] > sigmas[2]
    assert sigmas[0] > 0.02
    assert sigmas[2] < 0.01


def test_people_of_stated_heights_are_not_of_the_population() -> None:
    cues, identities = ScaleCues(people=(PersonHeight(7, 1.9, 0.01),)), np.array([3, 7, 9])
    mean, sd = expected_heights(cues, identities)
    assert mean.tolist() == [1.72, 1.9, 1.72]
    assert sd[1] == 0.01
    # The mean of the two others is known to their own spread and to what all people have in common.
    assert sd[0] / np.sqrt(2) == pytest.approx(np.hypot(0.09 / np.sqrt(2), POPULATION_BIAS * 1.72))
    assert np.isnan(population_spread(cues, identities)).tolist() == [False, True, False]


def test_rows_measure_the_true_rig_and_cues_on_cameras_outside_it_are_left_out() -> None:
    distances, heights = (CameraDistance(("C1", "C3"), 1.0, 0.1),), (CameraHeight("C2", 1.0, 0.1),)
    rows = cue_rows(ScaleCues(lengths=(length(3.0),), distances=distances, camera_heights=heights), TRUTH.rig)
    marks = triangulate_marks(rows, *POSES)
    np.testing.assert_allclose(marks, ENDS, atol=0.03)
    values = [value for _, value, _, _ in scale_cue_lengths(rows, *POSES, marks)]
    np.testing.assert_allclose(values, [3.6, TRUE_DISTANCE, TRUE_HEIGHT], atol=0.03)
    outside = {"distances": (CameraDistance(("C1", "Z"), 5.0, 0.1),), "camera_heights": (CameraHeight("Z", 5.0, 0.1),)}
    rows = cue_rows(ScaleCues(lengths=(length(3.6, cameras=("C1", "C2")),), **outside), TRUTH.rig)
    assert (len(rows.lengths), len(rows.distances), len(rows.heights)) == (1, 0, 0)
    assert cue_rows(ScaleCues(), TRUTH.rig) is cue_rows(ScaleCues(**outside), TRUTH.rig) is None
    # NaN pixels stand for any mark outside what the lens can express.
    marks = {"C1": np.array([[1.0, 2.0], [np.nan, 3.0]]), "C2": np.zeros((2, 2))}
    with pytest.raises(InputError, match="camera C1"):
        cue_rows(ScaleCues(lengths=(KnownLength(1.0, 0.1, marks),)), TRUTH.rig)


def test_first_scale_weighs_people_against_cues() -> None:
    for sd_m, scale in ((0.001, 2), (100.0, 1)):
        rows = cue_rows(ScaleCues(distances=(CameraDistance(("C1", "C3"), 2 * TRUE_DISTANCE, sd_m),)), TRUTH.rig)
        assert initial_scale(rows, *POSES, np.zeros((0, 3)), 5, 0.05) == pytest.approx(scale, abs=0.01)
    assert initial_scale(None, *POSES, np.zeros((0, 3)), 0, 0.05) == 1.0


TALL = [1.45, 1.41, 1.52, 1.48, 1.44, 1.56, 2.32, 2.11, 3.0]


@pytest.mark.parametrize(
    ("heights", "spread", "unusual"),
    [
        (TALL, 0.052, [6, 7]),  # the last is of unknown height
        ([1.7, 1.72, 3.0, 1.69, np.nan], 0.052, []),
        ([1.2, 1.25, 1.3, 1.7, 1.75, 1.8, 1.72, np.nan], 0.052, []),
        ([1.2, 1.72, 1.7, 1.75, 1.68, 1.8, np.nan], 0.22 / 1.52, []),
    ],
    ids=["giants", "too few people", "nearly as many children as adults", "a mixed population"],
)
def test_who_is_far_taller_than_most_is_unusual(heights, spread, unusual):
    known = np.arange(len(heights)) < len(heights) - 1
    assert np.flatnonzero(unusual_people(np.array(heights), known, np.full(len(heights), spread))).tolist() == unusual


def test_people_who_differ_by_more_than_a_population_make_the_scale_unsure():
    """Chance is allowed for; of four people on stilts among seven no one can say who is as expected."""
    spread, rng = np.full(7, 0.052), np.random.default_rng(5)
    ordinary = [unexplained_spread(1.72 * np.exp(rng.normal(0.0, np.hypot(0.052, 0.04), 7)), spread) for _ in range(400)]
    assert np.mean(np.array(ordinary) == 0.0) > 0.95
    assert max(ordinary) < 0.08
    stilts = np.array([1.7, 1.65, 1.8, 2.45, 2.4, 2.5, 2.44])
    assert 0.1 < unexplained_spread(stilts, spread) < np.log(stilts).std(ddof=1)
    assert unexplained_spread(stilts[:1], spread[:1]) == unexplained_spread(stilts[:0], spread[:0]) == 0.0


def test_a_poster_among_people_does_not_change_the_metre():
    cameras = {}
    for name, seen in SEEN.cameras.items():
        ltwh = seen.boxes.ltwh.copy()
        rows = np.isin(seen.boxes.identity, TRUTH.identities[:1])
        ltwh[rows, 1] -= 0.5 * ltwh[rows, 3]
        ltwh[rows, 3] *= 1.5
        cameras[name] = CameraObservations(replace(seen.boxes, ltwh=ltwh), seen.keypoints)
    before, after = (solved(ScaleCues(), seen) for seen in (SEEN, Observations(cameras, SEEN.fps)))
    assert scale_of(after) == pytest.approx(scale_of(before), rel=0.02)
    (cue,) = weighted(after)
    assert cue.count == len(TRUTH.identities) - 1
    assert before.figures.people.unusual is None
    assert after.figures.people.unusual == (TRUTH.identities[0],)
    (notice,) = find_unusual_heights(after.figures.people)
    assert (notice.code, notice.severity, notice.values["identities"]) == ("people_unusual", "notice", [TRUTH.identities[0]])
    assert notice.values["low_m"] == notice.values["high_m"] > 1.3 * notice.values["usual_m"]
    assert find_unusual_heights(before.figures.people) == find_unusual_heights(None) == ()


def seen(noise_px: float = 1.0, seed: int = 3) -> Observations:
    return with_wands(SEEN, carried_wand(TRUTH, np.random.default_rng(seed), noise_px=noise_px))


def solved_by_wand(observations: Observations, wand: Wand = WAND, **population: PopulationHeight) -> Solution:
    return solved(ScaleCues(lengths=lengths_of_wands((wand,), observations), **population), observations)


def measured(observations: Observations):
    """The wand, by the true rig."""
    rows = cue_rows(ScaleCues(lengths=lengths_of_wands((WAND,), observations)), TRUTH.rig)
    return measure_cues(rows, *POSES, triangulate_marks(rows, *POSES))


def test_a_wand_is_a_length_at_each_time_step_that_two_cameras_see() -> None:
    """One that was marked by hand at three times under one name is one cue, known no better than it is stated."""
    observations = seen()
    lengths = lengths_of_wands((WAND,), observations)
    assert 10 < len(lengths) <= MOST_STEPS
    assert all(len(one.points) > 1 and one.name == "wand tip to grip" for one in lengths)
    none = {name: Keypoints.empty(camera.wands.joints) for name, camera in observations.cameras.items()}
    alone = with_wands(observations, none | {"C1": observations["C1"].wands})
    assert lengths_of_wands((WAND,), alone) == ()
    by_hand = tuple(KnownLength(1.0, 0.01, one.points, "length stick") for one in lengths_of_wands((WAND,), seen(0.0))[:3])
    rows = cue_rows(ScaleCues(lengths=by_hand), TRUTH.rig)
    assert rows.names == ("length stick",)
    assert np.sum(1 / rows.lengths[:, 1] ** 2) == pytest.approx(1 / 0.01**2)


def test_a_wand_sets_the_scale_and_the_error_of_its_stated_length_does_not_shrink_with_the_time_steps() -> None:
    solution = solved_by_wand(seen())
    sigma = solution.figures.scale.relative_sigma
    assert sigma < 0.01
    assert scale_of(solution) == pytest.approx(1.0, abs=3 * sigma)
    (wand,) = [cue for cue in solution.figures.scale.cues if cue.kind == "length"]
    assert wand.cue == "wand tip to grip"
    assert wand.count == len(lengths_of_wands((WAND,), seen()))
    assert wand.share > 0.8
    assert wand.measured_m == pytest.approx(1.0, abs=3 * wand.sd_m)
    assert scale_of(solution) * wand.own_scale == pytest.approx(1.0, abs=3 * wand.own_sigma)
    assert 0.002 < wand.own_sigma < 0.006
    assert compare(solution.rig, TRUTH.rig).similarity.mean_position_mm < 40
    loose = solved_by_wand(seen(), replace(WAND, sd_m=0.05))
    assert 0.05 <= next(cue for cue in loose.figures.scale.cues if cue.kind == "length").sd_m < 0.055


def test_people_who_contradict_a_wand_are_reported_and_it_wins() -> None:
    """People whose mean height is stated 5 % too tall, and to be known to 1 cm."""
    mean = float(np.mean(list(TRUTH.heights.values())))
    solution = solved_by_wand(seen(0.5), population=PopulationHeight(1.05 * mean, 0.02, 0.01))
    assert "scale_cues_disagree" in [finding.code for finding in solution.findings]
    assert scale_of(solution) == pytest.approx(1.0, abs=0.02)  # 1.05 by the people


@pytest.mark.parametrize("noise_px", [1.0, 4.0])
def test_noise_makes_a_length_neither_longer_nor_surer_than_it_is(noise_px: float) -> None:
    """By the true rig, over many draws: the mean of the lengths is the true one, and their spread is the stated sigma."""
    found = [measured(seen(noise_px, seed)) for seed in range(25)]
    ratio = np.array([(one.metres[0] - 1.0) / one.sigma_m[0] for one in found])
    assert abs(np.mean(ratio)) < 1.0
    assert 0.4 < np.sqrt(np.mean(ratio**2)) < 1.4


def test_false_ends_do_not_count_and_a_turning_wand_keeps_its_length_between_samples() -> None:
    """One mark in eight is elsewhere. Between five samples a second, straight lines would shorten a wand by 2 to 4 %."""
    observations, rng = seen(), np.random.default_rng(5)
    false = {}
    for name, camera in observations.cameras.items():
        xy = camera.wands.xy.copy()
        wrong = rng.random(len(xy)) < 0.125
        xy[wrong] = rng.uniform(0, 300, (int(wrong.sum()), 2, 2))
        false[name] = replace(camera.wands, xy=xy)
    right, found = measured(observations), measured(with_wands(observations, false))
    assert found.metres[0] == pytest.approx(right.metres[0], abs=2 * right.sigma_m[0])
    truth = simulated("terrace", seconds=8.0, clock_offsets=0.4)
    exact = with_wands(part(truth.observations), carried_wand(truth, np.random.default_rng(3), noise_px=0.0))
    clocks = {name: Clock(truth.options.fps, offset) for name, offset in truth.clock_offsets.items()}
    steps = resample_to_common_steps(exact, clocks)
    assert len(lengths_of_wands((WAND,), steps)) > 10
    assert measured(steps).metres[0] == pytest.approx(1.0, abs=0.005)


@pytest.mark.parametrize(
    ("cues", "unit"),
    [
        (ScaleCues(lengths=lengths_of_wands((Wand(("tip", "grip"), 1000.0, 2.0),), seen())), "millimetres"),
        (ScaleCues(distances=(CameraDistance(("C1", "C3"), 100 * TRUE_DISTANCE, 5.0),)), "centimetres"),
        (ScaleCues(camera_heights=(CameraHeight("C2", TRUE_HEIGHT / 0.3048, 0.1),)), "feet"),
    ],
)
def test_a_length_in_a_wrong_unit_is_an_error(cues: ScaleCues, unit: str) -> None:
    with pytest.raises(InputError, match=rf"\[scale\], .* so they seem to be in {unit}: give metres"):
        solved(cues, seen())
