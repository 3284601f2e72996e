"""Labels that geometry confirms: what changed hands, is hidden, or is seen by a wrong clock must not come through."""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from itertools import combinations

import numpy as np
import pytest

from passerby.core.observations import Boxes, Clock
from passerby.people.ground_positions import places_of
from passerby.simulation import SimulationOptions, simulate
from passerby.training.agreement import BEHIND, MISFIT, NEAR, SURE, verify_boxes
from passerby.training.sure_spans import pseudo_labels
from support.scenes.people_and_rigs import observe, ring

FPS = 5.0


@cache
def scene(**faults):
    return simulate(SimulationOptions(preset="terrace", people=6, seconds=40.0, box_noise=0.02, **faults))


def judged(rig, boxes, clocks=None):
    places = places_of(rig, boxes, clocks or {name: Clock(FPS) for name in rig.names})
    agreed = verify_boxes(places)
    return places, agreed, pseudo_labels(places, agreed)


def labelled(made):
    return {name: made.observations[name].boxes for name in made.rig.names}


def truth_of(made, places):
    names = made.rig.names
    return np.array([made.true_identities[names[c]][r] for c, r in zip(places.camera, places.row, strict=True)])


def cross_camera(step, camera, label, true):
    """Right and all pairs of boxes of one label by two cameras at one instant."""
    right = total = 0
    key = step * 1000 + label
    for one in np.unique(key):
        for a, b in combinations(np.flatnonzero(key == one), 2):
            total += camera[a] != camera[b]
            right += bool(camera[a] != camera[b] and true[a] == true[b])
    return right, total


def purity(places, spans, true):
    kept = spans.span >= 0
    right, total = cross_camera(places.step[kept], places.camera[kept], spans.span[kept], true[kept])
    return right / total


def people_of_spans(spans, true):
    """Of each span the set of people whom its boxes really show."""
    return [set(true[spans.span == number].tolist()) for number in range(len(spans.identity))]


def assert_apart_is_right(spans, true):
    people = people_of_spans(spans, true)
    assert (spans.apart == spans.apart.T).all()
    assert not spans.apart.diagonal().any()
    for a, b in np.argwhere(spans.apart):
        assert not people[a] & people[b]


def test_right_labels_are_confirmed_where_people_are_not_hidden():
    made = scene()
    places, agreed, spans = judged(made.rig, labelled(made))
    true = truth_of(made, places)
    kept = spans.span >= 0
    assert purity(places, spans, true) == 1.0
    together = {(s, who) for s, who, c in set(zip(places.step.tolist(), true.tolist(), places.camera.tolist(), strict=True))}
    instants = set(zip(places.step[kept].tolist(), true[kept].tolist(), strict=True))
    assert len(instants) > 0.3 * len(together)
    assert set(true[kept].tolist()) == set(made.identities.tolist())
    assert_apart_is_right(spans, true)
    assert spans.apart.sum() > len(spans.identity)
    assert (agreed.reason[kept] == SURE).all()
    assert (spans.n_cameras >= 2).all()
    assert (spans.seconds[:, 1] > spans.seconds[:, 0]).all()


def test_labels_that_changed_hands_in_one_camera_do_not_come_through():
    made = scene()
    boxes = labelled(made)
    swapped = boxes["C2"].identity.copy()
    later = boxes["C2"].frame > 60
    for one, other in ((1, 2), (3, 4)):
        swapped[later & (boxes["C2"].identity == one)] = other
        swapped[later & (boxes["C2"].identity == other)] = one
    boxes["C2"] = replace(boxes["C2"], identity=swapped)
    places, agreed, spans = judged(made.rig, boxes)
    true = truth_of(made, places)
    wrong = places.identity != true
    assert wrong.sum() > 300
    assert not (spans.span[wrong] >= 0).any()
    assert (agreed.reason[wrong] == MISFIT).mean() > 0.5
    assert all(len(people) == 1 for people in people_of_spans(spans, true))
    # The other cameras carry these people through: a fault of one camera costs none of their time.
    assert {1, 2, 3, 4} <= set(true[(spans.span >= 0) & (places.step > 70)].tolist())


def test_labels_that_are_exchanged_at_random():
    made = scene(identity_swaps=0.05)
    places, _, spans = judged(made.rig, labelled(made))
    true = truth_of(made, places)
    before = cross_camera(places.step, places.camera, places.identity, true)
    assert before[0] / before[1] < 0.95
    assert (spans.span >= 0).sum() > 200
    assert purity(places, spans, true) >= 0.99
    assert_apart_is_right(spans, true)


@pytest.mark.slow
def test_false_boxes_and_missing_ones():
    made = scene(false_boxes=0.1, missing=0.1)
    places, _, spans = judged(made.rig, labelled(made))
    true = truth_of(made, places)
    assert (spans.span >= 0).sum() > 300
    assert (true[spans.span >= 0] > 0).all()
    assert purity(places, spans, true) >= 0.99


def poles(ground, people, frames, heights=1.75, cameras=4):
    """Boxes by camera of people at `ground` (T, P, 2)."""
    rig = ring(cameras)
    frame, identity = np.repeat(frames, len(people)), np.tile(people, len(frames))
    seen = observe(rig, ground.reshape(-1, 2), np.full(len(frame), heights), frame, identity)
    return rig, {name: one.boxes for name, one in seen.items()}


def two_who_meet(distance, frames=120):
    """Two people who come towards each other along x, pass each other at a distance (metres) in the middle, and go on."""
    x = np.linspace(-3.0, 3.0, frames)
    y = 0.5 * distance * np.ones(frames)
    return np.stack([np.column_stack([x, y]), np.column_stack([-x, -y])], axis=1)


@pytest.mark.parametrize("exchanged", [False, True])
def test_who_meets_somebody_becomes_another_person(exchanged):
    frames = np.arange(1, 121)
    rig, boxes = poles(two_who_meet(0.4), np.array([1, 2]), frames)
    true = {name: one.identity for name, one in boxes.items()}
    if exchanged:
        boxes = {
            name: replace(one, identity=np.where(one.frame > 60, 3 - one.identity, one.identity)) for name, one in boxes.items()
        }
    places, agreed, spans = judged(rig, boxes)
    shown = np.array([true[rig.names[c]][r] for c, r in zip(places.camera, places.row, strict=True)])
    people = people_of_spans(spans, shown)
    assert sorted(spans.identity.tolist()) == [1, 1, 2, 2]
    assert sorted(spans.number.tolist()) == [1, 1, 2, 2]
    assert all(len(who) == 1 for who in people)
    assert agreed.near.any()
    # Seen at one time they are two people; of two times nothing is known, be it one person or two.
    for a, b in combinations(range(4), 2):
        overlap = spans.seconds[a][0] < spans.seconds[b][1] and spans.seconds[b][0] < spans.seconds[a][1]
        assert spans.apart[a, b] == overlap
    assert spans.apart.sum() == 4


def test_labels_that_jump_from_one_to_another_are_cut():
    frames = np.arange(1, 121)
    ground = np.stack([np.column_stack([np.linspace(-2, 2, 120), np.full(120, y)]) for y in (-2.0, 2.0)], axis=1)
    rig, boxes = poles(ground, np.array([1, 2]), frames)
    true = {name: one.identity for name, one in boxes.items()}
    boxes = {
        name: replace(one, identity=np.where(one.frame > 60, 3 - one.identity, one.identity)) for name, one in boxes.items()
    }
    places, _, spans = judged(rig, boxes)
    shown = np.array([true[rig.names[c]][r] for c, r in zip(places.camera, places.row, strict=True)])
    assert len(spans.identity) == 4
    assert all(len(who) == 1 for who in people_of_spans(spans, shown))


@pytest.mark.parametrize("both_found", [True, False])
def test_who_is_hidden_in_one_camera_is_carried_through_by_the_others(both_found):
    """Somebody walks across the view of camera C1, close before it; a person farther off stands still."""
    frames = np.arange(1, 121)
    rig = ring(4)
    towards = rig["C1"].centre[:2] / np.linalg.norm(rig["C1"].centre[:2])
    aside = np.array([-towards[1], towards[0]])
    ground = np.stack([np.zeros((120, 2)), 2.5 * towards + np.linspace(-2.5, 2.5, 120)[:, None] * aside], axis=1)
    rig, boxes = poles(ground, np.array([1, 2]), frames)
    seen = boxes["C1"]
    middle = np.abs(seen.frame - 60.5) < 6
    if not both_found:  # the one behind has the only box, which is the nearer one's
        gone = middle & (seen.identity == 1)
        ltwh = seen.ltwh[~gone]
        identity = np.where(middle & (seen.identity == 2), 1, seen.identity)[~gone]
        boxes["C1"] = Boxes(seen.frame[~gone], identity, ltwh, seen.score[~gone])
    places, agreed, spans = judged(rig, boxes)
    behind = (places.camera == 0) & (places.identity == 1) & (np.abs(places.step - 59.5) < 6)
    assert behind.sum() >= 10
    assert not (spans.span[behind] >= 0).any()
    assert np.isin(agreed.reason[behind], (BEHIND, MISFIT, NEAR)).any()
    assert spans.identity.tolist() == [1, 2]
    assert spans.seconds[0][1] - spans.seconds[0][0] > 23.0
    # Before and after, the same camera's boxes count.
    mine = spans.span[(places.camera == 0) & (places.identity == 1)]
    assert (mine == 0).sum() > 60


def test_a_wrong_clock_leaves_nothing_of_its_camera_and_nothing_wrong():
    made = scene()
    clocks = {name: Clock(FPS, 1.5 if name == "C3" else 0.0) for name in made.rig.names}
    places, _, spans = judged(made.rig, labelled(made), clocks)
    true = truth_of(made, places)
    right = judged(made.rig, labelled(made))
    late = (spans.span[places.camera == 2] >= 0).sum()
    on_time = (right[2].span[right[0].camera == 2] >= 0).sum()
    assert late < 0.35 * on_time
    assert purity(places, spans, true) >= 0.99
    assert_apart_is_right(spans, true)


def test_cameras_of_different_rates_meet_at_common_instants():
    ground = two_who_meet(3.0, 240)
    rig, fine = poles(ground, np.array([1, 2]), np.arange(1, 241))
    clocks = {name: Clock(10.0) for name in rig.names}
    boxes = dict(fine)
    every = fine["C2"].take(fine["C2"].frame % 3 == 1)  # 3.33 pictures a second, counted by themselves, two seconds late
    boxes["C2"] = replace(every, frame=(every.frame - 1) // 3 + 1)
    clocks["C2"] = Clock(10.0 / 3, 0.0)
    shifted = fine["C3"].take(fine["C3"].frame > 20)
    boxes["C3"] = replace(shifted, frame=shifted.frame - 20)
    clocks["C3"] = Clock(10.0, 2.0)
    places, _, spans = judged(rig, boxes, clocks)
    assert places.step_s == pytest.approx(0.3)
    assert spans.identity.tolist() == [1, 2]
    for camera in range(4):
        mine = places.camera == camera
        assert (spans.span[mine] >= 0).mean() > 0.6


def test_nobody_known_nobody_sure():
    made = scene()
    for boxes in (
        {name: replace(one, identity=np.full(len(one), -1)) for name, one in labelled(made).items()},
        {name: Boxes.empty() for name in made.rig.names},
    ):
        places, agreed, spans = judged(made.rig, boxes)
        assert len(spans.identity) == 0
        assert spans.apart.shape == (0, 0)
        assert not (agreed.reason == SURE).any()
        assert (spans.span == -1).all()
        assert len(places) == len(spans.span)


def test_parts_of_a_long_recording_are_judged_as_the_whole(monkeypatch):
    made = scene()
    whole = judged(made.rig, labelled(made))
    spread = whole[1].spread
    monkeypatch.setattr("passerby.training.agreement.BLOCK_ROWS", 700)
    monkeypatch.setattr("passerby.training.agreement._spread", lambda places: spread)
    parts = judged(made.rig, labelled(made))
    assert (parts[2].span == whole[2].span).all()
    assert (parts[1].reason == whole[1].reason).all()
