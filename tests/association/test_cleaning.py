"""Box by box: names that are wrong for a moment are put right, and what cannot be decided stays open."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
import pytest

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
    """People that the cameras see, and who they are."""

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
        return cls(bodies, [own.identity.copy() for own in bodies], clocks)

    def cleaned(self, person: list[np.ndarray], rig: Rig | None = None) -> list[np.ndarray]:
        before = [column.copy() for column in person]
        found = reassign_detections(rig or RIG, self.bodies, person, self.clocks, Clock(FPS), 1.72)
        for given, column in zip(before, person, strict=True):
            np.testing.assert_array_equal(given, column, "what was given is not written to")
        return found

    def rows(self, c: int, who: int, *frames: int) -> np.ndarray:
        """Rows of a person in a camera, at some frames."""
        return np.flatnonzero((self.person[c] == who) & np.isin(self.bodies[c].step, frames or FRAMES))

    def only(self, people: Mapping[int, list[int]]) -> Scene:
        """Each camera sees those alone; all where it is not among them."""
        rows = [np.isin(column, people.get(c, column)) for c, column in enumerate(self.person)]
        bodies = [own.take(on) for own, on in zip(self.bodies, rows, strict=True)]
        return replace(self, bodies=bodies, person=[column[on] for column, on in zip(self.person, rows, strict=True)])

    def assert_is(self, found: list[np.ndarray], expected: list[np.ndarray]) -> None:
        for c, (name, column, truth) in enumerate(zip(RIG.names, found, expected, strict=True)):
            np.testing.assert_array_equal(column, truth, name)
            assert len(column) == len(self.bodies[c])


PLACES = {0: (-2.0, -1.6), 1: (-1.0, 1.5), 2: (-1.8, 0.2), 7: (0.0, -0.6)}


@pytest.mark.parametrize(
    "wrong",
    [
        [],
        [(C1, 1, (5, 6, 7), UNKNOWN), (C1, 0, (5, 6, 7), 1)],
        [(C1, 0, (9, 10), 2), (C1, 2, (9, 10), 0)],
        [(C3, 2, (3, 11), UNKNOWN), (C1, 7, (), UNKNOWN)],
    ],
    ids=["nothing", "1's tracklet is on 0, whose box is missing", "exchanged", "single detections"],
)
def test_names_that_are_wrong_for_a_moment_are_put_right(wrong: list[tuple[int, int, tuple[int, ...], int]]) -> None:
    """Of a camera, a person at some frames, or at all, has another name."""
    scene = Scene.of(PLACES)
    person = [column.copy() for column in scene.person]
    for c, who, frames, name in wrong:
        person[c][scene.rows(c, who, *frames)] = name
    scene.assert_is(scene.cleaned(person), scene.person)


def test_a_box_of_a_stranger_that_other_cameras_do_not_see_loses_its_name() -> None:
    """Person 7's tracklet in one camera is on a stranger, and no other camera names that person."""
    scene = Scene.of({**PLACES, 9: (-0.5, 3.2)})
    person = [np.where(column == 9, UNKNOWN, column) for column in scene.person]
    expected = [column.copy() for column in person]
    person[C1][scene.rows(C1, 7, 4)] = UNKNOWN
    person[C1][scene.rows(C1, 9, 4)] = 7
    scene.assert_is(scene.cleaned(person), expected)


def test_a_person_has_one_box_a_camera() -> None:
    """Person 0's second box of a picture stays without a name, and 1's tracklet on it does not make it 1's."""
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


@pytest.mark.parametrize(("people", "expected"), [([4, 5], UNKNOWN), ([4], 4)])
def test_a_single_detection_between_two_people_stays_without_a_name(people: list[int], expected: int) -> None:
    """In camera C3 a box stands between 4 and 5, a little nearer to 4; the other cameras see both. Alone, 4 takes it."""
    across = RIG["C3"].pose.R_cw[0, :2]  # type: ignore[union-attr]
    scene = Scene.of({who: tuple(x * across) for who, x in ((4, 0.0), (5, 0.36), (6, 0.16))})
    scene = scene.only({c: [6] if c == C3 else people for c in range(4)})
    scene.person[C3][:] = UNKNOWN
    assert (scene.cleaned(scene.person)[C3] == expected).all()


def test_a_person_that_one_camera_alone_sees_keeps_the_name_unless_two_cameras_contradict_each_other() -> None:
    lone = Scene.of(PLACES).only({c: [0, 1, 2] for c in range(4) if c != C1})
    assert 7 in lone.person[C1]
    lone.assert_is(lone.cleaned(lone.person), lone.person)
    # C1 and C3 alone see 7, and C3's 7 is somebody else: neither is believed.
    scene = Scene.of({7: (0.0, -1.5), 8: (0.0, 2.0)}).only({0: [7], 1: [], 2: [8], 3: []})
    found = scene.cleaned([np.full_like(column, 7) for column in scene.person])
    assert all((column == UNKNOWN).all() for column in found)


def lost(*cameras: int) -> Rig:
    """The rig, in which these cameras have no pose."""
    return Rig(tuple(replace(camera, pose=None) if c in cameras else camera for c, camera in enumerate(RIG)))


def test_a_camera_without_a_pose_keeps_what_it_has() -> None:
    scene = Scene.of(PLACES)
    person = [np.roll(column, 1) for column in scene.person]
    good = [column if c != C3 else person[c] for c, column in enumerate(scene.person)]
    scene.assert_is(scene.cleaned(good, lost(C3)), good)
    scene.assert_is(scene.cleaned(person, lost(0, 1, 3)), person)


def test_instants_are_by_the_clocks() -> None:
    """Frames that show the world up to two seconds later than those of the same number."""
    scene = Scene.of(PLACES, (0.0, 1.0, -0.4, 0.6))
    person = [column.copy() for column in scene.person]
    person[C3][scene.rows(C3, 2, 8, 9, 10)] = UNKNOWN
    scene.assert_is(scene.cleaned(person), scene.person)
    by_number = reassign_detections(RIG, scene.bodies, scene.person, dict.fromkeys(RIG.names, Clock(FPS)), Clock(FPS), 1.72)
    wrong = [np.mean(column != truth) for column, truth in zip(by_number, scene.person, strict=True)]
    assert max(wrong) > 0.3, "the walk is quick enough to tell"
