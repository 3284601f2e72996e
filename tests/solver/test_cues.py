"""Scale cues: each pulls the scale to its value, together by their weights, and what contradicts is told."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from passerby.calibration.diagnostics.verdict import find_unusual_heights
from passerby.common.errors import InputError
from passerby.core.figures import CueFigures
from passerby.core.observations import CameraObservations, Observations
from passerby.core.scale_cues import CameraDistance, CameraHeight, KnownLength, PersonHeight, PopulationHeight, ScaleCues
from passerby.core.solution import Solution
from passerby.evaluation.metrics import compare
from passerby.solver.cues import (
    POPULATION_BIAS,
    cue_rows,
    expected_heights,
    initial_scale,
    population_spread,
    scale_cue_lengths,
    triangulate_marks,
    unexplained_spread,
    unusual_people,
)
from passerby.solver.people import PeopleOptions
from support.scenes.people_and_rigs import part, simulated, solve

TRUTH = simulated("terrace", seconds=8.0)
SEEN = part(TRUTH.observations)
QUICK = PeopleOptions(coarse_people=150)
# What the population says is wrong and hardly believed, so that a cue has to do it alone.
VAGUE = PopulationHeight(1.5, 0.5)
TRUE_DISTANCE = float(np.linalg.norm(TRUTH.rig["C1"].centre - TRUTH.rig["C3"].centre))
TRUE_HEIGHT = float(TRUTH.rig["C2"].centre[2])
ENDS = np.array([[-1.8, 0.5, 0.0], [1.8, 0.5, 0.0]])


def length(metres: float, sd_m: float = 0.01, cameras: tuple[str, ...] = ("C1", "C2", "C3")) -> KnownLength:
    """3.6 m on the ground, marked to the pixel, whatever `metres` says of it."""
    return KnownLength(metres, sd_m, {name: np.round(TRUTH.rig[name].project(ENDS)) for name in cameras})


def solved(cues: ScaleCues) -> Solution:
    return solve(TRUTH.rig, SEEN, cues, QUICK)


def weighted(solution: Solution) -> list[CueFigures]:
    """The cues of the adjustment, without those that are only compared with them."""
    return [cue for cue in solution.figures.scale.cues if cue.share > 0]


def scale_of(solution: Solution) -> float:
    ratio = compare(solution.rig, TRUTH.rig).scale_ratio
    assert ratio is not None
    return ratio


@cache
def vague_scale() -> float:
    return scale_of(solved(ScaleCues(VAGUE)))


POSES = [np.array([getattr(camera.pose, name) for camera in TRUTH.rig]) for name in ("R_cw", "centre")]


def person(share: float = 1.0) -> PersonHeight:
    return PersonHeight(2, TRUTH.heights[2] * share, 0.002)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "cues", "tolerance"),
    [
        ("length", ScaleCues(VAGUE, lengths=(length(3.6 * 1.2),)), 0.01),
        ("distance", ScaleCues(VAGUE, distances=(CameraDistance(("C1", "C3"), TRUE_DISTANCE * 1.2, 0.01),)), 0.01),
        ("camera height", ScaleCues(VAGUE, camera_heights=(CameraHeight("C2", TRUE_HEIGHT * 1.2, 0.002),)), 0.02),
        ("height of one person", ScaleCues(VAGUE, (person(1.2),)), 0.04),
    ],
)
def test_each_cue_pulls_the_scale_to_its_value(name: str, cues: ScaleCues, tolerance: float) -> None:
    """All lengths stated 20 % too long, so the world must come out 20 % too large."""
    assert abs(vague_scale() - 1.2) > 0.1
    solution = solved(cues)
    assert scale_of(solution) == pytest.approx(1.2, rel=tolerance)
    report = weighted(solution)
    told = [item for item in report if not item.cue.startswith("population")]
    assert len(told) == 1
    assert abs(told[0].residual_sigmas) < 1.5
    assert told[0].share > 0.9
    assert name.split()[0] in told[0].cue


@pytest.mark.slow
def test_shares_sum_to_one_and_go_with_the_sigmas() -> None:
    """Two distances that contradict by a fifth, one known half as well: the scale lies at the weighted mean of the two."""
    cues = ScaleCues(
        VAGUE,
        distances=(
            CameraDistance(("C1", "C3"), TRUE_DISTANCE, 0.02),
            CameraDistance(("C1", "C3"), 1.2 * TRUE_DISTANCE, 0.04),
        ),
    )
    solution = solved(cues)
    report = weighted(solution)
    assert sum(item.share for item in report) == pytest.approx(1)
    first, second = report[-2:]
    assert scale_of(solution) == pytest.approx(0.8 * 1.0 + 0.2 * 1.2, abs=0.01)
    assert first.share > 2 * second.share
    # Both are told to be contradicted: by 4 % of the distance in 2 cm, by 16 % in 4 cm.
    assert first.residual_sigmas == pytest.approx(0.04 * TRUE_DISTANCE / 0.02, rel=0.3)
    assert second.residual_sigmas == pytest.approx(-0.16 * TRUE_DISTANCE / 0.04, rel=0.3)


@pytest.mark.slow
def test_a_cue_against_precise_people_is_told_with_its_residual() -> None:
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
    sigmas = [
        solved(cues).figures.scale.relative_sigma
        for cues in (
            ScaleCues(),
            ScaleCues(camera_heights=(CameraHeight("C2", TRUE_HEIGHT, 0.02),)),
            ScaleCues(camera_heights=(CameraHeight("C2", TRUE_HEIGHT, 0.02),), lengths=(length(3.6),)),
        )
    ]
    assert sigmas[0] > sigmas[1] > sigmas[2]
    assert 0.02 < sigmas[0] < 0.06
    assert sigmas[2] < 0.01


def test_expected_heights_are_those_of_the_named_who_are_not_of_the_population() -> None:
    cues, identities = ScaleCues(people=(PersonHeight(7, 1.9, 0.01),)), np.array([3, 7, 9])
    mean, sd = expected_heights(cues, identities)
    assert mean.tolist() == [1.72, 1.9, 1.72]
    assert sd[1] == 0.01
    # The mean of the two others is known to their own spread and to what all people have in common.
    assert sd[0] / np.sqrt(2) == pytest.approx(np.hypot(0.09 / np.sqrt(2), POPULATION_BIAS * 1.72))
    assert np.isnan(population_spread(cues, identities)).tolist() == [False, True, False]


def test_cues_on_cameras_outside_the_rig_are_left_out() -> None:
    cues = ScaleCues(
        lengths=(length(3.6, cameras=("C1", "C2")),),
        distances=(CameraDistance(("C1", "Z"), 5.0, 0.1),),
        camera_heights=(CameraHeight("Z", 5.0, 0.1),),
    )
    rows = cue_rows(cues, TRUTH.rig)
    assert len(rows.lengths) == 1
    assert len(rows.distances) == len(rows.heights) == 0
    assert cue_rows(ScaleCues(), TRUTH.rig) is None
    assert cue_rows(ScaleCues(distances=cues.distances), TRUTH.rig) is None


def test_rows_measure_the_true_rig() -> None:
    cues = ScaleCues(
        lengths=(length(3.0),),
        distances=(CameraDistance(("C1", "C3"), 1.0, 0.1),),
        camera_heights=(CameraHeight("C2", 1.0, 0.1),),
    )
    rows = cue_rows(cues, TRUTH.rig)
    marks = triangulate_marks(rows, *POSES)
    np.testing.assert_allclose(marks, ENDS, atol=0.03)
    values = [value for _, value, _, _ in scale_cue_lengths(rows, *POSES, marks)]
    np.testing.assert_allclose(values, [3.6, TRUE_DISTANCE, TRUE_HEIGHT], atol=0.03)


def test_first_scale_weighs_people_against_cues() -> None:
    for sd_m, scale in ((0.001, 2), (100.0, 1)):
        rows = cue_rows(ScaleCues(distances=(CameraDistance(("C1", "C3"), 2 * TRUE_DISTANCE, sd_m),)), TRUTH.rig)
        assert initial_scale(rows, *POSES, np.zeros((0, 3)), 5, 0.05) == pytest.approx(scale, abs=0.01)
    assert initial_scale(None, *POSES, np.zeros((0, 3)), 0, 0.05) == 1.0


def test_a_mark_that_the_lens_cannot_see_is_refused() -> None:
    """NaN pixels stand for any mark outside what the lens can express."""
    marks = {"C1": np.array([[1.0, 2.0], [np.nan, 3.0]]), "C2": np.zeros((2, 2))}
    with pytest.raises(InputError, match="camera C1"):
        cue_rows(ScaleCues(lengths=(KnownLength(1.0, 0.1, marks),)), TRUTH.rig)


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
    before, after = (solve(TRUTH.rig, seen, options=QUICK) for seen in (SEEN, Observations(cameras, SEEN.fps)))
    usual, unusual = (compare(found.rig, TRUTH.rig).scale_ratio for found in (before, after))
    assert usual is not None
    assert unusual == pytest.approx(usual, rel=0.02)
    (cue,) = weighted(after)
    assert cue.count == len(TRUTH.identities) - 1
    assert before.figures.people.unusual is None
    assert after.figures.people.unusual == (TRUTH.identities[0],)
    (told,) = find_unusual_heights(after.figures.people)
    assert (told.code, told.severity, told.values["identities"]) == ("people_unusual", "notice", [TRUTH.identities[0]])
    assert told.values["low_m"] == told.values["high_m"] > 1.3 * told.values["usual_m"]
    assert find_unusual_heights(before.figures.people) == find_unusual_heights(None) == ()
