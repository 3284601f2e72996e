"""Groups of cameras that share nobody: each becomes a rig of its own, with its own frame, metre, clock and verdict.

The largest group is the main rig. Another group never changes it, and nothing that is wrong with one group costs another.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

from passerby.calibration.calibration import Calibration
from passerby.common.progress import Progress, tell_note
from passerby.core.overlap import connected_groups, count_shared_observations
from passerby.findings.finding import Finding, notice
from passerby.interchange.output_folder import group_folder
from passerby.scene.inputs import SceneInputs, part_of

FEWEST = 2
"""Cameras of a rig."""

Calibrate = Callable[[SceneInputs], Calibration]


def calibrate_by_groups(
    inputs: SceneInputs, stated: Sequence[Sequence[str]], calibrate: Calibrate, tell: Progress
) -> Calibration:
    """The calibration of the largest group, with those of all other groups in it.

    Args:
        inputs: of all cameras.
        stated: names of cameras that may share ground, by the user (`[sites] groups`); empty where nothing is stated. Cameras
            that no chain of them connects are calibrated by themselves from the start.
        calibrate: calibrates the cameras of some inputs together; cameras that share nobody with its largest group have no
            pose then.
        tell: told of each group.
    """
    parts = stated_parts(inputs.rig.names, stated)
    if len(parts) == 1:
        main, *others = _with_others(inputs, calibrate, tell)
    else:
        found = [one for part in parts for one in _with_others(part_of(inputs, part), calibrate, tell)]
        main, *others = sorted(found, key=lambda one: -len(one.rig.posed()))
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


def _with_others(inputs: SceneInputs, calibrate: Calibrate, tell: Progress) -> list[Calibration]:
    """The calibration of the largest group, and those of the groups that it leaves out, each with a rig."""
    main = calibrate(inputs)
    found = [main]
    for names in unplaced_groups(main):
        tell_note(tell, f"{', '.join(names)} share nobody with the other cameras: they are calibrated by themselves")
        found += [one for one in _with_others(part_of(inputs, names), calibrate, tell) if len(one.rig.posed()) >= FEWEST]
    return found


def unplaced_groups(main: Calibration) -> list[list[str]]:
    """The cameras without a pose, as far as people tie two or more of them together; none where there is no rig at all."""
    without = [camera.name for camera in main.rig if camera.pose is None]
    if len(without) < FEWEST or len(without) == len(main.rig) or main.scene.solver.method != "people":
        return []
    seen = main.instants
    shared = count_shared_observations(replace(seen, cameras={name: seen[name] for name in without}))
    return [group for group in connected_groups(shared) if len(group) >= FEWEST]


def _finding(one: Calibration) -> Finding:
    """The notice in the main result that a group has one of its own."""
    return notice(
        "separate_group", *one.rig.names, group=one.group, folder=group_folder(one.group), verdict=one.verdict,
        registered=len(one.rig.posed()),
    )  # fmt: skip
