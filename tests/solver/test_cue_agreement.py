"""Scale cues that contradict each other, those of people among them: the wrong one is named, sound ones never."""

from functools import cache
from itertools import permutations

import numpy as np
import pytest

from passerby.core import scale_cues
from passerby.core.figures import CueFigures
from passerby.core.solution import Solution
from passerby.evaluation.metrics import compare
from passerby.solver.cue_agreement import RIG_SD, check_cue_consistency, weigh_cues
from passerby.solver.people import PeopleOptions
from support.scenes.people_and_rigs import part, simulated, solve

TRUTH = simulated("terrace", seconds=8.0)
SEEN = part(TRUTH.observations)
QUICK = PeopleOptions(coarse_people=150)
ENDS = np.array([[-1.8, 0.5, 0.0], [1.8, 0.5, 0.0]])
KINDS = ("length", "distance", "camera_height", "person", "plan")
NAMES = {"length": "length", "distance": "distance", "camera_height": "height of camera", "person": "height of person",
         "plan": "plan"}  # fmt: skip


def said(name: str, scale: float | None, sigma: float | None, kind: str | None = None, share: float = 0.3) -> CueFigures:
    """A cue by whose own measure all lengths would have to be so many times as large."""
    return CueFigures(
        cue=name, kind=kind, stated_m=1.72, measured_m=1.72, sd_m=0.02, residual_sigmas=0.0, share=share, own_scale=scale,
        own_sigma=sigma,
    )  # fmt: skip


def named_by(log_scale: np.ndarray, sd: np.ndarray) -> list[str]:
    """The cues `0`, `1` ... that are named, by scales of their own."""
    cues = [said(str(n), float(np.exp(one)), float(sigma)) for n, (one, sigma) in enumerate(zip(log_scale, sd, strict=True))]
    return [cue for finding in check_cue_consistency(cues)[1] for cue in finding.values["cues"]]


@pytest.mark.parametrize("sd", [0.002, 0.02])
def test_sound_cues_contradict_nothing_and_a_tenth_is_a_contradiction_beside_a_cue_of_two_per_cent(sd: float) -> None:
    rng = np.random.default_rng(0)
    found = [named_by(rng.normal(0, sd), sd) for sd in rng.uniform(0.003, 0.05, (300, 4))]
    assert sum(map(bool, found)) < 8
    assert named_by(np.log([1.0, 1.1]), np.array([0.05, 0.01])) == [], "two sigmas of people: a crowd may be so"
    assert max(named_by(np.log([1.0, 1.1, 1.0]), np.array([0.045, sd, 0.02]))) >= "1"
    cues = [said("gate", 1.0, 0.02), said("pole", 1.02, 0.02), said("wall", None, None)]
    assert check_cue_consistency(cues) == (cues, [])
    assert check_cue_consistency(cues[2:]) == (cues[2:], [])


def test_a_cue_that_leaves_a_contradiction_behind_is_not_the_wrong_one() -> None:
    """Three cues of one per cent. Without the highest the others are 2.7 sigmas apart, without the lowest 3.5."""
    sigma = float(np.hypot(0.01, RIG_SD))
    apart = np.array([0.0, 2.7, 2.7 + 3.5]) * np.sqrt(2) * sigma
    for order in permutations(range(3)):
        assert named_by(apart[list(order)], np.full(3, 0.01)) == [str(order.index(2))]


def test_a_cue_that_all_others_contradict_is_named_with_what_it_measures_and_of_two_both_the_surer_first() -> None:
    cues = [said("gate", 1.0, 0.01), said("pole", 1.1, 0.01), said("kerb", 1.0, 0.01), said("wall", None, None)]
    checked, (finding,) = check_cue_consistency(cues)
    assert (finding.code, finding.severity, finding.values["cues"]) == ("scale_cues_disagree", "doubt", ["pole"])
    assert finding.values["stated_m"] == 1.72
    assert finding.values["measured_m"] == pytest.approx(1.72 / 1.1, rel=1e-3)
    assert finding.values["sigmas"] > 5
    assert [cue.disagrees_with for cue in checked] == [None, ("gate", "kerb"), None, None]
    checked, (finding,) = check_cue_consistency([said("gate", 1.0, 0.02), said("pole", 1.25, 0.01)])
    assert (finding.code, finding.severity, finding.values["cues"]) == ("scale_cues_disagree", "doubt", ["pole", "gate"])
    assert finding.values["percent"] == pytest.approx(25.0)
    assert finding.values["sigmas_percent"] == pytest.approx([100 * np.hypot(sd, RIG_SD) for sd in (0.01, 0.02)])
    assert [cue.disagrees_with for cue in checked] == [("pole",), ("gate",)]


def people(speed: float, *more: CueFigures, width: float = 1.0, sigma: float = 0.05) -> list[CueFigures]:
    """A rig by people's heights in which they walk so many times as fast as usual, and are so wide."""
    return [
        said("population of 6", 1.0, sigma, "population", 1.0),
        said("walking speed of 6", 1 / speed, 0.14, "walking_speed", 0.0),
        said("width of the boxes of 6", 1 / width, 0.16, "body_width", 0.0), *more,
    ]  # fmt: skip


@pytest.mark.parametrize(
    ("speed", "width", "severity", "kinds"),
    [
        (1.45, 1.0, "doubt", ["population", "walking_speed"]),
        (0.4, 1.0, "notice", ["walking_speed"]),
        (1.1, 2.0, "doubt", ["population"]),
    ],
    ids=["children taken for adults", "people who walk slowly", "boxes that do not reach from head to feet"],
)
def test_people_who_are_no_crowd_of_adults_are_reported(speed: float, width: float, severity: str, kinds: list[str]) -> None:
    """Children of 1.2 m would walk 1.43 times as fast as usual; no population is half as tall again as adults."""
    _, (found,) = check_cue_consistency(people(speed, width=width))
    assert (found.severity, found.values["kinds"]) == (severity, kinds)


def test_another_population_is_in_the_variance_as_far_as_nothing_else_excludes_it() -> None:
    usual, fast = (np.hypot(0.05, np.sqrt(weigh_cues(people(speed)).more_variance)) for speed in (1.0, 1.3))
    assert usual < 0.06
    assert fast > 0.09
    assert weigh_cues(people(1.3, said("gate", 1.0, 0.01))).more_variance < 0.002**2
    assert weigh_cues(people(1.3, sigma=0.0125)).more_variance == 0.0  # stated, with a sigma of its own


@pytest.mark.parametrize("sigma", [0.025, 0.05])
def test_adults_slow_people_and_narrow_things_that_move_slowly_leave_the_scale_as_it_is(sigma: float) -> None:
    """Cylinders of 0.32 m: giants would seem as slow and as narrow, but boxes do not reach beyond head and feet."""
    for speed in (0.75, 0.9, 1.0, 1.1, 1.25):
        assert check_cue_consistency(people(speed))[1] == []
    assert not weigh_cues(people(0.6)).is_doubtful
    cues = people(1.0, width=0.7, sigma=sigma)
    assert not weigh_cues([cues[0], said("walking speed of 2", 1.9, 0.35, "walking_speed", 0.0), cues[2]]).is_doubtful
    _, found = check_cue_consistency(people(1.0, width=0.35, sigma=sigma))
    assert [(one.severity, one.values["kinds"]) for one in found] == [("notice", ["body_width"])]


def cue(kind: str, factor: float) -> dict[str, object]:
    """A cue of each kind, `factor` times the truth."""
    rig = TRUTH.rig
    if kind == "length":
        marks = {name: np.round(rig[name].project(ENDS)) for name in rig.names}
        return {"lengths": (scale_cues.KnownLength(3.6 * factor, 0.02, marks),)}
    if kind == "distance":
        metres = float(np.linalg.norm(rig["C1"].centre - rig["C3"].centre))
        return {"distances": (scale_cues.CameraDistance(("C1", "C3"), factor * metres, 0.05),)}
    if kind == "camera_height":
        return {"camera_heights": (scale_cues.CameraHeight("C2", factor * float(rig["C2"].centre[2]), 0.02),)}
    if kind == "person":
        return {"people": (scale_cues.PersonHeight(2, factor * TRUTH.heights[2], 0.01),)}
    at = {name: (50 * rig[name].centre[0] + 500, 500 - 50 * rig[name].centre[1]) for name in ("C1", "C3")}
    cameras = tuple(scale_cues.PlannedCamera(name, pixel, 0.04) for name, pixel in at.items())
    return {"plan": scale_cues.FloorPlan("plan.png", 0.02 * factor, 0.002, cameras)}


@cache
def solved(wrong: str, right: str | None = None) -> Solution:
    """With a cue that is 10 % off beside one that is right; with one sound cue where `right` is None."""
    cues = cue(wrong, 1.0) if right is None else {**cue(wrong, 1.1), **cue(right, 1.0)}
    return solve(TRUTH.rig, SEEN, scale_cues.ScaleCues(**cues), QUICK)  # type: ignore[arg-type]


def named(solution: Solution) -> list[str]:
    return [name for one in solution.findings if one.code == "scale_cues_disagree" for name in one.values["cues"]]


QUICK_PAIRS = (("camera_height", "plan"), ("person", "length"), ("plan", "distance"))
TWO_PER_CENT = ("length", "distance", "person", "plan")
"""Cues that tell the scale to 2 %. A camera's height does not: boxes of eight seconds measure it to 3 %."""
PAIRS = [
    pytest.param(*pair, marks=() if pair in QUICK_PAIRS else pytest.mark.slow)
    for pair in permutations(KINDS, 2)
    if pair[1] in TWO_PER_CENT
]
SOUND = [pytest.param(kind, marks=() if kind in ("camera_height", "plan") else pytest.mark.slow) for kind in KINDS]


@pytest.mark.parametrize(("wrong", "right"), PAIRS)
def test_a_cue_of_every_kind_that_is_a_tenth_off_is_named(wrong: str, right: str) -> None:
    solution = solved(wrong, right)
    assert any(name.startswith(NAMES[wrong]) for name in named(solution))
    off = abs(float(np.log(compare(solution.rig, TRUTH.rig).scale_ratio)))
    assert solution.verdict == "doubtful" or off < 3 * solution.figures.scale.relative_sigma
    reported = {item.cue: item.disagrees_with for item in solution.figures.scale.cues if item.disagrees_with}
    assert set(reported) == set(named(solution))


@pytest.mark.parametrize("kind", SOUND)
def test_a_sound_cue_is_not_accused_and_says_its_own_scale(kind: str) -> None:
    solution = solved(kind)
    assert named(solution) == []
    (item,) = [item for item in solution.figures.scale.cues if item.kind == kind]
    ratio = compare(solution.rig, TRUTH.rig).scale_ratio
    # By this cue alone all lengths would be true.
    assert ratio * item.own_scale == pytest.approx(1, abs=3 * item.own_sigma)
    assert item.own_sigma < 0.035
