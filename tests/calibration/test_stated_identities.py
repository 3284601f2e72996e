"""What a user says of who is who is followed, in every mode that finds identities, and told where it cannot be."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from passerby.association.associate import joined_pairs
from passerby.association.correlation_clustering import cluster_tracklets
from passerby.association.not_people import without_people
from passerby.association.stated import stated_pairs
from passerby.calibration.in_memory import calibrate_observations
from passerby.common.errors import InputError
from passerby.core.observations import Boxes, CameraObservations
from passerby.core.pointing import Sighting, StatedIdentities
from passerby.simulation import SimulationOptions, simulate

FPS = 5.0


@pytest.fixture(scope="module")
def small():
    return simulate(SimulationOptions(seed=4000, seconds=12.0, box_noise=0.02, missing=0.1))


def found_by(simulated, **association):
    boxes = {name: simulated.observations[name].boxes for name in simulated.rig.names}
    settings = {"mode": "combined", "max_offset_s": 0, **association}
    return calibrate_observations(simulated.rig, boxes, fps=FPS, association=settings)


def alone_in(simulated, camera, who):
    """A pixel on a person who stands alone, in the first frame where that is so."""
    boxes, true = simulated.observations[camera].boxes, simulated.true_identities[camera]
    rows = np.flatnonzero(true == who)
    for row in rows:
        at = boxes.ltwh[row, :2] + boxes.ltwh[row, 2:] / 2
        same = boxes.ltwh[boxes.frame == boxes.frame[row]]
        if ((same[:, :2] <= at) & (same[:, :2] + same[:, 2:] >= at)).all(axis=1).sum() == 1:
            return {"camera": camera, "frame": int(boxes.frame[row]), "at": at.tolist()}
    raise AssertionError(f"{who} never stands alone in {camera}")


def identity(calibration, one):
    """The identity found for a box."""
    boxes = calibration.association.observations[one["camera"]].boxes
    inside = (boxes.ltwh[:, :2] <= one["at"]).all(axis=1) & (boxes.ltwh[:, :2] + boxes.ltwh[:, 2:] >= one["at"]).all(axis=1)
    return int(boxes.identity[inside & (boxes.frame == one["frame"])][0])


@pytest.mark.slow
def test_two_people_stated_to_be_one_and_one_person_to_be_two(small):
    """Against the truth, so that it has to be the statement that decides."""
    first, second = alone_in(small, "C1", 1), alone_in(small, "C2", 2)
    one, other = alone_in(small, "C1", 3), alone_in(small, "C2", 3)
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


def test_what_cannot_be_is_told_and_statements_go_with_their_cameras(small):
    one, other = alone_in(small, "C1", 3), alone_in(small, "C2", 3)
    told = found_by(small, same=[{"boxes": [one, other]}], different=[{"boxes": [one, other]}])
    (finding,) = [finding for finding in told.notices if finding.code == "stated_identity_unfulfilled"]
    assert finding.values["place"].startswith("[[association.")
    boxes = tuple(Sighting(name, 1, (0.0, 0.0), "") for name in ("A", "B", "C"))
    stated = StatedIdentities((boxes,), (boxes[:2],), boxes[2:])
    assert stated.within(["A", "C"]) == StatedIdentities((boxes[::2],), (), boxes[2:])


def with_poster(simulated, camera):
    """The scene with a poster that a detector sees in one camera all the time, and the box of it."""
    boxes = simulated.observations[camera].boxes
    frames = np.unique(boxes.frame)
    rng = np.random.default_rng(5)
    ltwh = np.array([30.0, 40.0, 45.0, 130.0]) + rng.normal(0, 1.5, (len(frames), 4))
    number = np.full(len(frames), int(boxes.identity.max()) + 1)
    all_boxes = Boxes(
        np.append(boxes.frame, frames), np.append(boxes.identity, number), np.vstack([boxes.ltwh, ltwh]),
        np.append(boxes.score, np.ones(len(frames))),
    )  # fmt: skip
    order = np.argsort(all_boxes.frame, kind="stable")
    seen = dict(simulated.observations.cameras) | {camera: CameraObservations(all_boxes.take(order))}
    at = {"camera": camera, "frame": int(frames[len(frames) // 2]), "at": [50.0, 100.0]}
    return replace(simulated, observations=replace(simulated.observations, cameras=seen)), at


def has_boxes_at(calibration, at):
    boxes = calibration.association.observations[at["camera"]].boxes
    centre = boxes.ltwh[:, :2] + boxes.ltwh[:, 2:] / 2
    return int((np.abs(centre - [52.5, 105.0]).max(axis=1) < 15).sum())


@pytest.mark.slow
def test_a_poster_is_no_person(small):
    posted, at = with_poster(small, "C1")
    assert has_boxes_at(found_by(posted), at) > 20
    assert has_boxes_at(found_by(posted, not_people=[at]), at) == 0


@pytest.mark.slow
def test_a_poster_is_no_person_in_given_identities(small):
    """Here an id is known, and all of it goes, of this camera only."""
    posted, at = with_poster(small, "C1")
    given = {
        name: replace(
            seen.boxes, identity=np.append(small.true_identities[name], np.full(len(seen.boxes), 99))[: len(seen.boxes)]
        )
        for name, seen in posted.observations.cameras.items()
    }
    boxes = posted.observations["C1"].boxes
    own = np.full(len(boxes), 99)
    own[boxes.identity < boxes.identity.max()] = small.true_identities["C1"]
    given["C1"] = replace(boxes, identity=own)
    result = calibrate_observations(
        small.rig, given, fps=FPS, association={"mode": "given", "max_offset_s": 0, "not_people": [at]}
    )
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
