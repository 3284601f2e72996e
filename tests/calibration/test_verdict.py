"""What no solver's answer may hide: cameras left out, people who walked where they fix no rig, people who should be seen."""

from dataclasses import replace

import numpy as np
import pytest

from passerby.calibration.diagnostics.verdict import MIN_POSITIONS, people_positions, with_verdict
from passerby.common.arrays import Floats
from passerby.core.cameras import Rig
from passerby.core.observations import Boxes, CameraObservations, Keypoints, Observations
from passerby.core.solution import Solution, Verdict
from passerby.core.usability import add_missing_camera_doubts
from passerby.findings.finding import doubt, notice, refusal
from support.scenes.people_and_rigs import observe, ring

RIG = ring(4)
INSTANTS = 150


def seen(places: Floats, rig: Rig = RIG) -> Observations:
    """What all cameras see of one person who is at these places (N, 2), one after the other."""
    frame = np.arange(1, len(places) + 1)
    return Observations(observe(rig, places, np.full(len(places), 1.75), frame, np.ones(len(places), dtype=int)), fps=5.0)


def wandering(across_m: float, along_m: float = 3.0) -> Observations:
    """Somebody at places that are spread over a rectangle."""
    rng = np.random.default_rng(4)
    return seen(rng.uniform(-0.5, 0.5, (INSTANTS, 2)) * (along_m, across_m))


def solved(rig: Rig = RIG, verdict: Verdict = "accepted", method: str = "geopose") -> Solution:
    """Of a method whose people are not judged by their pace."""
    return Solution(method, rig, verdict)


def codes(solution: Solution) -> list[tuple[str, tuple[str, ...]]]:
    return [(one.code, one.cameras) for one in solution.findings]


def test_people_all_over_the_ground_leave_the_verdict_as_it_is_and_what_else_is_said_decides() -> None:
    for say, verdict in ((notice, "accepted"), (doubt, "doubtful"), (refusal, "refused")):
        findings = (say("few_walkers", "C1"),)
        found = with_verdict(replace(solved(), findings=findings), wandering(3.0))
        assert (found.verdict, found.findings) == (verdict, findings)
    found = with_verdict(solved(), wandering(3.0), doubts=[doubt("people_stand_still")])
    assert (found.verdict, codes(found)) == ("doubtful", [("people_stand_still", ())])


def test_it_takes_enough_places_to_tell_of_a_line() -> None:
    for count, told in ((MIN_POSITIONS - 1, []), (MIN_POSITIONS, [("rig_uncertain", ())])):
        along = np.column_stack([np.linspace(-1.5, 1.5, count), np.zeros(count)])
        assert codes(with_verdict(solved(), seen(along))) == told


@pytest.mark.parametrize(("across_m", "along_m", "shape", "length_m"), [(0.1, 3.0, "line", 2.7), (0.1, 0.2, "spot", 0.2)])
def test_people_on_one_line_or_spot_without_sigmas_let_no_rig_be_accepted(
    across_m: float, along_m: float, shape: str, length_m: float
) -> None:
    people = wandering(across_m, along_m)
    found = with_verdict(solved(), people)
    assert (found.verdict, codes(found)) == ("doubtful", [("rig_uncertain", ())])
    why = found.findings[0].values["why"]
    assert (why["code"], why["values"]["shape"]) == ("people_not_spread", shape)
    assert why["values"]["length_m"] == pytest.approx(length_m, rel=0.2)
    # Joints have extent of their own.
    joints = Keypoints([1], [1], np.full((1, 1, 2), 300.0), np.ones((1, 1)), ("head",))
    cameras = {name: CameraObservations(one.boxes, joints) for name, one in people.cameras.items()}
    assert with_verdict(solved(), replace(people, cameras=cameras)).verdict == "accepted"


def test_a_camera_that_is_left_out_is_told_once_with_what_is_known_of_it() -> None:
    people = wandering(3.0)
    alone = CameraObservations(replace(people["C4"].boxes, identity=np.full(len(people["C4"].boxes), 99)))
    people = replace(people, cameras={**people.cameras, "C4": alone})
    lost = Rig(tuple(replace(camera, pose=None) if camera.name == "C4" else camera for camera in RIG))
    assert codes(with_verdict(solved(lost), wandering(3.0))) == [("camera_without_pose", ("C4",))], (
        "for no reason that is known"
    )
    found = with_verdict(solved(lost), people)
    assert found.verdict == "doubtful"
    assert causes(found) == [("cameras_share_nobody", ("C4",))]
    why = notice("few_walkers", "C4")
    assert causes(with_verdict(solved(lost), people, why={"C4": why})) == [("few_walkers", ("C4",))]
    # The solver's own words on it are dropped: that nobody is shared says more.
    apart = replace(solved(lost), findings=(notice("cameras_disconnected", "C4", main=["C1", "C2", "C3"]),))
    assert causes(with_verdict(apart, people)) == [("cameras_share_nobody", ("C4",))]


def test_each_cause_is_one_doubt_about_its_cameras() -> None:
    """The most specific cause of a camera counts; one about several cameras names those that have no better one."""
    lost = Rig(tuple(camera if camera.name == "C1" else replace(camera, pose=None) for camera in RIG))
    findings = [
        notice("cameras_share_nobody", "C2", "C3", main=["C1"], given=True),
        doubt("people_stand_still"),
        notice("clock_unknown", "C3"),
    ]
    found = add_missing_camera_doubts(lost, findings)
    assert [(one.code, one.cameras, (one.values.get("why") or {}).get("code")) for one in found] == [
        ("camera_without_pose", ("C3",), "clock_unknown"),
        ("camera_without_pose", ("C2",), "cameras_share_nobody"),
        ("camera_without_pose", ("C4",), None),
        ("people_stand_still", (), None),
    ]
    assert add_missing_camera_doubts(lost, found) == found
    # A notice about cameras that have a pose is no cause, and stays.
    assert add_missing_camera_doubts(RIG, findings) == findings


def causes(solution: Solution) -> list[tuple[str, tuple[str, ...]]]:
    """What explains the cameras without a pose, where nothing else is found."""
    assert {one.code for one in solution.findings} == {"camera_without_pose"}
    return [(one.values["why"]["code"], one.cameras) for one in solution.findings]


def test_identities_that_nobody_gave_and_that_were_not_found_are_told_by_what_was_said_before() -> None:
    """That nobody is shared follows from it, and would send the user to the wrong remedy."""
    people = wandering(3.0)
    cameras = {
        name: CameraObservations(replace(one.boxes, identity=one.boxes.identity + number))
        for number, (name, one) in enumerate(people.cameras.items())
    }
    apart, lost = replace(people, cameras=cameras), Rig(tuple(replace(camera, pose=None) for camera in RIG))
    before = doubt("people_stand_still")
    found = with_verdict(solved(lost, "refused"), apart, given=False, doubts=[before])
    assert (found.verdict, found.findings) == ("refused", (before,))
    assert {code for code, _ in codes(with_verdict(solved(lost, "refused"), apart, given=False))} == {"no_shared_people"}


def test_places_of_people_need_two_cameras_that_know_who_it_is() -> None:
    places = np.array([[0.0, 0.0], [1.0, 0.5]])
    found = people_positions(RIG, seen(places))
    np.testing.assert_allclose(found[:, :2], places, atol=0.02)
    np.testing.assert_allclose(found[:, 2], 0.875, atol=0.15)
    nobody = Observations({name: CameraObservations() for name in RIG.names})
    unknown = seen(places)
    cameras = {
        name: CameraObservations(Boxes(one.boxes.frame, np.full(2, -1), one.boxes.ltwh, one.boxes.score))
        for name, one in unknown.cameras.items()
    }
    unposed = Rig(tuple(replace(camera, pose=None) for camera in RIG))
    for rig, people in ((RIG, nobody), (RIG, replace(unknown, cameras=cameras)), (unposed, unknown)):
        assert people_positions(rig, people).shape == (0, 3)
