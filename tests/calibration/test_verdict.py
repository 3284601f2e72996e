"""What no solver's answer may hide: cameras left out, people who walked where they fix no rig, ground that is no plane."""

import json
from dataclasses import replace

import numpy as np
import pytest

from passerby.calibration.diagnostics.ground_planarity import (
    ground_figures,
    height_error_m,
    notices_of_ground,
    on_ground,
    shape_of,
)
from passerby.calibration.diagnostics.verdict import people_positions, with_verdict
from passerby.cli.main import run
from passerby.common.arrays import Floats
from passerby.core.cameras import Rig
from passerby.core.figures import AdjustedFigures
from passerby.core.measuring import CameraMeasuring, MeasuringFigures, MeasuringSigma
from passerby.core.observations import Boxes, CameraObservations, Keypoints, Observations
from passerby.core.solution import Solution, Verdict
from passerby.core.usability import add_missing_camera_doubts
from passerby.findings.finding import doubt, notice, refusal
from passerby.people.ground_shape import GroundShape
from passerby.simulation import SimulationOptions, simulate, write_scene
from support.scenes.boxes_of_walks import boxes_of
from support.scenes.people_and_rigs import observe, ring, simulated

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
    """Of a method that ignores the pace of people."""
    return Solution(method, rig, verdict)


def codes(solution: Solution) -> list[tuple[str, tuple[str, ...]]]:
    return [(one.code, one.cameras) for one in solution.findings]


def causes(solution: Solution) -> list[tuple[str, tuple[str, ...]]]:
    """What explains the cameras without a pose, where nothing else is found."""
    assert {one.code for one in solution.findings} == {"camera_without_pose"}
    return [(one.values["why"]["code"], one.cameras) for one in solution.findings]


def test_people_all_over_the_ground_leave_the_verdict_as_it_is_and_what_else_is_said_decides() -> None:
    for say, verdict in ((notice, "accepted"), (doubt, "doubtful"), (refusal, "refused")):
        findings = (say("few_walkers", "C1"),)
        found = with_verdict(replace(solved(), findings=findings), wandering(3.0))
        assert (found.verdict, found.findings) == (verdict, findings)
    found = with_verdict(solved(), wandering(3.0), doubts=[doubt("people_stand_still")])
    assert (found.verdict, codes(found)) == ("doubtful", [("people_stand_still", ())])


def test_it_takes_enough_places_to_tell_of_a_line() -> None:
    for count, told in ((3, []), (100, [("rig_uncertain", ())])):
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


def test_a_camera_that_is_left_out_is_reported_once_with_what_is_known_of_it() -> None:
    people = wandering(3.0)
    alone = CameraObservations(replace(people["C4"].boxes, identity=np.full(len(people["C4"].boxes), 99)))
    people = replace(people, cameras={**people.cameras, "C4": alone})
    lost = Rig(tuple(replace(camera, pose=None) if camera.name == "C4" else camera for camera in RIG))
    assert codes(with_verdict(solved(lost), wandering(3.0))) == [("camera_without_pose", ("C4",))], "for no known reason"
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


def test_identities_that_were_neither_given_nor_found_are_reported_by_what_was_said_before() -> None:
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


def shape(rise_m: float, chance_sigmas: float = 30.0, slope: tuple[float, float] = (0.1, 0.1)) -> GroundShape:
    return GroundShape(rise_m, 0.01, (1.0, 2.0), (3.0, 4.0), chance_sigmas, *slope, 10.0)


def test_ways_that_slope_beyond_chance_and_a_rise_with_its_places_are_notices() -> None:
    (found,) = notices_of_ground(shape(0.001, slope=(5.0, 0.1)))
    assert (found.code, found.severity) == ("people_on_levels", "notice")
    assert found.values == {"slope_deg": 5.0, "sigma_deg": 0.1}
    (found,) = notices_of_ground(shape(0.3))
    assert (found.code, found.severity) == ("ground_uneven", "notice")
    assert found.values == {"rise_m": 0.3, "at": [[1.0, 2.0], [3.0, 4.0]]}
    (placed,) = notices_of_ground(shape(0.4), placed=True)
    assert placed.values["at"] is None, "the solver's coordinates say nothing in a world of known places"
    # Heights spread evenly between the lowest and the highest; their scatter is that of random draws.
    draws = np.random.default_rng(1).uniform(0.0, 0.6, 200_000)
    assert height_error_m(shape(0.6)) == pytest.approx(np.std(draws), rel=0.01)
    figures = ground_figures(shape(0.4))
    assert (figures.rise_m, figures.low, figures.high, figures.chance_sigmas) == (0.4, (1.0, 2.0), (3.0, 4.0), 30.0)


@pytest.mark.parametrize(
    "none",
    [None, shape(0.001), shape(0.4, chance_sigmas=0.5), shape(0.001, slope=(0.3, 0.01)), shape(0.001, slope=(2.0, 2.0))],
    ids=["unknown", "flat", "by chance", "a little slope", "slope by chance"],
)
def test_nothing_is_said_of_a_plane_or_of_what_chance_makes(none: GroundShape | None) -> None:
    assert notices_of_ground(none) == ()
    assert none is None or height_error_m(none) == 0.0


def test_uneven_ground_makes_positions_on_it_uncertain_and_more_where_rays_are_flat() -> None:
    """Feet that are lifted are read where the rays through them meet z = 0."""
    scene = simulated("terrace", 20.0, 0)
    sigma = MeasuringSigma(median_mm=30.0, p90_mm=60.0)
    rise = shape(0.6)
    for camera in scene.rig:
        feet = scene.observations[camera.name].boxes.ltwh
        xy = camera.ground(feet[:, :2] + feet[:, 2:] * (0.5, 1.0)).xy
        lifted = camera.ground(camera.project(np.column_stack([xy, np.full(len(xy), 0.01)]))).xy
        moved = float(np.median(np.linalg.norm(lifted - xy, axis=1))) / 0.01
        reach = float(np.median(np.linalg.norm(xy - camera.centre[:2], axis=1)) / camera.centre[2])
        own = CameraMeasuring(points=sigma, across=sigma, ground=sigma, reach=reach)
        even = MeasuringFigures(places=10, points=sigma, ground=sigma, ground_height_mm=None, cameras={camera.name: own})
        found = on_ground(replace(AdjustedFigures(), measuring=even), rise).measuring
        assert found.points == sigma
        with_rise = found.cameras[camera.name].ground
        assert found.ground == with_rise
        assert with_rise.median_mm == pytest.approx(np.hypot(30.0, 1000 * height_error_m(rise) * moved), rel=0.02)
        assert found.cameras[camera.name].height_mm == pytest.approx(with_rise.median_mm / reach)
    assert on_ground(AdjustedFigures(), shape(0.001)) == AdjustedFigures()


def test_two_cameras_tell_the_shape_of_the_ground_and_one_does_not() -> None:
    scene = simulated("terrace", 20.0, 0)
    posed = [Rig(tuple(c if n < count else replace(c, pose=None) for n, c in enumerate(scene.rig))) for count in (1, 2, 4)]
    one, two, all_four = (shape_of(Solution("people", rig, "accepted"), scene.observations, 1.72) for rig in posed)
    assert one is None
    for found in (two, all_four):
        assert not found.sure
        assert notices_of_ground(found) == ()


@pytest.fixture(scope="module")
def terrace():
    return simulate(SimulationOptions(preset="terrace", box_noise=0.02, seconds=30))


def walks_on(ways) -> dict[int, tuple[np.ndarray, float]]:
    """identity -> way and height of three people."""
    return {identity: (way, height) for identity, (way, height) in enumerate(zip(ways, (1.75, 1.62, 1.85), strict=True), 1)}


@pytest.mark.slow
@pytest.mark.parametrize("method", ["people", "geopose"])
@pytest.mark.parametrize("case", ["one camera shares nobody", "one straight line", "curves"])
def test_sound_input_that_cannot_fix_a_rig_ends_with_3_and_says_what_is_missing(terrace, tmp_path, capsys, method, case):
    """Walkers on curves are enough: it is the line that is told, not how the boxes were made."""
    seen, turn, line = dict(terrace.observations.cameras), np.linspace(0, 2 * np.pi, 150), np.linspace(-1, 1, 150)
    if case == "one camera shares nobody":
        seen["C3"] = CameraObservations(replace(seen["C3"].boxes, identity=seen["C3"].boxes.identity + 100))
        observations = Observations(seen, 5.0)
    else:
        ways = [
            np.outer(np.roll(line * (1, -1, 1)[k - 1], 40 * k), [2.0, 3.5])
            if case == "one straight line"
            else np.column_stack([1.8 * np.cos(turn + k), 3.2 * np.sin(2 * turn + 2 * k)])
            for k in (1, 2, 3)
        ]
        observations = boxes_of(terrace.rig, walks_on(ways), np.random.default_rng(1))
    scene = write_scene(replace(terrace, observations=observations), tmp_path / "scene")
    reference = '\nreference = "C1"' if method == "geopose" else ""
    scene.write_text(scene.read_text().replace('method = "people"', f'method = "{method}"{reference}'))
    status = run(["calibrate", str(scene), "-o", str(tmp_path / "out")])
    report = json.loads((tmp_path / "out" / "calibration.json").read_text())
    errors = capsys.readouterr().err
    assert status == (0 if case == "curves" else 3), report["reasons"]
    if case == "one camera shares nobody":
        assert report["verdict"] in ("doubtful", "refused")
        assert "camera C3 shares no people with C1, C2, C4" in errors
        assert [camera["registered"] for camera in report["cameras"]] == [True, True, False, True]
    if case == "one straight line":
        assert any("line" in reason for reason in report["reasons"]), report["reasons"]
        assert "line" in errors
