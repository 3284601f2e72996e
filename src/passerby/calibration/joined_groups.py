"""Joining of groups of cameras between which people pass into one rig.

Each group already has identities, clocks and poses. The identities that both groups have in common are found here: people who
are at one place, by the motion between the groups, whenever both groups see them. One solve of all cameras then determines the
relative pose of the groups, and its uncertainty.
"""

from __future__ import annotations

import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cache
from itertools import combinations

import numpy as np
from scipy.sparse import csr_array
from scipy.sparse.csgraph import connected_components
from scipy.spatial.distance import pdist
from threadpoolctl import threadpool_limits

from passerby.association.clocks.offsets import clock_corrections
from passerby.association.clocks.starts import FULL_SEARCH_S
from passerby.association.doors import Door
from passerby.association.ground.common_sightings import compare_people, refine_by_sightings
from passerby.association.ground.pair_matching import GroundMotion
from passerby.association.ground.passages import find_track_ends, register_by_passages
from passerby.association.result import Association
from passerby.association.shared_sightings import joined_sightings
from passerby.calibration.camera_motion import MotionSearch, measure_motions
from passerby.calibration.lens_corrections import LensExamination
from passerby.calibration.run import CalibrationRun, Corrections, Estimate
from passerby.calibration.scene_solver import solve_scene
from passerby.calibration.separate_groups import GroupEstimate
from passerby.common.arrays import Ints
from passerby.core.association_figures import AssociationFigures
from passerby.core.cameras import Camera, Pose, Rig
from passerby.core.figures import adjusted
from passerby.core.observations import CameraObservations, Clock, Observations
from passerby.core.synchronisation import clocks_of, resample_to_common_steps
from passerby.core.unknown_focals import begin_with
from passerby.geometry.rotations import exp_rotation
from passerby.geometry.two_view import PairHypothesis
from passerby.hypotheses.lenses import LensResult
from passerby.people.ground_positions import Places, places_of
from passerby.scene.inputs import SceneInputs, part_of
from passerby.solver.initialisation import JoinedRig

PRESENT_S = 0.5
"""Two identities that one group sees in the same interval of this length, seconds, are two people."""
LARGER_SIGMAS = 3.0
"""If the size of a group changes in the common rig by more than this many standard deviations of its scale, joining deforms the
group."""


def find_doors(run: CalibrationRun, found: Sequence[GroupEstimate]) -> dict[tuple[int, int], Door]:
    """Find the doors between two groups, by the numbers of the groups; none if clocks may differ by more than
    `FULL_SEARCH_S`.
    """
    height_m, search_s = run.scene.scale.person_height_m, run.scene.association.search_s
    if search_s > FULL_SEARCH_S:
        return {}
    run.progress("groups of cameras")
    rigs = [one.rig.posed() for one in found]
    ends = [
        find_track_ends(rig, one.estimate.association.instants, height_m) for rig, one in zip(rigs, found, strict=True)
    ]  # fmt: skip
    offsets = [
        [clock.offset_s for name, clock in one.estimate.association.clocks.items() if name in rig.names] or [0.0]
        for rig, one in zip(rigs, found, strict=True)
    ]

    @cache
    def seen(number: int) -> Places:
        return _places(rigs[number], found[number].inputs.observations, found[number], height_m)

    out = {}
    for a, b in combinations(range(len(found)), 2):
        lags_s = min(offsets[b]) - max(offsets[a]) - search_s, max(offsets[b]) - min(offsets[a]) + search_s
        passage = register_by_passages(ends[a], ends[b], lags_s)
        if passage is not None:
            known = refine_by_sightings(passage, seen(a), seen(b)) if passage.clear else passage
            out[a, b] = Door(rigs[a].names, rigs[b].names, known)
    return out


def _places(rig: Rig, seen: Observations, found: GroupEstimate, person_height_m: float) -> Places:
    """Return the places of a group's boxes on the ground, with times by the clocks that were found."""
    clocks = found.estimate.association.clocks
    known = {name: clocks.get(name) or clocks_of(seen, [name])[name] for name in rig.names}
    return places_of(rig, {name: seen[name].boxes for name in rig.names}, known, person_height_m)


def nearest_door(number: int, doors: Mapping[tuple[int, int], Door]) -> Door | None:
    """Return the door of a group with the largest share of the people needed for joining; None without a door."""
    own = [door for pair, door in doors.items() if number in pair]
    return max(own, key=lambda door: door.passage.votes / door.passage.needed, default=None)


def join_numbers(pairs: Sequence[tuple[int, int]], n: int) -> list[list[int]]:
    """Return the sets of two or more numbers below n that chains of pairs join, each in ascending order."""
    a, b = np.array(list(pairs), dtype=np.int64).reshape(-1, 2).T
    count, label = connected_components(csr_array((np.ones(len(a)), (a, b)), shape=(n, n)), directed=False)
    groups = [np.flatnonzero(label == number).tolist() for number in range(count)]
    return [group for group in groups if len(group) > 1]


def join_estimates(
    run: CalibrationRun, inputs: SceneInputs, own: Sequence[GroupEstimate], doors: Mapping[tuple[int, int], Door]
) -> GroupEstimate | None:
    """Estimate one rig of groups between which people pass; None if this fails, or if the rig contradicts its groups.

    It contradicts them if a camera gets no pose, a group gets another size, or a doubt arises that no group had.

    Args:
        run: the scene and its options.
        inputs: the inputs of all cameras, as they were read.
        own: the groups.
        doors: the doors between two groups, by the numbers of the groups; chains of them join all groups.
    """
    began, height_m = time.perf_counter(), run.scene.scale.person_height_m
    home = _home(own)
    stated = part_of(inputs, home)
    inputs = replace(
        stated, rig=Rig(tuple(own[home[name]].inputs.rig[name] for name in stated.rig.names)),
        observations=replace(
            stated.observations, cameras={name: own[home[name]].inputs.observations[name] for name in stated.rig.names}
        ),
    )  # fmt: skip
    with threadpool_limits(limits=1, user_api="blas"):
        estimate = _estimate(run, inputs.rig, own, doors)
        if estimate is None or any(_is_bent(one, estimate.solution.rig) for one in own):
            return None
        made = Corrections(tuple(correction for one in own for correction in one.corrections.made))
        moved = measure_motions(MotionSearch(stated, run.scene.association.given, height_m), made, estimate)
    seconds = time.perf_counter() - began
    together = GroupEstimate(stated, inputs, estimate, made, _lenses(own), moved, seconds, tuple(doors.values()))
    return together if together.doubted <= {code for one in own for code in one.doubted} else None


def _lenses(own: Sequence[GroupEstimate]) -> LensExamination:
    """Return the results of the groups on their lenses: a door gives no further evidence on these."""
    results = [one.lenses.result for one in own]
    unsettled = next((one for one in results if one.decision == "unsettled"), LensResult("nothing"))
    return LensExamination(
        tuple(finding for one in own for finding in one.lenses.findings),
        replace(unsettled, screened=tuple(screened for one in results for screened in one.screened)),
    )


def _home(own: Sequence[GroupEstimate]) -> dict[str, int]:
    """Return the group of each camera: the one in which it has a pose, else the first that contains it."""
    every = {name: g for g in reversed(range(len(own))) for name in own[g].rig.names}
    return every | {name: g for g in range(len(own)) for name in own[g].rig.posed().names}


def _is_bent(one: GroupEstimate, together: Rig) -> bool:
    """Check whether one of a group's cameras lacks a pose in the common rig, or the group's size changes significantly."""
    names, sigma = one.rig.posed().names, adjusted(one.estimate.solution.figures).scale.relative_sigma
    if any(together[name].pose is None for name in names):
        return True
    after, before = (float(pdist([rig[name].centre for name in names]).sum()) for rig in (together, one.rig))
    return sigma is not None and abs(float(np.log(after / before))) > LARGER_SIGMAS * sigma


def _estimate(
    run: CalibrationRun, rig: Rig, own: Sequence[GroupEstimate], doors: Mapping[tuple[int, int], Door]
) -> Estimate | None:
    """Estimate the rig of all cameras by the people of the groups; None if a door has no common person, or without a rig."""
    people = _identify(own, doors, run.scene.scale.person_height_m)
    if people is None:
        return None
    motions = _motions_to_first(doors, len(own))
    parts, home = [one.estimate.association for one in own], _home(own)
    clocks = {
        name: replace(clock, offset_s=clock.offset_s + motions[g].lag_s)
        for name, g in home.items() if (clock := parts[g].clocks.get(name)) is not None
    }  # fmt: skip
    observations = Observations(
        {name: _named(parts[home[name]].observations[name], people.number[home[name]]) for name in rig.names}
    )  # fmt: skip
    first = Rig(tuple(_placed(own[home[name]].rig[name], motions[home[name]]) for name in rig.names))
    joined = JoinedRig(first, tuple(one.rig.posed().names for one in own))
    lenses = begin_with(rig, first) if any(camera.lens.uncalibrated for camera in rig) else None
    known = tuple(
        replace(one, identity=int(number[one.identity]))
        for part, number in zip(parts, people.number, strict=True) for one in part.known_heights
    )  # fmt: skip
    pairs = [*people.together, *(pair for pair in combinations(rig.names, 2) if home[pair[0]] == home[pair[1]])]
    refine_time, rng, sigma_s = run.scene.association.search_s > 0, run.rng(), dict[str, float]()
    for passing in (True, False):
        run.progress("solving")
        instants = _instants(rig, observations, clocks, pairs)
        solution = solve_scene(
            run, rig, instants, rng, guesses=_guesses(first), known=known, passing=passing, refine_time=refine_time,
            lenses=lenses, begin=joined,
        )  # fmt: skip
        if solution.verdict == "refused":
            return None
        if refine_time:
            correction_s, sigmas = (
                dict(zip(rig.names, column.tolist(), strict=True)) for column in clock_corrections(solution)
            )
            clocks = {name: replace(clock, offset_s=clock.offset_s + correction_s[name]) for name, clock in clocks.items()}
            sigma_s = {name: sigma for name, sigma in sigmas.items() if np.isfinite(sigma)}
    reference = clocks[solution.rig.posed().names[0]].offset_s
    clocks = {name: replace(clocks[name], offset_s=clocks[name].offset_s - reference) for name in rig.names if name in clocks}
    association = Association(
        observations, _instants(rig, observations, clocks, pairs), clocks, sigma_s, _figures(parts, home),
        {name: why for g, part in enumerate(parts) for name, why in part.lost.items() if home[name] == g},
        tuple(one for part in parts for one in part.doubts), tuple(one for part in parts for one in part.notices),
        {name: drift for g, part in enumerate(parts) for name, drift in part.drifts.items() if home[name] == g}, known,
        tuple(one for part in parts for one in part.height_findings),
    )  # fmt: skip
    return Estimate(solution, association)


def _instants(
    rig: Rig, observations: Observations, clocks: Mapping[str, Clock], pairs: Sequence[tuple[str, str]]
) -> Observations:
    """Return the people at common time steps; at each step, only sightings by cameras that pairs join."""
    sizes = {camera.name: camera.lens.size for camera in rig}
    return joined_sightings(resample_to_common_steps(observations, clocks, sizes=sizes), pairs)


def _motions_to_first(doors: Mapping[tuple[int, int], Door], n: int) -> list[GroundMotion]:
    """Return the motions from the ground and clock of each of n groups to those of the first, by the doors with most people."""
    found = {0: GroundMotion(1.0, 0.0, 0.0)}
    by_people = sorted(doors.items(), key=lambda item: -item[1].passage.votes)
    while len(found) < n:
        (a, b), motion = next(
            (pair, door.passage.motion) for pair, door in by_people if (pair[0] in found) != (pair[1] in found)
        )
        if a in found:
            found[b] = motion.inverse.then(found[a])
        else:
            found[a] = motion.then(found[b])
    return [found[number] for number in range(n)]


def _placed(camera: Camera, motion: GroundMotion) -> Camera:
    """Move a camera of a group into the world of the first group."""
    if camera.pose is None:
        return camera
    x, y, z = camera.centre
    at = motion.turn * complex(x, y) + motion.shift
    turned = exp_rotation(np.array([0.0, 0.0, -np.angle(motion.turn)]))
    return replace(camera, pose=Pose.from_centre(camera.pose.R_cw @ turned, np.array([at.real, at.imag, z])))


def _guesses(rig: Rig) -> list[PairHypothesis]:
    """Return the relative poses of all pairs of cameras."""
    posed = [(c, camera.pose) for c, camera in enumerate(rig) if camera.pose is not None]
    out = []
    for a, first in posed:
        for b, second in posed:
            if a < b:
                R = second.R_cw @ first.R_cw.T
                out.append(PairHypothesis(a, b, R, R @ first.R_cw @ (first.centre - second.centre), "tracks", 0, 0))
    return out


def _named(seen: CameraObservations, number: Ints) -> CameraObservations:
    """Return a camera's observations with the common numbers of its people."""
    boxes, joints = seen.boxes, seen.keypoints
    return replace(
        seen, boxes=replace(boxes, identity=number[boxes.identity]), keypoints=replace(joints, identity=number[joints.identity])
    )


@dataclass(frozen=True, eq=False)
class _People:
    """Common identities of the people of all groups."""

    number: list[Ints]
    """For each group, an array from its own identities to the common ones."""
    together: list[tuple[str, str]]
    """Names of cameras of two groups that see people at one place."""


def _identify(own: Sequence[GroupEstimate], doors: Mapping[tuple[int, int], Door], person_height_m: float) -> _People | None:
    """Find common identities of the people of all groups; None if a door has no common person.

    If one group sees two identities at the same time, only the one that fits better is taken for a person of another group.
    """
    present, together = [_present(one.estimate.association) for one in own], list[tuple[str, str]]()
    persons = _Persons({(g, person): {(g, person)} for g, group in enumerate(present) for person in group})
    places = [_places(one.rig.posed(), one.estimate.association.observations, one, person_height_m) for one in own]
    for (a, b), door in doors.items():
        alike = compare_people(door.passage, places[a], places[b])
        joined = [persons.join((a, i), (b, j), present) for i, j in alike.pairs.tolist()]
        if not any(joined):
            return None
        together += [(door.first[c], door.second[d]) for c, d in alike.cameras.tolist()]
    return _People(persons.numbers([max(group, default=0) + 1 for group in present]), together)


def _present(found: Association) -> dict[int, Ints]:
    """Return the numbers of the half seconds in which a camera sees a person, by person."""
    parts = [
        (part.identity, np.floor(found.clocks[name].seconds(part.frame) / PRESENT_S))
        for name, seen in found.observations.cameras.items() for part in (seen.boxes, seen.keypoints)
    ]  # fmt: skip
    pairs = np.unique(np.concatenate([np.column_stack(part) for part in parts]).astype(np.int64), axis=0)
    numbers, first = np.unique(pairs[:, 0], return_index=True)
    return dict(zip(numbers.tolist(), np.split(pairs[:, 1], first[1:]), strict=True))


Person = tuple[int, int]
"""Number of the group, and number of the person in it."""


@dataclass(frozen=True, eq=False)
class _Persons:
    """Sets of identities of all groups that belong to the same person."""

    alike: dict[Person, set[Person]]
    """person -> all identities of the same person, this one included."""

    def join(self, one: Person, other: Person, present: Sequence[Mapping[int, Ints]]) -> bool:
        """Join two persons, unless one group sees both at the same time; return whether they are one."""
        if one not in self.alike or other not in self.alike:
            return False
        first, second = self.alike[one], self.alike[other]
        if first is second:
            return True
        if any(g == h and np.intersect1d(present[g][p], present[h][q]).size for g, p in first for h, q in second):
            return False
        first |= second
        for person in second:
            self.alike[person] = first
        return True

    def numbers(self, sizes: Sequence[int]) -> list[Ints]:
        """Return, for each group, an array (size,) from its own numbers of people to the common ones, which begin at 1."""
        number = {
            min(alike): rank for rank, alike in enumerate(sorted({frozenset(one) for one in self.alike.values()}, key=min), 1)
        }
        out = [np.zeros(size, np.int64) for size in sizes]
        for (g, person), alike in self.alike.items():
            out[g][person] = number[min(alike)]
        return out


def _figures(parts: Sequence[Association], home: Mapping[str, int]) -> AssociationFigures:
    """Join the figures of all groups' associations, each with its own cameras."""
    figures = [part.figures for part in parts]
    return replace(
        figures[0],
        cameras=tuple(one for g, part in enumerate(figures) for one in part.cameras or () if home[one.name] == g),
        pairs=tuple(
            one for g, part in enumerate(figures) for one in part.pairs or () if {home[name] for name in one.cameras} == {g}
        ),
        people=sum(part.people or 0 for part in figures),
    )
