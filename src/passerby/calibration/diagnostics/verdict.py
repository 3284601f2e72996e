"""The verdict on a solution, with the checks that do not depend on the solver, and the notice on people of unusual height."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from passerby.common.arrays import Floats
from passerby.core.cameras import Rig
from passerby.core.figures import PeopleFigures
from passerby.core.observations import UNKNOWN, Observations
from passerby.core.overlap import count_shared_observations, missing_overlap
from passerby.core.solution import Solution, decide_verdict
from passerby.core.usability import add_missing_camera_doubts, add_uncertainty_doubts
from passerby.findings.finding import Finding, notice
from passerby.geometry.triangulation import triangulate

LINE_WIDTH_M = 0.25
"""If nine of ten positions are this close to one line, metres, people walked on one line: half a body's breadth, and the noise
of a box's centre."""
LINE_SHARE = 0.02
"""The same limit as a share of the length of the line, because the noise grows with it; the larger limit is used."""
MIN_POSITIONS = 10


def with_verdict(
    solution: Solution, observations: Observations, *, given: bool = True, why: Mapping[str, Finding] | None = None,
    causes: Sequence[Finding] = (), doubts: Sequence[Finding] = (),
) -> Solution:  # fmt: skip
    """Determine the verdict and the findings: a rig is not accepted if a camera is missing or measurements are too uncertain.

    Args:
        solution: result of a solver.
        observations: people at common instants.
        given: whether their identities were given, not found.
        why: by camera, the reason why it has no pose, if more is known than that it shares no people.
        causes: doubts about the input and about cameras that were in motion. They come first: other findings follow from them.
        doubts: other evidence against the rig, and notices that may explain an uncertainty.
    """
    findings = [*causes, *solution.findings, *doubts]
    missing = len(solution.rig.posed()) < len(solution.rig)
    separate = _find_separate_cameras(observations, given, why or {}, nothing_known=not findings) if missing else []
    if solution.verdict == "refused":
        findings = [*solution.findings, *causes, *doubts]
        separate = [replace(one, severity="refusal") for one in separate]
    findings += [one for one in separate if not any(one.says_same(other) for other in findings)]
    if solution.verdict != "refused":
        findings = add_missing_camera_doubts(solution.rig, findings)
    degenerate = people_not_spread(solution.rig, observations)
    findings += [] if degenerate is None else [degenerate]
    findings = add_uncertainty_doubts(solution.rig, solution.figures, findings)
    return replace(solution, verdict=decide_verdict(solution.rig, findings), findings=tuple(findings))


def _find_separate_cameras(
    observations: Observations, given: bool, why: Mapping[str, Finding], *, nothing_known: bool
) -> list[Finding]:
    """Return the reasons why cameras are separate, one finding for each group of them."""
    found = missing_overlap(count_shared_observations(observations), given=given)
    if not given and any(one.code == "no_shared_people" for one in found) and not nothing_known:
        return []  # other findings already state that identities were not found, and the reason
    return [why.get(one.cameras[0], one) if len(one.cameras) == 1 else one for one in found]


def people_positions(rig: Rig, observations: Observations) -> Floats:
    """Return the triangulated box centres (N, 3) of the people seen by two or more cameras, world, metres."""
    return placed_people(rig, observations)[1]


def placed_people(rig: Rig, observations: Observations) -> tuple[Floats, Floats]:
    """Return frame and identity (N, 2) of people seen by two or more cameras, and their triangulated box centres (N, 3)."""
    posed = [camera for camera in rig if camera.pose is not None]
    columns, bearings = [], []
    for index, camera in enumerate(posed):
        boxes = observations[camera.name].boxes
        columns.append(np.column_stack([np.full(len(boxes), index), boxes.frame, boxes.identity]))
        bearings.append(camera.lens.bearings(boxes.ltwh[:, :2] + boxes.ltwh[:, 2:] / 2))
    if not columns:
        return np.zeros((0, 2)), np.zeros((0, 3))
    rows, rays = np.concatenate(columns), np.concatenate(bearings)
    sound = np.isfinite(rays).all(axis=1) & (rows[:, 2] > UNKNOWN)
    rows, rays = rows[sound], rays[sound]
    if not len(rows):
        return np.zeros((0, 2)), np.zeros((0, 3))
    instants, point = np.unique(rows[:, 1:], axis=0, return_inverse=True)
    poses = [camera.pose for camera in posed if camera.pose is not None]
    points = triangulate(
        rows[:, 0],
        point.reshape(-1),
        rays,
        np.array([pose.R_cw for pose in poses]),
        np.array([pose.t_cw for pose in poses]),
        len(instants),
    )
    placed = np.isfinite(points).all(axis=1)
    return instants[placed], points[placed]


def people_not_spread(rig: Rig, observations: Observations) -> Finding | None:
    """Return a notice if all people stay on one spot or walk on one line, which does not determine a rig; else None.

    The joints of a body are spread in space: with them, one person on one spot is enough.
    """
    with_joints = sum(len(observations[camera.name].keypoints) > 0 for camera in rig) > 1
    return None if with_joints else _one_line_or_spot(people_positions(rig, observations))


def _one_line_or_spot(points: Floats) -> Finding | None:
    """Return a notice if positions (N, 3), world, z up, are on one spot or line; None if they are not, or are too few."""
    if len(points) < MIN_POSITIONS:
        return None
    ground = points[:, :2] - np.median(points[:, :2], axis=0)
    near = ground[np.linalg.norm(ground, axis=1) <= np.percentile(np.linalg.norm(ground, axis=1), 90)]
    _, _, axes = np.linalg.svd(near - near.mean(axis=0), full_matrices=False)
    along, across = np.abs((near - near.mean(axis=0)) @ axes.T).T
    length = 2 * float(along.max())
    width = float(np.percentile(across, 90))
    if length < 2 * LINE_WIDTH_M:
        return notice("people_not_spread", shape="spot", length_m=length)
    if width < max(LINE_WIDTH_M, LINE_SHARE * length):
        return notice("people_not_spread", shape="line", length_m=length)
    return None


def find_unusual_heights(people: PeopleFigures | None) -> tuple[Finding, ...]:
    """Return a notice on people not used for the scale by the solver: their identities, and the heights of all by the rig."""
    if people is None or not people.unusual:
        return ()
    low, high = (float(one) for one in np.percentile([people.heights_m[str(who)] for who in people.unusual], (0, 100)))
    usual = float(np.median(list(people.heights_m.values())))
    identities = list(people.unusual)
    return (notice("people_unusual", identities=identities, low_m=low, high_m=high, usual_m=usual),)
