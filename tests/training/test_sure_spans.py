"""Labels that geometry confirms: what changed hands, is hidden, or is seen by a wrong clock must not come through."""

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


def confirmed(rig, boxes, clocks=None):
    places = places_of(rig, boxes, clocks or {name: Clock(FPS) for name in rig.names})
    agreed = verify_boxes(places)
    return places, agreed, pseudo_labels(places, agreed)


def labelled(made):
    return {name: made.observations[name].boxes for name in made.rig.names}


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


def confirmed_scene(made, boxes=None, clocks=None):
    """And the people that the places really show."""
    places, agreed, spans = confirmed(made.rig, boxes or labelled(made), clocks)
    names = made.rig.names
    true = np.array([made.true_identities[names[c]][r] for c, r in zip(places.camera, places.row, strict=True)])
    return places, agreed, spans, true


def exchanged(boxes):
    """From frame 61 on 1 is called 2, and 2 is called 1."""
    return {
        name: replace(one, identity=np.where(one.frame > 60, 3 - one.identity, one.identity)) for name, one in boxes.items()
    }


def shown_in(rig, boxes, places):
    return np.array([boxes[rig.names[c]].identity[r] for c, r in zip(places.camera, places.row, strict=True)])


def people_of_spans(spans, true):
    """Of each span the set of people that its boxes really show."""
    return [set(true[spans.span == number].tolist()) for number in range(len(spans.identity))]


def assert_apart_is_right(spans, true):
    people = people_of_spans(spans, true)
    assert (spans.apart == spans.apart.T).all()
    assert not spans.apart.diagonal().any()
    for a, b in np.argwhere(spans.apart):
        assert not people[a] & people[b]


def test_right_labels_are_confirmed_where_people_are_not_hidden():
    made = scene()
    places, agreed, spans, true = confirmed_scene(made)
    kept = spans.span >= 0
    assert purity(places, spans, true) == 1.0
    together = set(zip(places.step.tolist(), true.tolist(), strict=True))
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
    own = boxes["C2"]
    swapped = np.where(own.frame > 60, np.array([0, 2, 1, 4, 3, 5, 6])[own.identity], own.identity)
    places, agreed, spans, true = confirmed_scene(made, boxes | {"C2": replace(own, identity=swapped)})
    wrong = places.identity != true
    assert wrong.sum() > 300
    assert not (spans.span[wrong] >= 0).any()
    assert (agreed.reason[wrong] == MISFIT).mean() > 0.5
    assert all(len(people) == 1 for people in people_of_spans(spans, true))
    # The other cameras carry these people through: a fault of one camera costs none of their time.
    assert {1, 2, 3, 4} <= set(true[(spans.span >= 0) & (places.step > 70)].tolist())


def test_labels_that_are_exchanged_at_random():
    places, _, spans, true = confirmed_scene(scene(identity_swaps=0.05))
    right, total = cross_camera(places.step, places.camera, places.identity, true)
    assert right / total < 0.95
    assert (spans.span >= 0).sum() > 200
    assert purity(places, spans, true) >= 0.99
    assert_apart_is_right(spans, true)


@pytest.mark.slow
def test_false_boxes_and_missing_ones():
    places, _, spans, true = confirmed_scene(scene(false_boxes=0.1, missing=0.1))
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


@pytest.mark.parametrize("mixed", [False, True])
def test_a_person_who_meets_somebody_becomes_another(mixed):
    rig, boxes = poles(two_who_meet(0.4), np.array([1, 2]), np.arange(1, 121))
    places, agreed, spans = confirmed(rig, exchanged(boxes) if mixed else boxes)
    assert (sorted(spans.identity.tolist()), sorted(spans.number.tolist())) == ([1, 1, 2, 2], [1, 1, 2, 2])
    assert all(len(who) == 1 for who in people_of_spans(spans, shown_in(rig, boxes, places)))
    assert agreed.near.any()
    # Seen at one time they are two people; of two times nothing is known, be it one person or two.
    for a, b in combinations(range(4), 2):
        overlap = spans.seconds[a][0] < spans.seconds[b][1] and spans.seconds[b][0] < spans.seconds[a][1]
        assert spans.apart[a, b] == overlap
    assert spans.apart.sum() == 4


def test_labels_that_jump_from_one_to_another_are_cut():
    ground = np.stack([np.column_stack([np.linspace(-2, 2, 120), np.full(120, y)]) for y in (-2.0, 2.0)], axis=1)
    rig, boxes = poles(ground, np.array([1, 2]), np.arange(1, 121))
    places, _, spans = confirmed(rig, exchanged(boxes))
    assert [len(who) for who in people_of_spans(spans, shown_in(rig, boxes, places))] == [1, 1, 1, 1]


@pytest.mark.parametrize("both_found", [True, False])
def test_a_person_hidden_in_one_camera_is_carried_through_by_the_others(both_found):
    """Somebody walks across the view of camera C1, close before it; a person farther off stands still."""
    centre = ring(4)["C1"].centre[:2]
    towards = centre / np.linalg.norm(centre)
    aside = np.array([-towards[1], towards[0]])
    ground = np.stack([np.zeros((120, 2)), 2.5 * towards + np.linspace(-2.5, 2.5, 120)[:, None] * aside], axis=1)
    rig, boxes = poles(ground, np.array([1, 2]), np.arange(1, 121))
    if not both_found:  # the one behind has the only box, which is the nearer one's
        seen = boxes["C1"]
        middle = np.abs(seen.frame - 60.5) < 6
        renamed = replace(seen, identity=np.where(middle & (seen.identity == 2), 1, seen.identity))
        boxes["C1"] = renamed.take(~(middle & (seen.identity == 1)))
    places, agreed, spans = confirmed(rig, boxes)
    mine = (places.camera == 0) & (places.identity == 1)
    behind = mine & (np.abs(places.step - 59.5) < 6)
    assert behind.sum() >= 10
    assert not (spans.span[behind] >= 0).any()
    assert np.isin(agreed.reason[behind], (BEHIND, MISFIT, NEAR)).any()
    assert spans.identity.tolist() == [1, 2]
    assert spans.seconds[0][1] - spans.seconds[0][0] > 23.0
    # Before and after, the same camera's boxes count.
    assert (spans.span[mine] == 0).sum() > 60


def test_a_wrong_clock_leaves_nothing_of_its_camera_and_nothing_wrong():
    made = scene()
    clocks = {name: Clock(FPS, 1.5 if name == "C3" else 0.0) for name in made.rig.names}
    places, _, spans, true = confirmed_scene(made, None, clocks)
    on_time, _, right = confirmed(made.rig, labelled(made))
    assert (spans.span[places.camera == 2] >= 0).sum() < 0.35 * (right.span[on_time.camera == 2] >= 0).sum()
    assert purity(places, spans, true) >= 0.99
    assert_apart_is_right(spans, true)


def test_cameras_of_different_rates_meet_at_common_instants():
    rig, fine = poles(two_who_meet(3.0, 240), np.array([1, 2]), np.arange(1, 241))
    every = fine["C2"].take(fine["C2"].frame % 3 == 1)  # 3.33 pictures a second, counted by themselves
    late = fine["C3"].take(fine["C3"].frame > 20)  # by two seconds
    others = {"C2": replace(every, frame=(every.frame - 1) // 3 + 1), "C3": replace(late, frame=late.frame - 20)}
    clocks = {name: Clock(10.0) for name in rig.names} | {"C2": Clock(10.0 / 3), "C3": Clock(10.0, 2.0)}
    places, _, spans = confirmed(rig, fine | others, clocks)
    assert (places.step_s, spans.identity.tolist()) == (pytest.approx(0.3), [1, 2])
    assert all((spans.span[places.camera == camera] >= 0).mean() > 0.6 for camera in range(4))


@pytest.mark.parametrize("seen", [lambda one: replace(one, identity=np.full(len(one), -1)), lambda one: Boxes.empty()])
def test_without_known_people_none_is_sure(seen):
    made = scene()
    places, agreed, spans = confirmed(made.rig, {name: seen(one) for name, one in labelled(made).items()})
    assert (len(spans.identity), spans.apart.shape, len(places)) == (0, (0, 0), len(spans.span))
    assert not (agreed.reason == SURE).any()
    assert (spans.span == -1).all()


def test_parts_of_a_long_recording_are_confirmed_as_the_whole(monkeypatch):
    made = scene()
    whole = confirmed(made.rig, labelled(made))
    spread = whole[1].spread
    monkeypatch.setattr("passerby.training.agreement.BLOCK_ROWS", 700)
    monkeypatch.setattr("passerby.training.agreement._spread", lambda places: spread)
    parts = confirmed(made.rig, labelled(made))
    assert (parts[2].span == whole[2].span).all()
    assert (parts[1].reason == whole[1].reason).all()
