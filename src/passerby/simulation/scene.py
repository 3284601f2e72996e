"""A whole simulated scene: cameras, people, and observations; also in several areas without common ground.

Further areas use random generators of their own. The first area is at the place of a single one: around the world's origin.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, fields, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from passerby.common.arrays import Floats, Ints
from passerby.common.errors import InputError
from passerby.core.cameras import Camera, Pose, Rig
from passerby.core.observations import BODY_17, UNKNOWN, Boxes, Clock, Observations
from passerby.simulation.body import BodyState, pose_joints
from passerby.simulation.lenses import place_cameras
from passerby.simulation.motion import Motion, simulate_motion
from passerby.simulation.observe import Detected, View, box_embeddings, detect, observe_camera, people_looks, renumber
from passerby.simulation.options import MIN_PEOPLE, PRESETS, SimulationOptions

BODIES_AT_ONCE = 4000
AREA_DISTANCE_M = 250.0
"""Distance between the middles of neighbouring areas, along x: ten times the largest area."""


@dataclass(frozen=True, eq=False)
class SimulatedScene:
    """The truth of a scene and the observations of its cameras. T instants, P people; world z up, ground z = 0, metres."""

    options: SimulationOptions
    rig: Rig
    """The true cameras, with poses."""
    observations: Observations
    """Boxes and COCO joints per camera. Frame numbers start at 1. There are clocks if frame rates are given per camera."""
    heights: dict[int, float]
    """Identity -> standing height with shoes, metres."""
    frames: Ints
    """(T,) frame numbers."""
    identities: Ints
    """(P,) identities, from 1."""
    ground_positions: Floats
    """(T, P, 2) ground position between the feet at world time (frame - 1) / fps; NaN before a person enters."""
    joints3d: Floats
    """(T, P, 17, 3) COCO's joints at the same times; NaN before a person enters."""
    upright: NDArray[np.bool_]
    """(T, P) whether a person is present and does not crouch, lean, sit, jump or reach overhead."""
    clock_offsets: dict[str, float]
    """Camera -> time offset, seconds: frame f shows the world at (f - 1) / fps + offset, with the camera's own fps."""
    motion: Motion
    """Motion of all people at any time, from which the pictures of the scene are rendered."""
    true_identities: dict[str, Ints]
    """Camera -> (N,) identity of the person that each box really shows; -1 for a box without a person."""

    @property
    def truth(self) -> dict[str, Boxes]:
        """Camera -> its boxes of people, with their true identities."""
        found = {}
        for name, identity in self.true_identities.items():
            boxes = replace(self.observations[name].boxes, identity=identity)
            found[name] = boxes.take(identity != UNKNOWN)
        return found

    @property
    def true_clocks(self) -> dict[str, Clock]:
        """Camera -> its true clock."""
        rates = dict(zip(self.rig.names, self.options.frame_rates, strict=True))
        return {name: Clock(fps, self.clock_offsets[name]) for name, fps in rates.items()}


@dataclass(frozen=True, eq=False)
class Filmed:
    """People in front of cameras, without a detector: the common part of scenes that differ only in the detector's faults."""

    options: SimulationOptions
    rig: Rig
    heights: Floats
    """(P,) standing heights, metres."""
    motion: Motion
    clock_offsets: Floats
    """(cameras,) time offsets, seconds."""
    views: tuple[View, ...]
    """View of each camera, at its own instants."""

    def serves(self, options: SimulationOptions) -> bool:
        """Return whether a scene with these options has the same views."""
        return remove_faults(options) == remove_faults(self.options)


FAULTS = (
    "box_noise", "corner_noise_px", "box_slack", "missing", "false_boxes", "identity_swaps", "joint_noise_px", "unrelated_ids",
    "tracklet_seconds", "embeddings",
)  # fmt: skip
"""Options that affect only the output of the detector, and not the views."""


def remove_faults(options: SimulationOptions) -> SimulationOptions:
    """Return the options with the default values for all options in `FAULTS`."""
    defaults: dict[str, Any] = {item.name: item.default for item in fields(options) if item.name in FAULTS}
    return replace(options, **defaults)


def simulate(options: SimulationOptions, filmed: Filmed | None = None) -> SimulatedScene:
    """Simulate a scene; the same options give the same scene, bit for bit.

    Cameras, heights, motion, clocks, each fault of the detector, tracklets and appearance use their own random generators.
    Therefore a fault changes neither the motion nor the cameras nor another fault.

    Args:
        options: options of the scene.
        filmed: result of `film` for the same options, or for others that differ only in `FAULTS`; saves most of the time.

    Raises:
        InputError: `filmed` shows another scene.
    """
    filmed = filmed or film(options)
    if not filmed.serves(options):
        raise InputError("the views are those of another scene: film it with the same preset, seed, people, cameras and clocks")
    *_, detecting, _, cutting, looking = _generators(options)
    rig, motion = filmed.rig, filmed.motion
    frames = np.arange(1, options.n_frames + 1)
    identities = np.arange(1, options.n_people + 1)
    found = {}
    for camera, seen, rng in zip(rig, filmed.views, detecting.spawn(len(rig)), strict=True):
        found[camera.name] = detect(seen, np.arange(1, len(seen.hidden) + 1), identities, camera.lens.size, options, rng)

    state, present = motion.at((frames - 1) / options.fps)
    absent = ~present[..., None]
    reaching = np.maximum(state.raised_left, state.raised_right) > 0.5
    bent = (state.crouch > 0.05) | (state.lean > 0.15) | (state.seat > 0.05) | (state.jump > 0.02) | reaching
    return SimulatedScene(
        options=options,
        rig=rig,
        observations=_observations(options, found, cutting, looking),
        heights=dict(zip(identities.tolist(), filmed.heights.tolist(), strict=True)),
        frames=frames,
        identities=identities,
        ground_positions=np.where(absent, np.nan, state.xy),
        joints3d=np.where(absent[..., None], np.nan, pose_joints(state, filmed.heights)[:, :, : len(BODY_17)]),
        upright=present & ~bent,
        clock_offsets=dict(zip(rig.names, filmed.clock_offsets.tolist(), strict=True)),
        motion=motion,
        true_identities={name: detected.true_identity for name, detected in found.items()},
    )


def film(options: SimulationOptions) -> Filmed:
    """Simulate cameras, people, their motion and their views, without faults; this takes most of the time of `simulate`."""
    placing, growing, moving, clocks, _, elsewhere, *_ = _generators(options)
    areas = Areas.of(options)
    others = [generator.spawn(2) for generator in elsewhere.spawn(len(options.group_sizes) - 1)]
    rig = place_groups(options, areas, [placing, *(other[0] for other in others)])
    # Heights are clipped at 2.5 sigma: with an adult as small as a child, results would depend on the draw, not on the method.
    normal = np.clip(growing.standard_normal(options.n_people), -2.5, 2.5)
    heights = options.person_height_mean_m + options.person_height_sd_m * normal
    rates = options.frame_rates
    counts = [max(1, round(options.seconds * fps)) for fps in rates]
    seconds = max(options.n_frames / options.fps, *(count / fps for count, fps in zip(counts, rates, strict=True)))
    motion = move_groups(options, areas, heights, seconds, [moving, *(other[1] for other in others)])
    offsets = _clock_offsets(options, clocks)
    views = []
    for index, camera in enumerate(rig):
        times = np.arange(counts[index]) / rates[index] + offsets[index]
        here = areas.of_person == areas.of_camera[index]
        views.append(_view(camera, motion, times, heights, here, options.occlusion))
    return Filmed(options, rig, heights, motion, offsets, tuple(views))


def _generators(options: SimulationOptions) -> list[np.random.Generator]:
    """Return the generators of cameras, heights, motion, clocks, detectors, further areas, tracklet cuts and embeddings."""
    seeds = np.random.SeedSequence((options.seed, list(PRESETS).index(options.preset))).spawn(8)
    return [np.random.default_rng(seed) for seed in seeds]


def _observations(
    options: SimulationOptions, found: Mapping[str, Detected], cutting: np.random.Generator, looking: np.random.Generator
) -> Observations:
    """Return the detectors' output with the tracklet numbers, the embeddings and the clocks that the options request."""
    dressing, *watching = looking.spawn(1 + len(found))
    appearance = people_looks(options.n_people, dressing) if options.embeddings == "distinct" else None
    cameras = {}
    for (name, detected), fps, cuts, look in zip(
        found.items(), options.frame_rates, cutting.spawn(len(found)), watching, strict=True
    ):
        seen = detected.seen
        if options.unrelated_ids:
            seen = renumber(seen, options.n_people, fps, options.tracklet_seconds, cuts)
        if options.embeddings != "none":
            seen = replace(seen, boxes=replace(seen.boxes, embedding=box_embeddings(detected.true_identity, appearance, look)))
        cameras[name] = seen
    clocks = {name: Clock(fps) for name, fps in zip(found, options.camera_fps, strict=False)}
    return Observations(cameras, options.frame_rates[0], clocks)


def _view(camera: Camera, motion: Motion, times: Floats, heights: Floats, here: NDArray[np.bool_], occlusion: bool) -> View:
    """Compute the view, at all times, of the people (P,) who are in the camera's area.

    It is computed in stretches, so that a scene of any length needs only a few hundred MB of memory.
    """
    stretch = max(1, BODIES_AT_ONCE // len(heights))
    parts = []
    for start in range(0, len(times), stretch):
        state, present = motion.at(times[start : start + stretch])
        parts.append(observe_camera(camera, pose_joints(state, heights), heights, present & here, occlusion))
    return View(**{item.name: np.concatenate([getattr(part, item.name) for part in parts]) for item in fields(View)})


def _clock_offsets(options: SimulationOptions, rng: np.random.Generator) -> Floats:
    """Return the time offsets (cameras,), seconds; if they are drawn, that of the first camera is 0."""
    if isinstance(options.clock_offsets, tuple):
        return np.array(options.clock_offsets)
    drawn = rng.uniform(-1, 1, options.n_cameras) * options.clock_offsets
    drawn[0] = 0.0
    return np.asarray(drawn)


@dataclass(frozen=True, eq=False)
class Areas:
    """Areas of C cameras and P people."""

    of_camera: Ints
    """(C,) number of the camera's area, from 0."""
    of_person: Ints
    """(P,) number of the person's area, from 0."""

    @classmethod
    def of(cls, options: SimulationOptions) -> Areas:
        """Return the areas of the options; people are distributed in proportion to the cameras."""
        cameras, numbers = options.group_sizes, np.arange(len(options.group_sizes))
        return cls(np.repeat(numbers, cameras), np.repeat(numbers, share_out(options.n_people, cameras)))

    def __iter__(self) -> Iterator[int]:
        return iter(range(int(self.of_camera.max()) + 1))

    @staticmethod
    def middle(area: int) -> Floats:
        """Return the middle of an area (2,), world, metres."""
        return np.array([AREA_DISTANCE_M * area, 0.0])


def share_out(people: int, cameras: Sequence[int]) -> tuple[int, ...]:
    """Return the number of people of each area: `MIN_PEOPLE`, and more in proportion to its cameras, by largest remainders."""
    if len(cameras) == 1:
        return (people,)
    least = np.full(len(cameras), MIN_PEOPLE)
    wanted = (people - least.sum()) * np.array(cameras) / sum(cameras)
    whole = np.floor(wanted).astype(np.int64)
    first = np.argsort(whole - wanted, kind="stable")[: people - least.sum() - whole.sum()]
    whole[first] += 1
    return tuple((least + whole).tolist())


def place_groups(options: SimulationOptions, areas: Areas, rngs: Sequence[np.random.Generator]) -> Rig:
    """Place the cameras of all areas, with consecutive names C1, C2, ...; `rngs` holds one generator for each area."""
    scene = options.scene
    cameras: list[Camera] = []
    for area in areas:
        count, first = int((areas.of_camera == area).sum()), len(cameras) + 1
        group = place_cameras(
            count, scene.area_m, scene.standoff_m, options.camera_height, scene.picture, rngs[area], first=first,
            lenses=options.lenses,
        )  # fmt: skip
        cameras += [_move_camera(camera, areas.middle(area)) if area else camera for camera in group]
    return Rig(tuple(cameras))


def move_groups(
    options: SimulationOptions, areas: Areas, heights: Floats, seconds: float, rngs: Sequence[np.random.Generator]
) -> Motion:
    """Simulate the motion of the people of all areas.

    Args:
        options: options of the scene.
        areas: areas of cameras and people.
        heights: (P,) standing heights, metres.
        seconds: length of the scene.
        rngs: one generator for each area.
    """
    parts = []
    for area in areas:
        part = simulate_motion(options.scene, heights[areas.of_person == area], seconds, rngs[area])
        if area:
            part = replace(part, state=replace(part.state, xy=part.state.xy + areas.middle(area)))
        parts.append(part)
    if len(parts) == 1:
        return parts[0]
    columns = {
        item.name: np.concatenate([getattr(part.state, item.name) for part in parts], axis=1) for item in fields(BodyState)
    }
    return Motion(parts[0].times, BodyState(**columns), np.concatenate([part.present_from for part in parts]))


def _move_camera(camera: Camera, by: Floats) -> Camera:
    assert camera.pose is not None
    return replace(camera, pose=Pose.from_centre(camera.pose.R_cw, camera.pose.centre + np.array([*by, 0.0])))
