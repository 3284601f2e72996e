"""Groups of cameras that share no people: each becomes a separate rig, with its own frame, scale, clock and verdict.

The largest group is the main rig. Other groups never change it, and a fault of one group has no effect on another. Groups
between which people pass are joined first.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

from passerby.association.doors import Door
from passerby.calibration.calibration import Calibration
from passerby.calibration.camera_motion import Motion
from passerby.calibration.lens_corrections import LensExamination
from passerby.calibration.run import CalibrationRun, Corrections, Estimate
from passerby.common.progress import Progress, tell_note
from passerby.core.cameras import Rig
from passerby.core.overlap import count_shared_observations, find_connected_groups
from passerby.core.usability import MISSING, doubt_missing_pose
from passerby.findings.finding import Finding, notice
from passerby.interchange.output_folder import group_folder
from passerby.scene.inputs import SceneInputs

FEWEST = 2
"""Least number of cameras of a rig."""


@dataclass(frozen=True, eq=False)
class GroupEstimate:
    """An estimate of a group of cameras, after the corrections of its inputs."""

    stated: SceneInputs
    """The inputs as they were read; the next field has them after the corrections."""
    inputs: SceneInputs
    estimate: Estimate
    corrections: Corrections
    lenses: LensExamination
    moved: tuple[Motion, ...]
    """The motions of cameras, measured by the final rig."""
    seconds: float
    """Wall time of the estimate."""
    doors: tuple[Door, ...] = ()
    """Doors between the groups of cameras that it joins."""
    nearest: Door | None = None
    """The door to a group that it does not join, with the largest share of the people needed for joining; None without one."""

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
    """Return the first calibration, which contains those of all other groups."""
    (_, main), *others = found
    if not others:
        return main
    groups = tuple(replace(one, group=number) for number, (_, one) in enumerate(others, start=2))
    for one in groups:
        tell_note(tell, f"group {one.group}: {len(one.rig.posed())} of {len(one.rig)} cameras registered, {one.verdict}")
    findings = (_finding(one, estimate.nearest) for (estimate, _), one in zip(others, groups, strict=True))
    return replace(main, groups=groups, diagnostics=(*_doubt_groups_once(main, groups), *findings))


def _doubt_groups_once(main: Calibration, groups: Sequence[Calibration]) -> list[Finding]:
    """Return the findings of the main group, with one doubt for all cameras of other groups: some were joined since."""
    elsewhere = {name for one in groups for name in one.rig.posed().names}
    causes = {
        number: why
        for number, one in enumerate(main.diagnostics)
        if one.code == MISSING and one.values["why"] and elsewhere.issuperset(one.cameras)
        if (why := Finding.of_value(one.values["why"])).code == "cameras_share_nobody"
    }
    if len(causes) < 2:
        return list(main.diagnostics)
    first, names = min(causes), {name for why in causes.values() for name in why.cameras}
    cause = replace(
        causes[first], cameras=tuple(name for name in main.rig.names if name in names),
        values={**causes[first].values, "main": list(main.rig.posed().names),
                "groups": sum(not names.isdisjoint(one.rig.names) for one in groups)},
    )  # fmt: skip
    return [
        doubt_missing_pose(cause) if number == first else one
        for number, one in enumerate(main.diagnostics)
        if number == first or number not in causes
    ]


def stated_parts(names: Sequence[str], stated: Sequence[Sequence[str]]) -> list[list[str]]:
    """Divide the cameras into parts that no chain of stated groups connects, in the order of the names.

    Without stated groups there is one part.
    """
    if not stated:
        return [list(names)]
    part = {name: number for number, name in enumerate(names)}
    for group in stated:
        joined = {part[name] for name in group}
        part = {name: min(joined) if number in joined else number for name, number in part.items()}
    return [[name for name in names if part[name] == number] for number in sorted(set(part.values()))]


def unplaced_groups(run: CalibrationRun, found: GroupEstimate) -> list[list[str]]:
    """Find groups of cameras without a pose that share people with each other; none if no camera has a pose."""
    rig, seen = found.rig, found.estimate.association.instants
    without = [camera.name for camera in rig if camera.pose is None]
    if len(without) < FEWEST or len(without) == len(rig) or run.scene.solver.method != "people":
        return []
    shared = count_shared_observations(replace(seen, cameras={name: seen[name] for name in without}))
    return [group for group in find_connected_groups(shared) if len(group) >= FEWEST]


def _finding(one: Calibration, nearest: Door | None) -> Finding:
    """Return the notice in the main result on a separate group, with the door that is nearest to joining it."""
    joint = {} if nearest is None else {
        "nearest": list(nearest.nearest), "people": nearest.passage.votes, "needed": nearest.passage.needed,
        "open": not nearest.passage.turn_known,
    }  # fmt: skip
    return notice(
        "separate_group", *one.rig.names, group=one.group, folder=group_folder(one.group), verdict=one.verdict,
        registered=len(one.rig.posed()), **joint,
    )  # fmt: skip
