"""Groups of cameras that share no people: each becomes a rig of its own, with its own frame, metre, clock and verdict.

The largest group is the main rig. Another group never changes it, and nothing that is wrong with one group costs another.
Groups between which people pass are joined first.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.sparse import csr_array
from scipy.sparse.csgraph import connected_components

from passerby.association.clocks.starts import FULL_SEARCH_S
from passerby.association.ground.passages import find_track_ends, refine_by_sightings, register_by_passages
from passerby.association.result import Association
from passerby.association.seams import GroupCamera, Seam
from passerby.calibration.calibration import Calibration
from passerby.calibration.camera_motion import Motion
from passerby.calibration.lens_corrections import LensExamination
from passerby.calibration.run import CalibrationRun, Corrections, Estimate
from passerby.common.progress import Progress, tell_note
from passerby.core.cameras import Rig
from passerby.core.overlap import count_shared_observations, find_connected_groups
from passerby.core.synchronisation import clocks_of
from passerby.findings.finding import Finding, notice
from passerby.interchange.output_folder import group_folder
from passerby.people.ground_positions import Places, places_of
from passerby.scene.inputs import SceneInputs

FEWEST = 2
"""Cameras of a rig."""


@dataclass(frozen=True, eq=False)
class GroupEstimate:
    """An estimate of a group of cameras, after the corrections of the inputs that it asked for."""

    stated: SceneInputs
    """As they were read."""
    inputs: SceneInputs
    estimate: Estimate
    corrections: Corrections
    lenses: LensExamination
    moved: tuple[Motion, ...]
    """The motions of cameras, measured by the final rig."""
    seconds: float
    """Wall time."""
    seams: tuple[Seam, ...] = ()
    """Where people pass between the groups of cameras that it joins."""
    nearest: Seam | None = None
    """Where most people may pass to a group that it does not join."""

    @property
    def rig(self) -> Rig:
        """Names, lenses, and the poses that were found."""
        return self.estimate.solution.rig

    @property
    def doubted(self) -> set[str]:
        """Codes of the doubts about its cameras with poses."""
        found = (*self.estimate.solution.findings, *self.estimate.association.doubts)
        return {one.code for one in found if one.severity == "doubt" and one.code != "camera_without_pose"}


def join_groups(found: Sequence[tuple[GroupEstimate, Calibration]], tell: Progress) -> Calibration:
    """The first calibration, with those of all other groups in it."""
    (_, main), *others = found
    if not others:
        return main
    groups = tuple(replace(one, group=number) for number, (_, one) in enumerate(others, start=2))
    for one in groups:
        tell_note(tell, f"group {one.group}: {len(one.rig.posed())} of {len(one.rig)} cameras registered, {one.verdict}")
    findings = (_finding(one, estimate.nearest) for (estimate, _), one in zip(others, groups, strict=True))
    return replace(main, groups=groups, diagnostics=(*main.diagnostics, *findings))


def stated_parts(names: Sequence[str], stated: Sequence[Sequence[str]]) -> list[list[str]]:
    """The cameras in parts that no chain of stated groups connects, in the order of the names; one part without any."""
    if not stated:
        return [list(names)]
    part = {name: number for number, name in enumerate(names)}
    for group in stated:
        joined = {part[name] for name in group}
        part = {name: min(joined) if number in joined else number for name, number in part.items()}
    return [[name for name in names if part[name] == number] for number in sorted(set(part.values()))]


def unplaced_groups(run: CalibrationRun, found: GroupEstimate) -> list[list[str]]:
    """Groups of cameras without a pose that share people with each other; none where there is no rig at all."""
    rig, seen = found.rig, found.estimate.association.instants
    without = [camera.name for camera in rig if camera.pose is None]
    if len(without) < FEWEST or len(without) == len(rig) or run.scene.solver.method != "people":
        return []
    shared = count_shared_observations(replace(seen, cameras={name: seen[name] for name in without}))
    return [group for group in find_connected_groups(shared) if len(group) >= FEWEST]


def find_seams(run: CalibrationRun, found: Sequence[GroupEstimate]) -> dict[tuple[int, int], Seam]:
    """Where people may pass between two groups, by their numbers; nowhere where clocks may differ by more than a full search
    tries.
    """
    height_m, search_s = run.scene.scale.person_height_m, run.scene.association.search_s
    if search_s > FULL_SEARCH_S:
        return {}
    run.progress("groups of cameras")
    rigs = [one.rig.posed() for one in found]
    ends = [
        find_track_ends(rig, one.estimate.association.instants, height_m) for rig, one in zip(rigs, found, strict=True)
    ]  # fmt: skip
    cameras = [_group_cameras(rig, one.estimate.association) for rig, one in zip(rigs, found, strict=True)]
    out = {}
    for a in range(len(found)):
        for b in range(a + 1, len(found)):
            passage = register_by_passages(ends[a], ends[b], _possible_lags(cameras[a], cameras[b], search_s))
            if passage is not None and passage.clear:
                passage = refine_by_sightings(
                    passage, _places(rigs[a], found[a], height_m), _places(rigs[b], found[b], height_m)
                )
            if passage is not None:
                out[a, b] = Seam.of(passage, cameras[a], cameras[b])
    return out


def _places(rig: Rig, found: GroupEstimate, person_height_m: float) -> Places:
    """The places of all boxes of a group, by the clocks that were found."""
    seen, clocks = found.inputs.observations, found.estimate.association.clocks
    known = {name: clocks.get(name) or clocks_of(seen, [name])[name] for name in rig.names}
    return places_of(rig, {name: seen[name].boxes for name in rig.names}, known, person_height_m)


def nearest_seam(number: int, seams: Mapping[tuple[int, int], Seam]) -> Seam | None:
    """Of a group's seams that with most of the people who are needed."""
    own = [seam for pair, seam in seams.items() if number in pair]
    return max(own, key=lambda seam: seam.people / seam.needed, default=None)


def _group_cameras(rig: Rig, association: Association) -> list[GroupCamera]:
    """The cameras of a group with their poses and clocks."""
    clocks = association.clocks
    return [
        GroupCamera(camera.name, camera.pose, clocks[camera.name].offset_s if camera.name in clocks else 0.0)
        for camera in rig
        if camera.pose is not None
    ]


def _possible_lags(a: Sequence[GroupCamera], b: Sequence[GroupCamera], search_s: float) -> tuple[float, float]:
    """From the least to the largest difference of two groups' clocks: those of two of their cameras differ by `search_s`."""
    first, second = ([camera.offset_s for camera in group] for group in (a, b))
    return min(second) - max(first) - search_s, max(second) - min(first) + search_s


def join_numbers(pairs: Iterable[tuple[int, int]], n: int) -> list[list[int]]:
    """The numbers below n that chains of pairs join, those of two or more, each in ascending order."""
    a, b = np.array(list(pairs), dtype=np.int64).reshape(-1, 2).T
    count, label = connected_components(csr_array((np.ones(len(a)), (a, b)), shape=(n, n)), directed=False)
    groups = [np.flatnonzero(label == number).tolist() for number in range(count)]
    return [group for group in groups if len(group) > 1]


def _finding(one: Calibration, nearest: Seam | None) -> Finding:
    """The notice in the main result that a group has one of its own, and what is nearest to joining it."""
    edge = None if nearest is None else nearest.edges[0]
    joint = {} if nearest is None or edge is None else {
        "nearest": [edge.a, edge.b], "people": nearest.people, "needed": nearest.needed,
    }  # fmt: skip
    return notice(
        "separate_group", *one.rig.names, group=one.group, folder=group_folder(one.group), verdict=one.verdict,
        registered=len(one.rig.posed()), **joint,
    )  # fmt: skip
