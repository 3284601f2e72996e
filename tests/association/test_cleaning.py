"""Box by box: names that are wrong for a moment are put right, and what cannot be told stays untold."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from passerby.association.cleaning import reassign_detections
from passerby.core.cameras import Rig
from passerby.core.observations import UNKNOWN, Clock
from passerby.people.sightings import Sightings, upright_sightings
from support.scenes.people_and_rigs import observe, ring

FPS = 5.0
FRAMES = np.arange(1, 21)
RIG = ring(4)
C1, C3 = 0, 2


@dataclass(frozen=True, eq=False)
class Scene:
    """People whom the cameras see, and who they are."""

    rig: Rig
    bodies: list[Sightings]
    person: list[np.ndarray]
    clocks: Mapping[str, Clock]

    @classmethod
    def of(cls, places: Mapping[int, tuple[float, float]], offset_s: tuple[float, ...] = (0.0, 0.0, 0.0, 0.0)) -> Scene:
        """Walkers from `places`, along x by 0.8 m/s: frame f shows the world at (f - 1) / fps + offset."""
        clocks = {name: Clock(FPS, offset) for name, offset in zip(RIG.names, offset_s, strict=True)}
        bodies = []
        for camera in RIG:
            person, frame = (grid.ravel() for grid in np.meshgrid(list(places), FRAMES, indexing="ij"))
            ground = np.array([places[p] for p in person.tolist()], dtype=np.float64)
            ground[:, 0] += 0.8 * clocks[camera.name].seconds(frame)
            seen = observe(Rig((camera,)), ground, np.full(len(frame), 1.72), frame, person)[camera.name]
            bodies.append(upright_sightings(seen, camera.lens, clocks[camera.name]))
            assert len(bodies[-1]) == len(frame), "everybody is wholly in every picture"
        return cls(RIG, bodies, [own.identity.copy() for own in bodies], clocks)

    def cleaned(self, person: list[np.ndarray], rig: Rig | None = None) -> list[np.ndarray]:
        before = [column.copy() for column in person]
        found = reassign_detections(rig or self.rig, self.bodies, person, self.clocks, Clock(FPS), 1.72)
        for given, column in zip(before, person, strict=True):
            np.testing.assert_array_equal(given, column, "what was given is not written to")
        return found

    def rows(self, c: int, who: int, *frames: int) -> np.ndarray:
        """Rows of a person in a camera, at some frames."""
        return np.flatnonzero((self.person[c] == who) & np.isin(self.bodies[c].step, frames or FRAMES))

    def assert_is(self, found: list[np.ndarray], expected: list[np.ndarray]) -> None:
        for c, (name, column, truth) in enumerate(zip(self.rig.names, found, expected, strict=True)):
            np.testing.assert_array_equal(column, truth, name)
            assert len(column) == len(self.bodies[c])


PLACES = {0: (-2.0, -1.6), 1: (-1.0, 1.5), 2: (-1.8, 0.2), 7: (0.0, -0.6)}


def test_right_names_stay() -> None:
    scene = Scene.of(PLACES)
    scene.assert_is(scene.cleaned(scene.person), scene.person)


def test_a_tracklet_that_shows_somebody_else_for_a_moment() -> None:
    """Person 1's tracklet sits on person 0, whose own box is missing: it is 0's; where 0 has a box there, it is nobody's."""
    scene = Scene.of(PLACES)
    person = [column.copy() for column in scene.person]
    person[C1][scene.rows(C1, 1, 5, 6, 7)] = UNKNOWN
    person[C1][scene.rows(C1, 0, 5, 6, 7)] = 1
    scene.assert_is(scene.cleaned(person), scene.person)


def test_names_exchanged_in_one_camera_are_exchanged_back() -> None:
    scene = Scene.of(PLACES)
    person = [column.copy() for column in scene.person]
    person[C1][scene.rows(C1, 0, 9, 10)], person[C1][scene.rows(C1, 2, 9, 10)] = 2, 0
    scene.assert_is(scene.cleaned(person), scene.person)


def test_a_box_that_shows_nobody_whom_others_see_goes_to_nobody() -> None:
    """Person 7's tracklet in one camera is on a stranger whom no other camera names."""
    scene = Scene.of({**PLACES, 9: (-0.5, 3.2)})
    person = [np.where(column == 9, UNKNOWN, column) for column in scene.person]
    expected = [column.copy() for column in person]
    person[C1][scene.rows(C1, 7, 4)] = UNKNOWN
    person[C1][scene.rows(C1, 9, 4)] = 7
    scene.assert_is(scene.cleaned(person), expected)


def test_a_person_has_one_box_a_camera() -> None:
    """Person 0's second box of a picture stays nobody's, and 1's tracklet on it does not make it 1's."""
    scene = Scene.of(PLACES)
    twice = scene.rows(C1, 0)
    bodies = scene.bodies[C1].take(np.append(np.arange(len(scene.bodies[C1])), twice))
    names = np.append(scene.person[C1], np.full(len(twice), UNKNOWN))
    names[scene.rows(C1, 1)] = UNKNOWN
    names[-len(twice) :] = 1
    doubled = replace(scene, bodies=[bodies, *scene.bodies[1:]], person=[names, *scene.person[1:]])
    found = doubled.cleaned(doubled.person)
    for frame in FRAMES.tolist():
        at = found[C1][bodies.step == frame]
        assert sorted(at.tolist()) == [-1, 0, 1, 2, 7]
    assert (found[C1][scene.rows(C1, 1)] == 1).all()


def test_single_detections_go_to_whom_they_show() -> None:
    scene = Scene.of(PLACES)
    person = [column.copy() for column in scene.person]
    person[C3][scene.rows(C3, 2, 3, 11)] = UNKNOWN
    person[C1][scene.rows(C1, 7)] = UNKNOWN
    scene.assert_is(scene.cleaned(person), scene.person)


def test_a_single_detection_between_two_people_stays_nobodys() -> None:
    """In camera C3 a box stands between 4 and 5, a little nearer to 4; the other cameras see both. Alone, 4 takes it."""
    across = RIG["C3"].pose.R_cw[0, :2]  # type: ignore[union-attr]
    along = np.array([across[1], -across[0]])
    places = {4: (0.0, 0.0), 5: (0.36, 0.0), 6: (0.16, 0.0)}
    for people, expected in (((4, 5), UNKNOWN), ((4,), 4)):
        scene = Scene.of({who: tuple(x * across + 0.0 * along) for who, (x, _) in places.items()})
        keep = [np.isin(column, [6] if c == C3 else people) for c, column in enumerate(scene.person)]
        bodies = [own.take(rows) for own, rows in zip(scene.bodies, keep, strict=True)]
        names = [column[rows] for column, rows in zip(scene.person, keep, strict=True)]
        names[C3] = np.full(len(names[C3]), UNKNOWN)
        found = replace(scene, bodies=bodies, person=names).cleaned(names)
        assert (found[C3] == expected).all(), people


def test_whoever_is_seen_by_one_camera_alone_keeps_the_name() -> None:
    scene = Scene.of(PLACES)
    hidden = [np.where(column == 7, UNKNOWN, column) if c != C1 else column for c, column in enumerate(scene.person)]
    rows = [np.flatnonzero(column > UNKNOWN) for column in hidden]
    bodies = [own.take(on) for own, on in zip(scene.bodies, rows, strict=True)]
    names = [column[on] for column, on in zip(hidden, rows, strict=True)]
    lone = replace(scene, bodies=bodies, person=names)
    lone.assert_is(lone.cleaned(names), names)
    assert 7 in names[C1]


def test_two_cameras_that_contradict_each_other_name_nobody() -> None:
    """Neither is believed: C1 and C3 alone see 7, and C3's 7 is somebody else."""
    scene = Scene.of({7: (0.0, -1.5), 8: (0.0, 2.0)})
    keep = [np.isin(column, {C1: [7], C3: [8]}.get(c, [])) for c, column in enumerate(scene.person)]
    bodies = [own.take(rows) for own, rows in zip(scene.bodies, keep, strict=True)]
    names = [np.full(len(own), 7) for own in bodies]
    found = replace(scene, bodies=bodies, person=names).cleaned(names)
    assert all((column == UNKNOWN).all() for column in found)


def test_a_camera_without_a_pose_keeps_what_it_has() -> None:
    scene = Scene.of(PLACES)
    person = [np.roll(column, 1) for column in scene.person]
    lost = Rig(tuple(replace(camera, pose=None) if c == C3 else camera for c, camera in enumerate(RIG)))
    good = [column if c != C3 else person[c] for c, column in enumerate(scene.person)]
    scene.assert_is(scene.cleaned(good, lost), good)
    alone = Rig(tuple(replace(camera, pose=None) if c != C3 else camera for c, camera in enumerate(RIG)))
    scene.assert_is(scene.cleaned(person, alone), person)


def test_instants_are_by_the_clocks() -> None:
    """Frames that show the world up to two seconds later than those of the same number."""
    scene = Scene.of(PLACES, (0.0, 1.0, -0.4, 0.6))
    person = [column.copy() for column in scene.person]
    person[C3][scene.rows(C3, 2, 8, 9, 10)] = UNKNOWN
    scene.assert_is(scene.cleaned(person), scene.person)
    by_number = reassign_detections(RIG, scene.bodies, scene.person, dict.fromkeys(RIG.names, Clock(FPS)), Clock(FPS), 1.72)
    wrong = [np.mean(column != truth) for column, truth in zip(by_number, scene.person, strict=True)]
    assert max(wrong) > 0.3, "the walk is quick enough to tell"
