"""Which scale cues contradict each other: the wrong one of several, both of two, and none of sound ones."""

from __future__ import annotations

from functools import cache
from itertools import permutations

import numpy as np
import pytest

from passerby.core.figures import CueFigures
from passerby.core.floor_plan import FloorPlan, PlannedCamera
from passerby.core.scale_cues import CameraDistance, CameraHeight, KnownLength, PersonHeight, ScaleCues
from passerby.core.solution import Solution
from passerby.evaluation.metrics import compare
from passerby.solver.cue_agreement import RIG_SD, argue, find_disputes
from passerby.solver.people import PeopleOptions
from support.scenes.people_and_rigs import part, simulated, solve

TRUTH = simulated("terrace", seconds=8.0)
SEEN = part(TRUTH.observations)
QUICK = PeopleOptions(coarse_people=150)
ENDS = np.array([[-1.8, 0.5, 0.0], [1.8, 0.5, 0.0]])
KINDS = ("length", "distance", "camera_height", "person", "plan")
NAMES = {"length": "length", "distance": "distance", "camera_height": "height of camera", "person": "height of person",
         "plan": "plan"}  # fmt: skip


def test_sound_cues_contradict_nothing() -> None:
    rng = np.random.default_rng(0)
    disputes = [find_disputes(rng.normal(0, sd), sd) for sd in rng.uniform(0.003, 0.05, (300, 4))]
    assert sum(map(bool, disputes)) < 8


@pytest.mark.parametrize("sd", [0.002, 0.01, 0.02])
def test_a_tenth_is_a_contradiction_beside_a_cue_of_two_per_cent(sd: float) -> None:
    (dispute,) = find_disputes(np.log([1.0, 1.1, 1.0]), np.array([0.045, sd, 0.02]))
    assert {dispute.cue, dispute.other} >= {1}


def test_a_third_cue_decides() -> None:
    (dispute,) = find_disputes(np.log([1.0, 1.1, 1.0, 1.02]), np.array([0.01, 0.01, 0.01, 0.045]))
    assert (dispute.cue, dispute.other) == (1, None)
    assert dispute.off == pytest.approx(np.log(1.1), abs=0.002)


def test_of_two_both_are_named_the_more_certain_first() -> None:
    (dispute,) = find_disputes(np.log([1.0, 1.3]), np.array([0.045, 0.01]))
    assert (dispute.cue, dispute.other) == (1, 0)
    assert dispute.off == pytest.approx(np.log(1.3))


def test_who_leaves_a_contradiction_behind_is_not_the_one_that_is_wrong() -> None:
    """Three cues of one per cent. Without the highest the others are 2.7 sigmas apart, without the lowest 3.5."""
    sigma = float(np.hypot(0.01, RIG_SD))
    apart = np.array([0.0, 2.7, 2.7 + 3.5]) * np.sqrt(2) * sigma
    for order in permutations(range(3)):
        (dispute,) = find_disputes(apart[list(order)], np.full(3, 0.01))
        assert (order[dispute.cue], dispute.other) == (2, None)


def test_people_of_five_per_cent_do_not_contradict_a_tenth() -> None:
    """Two of their sigmas: a crowd may be so."""
    assert find_disputes(np.log([1.0, 1.1]), np.array([0.05, 0.01])) == []


def said(name: str, scale: float | None, sigma: float | None, stated_m: float = 2.0) -> CueFigures:
    """A cue by whose own measure all lengths would have to be so many times as large."""
    return CueFigures(
        cue=name, stated_m=stated_m, measured_m=stated_m, sd_m=0.02, residual_sigmas=0.0, share=0.3, own_scale=scale,
        own_sigma=sigma,
    )  # fmt: skip


def test_the_cue_that_all_others_contradict_is_told_with_what_it_measures() -> None:
    cues = [said("gate", 1.0, 0.01), said("pole", 1.1, 0.01), said("kerb", 1.0, 0.01), said("wall", None, None)]
    judged, (told,) = argue(cues)
    assert (told.code, told.severity, told.values["cue"]) == ("scale_cue_contradicted", "doubt", "pole")
    assert told.values["stated_m"] == 2.0
    assert told.values["measured_m"] == pytest.approx(2.0 / 1.1, rel=1e-3)
    assert told.values["sigmas"] > 5
    assert [cue.disagrees_with for cue in judged] == [None, ("gate", "kerb"), None, None]


def test_of_two_cues_that_contradict_each_other_both_are_told() -> None:
    judged, (told,) = argue([said("gate", 1.0, 0.02), said("pole", 1.25, 0.01)])
    assert (told.code, told.severity) == ("scale_cues_disagree", "doubt")
    assert told.values["cues"] == ["pole", "gate"]
    assert told.values["percent"] == pytest.approx(25.0)
    assert told.values["sigmas_percent"] == pytest.approx([1.0, 2.0])
    assert [cue.disagrees_with for cue in judged] == [("pole",), ("gate",)]


def test_cues_that_agree_or_say_nothing_are_left_as_they_are() -> None:
    cues = [said("gate", 1.0, 0.02), said("pole", 1.02, 0.02), said("wall", None, None)]
    assert argue(cues) == (cues, [])
    assert argue(cues[2:]) == (cues[2:], [])


def cue(kind: str, factor: float) -> dict[str, object]:
    """A cue of each kind, `factor` times the truth."""
    rig = TRUTH.rig
    if kind == "length":
        marks = {name: np.round(rig[name].project(ENDS)) for name in rig.names}
        return {"lengths": (KnownLength(3.6 * factor, 0.02, marks),)}
    if kind == "distance":
        metres = float(np.linalg.norm(rig["C1"].centre - rig["C3"].centre))
        return {"distances": (CameraDistance(("C1", "C3"), factor * metres, 0.05),)}
    if kind == "camera_height":
        return {"camera_heights": (CameraHeight("C2", factor * float(rig["C2"].centre[2]), 0.02),)}
    if kind == "person":
        return {"people": (PersonHeight(2, factor * TRUTH.heights[2], 0.01),)}
    at = {name: (50 * rig[name].centre[0] + 500, 500 - 50 * rig[name].centre[1]) for name in ("C1", "C3")}
    cameras = tuple(PlannedCamera(name, pixel, 0.04) for name, pixel in at.items())
    return {"plan": FloorPlan("plan.png", 0.02 * factor, 0.002, cameras)}


@cache
def solved(wrong: str, right: str | None = None) -> Solution:
    """With a cue that is 10 % off beside one that is right; with one sound cue where `right` is None."""
    cues = cue(wrong, 1.0) if right is None else {**cue(wrong, 1.1), **cue(right, 1.0)}
    return solve(TRUTH.rig, SEEN, ScaleCues(**cues), QUICK)  # type: ignore[arg-type]


def named(solution: Solution) -> list[str]:
    told = [one.values for one in solution.findings if one.code in ("scale_cue_contradicted", "scale_cues_disagree")]
    return [name for values in told for name in ([values["cue"]] if "cue" in values else values["cues"])]


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
    assert solution.verdict == "doubtful"
    told = {item.cue: item.disagrees_with for item in solution.figures.scale.cues if item.disagrees_with}
    assert set(told) == set(named(solution))


@pytest.mark.parametrize("kind", SOUND)
def test_a_sound_cue_is_not_accused_and_says_its_own_scale(kind: str) -> None:
    solution = solved(kind)
    assert named(solution) == []
    (item,) = [item for item in solution.figures.scale.cues if item.kind == kind]
    ratio = compare(solution.rig, TRUTH.rig).scale_ratio
    # By this cue alone all lengths would be true.
    assert ratio * item.own_scale == pytest.approx(1, abs=3 * item.own_sigma)
    assert item.own_sigma < 0.035
