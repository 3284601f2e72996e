"""A carried stick of known length: the scale and its sigma, false ends, and people who contradict it."""

from dataclasses import replace

import numpy as np
import pytest

from passerby.common.errors import InputError
from passerby.core.observations import Clock, Keypoints, Observations
from passerby.core.scale_cues import (
    MOST_STEPS,
    CameraDistance,
    CameraHeight,
    KnownLength,
    PopulationHeight,
    ScaleCues,
    Wand,
    lengths_of_wands,
)
from passerby.core.solution import Solution
from passerby.core.synchronisation import resample_to_common_steps
from passerby.evaluation.metrics import compare
from passerby.solver.cues import cue_rows, measure_cues, triangulate_marks
from passerby.solver.people import PeopleOptions
from support.scenes.people_and_rigs import part, simulated, solve
from support.scenes.wands import carried_wand, with_wands

TRUTH = simulated("terrace", seconds=8.0)
WAND = Wand(("tip", "grip"), 1.0, 0.002)
POSES = tuple(np.array([getattr(camera.pose, name) for camera in TRUTH.rig]) for name in ("R_cw", "centre"))


def seen(noise_px: float = 1.0, seed: int = 3) -> Observations:
    return with_wands(part(TRUTH.observations), carried_wand(TRUTH, np.random.default_rng(seed), noise_px=noise_px))


def solved(observations: Observations, wand: Wand = WAND, population: PopulationHeight | None = None) -> Solution:
    lengths = lengths_of_wands((wand,), observations)
    return solve(
        TRUTH.rig, observations, ScaleCues(population or PopulationHeight(), lengths=lengths), PeopleOptions(coarse_people=150)
    )


def test_a_wand_is_a_length_at_each_time_step_that_two_cameras_see() -> None:
    observations = seen()
    lengths = lengths_of_wands((WAND,), observations)
    assert 10 < len(lengths) <= MOST_STEPS
    assert all(len(one.points) > 1 and one.name == "wand tip to grip" for one in lengths)
    none = {name: Keypoints.empty(camera.wands.joints) for name, camera in observations.cameras.items()}
    alone = with_wands(observations, none | {"C1": observations["C1"].wands})
    assert lengths_of_wands((WAND,), alone) == ()


def test_a_wand_sets_the_scale() -> None:
    solution = solved(seen())
    sigma = solution.figures.scale.relative_sigma
    ratio = compare(solution.rig, TRUTH.rig).scale_ratio
    assert sigma < 0.01
    assert ratio == pytest.approx(1.0, abs=3 * sigma)
    wand = next(cue for cue in solution.figures.scale.cues if cue.kind == "length")
    assert wand.cue == "wand tip to grip"
    assert wand.count == len(lengths_of_wands((WAND,), seen()))
    assert wand.share > 0.8


@pytest.mark.parametrize("noise_px", [1.0, 4.0])
def test_noise_makes_a_length_neither_longer_nor_surer_than_it_is(noise_px: float) -> None:
    """By the true rig, over many draws: the mean of the lengths is the true one, and their spread is the stated sigma."""
    found = [measured(seen(noise_px, seed)) for seed in range(25)]
    ratio = np.array([(one.metres[0] - 1.0) / one.sigma_m[0] for one in found])
    assert abs(np.mean(ratio)) < 1.0
    assert 0.4 < np.sqrt(np.mean(ratio**2)) < 1.4


def measured(observations: Observations):
    """The wand, by the true rig."""
    rows = cue_rows(ScaleCues(lengths=lengths_of_wands((WAND,), observations)), TRUTH.rig)
    return measure_cues(rows, *POSES, triangulate_marks(rows, *POSES))


def test_false_ends_do_not_count() -> None:
    """One mark in eight of a camera is somewhere else."""
    observations, rng = seen(), np.random.default_rng(5)
    false = {}
    for name, camera in observations.cameras.items():
        xy = camera.wands.xy.copy()
        wrong = rng.random(len(xy)) < 0.125
        xy[wrong] = rng.uniform(0, 300, (int(wrong.sum()), 2, 2))
        false[name] = replace(camera.wands, xy=xy)
    right, found = measured(observations), measured(with_wands(observations, false))
    assert found.metres[0] == pytest.approx(right.metres[0], abs=2 * right.sigma_m[0])


def test_the_error_of_a_stated_length_does_not_shrink_with_the_time_steps() -> None:
    observations = seen()
    loose = ScaleCues(lengths=lengths_of_wands((replace(WAND, sd_m=0.05),), observations))
    solution = solve(TRUTH.rig, observations, loose, PeopleOptions(coarse_people=150))
    wand = next(cue for cue in solution.figures.scale.cues if cue.kind == "length")
    assert 0.05 <= wand.sd_m < 0.055


def test_people_who_contradict_a_wand_are_reported_and_it_wins() -> None:
    """People whose mean height is stated 5 % too tall, and to be known to 1 cm."""
    mean = float(np.mean(list(TRUTH.heights.values())))
    solution = solved(seen(0.5), population=PopulationHeight(1.05 * mean, 0.02, 0.01))
    codes = [finding.code for finding in solution.findings]
    assert "scale_cues_disagree" in codes
    assert compare(solution.rig, TRUTH.rig).scale_ratio == pytest.approx(1.0, abs=0.02)  # 1.05 by the people


def test_marks_of_one_name_are_one_object() -> None:
    """A moving stick that was marked by hand at three times: one cue, known no better than it is stated."""
    lengths = lengths_of_wands((WAND,), seen(0.0))
    by_hand = tuple(KnownLength(1.0, 0.01, one.points, "length stick") for one in lengths[:3])
    rows = cue_rows(ScaleCues(lengths=by_hand), TRUTH.rig)
    assert rows.names == ("length stick",)
    assert np.sum(1 / rows.lengths[:, 1] ** 2) == pytest.approx(1 / 0.01**2)


@pytest.mark.parametrize(
    "cues",
    [
        ScaleCues(lengths=lengths_of_wands((Wand(("tip", "grip"), 1000.0, 2.0),), seen())),
        ScaleCues(distances=(CameraDistance(("C1", "C2"), 100 * float(np.linalg.norm(POSES[1][0] - POSES[1][1])), 5.0),)),
        ScaleCues(camera_heights=(CameraHeight("C2", float(POSES[1][1, 2]) / 0.3048, 0.1),)),
    ],
    ids=["wand in millimetres", "distance in centimetres", "camera height in feet"],
)
def test_a_length_in_a_wrong_unit_is_an_error(cues: ScaleCues, request: pytest.FixtureRequest) -> None:
    unit = request.node.callspec.id.split(" in ")[1]
    with pytest.raises(InputError, match=rf"\[scale\], .* so they seem to be in {unit}: give metres"):
        solve(TRUTH.rig, seen(), cues, PeopleOptions(coarse_people=150))


def test_a_turning_wand_keeps_its_length_between_samples() -> None:
    """Five samples a second, clocks up to 0.4 s apart, and no noise: straight lines would shorten it by 2 to 4 %."""
    truth = simulated("terrace", seconds=8.0, clock_offsets=0.4)
    exact = with_wands(part(truth.observations), carried_wand(truth, np.random.default_rng(3), noise_px=0.0))
    clocks = {name: Clock(truth.options.fps, offset) for name, offset in truth.clock_offsets.items()}
    steps = resample_to_common_steps(exact, clocks)
    assert len(lengths_of_wands((WAND,), steps)) > 10
    assert measured(steps).metres[0] == pytest.approx(1.0, abs=0.005)
