"""What users say of people, pointed at by pixels: heights set the scale, who is who is followed, wrong statements are named."""

import re
from types import SimpleNamespace

import numpy as np
import pytest

from passerby.association.associate import joined_pairs
from passerby.association.correlation_clustering import cluster_tracklets
from passerby.association.not_people import without_people
from passerby.association.stated import stated_pairs
from passerby.calibration.in_memory import calibrate_observations
from passerby.calibration.pointed_heights import identity_at, pointed_heights
from passerby.common.errors import InputError
from passerby.core.observations import Boxes, CameraObservations
from passerby.core.pointing import PointedPerson, Sighting, StatedIdentities
from passerby.evaluation.metrics import compare
from passerby.people.box_heights import heights_by_boxes
from passerby.simulation import SimulationOptions, simulate

FPS = 5.0


@pytest.fixture(scope="module")
def small():
    return simulate(SimulationOptions(seed=4000, seconds=12.0, box_noise=0.02, missing=0.1))


def boxes_of(simulated):
    return {name: simulated.observations[name].boxes for name in simulated.rig.names}


def found_by(simulated, boxes=None, scale=None, **association):
    settings = {"mode": "combined", "max_offset_s": 0, **association}
    boxes = boxes_of(simulated) if boxes is None else boxes
    return calibrate_observations(simulated.rig, boxes, fps=FPS, association=settings, scale=scale or {})


def scale_by(simulated, people, mode="given"):
    """The calibration with heights of people, and its scale over the true one."""
    calibration = found_by(simulated, scale={"people": people}, mode=mode)
    return calibration, compare(calibration.rig, simulated.rig).scale_ratio


def alone_in(simulated, camera, *, who=None, skip=()):
    """The first person, or this one, who stands alone in a camera, and the table that points there."""
    boxes, true = simulated.observations[camera].boxes, simulated.true_identities[camera]
    for row in np.flatnonzero(true > 0 if who is None else true == who):
        at = boxes.ltwh[row, :2] + boxes.ltwh[row, 2:] / 2
        same = boxes.ltwh[boxes.frame == boxes.frame[row]]
        inside = ((same[:, :2] <= at) & (same[:, :2] + same[:, 2:] >= at)).all(axis=1)
        if inside.sum() == 1 and int(true[row]) not in skip:
            return int(true[row]), {"camera": camera, "frame": int(boxes.frame[row]), "at": at.tolist()}
    raise AssertionError(f"no person stands alone in {camera}")


def pointed_at(simulated, camera, grown=1.0, skip=(), **more):
    """The identity and the table of the height of a person who stands alone in a camera."""
    identity, table = alone_in(simulated, camera, skip=skip)
    return identity, {**table, "height_m": grown * simulated.heights[identity], **more}


@pytest.mark.slow
def test_a_height_sets_the_scale_by_frame_and_by_time(small):
    """Stated 30 % too tall, so that it has to be this person who sets the scale."""
    identity, table = pointed_at(small, "C1", grown=1.3)
    calibration, scale = scale_by(small, [table])
    assert scale == pytest.approx(1.3, abs=0.05)
    (known,) = calibration.association.known_heights
    assert (known.identity, known.metres) == (identity, pytest.approx(table["height_m"]))
    named = [cue.cue for cue in calibration.figures.scale.cues if cue.kind == "person"]
    assert named == [f"height of person {identity}, [[scale.people]] 1"]
    timed = {key: value for key, value in table.items() if key != "frame"} | {"time_s": (table["frame"] - 1) / FPS}
    by_time = scale_by(small, [timed])
    assert by_time[0].association.known_heights == calibration.association.known_heights
    assert by_time[1] == scale


@pytest.mark.slow
def test_heights_that_contradict_each_other_are_named_by_their_tables(small):
    """A wrong one bends the rig and makes its person's boxes outliers: in the adjustment its residual is below 4 sigmas."""
    first, one = pointed_at(small, "C1")
    second, two = pointed_at(small, "C2", skip=(first,))
    third, wrong = pointed_at(small, "C3", grown=1.15, skip=(first, second))
    calibration, _ = scale_by(small, [one, {**one, "height_m": one["height_m"] - 0.2}])
    (found,) = [one for one in calibration.diagnostics if one.code == "scale_cues_disagree"]
    assert [name[-1] for name in sorted(found.values["cues"])] == ["1", "2"]
    assert calibration.verdict == "doubtful"
    calibration, _ = scale_by(small, [one, two, wrong])
    (found,) = [found for found in calibration.doubts if found.code == "scale_cues_disagree"]
    assert found.values["cues"] == [f"height of person {third}, [[scale.people]] 3"]
    assert found.values["measured_m"] == pytest.approx(small.heights[third], rel=0.02)
    assert calibration.verdict == "doubtful"
    calibration, _ = scale_by(small, [one, {**two, "height_m": 1.25 * two["height_m"]}])
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
    people = [{**alone_in(small, "C1")[1], "time_s": 1.0, "height_m": 1.7}]
    del people[0]["frame"]
    with pytest.raises(InputError, match="time_s: no frame rate of camera C1 is known: use frame"):
        calibrate_observations(small.rig, boxes_of(small), association={"mode": "given"}, scale={"people": people})


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


def test_heights_of_one_person_contradict_each_other_beyond_their_sigmas_and_of_no_person_none_is_used():
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
def test_a_height_is_that_of_the_true_person_where_identities_are_found():
    """By a wrong height again: the found identity holds it in all cameras."""
    options = SimulationOptions(seed=4001, seconds=20.0, box_noise=0.02, missing=0.1, unrelated_ids=True, tracklet_seconds=4.0)
    simulated = simulate(options)
    _, table = pointed_at(simulated, "C1", grown=1.25)
    calibration, scale = scale_by(simulated, [table], mode="trajectory")
    assert scale == pytest.approx(1.25, abs=0.06)
    assert len(calibration.association.known_heights) == 1


def identity(calibration, one):
    """The identity found for a box."""
    boxes = calibration.association.observations[one["camera"]].boxes
    inside = (boxes.ltwh[:, :2] <= one["at"]).all(axis=1) & (boxes.ltwh[:, :2] + boxes.ltwh[:, 2:] >= one["at"]).all(axis=1)
    return int(boxes.identity[inside & (boxes.frame == one["frame"])][0])


@pytest.mark.slow
def test_two_people_stated_to_be_one_and_one_person_to_be_two(small):
    """Against the truth, so that it has to be the statement that decides."""
    first, second = alone_in(small, "C1", who=1)[1], alone_in(small, "C2", who=2)[1]
    one, other = alone_in(small, "C1", who=3)[1], alone_in(small, "C2", who=3)[1]
    plain = found_by(small)
    assert identity(plain, first) != identity(plain, second)
    assert identity(plain, one) == identity(plain, other)
    told = found_by(small, same=[{"boxes": [first, second]}], different=[{"boxes": [one, other]}])
    assert identity(told, one) != identity(told, other)
    unfulfilled = [finding for finding in told.notices if finding.code == "stated_identity_unfulfilled"]
    if identity(told, first) != identity(told, second):  # the rig takes back boxes of two who walk apart, and it is told
        assert [finding.values["place"] for finding in unfulfilled] == ["[[association.same]] 1"]
    else:
        assert not unfulfilled


def test_statements_join_and_separate_tracklets_against_other_evidence():
    frames, left = np.repeat([1, 2], 2), np.tile([10.0, 200.0], 2)
    ltwh = np.column_stack([left, np.full(4, 50.0), np.full(4, 40.0), np.full(4, 100.0)])
    seen = CameraObservations(Boxes(frames, np.tile([0, 1], 2), ltwh, np.ones(4)))
    cameras = [SimpleNamespace(name=name, seen=seen) for name in ("C1", "C2")]
    tracklets = SimpleNamespace(first=np.array([0, 2, 4]))
    here = {name: [Sighting(name, 1, (u, 90.0), "") for u in (30.0, 220.0)] for name in ("C1", "C2")}
    stated = StatedIdentities(
        same=((here["C1"][0], here["C2"][1]),), different=((here["C1"][0], here["C2"][0]), (here["C1"][1], here["C2"][1]))
    )
    against = np.array([0, 1]), np.array([2, 3]), np.array([500.0, 500.0])  # C1's first is C2's first, and so on
    first, second, weight = joined_pairs(against, stated_pairs(tracklets, cameras, stated))
    person = cluster_tracklets(4, first, second, weight)
    assert person[0] == person[3]
    assert person[0] != person[2]
    assert person[1] != person[3]
    assert stated_pairs(tracklets, cameras, StatedIdentities()) is None


def test_impossible_statements_are_reported_and_statements_go_with_their_cameras(small):
    one, other = alone_in(small, "C1", who=3)[1], alone_in(small, "C2", who=3)[1]
    told = found_by(small, same=[{"boxes": [one, other]}], different=[{"boxes": [one, other]}])
    (finding,) = [finding for finding in told.notices if finding.code == "stated_identity_unfulfilled"]
    assert finding.values["place"].startswith("[[association.")
    boxes = tuple(Sighting(name, 1, (0.0, 0.0), "") for name in ("A", "B", "C"))
    stated = StatedIdentities((boxes,), (boxes[:2],), boxes[2:])
    assert stated.within(["A", "C"]) == StatedIdentities((boxes[::2],), (), boxes[2:])


def with_poster(simulated):
    """Boxes of the scene with those of a poster, identity 99, that a detector sees in C1 all the time, and a pixel on it."""
    boxes = boxes_of(simulated)
    own, frames = boxes["C1"], np.unique(boxes["C1"].frame)
    ltwh = np.array([30.0, 40.0, 45.0, 130.0]) + np.random.default_rng(5).normal(0, 1.5, (len(frames), 4))
    everything = Boxes(
        np.append(own.frame, frames), np.append(own.identity, np.full(len(frames), 99)), np.vstack([own.ltwh, ltwh]),
        np.append(own.score, np.ones(len(frames))),
    )  # fmt: skip
    boxes["C1"] = everything.take(np.argsort(everything.frame, kind="stable"))
    return boxes, {"camera": "C1", "frame": int(frames[len(frames) // 2]), "at": [50.0, 100.0]}


@pytest.mark.slow
def test_a_poster_is_no_person(small):
    """Where an id is known, all of it goes, of this camera only."""
    boxes, at = with_poster(small)
    for not_people, least, most in (([], 21, 10_000), ([at], 0, 0)):
        seen = found_by(small, boxes, not_people=not_people).association.observations["C1"].boxes
        centre = seen.ltwh[:, :2] + seen.ltwh[:, 2:] / 2
        assert least <= (np.abs(centre - [52.5, 105.0]).max(axis=1) < 15).sum() <= most
    result = found_by(small, boxes, mode="given", not_people=[at])
    assert 99 not in result.association.observations["C1"].boxes.identity


def test_the_tracklet_of_a_box_goes_and_what_stays_in_its_place():
    moves, still = 80 + 60 * np.arange(10), np.full(10, 20.0)
    left = np.concatenate([still, still + 3, moves, still - 2])
    frame = np.concatenate([first + np.arange(10) for first in (1, 20, 40, 60)])
    ltwh = np.column_stack([left, np.tile([50.0, 40.0, 100.0], (40, 1))])
    seen = CameraObservations(Boxes(frame, np.repeat([0, 1, 2, -1], 10), ltwh, np.ones(40)))
    rest = without_people(seen, [Sighting("C1", 3, (40.0, 90.0), "")]).boxes
    assert rest.identity.tolist() == [2] * 10
    assert len(without_people(seen, [Sighting("C1", 3, (400.0, 90.0), "")]).boxes) == 40


HERE, THERE = {"camera": "C1", "frame": 1, "at": [1, 1]}, {"camera": "C2", "frame": 1, "at": [1, 1]}


HERE, THERE = {"camera": "C1", "frame": 1, "at": [1, 1]}, {"camera": "C2", "frame": 1, "at": [1, 1]}


@pytest.mark.parametrize(
    ("association", "fault"),
    [
        ({"mode": "given", "same": [{"boxes": [HERE, THERE]}]}, 'same: corrects .* mode "given"'),
        ({"same": [{"boxes": [HERE]}]}, r"\[\[association.same\]\] 1 boxes"),
        ({"same": [{"boxes": [HERE, {"camera": "C2", "at": [1, 1]}]}]}, r"same\]\] 1 boxes 2: has no time_s and no frame"),
        ({"not_people": [{**HERE, "time_s": 1}]}, r"\[\[association.not_people\]\] 1: has time_s and frame"),
        ({"not_people": [{**HERE, "camera": "C9"}]}, r"not_people\]\] 1 camera: camera '?C9"),
        ({"not_people": [{**HERE, "at": [-5, 1]}]}, r"not_people\]\] 1 at: .* lies outside"),
        ({"different": [{"boxes": [HERE, {**THERE, "att": 1}]}]}, r"different\]\] 1 boxes 2: unknown key 'att'"),
    ],
)  # fmt: skip
def test_faults_name_their_place(small, association, fault):
    with pytest.raises(InputError, match=fault):
        found_by(small, **association)
