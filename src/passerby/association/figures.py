"""Results of association as figures for reports."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from passerby.association.appearance.affinity import AppearanceAffinity
from passerby.association.associate import Tracklets
from passerby.association.camera_tracklets import CameraTracklets
from passerby.association.initial_association import InitialAssociation
from passerby.association.joints.joint_pairs import JointRegistration
from passerby.common.arrays import Floats, Ints
from passerby.core.association_figures import AssociationFigures, CameraTracks, TiedPair
from passerby.core.figures import LevelFigures


def association_figures(
    cameras: Sequence[CameraTracklets], tracklets: Tracklets, appearance: AppearanceAffinity | None,
    initial: InitialAssociation | None, person: Ints,
    offset_s: Floats,
) -> AssociationFigures:  # fmt: skip
    """Collect the figures of cameras, pairs and people."""
    starts = None if initial is None else initial.starts
    return AssociationFigures(
        cameras=tuple(_camera(c, camera, tracklets, appearance) for c, camera in enumerate(cameras)),
        pairs=tuple(_pairs(cameras, tracklets, appearance, initial, person, offset_s)),
        starts=None if starts is None else starts.differences,
        searched_s=None if starts is None else starts.searched_s,
        pairs_tried=None if initial is None or initial.candidates is None else initial.candidates.tried,
        people=len(np.unique(person[np.isfinite(tracklets.start_s)])),
    )


def _camera(c: int, camera: CameraTracklets, tracklets: Tracklets, appearance: AppearanceAffinity | None) -> CameraTracks:
    start_s = tracklets.start_s[tracklets.first[c] : tracklets.first[c + 1]]
    boxes, own = camera.seen.boxes, None if appearance is None else appearance.cameras[c]
    level = camera.level
    return CameraTracks(
        name=camera.name,
        tracklets=int(np.count_nonzero(np.isfinite(start_s))),
        tracked_boxes=int(np.count_nonzero(boxes.identity >= 0)),
        boxes=len(boxes),
        walking_samples=0 if camera.tracks is None else len(camera.tracks),
        own_level=None if level is None else LevelFigures(height_m=level.height, residual=level.residual),
        looks=None if own is None or own.usefulness is None else own.usefulness.probability,
    )


def _pairs(
    cameras: Sequence[CameraTracklets], tracklets: Tracklets, appearance: AppearanceAffinity | None,
    initial: InitialAssociation | None, person: Ints,
    offset_s: Floats,
) -> list[TiedPair]:  # fmt: skip
    edges = {} if initial is None or initial.graph is None else {(e.a, e.b): e for e in initial.graph.edges}
    joints = {} if initial is None else {(one.a, one.b): one for one in initial.by_joints}
    out = []
    for a in range(len(cameras)):
        for b in range(a + 1, len(cameras)):
            edge = edges.get((a, b))
            guess = None if edge is None else edge.guess
            of_looks = None if appearance is None else appearance.pairs.get((a, b))
            of_joints = joints.get((a, b))
            if of_joints is not None and not (of_joints.used or guess is None):
                of_joints = None
            if guess is None and of_looks is None and of_joints is None:
                continue
            useful = None if of_looks is None else of_looks.usefulness
            tied = TiedPair(
                cameras=(cameras[a].name, cameras[b].name),
                route="tracks" if guess is not None else "looks",
                used=edge.used if edge is not None else True,
                score=None if guess is None else guess.score,
                share=None if guess is None else guess.share,
                runner_up=None if edge is None or guess is None else edge.runner_up,
                support=None if edge is None else edge.support,
                matches=None if guess is None else guess.samples,
                matched_tracklets=_joined(tracklets, person, a, b),
                offset_s=float(offset_s[b] - offset_s[a]),
                registered_offset_s=None if guess is None else -guess.lag_s,
                looks=None if useful is None else useful.probability,
            )
            out.append(tied if of_joints is None else _by_joints(tied, of_joints))
    return out


def _by_joints(pair: TiedPair, one: JointRegistration) -> TiedPair:
    """Return the figures of a pair that joints registered."""
    return replace(
        pair, route="joints", used=one.used, score=one.score, share=one.gain, runner_up=one.runner_up, support=None,
        matches=one.joints, registered_offset_s=-one.lag_s,
    )  # fmt: skip


def _joined(tracklets: Tracklets, person: Ints, a: int, b: int) -> int:
    """Count the pairs of tracklets of two cameras that are one person."""
    count = 0
    rows_b = np.arange(tracklets.first[b], tracklets.first[b + 1])
    by_person: dict[int, list[int]] = {}
    for row in rows_b[np.isfinite(tracklets.start_s[rows_b])].tolist():
        by_person.setdefault(int(person[row]), []).append(row)
    for row in range(int(tracklets.first[a]), int(tracklets.first[a + 1])):
        count += len(by_person.get(int(person[row]), ())) if np.isfinite(tracklets.start_s[row]) else 0
    return count
