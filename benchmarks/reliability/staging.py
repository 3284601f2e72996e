"""Scenes that are staged: people moved, cameras placed, and pictures spoilt in other ways than the simulator's own options."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, fields, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from passerby.common.arrays import Floats, Ints
from passerby.core.cameras import Camera, Lens, Pose, Rig
from passerby.core.measuring import places_of_people
from passerby.core.observations import Boxes
from passerby.simulation import SimulationOptions, simulate
from passerby.simulation.body import BodyState, pose_joints, stride_length
from passerby.simulation.lenses import looking_at, place_cameras
from passerby.simulation.motion import STEP_S, Motion, simulate_motion
from passerby.simulation.observe import View, observe_camera
from passerby.simulation.scene import Filmed, SimulatedScene, remove_faults

Mask = NDArray[np.bool_]


@dataclass(frozen=True, eq=False)
class HandedIn:
    """What a user hands in, and what is true of it."""

    lenses: Rig
    """The cameras as the user states them; their poses are not read."""
    boxes: Mapping[str, Boxes]
    truth: Rig
    """Where the cameras that filmed the boxes are."""
    fps: float | Mapping[str, float] = 5.0
    tables: Mapping[str, Mapping[str, Any]] = field(default_factory=dict)
    later: Rig | None = None
    """Where they are in the end, where that is elsewhere: a rig is right only if it is right for both."""
    who: Mapping[str, Ints] = field(default_factory=dict)
    """Camera -> (N,) whom each box shows; -1 for nobody. For spoiling, not for the product."""
    walked: Floats | None = None
    """(N, 2) places on the true ground where people were, metres: there a rig is judged. None: on a grid."""

    def with_boxes(self, camera: str, boxes: Boxes, who: Ints | None = None) -> HandedIn:
        """Another set of boxes in one camera."""
        known = self.who if who is None else {**self.who, camera: who}
        return replace(self, boxes={**self.boxes, camera: boxes}, who=known)

    def kept(self, camera: str, rows: Mask) -> HandedIn:
        """Only some of a camera's boxes."""
        return self.with_boxes(camera, self.boxes[camera].take(rows), self.who[camera][rows])

    def with_lens(self, camera: str, change: Callable[[Lens], Lens]) -> HandedIn:
        """Another lens stated for one camera than it has."""
        cameras = tuple(replace(c, lens=change(c.lens)) if c.name == camera else c for c in self.lenses)
        return replace(self, lenses=Rig(cameras))

    def as_shown(self, camera: str, change: Callable[[Lens], Lens]) -> HandedIn:
        """Boxes in pixels of another picture than the one filmed: the lens that would be right for it."""
        cameras = tuple(replace(c, lens=change(c.lens)) if c.name == camera else c for c in self.truth)
        return replace(self, truth=Rig(cameras))

    def with_tables(self, **tables: Mapping[str, Any]) -> HandedIn:
        """Further tables of the scene file."""
        return replace(self, tables={**self.tables, **tables})


def affine(lens: Lens, scale: float, shift: Sequence[float]) -> Lens:
    """The lens of a picture whose pixels are those of another one, scaled, then shifted by (x, y)."""
    matrix = np.array(lens.matrix)
    matrix[:2] *= scale
    matrix[:2, 2] += shift
    return replace(lens, matrix=matrix)


MoveRig = Callable[[Rig, np.random.Generator], Rig]
MovePeople = Callable[[Motion, Floats, np.random.Generator], Motion]


def staged(
    seed: int, *, given: bool = True, rig: MoveRig | None = None, people_move: MovePeople | None = None,
    later: tuple[float, MoveRig] | None = None, **wanted: Any,
) -> HandedIn:  # fmt: skip
    """A scene of four cameras and six people, half a minute long, with an ordinary detector; changed as asked for.

    Args:
        seed: of everything.
        given: whether identities are given; otherwise each camera numbers its tracklets by itself.
        rig: changes the cameras; the first ones stand about the preset's area.
        people_move: changes the motion of people of the heights (P,).
        later: from so many seconds on, the cameras are where this moves them.
        wanted: fields of `SimulationOptions`.
    """
    defaults = {
        "cameras": 4, "people": 6, "seconds": 30.0, "box_noise": 0.02, "missing": 0.05, "false_boxes": 0.03,
        "unrelated_ids": not given, "tracklet_seconds": 0.0 if given else 10.0, "clock_offsets": 0.0 if given else 1.0,
    }  # fmt: skip
    options = SimulationOptions(seed=seed, **{**defaults, **wanted})
    filmed, after = _filmed(options, rig, people_move, later)
    scene = simulate(options, filmed)
    tables = {"association": {"mode": "given" if given else "combined"}}
    boxes = {name: scene.observations[name].boxes for name in scene.rig.names}
    rates = dict(zip(scene.rig.names, options.frame_rates, strict=True)) if options.camera_fps else options.fps
    return HandedIn(scene.rig, boxes, scene.rig, rates, tables, after, _who(scene), walked_places(scene))


def walked_places(scene: SimulatedScene) -> Floats:
    """(N, 2) places on the ground where the cameras see people, metres."""
    return places_of_people(scene.rig, scene.truth)


def _who(scene: SimulatedScene) -> dict[str, Ints]:
    return {name: np.asarray(who) for name, who in scene.true_identities.items()}


def _filmed(
    options: SimulationOptions, rig: MoveRig | None, people_move: MovePeople | None, later: tuple[float, MoveRig] | None
) -> tuple[Filmed, Rig | None]:
    """The views, with cameras and people where they are wanted, and where the cameras are in the end if elsewhere."""
    placing, growing, moving, clocks, changing, changing_later = (
        np.random.default_rng(child) for child in np.random.SeedSequence((options.seed, 77)).spawn(6)
    )
    scene = options.scene
    cameras = place_cameras(
        options.n_cameras, scene.area_m, scene.standoff_m, options.camera_height, scene.picture, placing
    )  # fmt: skip
    normal = np.clip(growing.standard_normal(options.n_people), -2.5, 2.5)
    heights = options.person_height_mean_m + options.person_height_sd_m * normal
    motion = simulate_motion(scene, heights, options.seconds + 1, moving)
    if people_move is not None:
        motion = people_move(motion, heights, changing)
    if rig is not None:
        cameras = rig(cameras, changing)
    moved = cameras if later is None else later[1](cameras, changing_later)
    offsets = _offsets(options, clocks)
    views = []
    for camera, after, fps, offset in zip(cameras, moved, options.frame_rates, offsets, strict=True):
        times = np.arange(max(1, round(options.seconds * fps))) / fps + offset
        first = times < (np.inf if later is None else later[0])
        parts = [_view(camera, motion, times[first], heights, options)]
        if not first.all():
            parts.append(_view(after, motion, times[~first], heights, options))
        views.append(View(**{f.name: np.concatenate([getattr(part, f.name) for part in parts]) for f in fields(View)}))
    filmed = Filmed(remove_faults(options), cameras, heights, motion, offsets, tuple(views))
    return filmed, None if later is None else moved


def _offsets(options: SimulationOptions, rng: np.random.Generator) -> Floats:
    if isinstance(options.clock_offsets, tuple):
        return np.array(options.clock_offsets)
    drawn = rng.uniform(-1, 1, options.n_cameras) * options.clock_offsets
    drawn[0] = 0.0
    return np.asarray(drawn)


def _view(camera: Camera, motion: Motion, times: Floats, heights: Floats, options: SimulationOptions) -> View:
    state, present = motion.at(times)
    return observe_camera(camera, pose_joints(state, heights), heights, present, options.occlusion)


def walking(motion: Motion, xy: Floats, heights: Floats) -> Motion:
    """People on other ways (K, P, 2): heading, speed and gait follow from the way."""
    velocity = np.gradient(xy, STEP_S, axis=0)
    speed = np.linalg.norm(velocity, axis=-1)
    heading = np.unwrap(np.arctan2(velocity[..., 1], velocity[..., 0]), axis=0)
    heading = np.where(speed.max(axis=0) < 0.05, motion.state.heading, heading)
    stride = stride_length(speed, heights)
    phase = np.cumsum(np.where(speed > 0.05, speed / np.maximum(stride, 1e-9), 0.0), axis=0) * STEP_S
    still = np.where(speed < 0.05, 0.0, speed)
    return replace(motion, state=replace(motion.state, xy=xy, heading=heading, speed=still, phase=phase))


def raised(motion: Motion, height: Callable[[Floats], Floats]) -> Motion:
    """People on ground of another height: metres above z = 0, from places (K, P, 2)."""
    return replace(motion, state=replace(motion.state, jump=motion.state.jump + height(motion.state.xy)))


def still(motion: Motion, places: Floats) -> Motion:
    """People who stand at places (P, 2)."""
    state = motion.state
    zero = np.zeros_like(state.speed)
    at = np.broadcast_to(places, state.xy.shape).copy()
    columns = {f.name: zero for f in fields(BodyState) if f.name not in ("xy", "heading")}
    return Motion(motion.times, BodyState(xy=at, heading=np.broadcast_to(state.heading[0], zero.shape).copy(), **columns),
                  np.full(len(motion.present_from), -np.inf))  # fmt: skip


def turned(rig: Rig, name: str, *, pan: float = 0.0, tilt: float = 0.0, roll: float = 0.0, shift: Floats | None = None) -> Rig:
    """One camera turned about the vertical, about its own horizontal axis and its optical axis (degrees), and shifted (m)."""
    cameras = []
    for camera in rig:
        pose = camera.pose
        if camera.name == name and pose is not None:
            R = _about(2, roll) @ _about(0, tilt) @ pose.R_cw @ _about(2, pan)
            camera = replace(camera, pose=Pose.from_centre(R, pose.centre + (0.0 if shift is None else shift)))
        cameras.append(camera)
    return Rig(tuple(cameras))


def _about(axis: int, degrees: float) -> Floats:
    """(3, 3) turn about a coordinate axis."""
    c, s = np.cos(np.radians(degrees)), np.sin(np.radians(degrees))
    a, b = [k for k in range(3) if k != axis]
    R = np.eye(3)
    R[a, a] = R[b, b] = c
    R[a, b], R[b, a] = -s, s
    return R


def aimed(rig: Rig, name: str, centre: Floats, aim: Floats) -> Rig:
    """One camera elsewhere, looking at a point (3,), metres."""
    pose = Pose.from_centre(looking_at(np.asarray(centre, float), np.asarray(aim, float)), np.asarray(centre, float))
    return Rig(tuple(replace(c, pose=pose) if c.name == name else c for c in rig))


def zoomed(lens: Lens, factor: float) -> Lens:
    """A lens of another focal length."""
    matrix = np.array(lens.matrix)
    matrix[0, 0] *= factor
    matrix[1, 1] *= factor
    return replace(lens, matrix=matrix)


def edges_of(boxes: Boxes) -> Floats:
    """(N, 4) left, top, right, bottom."""
    return np.concatenate([boxes.ltwh[:, :2], boxes.ltwh[:, :2] + boxes.ltwh[:, 2:]], axis=1)


def joined(first: Boxes, second: Boxes) -> tuple[Boxes, Ints]:
    """Two sets of boxes as one, by frame, and the order of its rows in the two put together."""
    frame = np.concatenate([first.frame, second.frame])
    order = np.argsort(frame, kind="stable")
    columns = [
        np.concatenate([getattr(part, name) for part in (first, second)])[order] for name in ("identity", "ltwh", "score")
    ]
    return Boxes(frame[order], *columns), order
