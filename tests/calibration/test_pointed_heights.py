"""A person named by a pixel sets the scale, whether identities are given or found, and wrong statements are named."""

import re

import numpy as np
import pytest

from passerby.calibration.in_memory import calibrate_observations
from passerby.calibration.pointed_heights import identity_at, pointed_heights
from passerby.common.errors import InputError
from passerby.core.observations import Boxes, CameraObservations
from passerby.core.pointing import PointedPerson
from passerby.evaluation.metrics import compare
from passerby.people.box_heights import heights_by_boxes
from passerby.simulation import SimulationOptions, simulate

FPS = 5.0
QUIET = {"seconds": 10.0, "box_noise": 0.02, "missing": 0.1}


def scale_by(simulated, people, mode="given"):
    """The calibration with heights of people, and its scale over the true one."""
    boxes = {name: simulated.observations[name].boxes for name in simulated.rig.names}
    calibration = calibrate_observations(
        simulated.rig, boxes, fps=FPS, association={"mode": mode, "max_offset_s": 0}, scale={"people": people}
    )
    return calibration, compare(calibration.rig, simulated.rig).scale_ratio


def pointed_at(simulated, camera, grown=1.0, skip=(), **more):
    """The table of somebody who stands alone in a camera, in a frame in which another camera sees him too."""
    boxes, who = simulated.observations[camera].boxes, simulated.true_identities[camera]
    for row in np.flatnonzero(who > 0):
        at = boxes.ltwh[row, :2] + boxes.ltwh[row, 2:] / 2
        same = boxes.ltwh[boxes.frame == boxes.frame[row]]
        inside = ((same[:, :2] <= at) & (same[:, :2] + same[:, 2:] >= at)).all(axis=1)
        if inside.sum() == 1 and int(who[row]) not in skip:
            height_m = grown * simulated.heights[int(who[row])]
            table = {"camera": camera, "frame": int(boxes.frame[row]), "at": at.tolist(), "height_m": height_m, **more}
            return int(who[row]), table
    raise AssertionError("nobody stands alone")


@pytest.fixture(scope="module")
def small():
    return simulate(SimulationOptions(seed=4000, **QUIET))


@pytest.mark.slow
def test_given_identities(small):
    """Stated 30 % too tall, so that it has to be this person who sets the scale."""
    identity, table = pointed_at(small, "C1", grown=1.3)
    calibration, scale = scale_by(small, [table])
    assert scale == pytest.approx(1.3, abs=0.05)
    (known,) = calibration.association.known_heights
    assert (known.identity, known.metres) == (identity, pytest.approx(table["height_m"]))
    named = [cue.cue for cue in calibration.figures.scale.cues if cue.kind == "person"]
    assert named == [f"height of person {identity}, [[scale.people]] 1"]


@pytest.mark.slow
def test_time_and_frame_say_the_same(small):
    identity, table = pointed_at(small, "C2", skip=(1, 2))
    timed = {key: value for key, value in table.items() if key != "frame"} | {"time_s": (table["frame"] - 1) / FPS}
    by_frame, by_time = (scale_by(small, [one]) for one in (table, timed))
    assert by_frame[0].association.known_heights == by_time[0].association.known_heights
    assert by_frame[0].association.known_heights[0].identity == identity
    assert by_frame[1] == by_time[1]


@pytest.mark.slow
def test_two_heights_of_one_person_that_differ_let_no_rig_be_accepted(small):
    _, table = pointed_at(small, "C1")
    calibration, _ = scale_by(small, [table, {**table, "height_m": table["height_m"] - 0.2}])
    (found,) = [one for one in calibration.diagnostics if one.code == "scale_cues_disagree"]
    assert [name[-1] for name in sorted(found.values["cues"])] == ["1", "2"]
    assert calibration.verdict == "doubtful"


@pytest.mark.slow
def test_a_height_that_contradicts_the_others_is_named_by_its_table(small):
    """In the adjustment it bends the rig and makes its person's boxes outliers: its residual there is below 4 sigmas."""
    first, one = pointed_at(small, "C1")
    second, two = pointed_at(small, "C2", skip=(first,))
    third, wrong = pointed_at(small, "C3", grown=1.15, skip=(first, second))
    calibration, _ = scale_by(small, [one, two, wrong])
    (found,) = [found for found in calibration.doubts if found.code == "scale_cues_disagree"]
    assert found.values["cues"] == [f"height of person {third}, [[scale.people]] 3"]
    assert found.values["measured_m"] == pytest.approx(small.heights[third], rel=0.02)
    assert calibration.verdict == "doubtful"


@pytest.mark.slow
def test_of_two_heights_that_contradict_each_other_both_are_named(small):
    first, one = pointed_at(small, "C1")
    second, wrong = pointed_at(small, "C2", grown=1.25, skip=(first,))
    calibration, _ = scale_by(small, [one, wrong])
    names = [name for found in calibration.doubts for name in found.values.get("cues", [])]
    assert f"height of person {second}, [[scale.people]] 2" in names


def test_heights_by_boxes_are_those_of_the_people(small):
    heights = heights_by_boxes(small.rig, small.observations)
    assert len(heights) > 4
    ratio = np.array([heights[identity] / small.heights[identity] for identity in heights])
    assert ratio / np.median(ratio) == pytest.approx(np.ones(len(ratio)), abs=0.02)


@pytest.mark.parametrize(
    ("changed", "message"),
    [
        ({"at": [5.0, 5.0]}, r"1 at: no person at \[5, 5\] in camera C1 at frame \d+ .*; the nearest box, \d+ px away"),
        ({"at": [5000.0, 5.0]}, r"at: \[5000, 5\] lies outside the \d+ x \d+ image of camera C1: give a pixel"),
        ({"frame": 4000}, r"frame: camera C1 sees people in frames 1 to \d+ \(0.0 to .* s\), not at frame 4000"),
        ({"camera": "C9"}, r"\[\[scale.people\]\] 1 camera: camera 'C9' is not declared"),
        ({"identity": 3}, r"has identity and camera: name the person by one of them"),
        ({"time_s": 1.0}, r"has time_s and frame: delete one of them"),
        ({"frame": None}, r"points at a person, but has no time_s or frame: add it"),
        ({"camera": None, "frame": None, "at": None}, r"does not say whose height it is: add identity, or camera"),
    ],
)
def test_bad_input_is_one_clear_error(small, changed, message):
    _, table = pointed_at(small, "C1")
    stated = {key: value for key, value in {**table, **changed}.items() if value is not None}
    with pytest.raises(InputError, match=message) as error:
        scale_by(small, [stated])
    assert error.value.exit_status == 2
    assert len(re.findall("scale.people", str(error.value))) == 1


def test_a_time_without_a_frame_rate_is_an_error(small):
    _, table = pointed_at(small, "C1", time_s=1.0)
    boxes = {name: small.observations[name].boxes for name in small.rig.names}
    people = [{key: value for key, value in table.items() if key != "frame"}]
    with pytest.raises(InputError, match="time_s: no frame rate of camera C1 is known: use frame"):
        calibrate_observations(small.rig, boxes, association={"mode": "given"}, scale={"people": people})


@pytest.mark.slow
def test_people_who_overlap_are_a_notice(small):
    boxes = small.observations["C1"].boxes
    for frame in np.unique(boxes.frame):
        ltwh = boxes.ltwh[boxes.frame == frame]
        middle = ltwh[:, :2] + ltwh[:, 2:] / 2
        inside = ((ltwh[:, None, :2] <= middle) & (ltwh[:, None, :2] + ltwh[:, None, 2:] >= middle)).all(axis=2)
        if inside.sum(axis=0).max() > 1:
            at = middle[int(inside.sum(axis=0).argmax())]
            break
    table = {"camera": "C1", "frame": int(frame), "at": at.tolist(), "height_m": 1.8, "sd_m": 0.5}
    calibration, _ = scale_by(small, [table])
    (found,) = [one for one in calibration.diagnostics if one.code == "pointed_people_overlap"]
    assert found.severity == "notice"
    assert found.values["count"] > 1


def seen_by_one(identity):
    ltwh = np.tile([10.0, 10.0, 20.0, 60.0], (4, 1))
    return CameraObservations(Boxes(np.arange(1, 5), np.full(4, identity), ltwh, np.ones(4)))


def test_a_row_that_association_left_out_gets_the_identity_of_its_tracklet():
    one, nobody = PointedPerson(1, "C1", 2, (20.0, 30.0), 1.8, 0.01), np.zeros(0, dtype=np.int64)
    assert identity_at(one, seen_by_one(5), np.array([-1, -1, 8, 9]), nobody) == 8
    assert identity_at(one, seen_by_one(5), np.array([-1, 7, 8, 9]), nobody) == 7
    assert identity_at(one, seen_by_one(5), np.full(4, -1), nobody) is None
    assert identity_at(one, seen_by_one(-1), np.array([-1, -1, 8, 9]), nobody) is None
    assert identity_at(PointedPerson(1, "C1", 2, (200.0, 30.0), 1.8, 0.01), seen_by_one(5), np.full(4, 8), nobody) is None


def test_heights_of_one_person_contradict_each_other_beyond_their_sigmas_and_of_nobody_none_is_used():
    stated = [PointedPerson(n, "C1", 2, (20.0, 30.0), metres, 0.01) for n, metres in enumerate((1.8, 1.81, 1.6), start=1)]
    nobody = pointed_heights(stated[:1], lambda _: None)
    assert nobody.people == ()
    assert [(one.code, one.severity, one.cameras) for one in nobody.findings] == [
        ("pointed_person_unmatched", "notice", ("C1",))
    ]
    assert pointed_heights(stated[:2], lambda _: 4).findings == ()
    assert pointed_heights(stated, lambda one: one.number).findings == ()
    (found,) = pointed_heights(stated, lambda _: 4).findings
    assert (found.code, found.values["cues"]) == ("scale_cues_disagree", ["height of person 4, [[scale.people]] 3"])
    assert found.values["measured_m"] == pytest.approx(1.805, abs=0.01)


@pytest.mark.slow
def test_identities_that_are_found():
    """The true person, by a wrong height again: the found identity holds it in all cameras."""
    options = SimulationOptions(seed=4001, **{**QUIET, "seconds": 20.0}, unrelated_ids=True, tracklet_seconds=4.0)
    simulated = simulate(options)
    _, table = pointed_at(simulated, "C1", grown=1.25)
    calibration, scale = scale_by(simulated, [table], mode="trajectory")
    assert scale == pytest.approx(1.25, abs=0.06)
    assert len(calibration.association.known_heights) == 1
