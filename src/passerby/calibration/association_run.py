"""The state of association between the rounds of a calibration: people by row, common time steps and figures."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass, field, replace

import numpy as np

from passerby.association.ambiguity import ambiguous_cameras
from passerby.association.appearance.affinity import AppearanceAffinity
from passerby.association.associate import Tracklets, cluster_by_rig
from passerby.association.attachment import Attached, attach_cameras
from passerby.association.camera_tracklets import CameraTracklets, with_lens
from passerby.association.cleaning import reassign_detections
from passerby.association.clocks.drift import Drift, clock_drifts, drift_findings
from passerby.association.clocks.offsets import (
    clocks_with,
    relative_to_reference,
    synchronise,
)
from passerby.association.clocks.starts import MeasuredStart, contradicted_starts
from passerby.association.figures import association_figures
from passerby.association.graph import ViewGraph
from passerby.association.initial_association import (
    InitialAssociation,
)
from passerby.association.joints.joint_graph import joined_by_joints
from passerby.association.registration_failures import nobody_walks, unregistered_cameras
from passerby.association.result import Association
from passerby.association.shared_sightings import joined_sightings
from passerby.calibration.pointed_heights import PointedHeights, identity_at, pointed_heights, unfulfilled
from passerby.common.arrays import Floats, Ints
from passerby.common.progress import Progress
from passerby.core.association_figures import AssociationRound
from passerby.core.cameras import Rig
from passerby.core.observations import UNKNOWN, CameraObservations, Observations, once_in_frame
from passerby.core.pointing import PointedPerson, Sighting, StatedIdentities
from passerby.core.solution import Solution
from passerby.core.stature import PERSON_HEIGHT_M
from passerby.core.synchronisation import find_common_time_steps
from passerby.findings.finding import Finding, notice

AGAIN_S = 0.5
"""Range in which the clock offset of a camera that the rig's people placed is searched in the next round, seconds."""


@dataclass(frozen=True)
class AssociationOptions:
    """Options of the search for identities."""

    mode: str = "combined"
    """combined | trajectory | appearance"""
    search_s: float = 5.0
    """Largest difference of two cameras' clocks that is searched for, seconds; 0 takes them as synchronised."""
    person_height_m: float = PERSON_HEIGHT_M
    """Mean standing height, metres."""
    pointed: tuple[PointedPerson, ...] = ()
    """People of known height, each named by a pixel."""
    measured: tuple[MeasuredStart, ...] = ()
    """Differences of two cameras' clocks from sources other than people."""
    stated: StatedIdentities = field(default_factory=StatedIdentities)
    """Identities that the user corrects."""
    groups: tuple[tuple[str, ...], ...] = ()
    """Names of cameras that may share ground, if the user states them: only cameras of one group are compared."""


def with_lenses_of(cameras: Sequence[CameraTracklets], rig: Rig, person_height_m: float) -> list[CameraTracklets]:
    """Compute the people of the cameras again with the lenses of a rig."""
    rngs = np.random.default_rng(0).spawn(len(cameras))
    return [
        with_lens(one, camera.lens, person_height_m, rng) for one, camera, rng in zip(cameras, rig, rngs, strict=True)
    ]  # fmt: skip


@dataclass(frozen=True, eq=False)
class AssociationRun:
    """The part of association that is the same in all rounds, with its results for any identities and clocks."""

    rig: Rig
    cameras: Sequence[CameraTracklets]
    tracklets: Tracklets
    appearance: AppearanceAffinity | None
    options: AssociationOptions
    compared: tuple[tuple[str, str], ...] | None = None
    """Names of each two cameras that may see one person at one time; None: all."""

    def with_lenses(self, found: Rig) -> AssociationRun:
        """Return the same people with the lenses that a solution has estimated."""
        cameras = tuple(
            replace(old, lens=replace(new.lens, uncalibrated=True)) if old.lens.uncalibrated and new.pose else old
            for old, new in zip(self.rig, found, strict=True)
        )
        rig = replace(self.rig, cameras=cameras)
        return replace(self, rig=rig, cameras=with_lenses_of(self.cameras, rig, self.options.person_height_m))

    def rows(self, person: Ints, offset_s: Floats, solution: Solution | None) -> list[tuple[Ints, Ints]]:
        """Return the person of every box (N,) and of every set of joints (M,), camera by camera; -1 for no person."""
        out = []
        for c, camera in enumerate(self.cameras):
            own = person[self.tracklets.first[c] : self.tracklets.first[c + 1]]
            parts = []
            for part in (camera.seen.boxes, camera.seen.keypoints):
                known = part.identity > UNKNOWN
                column = np.full(len(part), UNKNOWN)
                column[known] = own[part.identity[known]]
                parts.append(_once(column, part.frame, part.identity))
            out.append((parts[0], parts[1]))
        if solution is None:
            return out
        bodies = [camera.bodies for camera in self.cameras]
        before = [
            np.where(seen.from_joints, _at(joints, seen.row), _at(boxes, seen.row))
            for seen, (boxes, joints) in zip(bodies, out, strict=True)
        ]
        clocks = clocks_with(self.cameras, offset_s)
        grid = find_common_time_steps(Observations({camera.name: camera.seen for camera in self.cameras}), clocks).clock
        for (boxes, joints), seen, after in zip(
            out,
            bodies,
            reassign_detections(solution.rig, bodies, before, clocks, grid, self.options.person_height_m),
            strict=True,
        ):
            boxes[seen.row[~seen.from_joints]] = after[~seen.from_joints]
            joints[seen.row[seen.from_joints]] = after[seen.from_joints]
        return [
            (_once(boxes, camera.seen.boxes.frame, boxes), _once(joints, camera.seen.keypoints.frame, joints))
            for camera, (boxes, joints) in zip(self.cameras, out, strict=True)
        ]

    def lost(
        self, solution: Solution, graph: ViewGraph, before: Mapping[int, Attached], *, search: bool
    ) -> dict[int, tuple[float, float]]:
        """Return, by index of cameras without pose or registration, range and centre of the clock offset's search, seconds.

        A camera that was placed `before` is searched near its last offset. The others are searched only with `search`.
        """
        alone = {group[0] for group in graph.groups if len(group) == 1}
        without = {c for c, camera in enumerate(solution.rig) if camera.pose is None} & alone
        search_s = self.options.search_s
        again = {c: (min(search_s, AGAIN_S), before[c].offset_s) for c in sorted(without & set(before))}
        return again | (dict.fromkeys(sorted(without - set(before)), (search_s, 0.0)) if search else {})

    def known(self, rows: Sequence[tuple[Ints, Ints]]) -> PointedHeights:
        """Return the heights of the people that the user marked, by the identities from `identified`."""
        return pointed_heights(self.options.pointed, lambda one: self._identity(one, rows))

    def _identity(self, one: PointedPerson | Sighting, rows: Sequence[tuple[Ints, Ints]]) -> int | None:
        """Return the identity of a person at a pixel, in the numbering of `identified`; None without one."""
        c = self.rig.names.index(one.camera) if one.camera in self.rig.names else None
        person = None if c is None else identity_at(one, self.cameras[c].seen, *rows[c])
        return None if person is None else person + 1

    def identified(self, rows: Sequence[tuple[Ints, Ints]]) -> Observations:
        """Return the observations with an identity, in each camera's own frames."""
        cameras = {}
        for camera, (boxes, joints) in zip(self.cameras, rows, strict=True):
            named = replace(camera.seen.boxes, identity=boxes + 1), replace(camera.seen.keypoints, identity=joints + 1)
            cameras[camera.name] = CameraObservations(
                named[0].take(boxes > UNKNOWN), named[1].take(joints > UNKNOWN), camera.seen.wands
            )  # fmt: skip
        return Observations(cameras)

    def instants(self, identified: Observations, offset_s: Floats) -> Observations:
        """Resample identified observations to instants that all cameras share."""
        seen = synchronise(self.rig, self.cameras, identified, offset_s)
        return seen if self.compared is None else joined_sightings(seen, self.compared)

    def association(
        self, person: Ints, offset_s: Floats, solution: Solution | None, initial: InitialAssociation | None,
        rounds: list[AssociationRound], sigma_s: Floats | None = None, attached: Collection[int] = (),
    ) -> Association:  # fmt: skip
        """Return the association. The first registered camera's clock is the rig's; `attached`: cameras placed by the rig."""
        offset_s = relative_to_reference(offset_s, solution.rig if solution else None)
        rows = self.rows(person, offset_s, solution)
        identified, heights = self.identified(rows), self.known(rows)
        known = {} if sigma_s is None else dict(zip(self.rig.names, sigma_s.tolist(), strict=True))
        figures = association_figures(self.cameras, self.tracklets, self.appearance, initial, person, offset_s)
        graph = initial.graph if initial is not None else None
        drifts = {} if solution is None else self._drifts(person, offset_s, solution)
        return Association(
            identified, self.instants(identified, offset_s), clocks_with(self.cameras, offset_s),
            {name: sigma for name, sigma in known.items() if np.isfinite(sigma)}, replace(figures, rounds=tuple(rounds)),
            {} if graph is None or initial is None
            else unregistered_cameras(
                self.cameras, graph, self.options.search_s, starts=initial.starts, near=initial.candidates
            ),
            *self._findings(solution, initial, drifts, offset_s, attached, rows),
            {self.cameras[c].name: drift for c, drift in drifts.items()},
            heights.people, heights.findings,
        )  # fmt: skip

    def identify_by_rig(
        self, person: Ints, offset_s: Floats, solution: Solution, initial: InitialAssociation, attached: dict[int, Attached],
        *, search: bool, executor: Executor | None, tell: Progress,
    ) -> tuple[Ints, int]:  # fmt: skip
        """Place cameras without a pose by the people of the rig, and identify all tracklets again by the rig.

        Args:
            person: (T,) person of each tracklet so far.
            offset_s: (C,) offsets of the clocks, seconds; those of cameras that are placed here are changed in place.
            solution: the rig.
            initial: the first association.
            attached: cameras that the rig's people placed before; those of this round are added.
            search: whether poses are also searched for cameras that were not placed before.
            executor: processes cameras in parallel.
            tell: called with each stage as it begins.

        Returns:
            (T,) the person of each tracklet, and the number of cameras with poses.
        """
        poses = [camera.pose for camera in solution.rig]
        if initial.graph is not None:
            height_m = self.options.person_height_m
            lost = self.lost(solution, initial.graph, attached, search=search)
            first = self.tracklets.first
            own = [person[first[c] : first[c + 1]] for c in range(len(poses))]
            found = attach_cameras(
                self.cameras, poses, own, offset_s, height_m, lost, initial.candidates,
                executor if initial.candidates is not None else None, tell,
            )  # fmt: skip
            attached |= found
            for c, one in found.items():
                poses[c], offset_s[c] = one.pose, one.offset_s
            affinity = self.appearance.affinity() if self.appearance else None
            person = cluster_by_rig(
                self.tracklets, self.cameras, initial.graph, poses, offset_s, height_m, affinity, initial.known,
                initial.candidates,
            )  # fmt: skip
        return person, sum(pose is not None for pose in poses)

    def _drifts(self, person: Ints, offset_s: Floats, solution: Solution) -> dict[int, Drift]:
        """Return the drifts of the clocks by the rig, by index of the camera."""
        first, poses = self.tracklets.first, [camera.pose for camera in solution.rig]
        own = [person[first[c] : first[c + 1]] for c in range(len(self.cameras))]
        return clock_drifts(self.cameras, poses, own, offset_s)

    def _findings(
        self,
        solution: Solution | None,
        initial: InitialAssociation | None,
        drifts: Mapping[int, Drift],
        offset_s: Floats,
        attached: Collection[int],
        rows: Sequence[tuple[Ints, Ints]],
    ) -> tuple[tuple[Finding, ...], tuple[Finding, ...]]:
        """Return the doubts about the association, and the notices on it."""
        if solution is None:
            return (), ()
        poses = [camera.pose for camera in solution.rig]
        doubts, notices = drift_findings(self.cameras, drifts)
        graph = initial.graph if initial is not None else None
        walked = graph is not None and any(edge.used for edge in graph.edges)
        if graph is not None:
            doubts = [*doubts, *ambiguous_cameras(graph, self.rig.names)]
        notices = [*notices, *unfulfilled(self.options.stated, lambda one: self._identity(one, rows))]
        joined = joined_by_joints(self.cameras, initial.by_joints) if initial is not None else []
        joined += [notice("registered_by_rig", self.cameras[c].name) for c in sorted(attached) if poses[c] is not None]
        if initial is not None and initial.starts is not None:
            registered = [pose is not None for pose in poses]
            contradicted = contradicted_starts(initial.starts, self.rig.names, offset_s, registered)
            notices = [*initial.starts.notices, *contradicted, *notices]
        return (*(nobody_walks(self.cameras, poses) if walked else ()), *doubts), (*joined, *notices)


def share_of_same_pairs(before: Ints, after: Ints) -> float:
    """Compute the similarity of two groupings of tracklets (T,): pairs together in both, as a share of those in either."""

    def pairs(label: Ints) -> float:
        count = np.bincount(label).astype(np.float64)
        return float((count * (count - 1)).sum() / 2)

    _, both = np.unique(np.column_stack([before, after]), axis=0, return_inverse=True)
    common = pairs(both.ravel())
    return common / max(pairs(before) + pairs(after) - common, 1.0)


def _at(column: Ints, row: Ints) -> Ints:
    """Return the column at the rows; -1 beyond its end, for rows that belong to another column."""
    padded = np.append(column, UNKNOWN)
    return np.asarray(padded[np.minimum(row, len(column))])


def _once(person: Ints, frame: Ints, tracklet: Ints) -> Ints:
    """Keep each person once in a frame: of two rows of a person, that of the longer tracklet; the other gets -1."""
    length = np.bincount(tracklet[tracklet > UNKNOWN], minlength=1)
    long = np.where(tracklet > UNKNOWN, length[np.maximum(tracklet, 0)], 0)
    kept = np.isin(np.arange(len(person)), once_in_frame(frame, person, -long))
    return np.where(kept, person, UNKNOWN)
