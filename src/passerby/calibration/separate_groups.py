"""Groups of cameras that share no people: each becomes a rig of its own, with its own frame, metre, clock and verdict.

The largest group is the main rig. Another group never changes it, and nothing that is wrong with one group costs another.
Groups between which people pass are joined first.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import replace

from passerby.association.ground.passages import find_track_ends, register_by_passages
from passerby.association.result import Association
from passerby.association.seams import GroupCamera, Seam
from passerby.calibration.calibration import Calibration
from passerby.calibration.corrections import CorrectedEstimate, correct_inputs
from passerby.calibration.run import CalibrationRun
from passerby.common.progress import Progress, tell_note
from passerby.core.cameras import Rig
from passerby.core.overlap import count_shared_observations, find_connected_groups
from passerby.findings.finding import Finding, notice
from passerby.interchange.output_folder import group_folder
from passerby.scene.inputs import SceneInputs, part_of

FEWEST = 2
"""Cameras of a rig."""


def join_groups(found: Sequence[Calibration], tell: Progress) -> Calibration:
    """The first calibration, with those of all other groups in it."""
    main, *others = found
    if not others:
        return main
    groups = tuple(replace(one, group=number) for number, one in enumerate(others, start=2))
    for one in groups:
        tell_note(tell, f"group {one.group}: {len(one.rig.posed())} of {len(one.rig)} cameras registered, {one.verdict}")
    return replace(main, groups=groups, diagnostics=(*main.diagnostics, *map(_finding, groups)))


def stated_parts(names: Sequence[str], stated: Sequence[Sequence[str]]) -> list[list[str]]:
    """The cameras in parts that no chain of stated groups connects, in the order of the names; one part without any."""
    if not stated:
        return [list(names)]
    part = {name: number for number, name in enumerate(names)}
    for group in stated:
        joined = {part[name] for name in group}
        part = {name: min(joined) if number in joined else number for name, number in part.items()}
    return [[name for name in names if part[name] == number] for number in sorted(set(part.values()))]


def estimate_groups(run: CalibrationRun, inputs: SceneInputs) -> list[CorrectedEstimate]:
    """The rig of all cameras that share people, then those of the groups that it leaves without a pose.

    Groups between which people pass are one rig.
    """
    waiting, found = [inputs], list[CorrectedEstimate]()
    while waiting:
        part = waiting.pop(0)
        one = correct_inputs(run, part)
        left = _unplaced_groups(run, one)
        for names in left:
            tell_note(run.progress, f"{', '.join(names)} share no people with the other cameras: calibrated separately")
        waiting = [*(part_of(part, names) for names in left), *waiting]
        if not found or len(one.rig.posed()) >= FEWEST:
            found.append(one)
    return _join_by_passages(run, inputs, found)


def _unplaced_groups(run: CalibrationRun, found: CorrectedEstimate) -> list[list[str]]:
    """Groups of cameras without a pose that share people with each other; none where there is no rig at all."""
    rig, seen = found.rig, found.estimate.association.instants
    without = [camera.name for camera in rig if camera.pose is None]
    if len(without) < FEWEST or len(without) == len(rig) or run.scene.solver.method != "people":
        return []
    shared = count_shared_observations(replace(seen, cameras={name: seen[name] for name in without}))
    return [group for group in find_connected_groups(shared) if len(group) >= FEWEST]


def _join_by_passages(run: CalibrationRun, inputs: SceneInputs, found: Sequence[CorrectedEstimate]) -> list[CorrectedEstimate]:
    """The groups of cameras, those between which people pass as one; as they were where that makes no rig of all of them."""
    out = list(found)
    if len(found) < 2 or run.scene.association.given or run.scene.solver.method != "people":
        return out
    seams = _find_seams(run, found)
    for members in _joined(seams, len(found)):
        own = [found[number] for number in members]
        cameras = [camera.name for one in own for camera in one.rig.posed()]
        tell_note(
            run.progress, f"people pass between the groups of {', '.join(one.rig.posed().names[0] for one in own)}: one rig"
        )
        between = tuple(seam for pair, seam in seams.items() if set(pair) <= set(members))
        names = {name for one in own for name in one.rig.names}
        one = correct_inputs(replace(run, seams=between), part_of(inputs, names))
        if all(one.rig[name].pose is not None for name in cameras):
            out[out.index(own[0])] = one
            for other in own[1:]:
                out.remove(other)
    return out


def _find_seams(run: CalibrationRun, found: Sequence[CorrectedEstimate]) -> dict[tuple[int, int], Seam]:
    """Where people pass between two groups, by their numbers."""
    run.progress("groups of cameras")
    height_m, search_s = run.scene.scale.person_height_m, run.scene.association.search_s
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
                out[a, b] = Seam.of(passage, cameras[a], cameras[b])
    return out


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


def _joined(pairs: Iterable[tuple[int, int]], n: int) -> list[list[int]]:
    """The numbers below n that chains of pairs join, those of two or more, each in ascending order."""
    label = list(range(n))
    for a, b in pairs:
        old, new = max(label[a], label[b]), min(label[a], label[b])
        label = [new if value == old else value for value in label]
    groups = [[number for number in range(n) if label[number] == value] for value in sorted(set(label))]
    return [group for group in groups if len(group) > 1]


def _finding(one: Calibration) -> Finding:
    """The notice in the main result that a group has one of its own."""
    return notice(
        "separate_group", *one.rig.names, group=one.group, folder=group_folder(one.group), verdict=one.verdict,
        registered=len(one.rig.posed()),
    )  # fmt: skip
