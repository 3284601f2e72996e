"""Groups of cameras that share no people: each becomes a rig of its own, with its own frame, metre, clock and verdict.

The largest group is the main rig. Another group never changes it, and nothing that is wrong with one group costs another.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from passerby.calibration.calibration import Calibration
from passerby.common.progress import Progress, tell_note
from passerby.core.overlap import count_shared_observations, find_connected_groups
from passerby.findings.finding import Finding, notice
from passerby.interchange.output_folder import group_folder

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


def unplaced_groups(main: Calibration) -> list[list[str]]:
    """Groups of cameras without a pose that share people with each other; none where there is no rig at all."""
    without = [camera.name for camera in main.rig if camera.pose is None]
    if len(without) < FEWEST or len(without) == len(main.rig) or main.scene.solver.method != "people":
        return []
    seen = main.instants
    shared = count_shared_observations(replace(seen, cameras={name: seen[name] for name in without}))
    return [group for group in find_connected_groups(shared) if len(group) >= FEWEST]


def _finding(one: Calibration) -> Finding:
    """The notice in the main result that a group has one of its own."""
    return notice(
        "separate_group", *one.rig.names, group=one.group, folder=group_folder(one.group), verdict=one.verdict,
        registered=len(one.rig.posed()),
    )  # fmt: skip
