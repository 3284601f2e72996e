"""Correction of the inputs for cameras that were moved, zoomed or kept turning while they filmed.

Observations from before or after a move or a zoom are left out. A slow rotation is removed from the pixels.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from passerby.association.result import Association
from passerby.calibration.run import Correction, Corrections, Estimate
from passerby.common.arrays import Bools, Floats, Ints
from passerby.core.cameras import Lens, Rig
from passerby.core.figures import DriftFigures, MotionFigures, adjusted
from passerby.core.observations import Boxes, CameraObservations, Clock, Keypoints, Observations, once_in_frame
from passerby.core.overlap import count_shared_observations
from passerby.core.synchronisation import USUAL_FPS, clocks_of, resample_to_common_steps
from passerby.findings.finding import Finding, doubt, notice
from passerby.hypotheses.camera_path import CameraPath
from passerby.hypotheses.changes import PoseChange, PoseDrift, drift_of, fit_drift, measure_step, step_of, suspect_change
from passerby.hypotheses.correspondences import Correspondences, instants_compared, match_people
from passerby.interchange.storage.text_formats import key
from passerby.people.body_centres import PeopleRays, body_centres, identified_body_centres
from passerby.people.sightings import Sightings
from passerby.scene.inputs import SceneInputs

MARGIN_S = 0.5
"""Time left out on both sides of a move, seconds: the time of the move is known to a few samples."""
ALL_AROUND_UP_TO = 12
"""Largest number of cameras of a rig in which each one is compared with the people of all others. Up to this number, all pairs
are registered."""
ON_A_FRAME = 1e-6
"""Largest distance from a whole frame that counts as 0: rounding errors of the conversion through seconds."""


@dataclass(frozen=True, eq=False)
class DetectedMotion:
    """A camera that had another pose, or another focal length, for one or more parts of its recording."""

    camera: str
    parts: tuple[tuple[int, int], ...]
    """First and last frame of each part that was left out, of the camera's own frames."""
    fps: float | None
    """Frames per second of the camera's own frames; None where it is not known."""
    change: PoseChange
    either: str | None = None
    """The other camera of a rig of two: it may have moved as well."""

    def seconds(self, frame: int) -> float:
        """Convert a frame to seconds of the camera's own recording."""
        return (frame - 1) / (self.fps or 1.0)

    def contains(self, frames: Floats | Ints, margin: float = 0.0) -> Bools:
        """Return whether each frame (N,) lies in a part that was left out, or within `margin` frames of one."""
        inside = np.zeros(len(frames), dtype=bool)
        for first, last in self.parts:
            inside |= (frames >= first - margin) & (frames <= last + margin)
        return inside

    @property
    def figures(self) -> MotionFigures:
        """Figures for reports."""
        change, frames = self.change, (self.parts[0][0], self.parts[-1][1])
        return MotionFigures(
            camera=self.camera, frames=frames,
            seconds=None if self.fps is None else (self.seconds(frames[0]), self.seconds(frames[1])),
            left_out="between" if change.returns else "before" if change.at_start else "after",
            metres=change.metres, degrees=change.degrees, sigmas=change.sigmas, shift=change.shift,
            zoom=None if change.zoom == 1.0 else change.zoom,
        )  # fmt: skip

    @property
    def finding(self) -> Finding:
        """The finding on a move or a zoom; `frames` are those of the first and the last change, or twice that of the only one.

        It is a notice if the camera came back once, since the rig is right before and after. Else it is a doubt.
        """
        change = self.change
        (first, last), once = (self.parts[0][0], self.parts[-1][1]), not change.returns
        if once:
            first = last = last + 1 if change.at_start else first
        timed = self.fps is not None
        factor = None if change.zoom == 1.0 else 1 / change.zoom if once and change.at_start else change.zoom
        said = doubt if once or len(self.parts) > 1 else notice
        return said(
            "camera_moved", self.camera, *([self.either] if self.either else []),
            metres=change.metres, degrees=change.degrees, factor=factor, left_out=self.figures.left_out, frames=[first, last],
            times=len(self.parts), seconds=[self.seconds(first), self.seconds(last)] if timed else None,
            until_s=max(0, math.floor(self.seconds(first) - MARGIN_S)) if timed else None,
            from_s=math.ceil(self.seconds(last) + MARGIN_S) if timed else None,
            table=f"cameras.{key(self.camera)}",
        )  # fmt: skip


@dataclass(frozen=True, eq=False)
class DetectedDrift:
    """A camera that kept turning during its recording."""

    camera: str
    frames: tuple[float, float]
    """The camera's own frames, fractional, at the drift's first and last knot."""
    fps: float | None
    """Frames per second of the camera's own frames; None where it is not known."""
    drift: PoseDrift
    either: str | None = None
    """The other camera of a rig of two: it may have turned instead."""

    @property
    def minutes(self) -> float | None:
        """Time over which the drift was observed; None where the frame rate is not known."""
        return None if self.fps is None else (self.frames[1] - self.frames[0]) / self.fps / 60.0

    @property
    def figures(self) -> DriftFigures:
        """Figures for reports."""
        return DriftFigures(
            camera=self.camera, degrees=self.drift.degrees, pixels=self.drift.pixels, minutes=self.minutes,
            steady=self.drift.steady,
        )  # fmt: skip

    @property
    def finding(self) -> Finding:
        """The doubt about a drift."""
        figures = self.figures
        return doubt(
            "camera_drifts", self.camera, *([self.either] if self.either else []), together=False, pixels=figures.pixels,
            degrees=figures.degrees, minutes=figures.minutes, steady=figures.steady,
        )  # fmt: skip

    def corrected(self, observations: Observations, lens: Lens) -> Observations:
        """Return the observations that the camera would have made if it had kept its mean orientation.

        Boxes that the image border cuts off are not changed: their cut edges are those of the image.
        """
        seen = observations[self.camera]
        boxes, joints = seen.boxes, seen.keypoints
        middle = boxes.ltwh[:, :2] + 0.5 * boxes.ltwh[:, 2:]
        moved = self._shifted(middle, boxes.frame, lens) - middle
        whole = np.asarray(boxes.inside(lens.size))[:, None]
        ltwh = np.column_stack([boxes.ltwh[:, :2] + np.where(whole, moved, 0.0), boxes.ltwh[:, 2:]])

        def held(points: Keypoints) -> Keypoints:
            frame = np.repeat(points.frame, points.xy.shape[1])
            return replace(points, xy=self._shifted(points.xy.reshape(-1, 2), frame, lens).reshape(points.xy.shape))

        found = CameraObservations(replace(boxes, ltwh=ltwh), held(joints), held(seen.wands))
        return replace(observations, cameras={**observations.cameras, self.camera: found})

    def _shifted(self, pixels: Floats, frame: Ints, lens: Lens) -> Floats:
        """Remove the drift from pixels (N, 2) of frames (N,); they are unchanged where the lens model cannot be inverted."""
        knots = self.drift.knots[[0, -1]]
        shifted = self.drift.shift(lens, pixels, np.interp(frame, self.frames, knots))
        known = np.asarray(np.isfinite(shifted).all(axis=1))
        return np.asarray(np.where(known[:, None], shifted, pixels))


Motion = DetectedMotion | DetectedDrift


def findings_of_motions(motions: Sequence[Motion], rig: Rig) -> list[Finding]:
    """Return the findings on moves, zooms and drifts. Moves of a camera that drifts are parts of its drift.

    If several cameras drift and all but one or all are in motion, one finding is about all of them: the motion of the last
    camera may look like that of the others.
    """
    drifts = [one for one in motions if isinstance(one, DetectedDrift)]
    steps = [one for one in motions if isinstance(one, DetectedMotion)]
    zooms = [one.finding for one in steps if one.change.zoom != 1.0]
    moves = [one for one in steps if one.change.zoom == 1.0]
    moving = {one.camera for one in drifts} | {one.camera for one in moves}
    if len(drifts) > 1 and len(moving) >= len(rig.posed()) - 1:
        pixels = [one.drift.pixels for one in drifts]
        names = [name for name in rig.names if name in moving]
        return [doubt("camera_drifts", *names, together=True, pixels=[min(pixels), max(pixels)]), *zooms]
    drifting = {one.camera for one in drifts}
    return [*(one.finding for one in drifts), *(one.finding for one in moves if one.camera not in drifting), *zooms]


@dataclass(frozen=True, eq=False)
class MotionCorrection(Correction):
    """Inputs that are corrected for the motion of one camera."""

    motion: Motion


@dataclass(frozen=True)
class MotionSearch:
    """Data of the scene for the search for cameras in motion."""

    stated: SceneInputs
    """The inputs as they were read, with the frame rates by which a scene file's seconds are counted."""
    identities_known: bool
    person_height_m: float
    """Mean standing height, metres."""


def correct_motion(search: MotionSearch, inputs: SceneInputs, estimate: Estimate) -> MotionCorrection | None:
    """Find the camera whose motion explains most of the misfit, and correct the inputs; None if none moved.

    Observations of a camera from another pose are left out. A slow rotation is removed from its observations.
    """
    motion = _most_certain(inputs, estimate, search)
    if motion is None:
        return None
    if isinstance(motion, DetectedDrift):
        lens = estimate.solution.rig[motion.camera].lens
        return MotionCorrection(replace(inputs, observations=motion.corrected(inputs.observations, lens)), motion)
    return MotionCorrection(replace(inputs, observations=_without(inputs.observations, motion)), motion)


def measure_motions(search: MotionSearch, corrections: Corrections, estimate: Estimate) -> tuple[Motion, ...]:
    """Measure the motions that were found again by the final rig; for a camera that drifts, return one drift."""
    found: dict[str | int, Motion] = {}
    for number, one in enumerate(corrections.of(MotionCorrection)):
        found[one.motion.camera if isinstance(one.motion, DetectedDrift) else number] = one.motion
    return tuple(
        _drift_measured_again(one, search.stated, estimate, search)
        if isinstance(one, DetectedDrift)
        else _measured_again(one, search.stated, estimate, search)
        for one in found.values()
    )


def _most_certain(inputs: SceneInputs, estimate: Estimate, search: MotionSearch) -> Motion | None:
    """Find the motion of the camera that predicts people best; others may look moved because of it.

    None if a camera at rest predicts them about as well, or if the motion changes the rig's measurements by no more than their
    uncertainty.
    """
    rig, association = estimate.solution.rig, estimate.association
    centres = identified_body_centres(rig, association.instants)
    rays, around = PeopleRays.of(rig, centres), _cameras_around(rig, association.instants)
    suspects = []
    for c, camera in enumerate(rig):
        if camera.pose is None:
            continue
        m = _matched(c, rig, centres[c], rays, around[c], inputs.observations, association, search)
        suspect = suspect_change(m, camera.pose, association.instants.fps or USUAL_FPS, len(rig.posed()))
        if suspect is not None:
            suspects.append((c, suspect, m))
    measuring = adjusted(estimate.solution.figures).measuring
    for c, suspect, m in sorted(suspects, key=lambda one: -one[1].gain):
        change = suspect.compared()
        if change is not None and change.effect(rig, c, m.people.place[:, :2], measuring) > 1:
            break
    else:
        return None
    name, posed = rig.names[c], rig.posed().names
    either = next(other for other in posed if other != name) if len(posed) == 2 else None
    clock = search.stated.observations.clocks.get(name)
    fps = clock.fps if clock is not None else search.stated.observations.fps
    if change.kind == "drifts":
        drift = drift_of(m, change.path, change.over_base.gain)
        return DetectedDrift(name, _span(name, drift, inputs.observations, association), fps, drift, either)
    step = step_of(m, change, stated=rig[name].lens.focal_sd is None)
    own = _own_frames(name, np.array(step.spans).ravel(), inputs.observations, association).reshape(-1, 2)
    parts = np.column_stack([np.ceil(own[:, 0]), np.floor(own[:, 1])]).astype(np.int64)
    frames = _all_frames(inputs.observations[name])
    if step.at_start:
        parts[0, 0] = frames[0]
    if step.at_end:
        parts[-1, 1] = frames[-1]
    return DetectedMotion(name, tuple((int(first), int(last)) for first, last in parts), fps, step, either)


def _span(name: str, drift: PoseDrift, observations: Observations, association: Association) -> tuple[float, float]:
    """Return a camera's own frames, fractional, at the first and the last knot of a drift."""
    first, last = _own_frames(name, drift.knots[[0, -1]], observations, association).tolist()
    return first, last


def _cameras_around(rig: Rig, instants: Observations) -> list[set[int]]:
    """Return, for each camera, itself and the cameras whose people it may see: all in small rigs, else within two overlaps.

    A camera that moved sees the surroundings of its old view. With all cameras, the computing time would be quadratic in their
    number.
    """
    every = set(range(len(rig)))
    if len(rig.posed()) <= ALL_AROUND_UP_TO:
        return [every] * len(rig)
    shared, number = count_shared_observations(instants), {name: c for c, name in enumerate(rig.names)}
    next_to = [{c} | {number[other] for other, one in shared[name].items() if one.people} for name, c in number.items()]
    return [set().union(*(next_to[other] for other in near)) for near in next_to]


def _matched(
    c: int, rig: Rig, own: Sightings | None, rays: PeopleRays, around: Collection[int], observations: Observations,
    association: Association, search: MotionSearch,
) -> Correspondences:  # fmt: skip
    """Match all sightings of a camera with the people's positions by the other cameras `around` it, from all cameras' `rays`.

    If identities were found by association, sightings from another pose have lost or never had one: each may show any person.
    """
    camera = rig.cameras[c]
    known, height_m = search.identities_known, search.person_height_m
    if not known or own is None:
        own = body_centres(_at_instants(camera.name, observations, association, rig), camera)
    others = np.isin(np.arange(len(rig)), [k for k in around if k != c])[rays.camera]
    seen = np.bincount(rays.person[others], minlength=len(rays.instant)) > 0
    instants = instants_compared(own, rays.instant[seen])
    # People are triangulated only at the instants that are compared: each instant is independent of the others.
    people = rays.triangulated(height_m, others & np.isin(rays.instant, instants)[rays.person])
    return match_people(own, people, height_m, given=known, instants=instants)


def _at_instants(name: str, observations: Observations, association: Association, rig: Rig) -> CameraObservations:
    """Return all observations of a camera, with and without identities, at the common instants."""
    seen, grid = observations[name], association.instants.clocks.get(name)
    if grid is None:
        return seen
    clock = _clock(name, observations, association)
    once = CameraObservations(
        seen.boxes.take(once_in_frame(seen.boxes.frame, seen.boxes.identity)),
        seen.keypoints.take(once_in_frame(seen.keypoints.frame, seen.keypoints.identity)),
    )
    return resample_to_common_steps(Observations({name: once}), {name: clock}, sizes={name: rig[name].lens.size}, grid=grid)[
        name
    ]


def _clock(name: str, observations: Observations, association: Association) -> Clock:
    """Return a camera's clock as it was found, or else as it was stated."""
    return association.clocks.get(name) or clocks_of(observations, [name])[name]


def _own_frames(
    name: str, instants: Ints | Floats, observations: Observations, association: Association
) -> NDArray[np.float64]:
    """Return a camera's own frames (N,), fractional, at common instants (N,)."""
    grid = association.instants.clocks.get(name)
    if grid is None:
        return instants.astype(np.float64)
    own = _clock(name, observations, association).frames(grid.seconds(instants))
    near = np.round(own)
    return np.where(np.abs(own - near) < ON_A_FRAME, near, own)


def _all_frames(seen: CameraObservations) -> Ints:
    """Return the frames with people in them, in order."""
    return np.unique(np.concatenate([seen.boxes.frame, seen.keypoints.frame]))


def _without(observations: Observations, moved: DetectedMotion) -> Observations:
    """Remove the observations that a camera made from another pose, and those within `MARGIN_S` of them."""
    margin = MARGIN_S * (moved.fps or USUAL_FPS)
    seen = observations[moved.camera]

    def kept(part: Boxes | Keypoints) -> Bools:
        return ~moved.contains(part.frame, margin)

    boxes, joints, wands = seen.boxes, seen.keypoints, seen.wands
    rest = CameraObservations(boxes.take(kept(boxes)), joints.take(kept(joints)), wands.take(kept(wands)))
    return replace(observations, cameras={**observations.cameras, moved.camera: rest})


def _measured_again(moved: DetectedMotion, inputs: SceneInputs, estimate: Estimate, search: MotionSearch) -> DetectedMotion:
    """Measure a motion by the corrected rig instead of the one that the motion deformed."""
    association, pose = estimate.association, estimate.solution.rig[moved.camera].pose
    if pose is None:
        return moved
    m = _matched_again(moved.camera, inputs, estimate, search)
    own = _own_frames(moved.camera, m.own.step, inputs.observations, association)
    part = m.part(moved.contains(own))
    rate = association.instants.fps or USUAL_FPS
    return replace(moved, change=measure_step(part, pose, moved.change, rate, len(estimate.solution.rig.posed())))


def _drift_measured_again(found: DetectedDrift, inputs: SceneInputs, estimate: Estimate, search: MotionSearch) -> DetectedDrift:
    """Measure a drift by the final rig, from the observations as they were read."""
    pose = estimate.solution.rig[found.camera].pose
    if pose is None:
        return found
    m = _matched_again(found.camera, inputs, estimate, search)
    path = fit_drift(m, CameraPath(pose), len(found.drift.knots) - 1)
    if path is None:
        return found
    drift = drift_of(m, path, found.drift.gain)
    return replace(found, drift=drift, frames=_span(found.camera, drift, inputs.observations, estimate.association))


def _matched_again(name: str, inputs: SceneInputs, estimate: Estimate, search: MotionSearch) -> Correspondences:
    """Match all sightings of a camera, as they were read, with the people's positions by the others in the final rig."""
    rig, association = estimate.solution.rig, estimate.association
    c = rig.names.index(name)
    everything = association.instants
    if search.identities_known:
        # `association.instants` lacks the observations that were left out.
        seen = inputs.observations
        clocks = {name: _clock(name, seen, association) for name in seen.cameras}
        grid = association.instants.clocks.get(name)
        everything = resample_to_common_steps(seen, clocks, grid=grid) if grid else seen
    middles = identified_body_centres(rig, everything)
    rays, everyone = PeopleRays.of(rig, middles), range(len(middles))
    return _matched(c, rig, middles[c], rays, everyone, inputs.observations, association, search)
