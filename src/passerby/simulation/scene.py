"""A whole simulated scene: cameras, people, and what the cameras make of them."""

from __future__ import annotations

from dataclasses import dataclass, fields

import numpy as np
from numpy.typing import NDArray

from passerby.cameras import Camera, Rig
from passerby.observations import BODY_17, Observations
from passerby.simulation.body import pose_joints
from passerby.simulation.detect import detect
from passerby.simulation.motion import Motion, simulate_motion
from passerby.simulation.observe import View, view
from passerby.simulation.options import SimulationOptions
from passerby.simulation.placement import place_cameras
from passerby.simulation.presets import PRESETS

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

BODIES_AT_ONCE = 4000


@dataclass(frozen=True, eq=False)
class SimulatedScene:
    """The truth of a scene and what its cameras report. T instants, P people; world z up, ground z = 0, metres."""

    options: SimulationOptions
    rig: Rig
    """The true cameras, with poses."""
    observations: Observations
    """Boxes and COCO joints per camera; `fps` is the options'. Frame numbers start at 1."""
    heights: dict[int, float]
    """Identity -> standing height with shoes, metres."""
    frames: Ints
    """(T,) frame numbers."""
    identities: Ints
    """(P,) identities, from 1."""
    ground_positions: Floats
    """(T, P, 2) ground position between the feet at world time (frame - 1) / fps; NaN before a person comes in."""
    joints3d: Floats
    """(T, P, 17, 3) COCO's joints at the same times; NaN before a person comes in."""
    upright: NDArray[np.bool_]
    """(T, P) who stands, walks or runs, and neither crouches, leans, sits, jumps nor reaches overhead."""
    clock_offsets: dict[str, float]
    """Camera -> seconds: its frame f shows the world at (f - 1) / fps + offset."""


def simulate(options: SimulationOptions) -> SimulatedScene:
    """Simulate a scene; the same options give the same scene, bit for bit.

    Cameras, heights, motion, clocks and every fault of the detector draw from generators of their own: a fault
    changes neither the motion nor the cameras nor another fault.
    """
    seeds = np.random.SeedSequence((options.seed, list(PRESETS).index(options.preset))).spawn(5)
    placing, growing, moving, clocks, detecting = (np.random.default_rng(seed) for seed in seeds)
    scene = options.scene
    rig = place_cameras(options.n_cameras, scene.area_m, scene.standoff_m, options.camera_height, scene.picture, placing)
    # Beyond 2.5 sigma is left out: a child-sized adult would say more about the draw than about the method.
    normal = np.clip(growing.standard_normal(options.n_people), -2.5, 2.5)
    heights = options.person_height_mean_m + options.person_height_sd_m * normal
    motion = simulate_motion(scene, heights, options.n_frames / options.fps, moving)
    frames = np.arange(1, options.n_frames + 1)
    identities = np.arange(1, options.n_people + 1)
    times = (frames - 1) / options.fps
    offsets = _clock_offsets(options, clocks)

    cameras = {}
    for camera, offset, rng in zip(rig, offsets, detecting.spawn(len(rig)), strict=True):
        seen = _view(camera, motion, times + offset, heights, options.occlusion)
        cameras[camera.name] = detect(seen, frames, identities, camera.lens.size, options, rng)

    state, present = motion.at(times)
    absent = ~present[..., None]
    reaching = np.maximum(state.raised_left, state.raised_right) > 0.5
    bent = (state.crouch > 0.05) | (state.lean > 0.15) | (state.seat > 0.05) | (state.jump > 0.02) | reaching
    return SimulatedScene(
        options=options,
        rig=rig,
        observations=Observations(cameras, options.fps),
        heights=dict(zip(identities.tolist(), heights.tolist(), strict=True)),
        frames=frames,
        identities=identities,
        ground_positions=np.where(absent, np.nan, state.xy),
        joints3d=np.where(absent[..., None], np.nan, pose_joints(state, heights)[:, :, : len(BODY_17)]),
        upright=present & ~bent,
        clock_offsets=dict(zip(rig.names, offsets.tolist(), strict=True)),
    )


def _view(camera: Camera, motion: Motion, times: Floats, heights: Floats, occlusion: bool) -> View:
    """The view at all times, computed in stretches: memory stays at a few hundred MB however long the scene is."""
    stretch = max(1, BODIES_AT_ONCE // len(heights))
    parts = []
    for start in range(0, len(times), stretch):
        state, present = motion.at(times[start : start + stretch])
        parts.append(view(camera, pose_joints(state, heights), heights, present, occlusion))
    return View(**{item.name: np.concatenate([getattr(part, item.name) for part in parts]) for item in fields(View)})


def _clock_offsets(options: SimulationOptions, rng: np.random.Generator) -> Floats:
    """(cameras,) seconds; the first camera keeps the world's time where the offsets are drawn."""
    if isinstance(options.clock_offsets, tuple):
        return np.array(options.clock_offsets)
    drawn = rng.uniform(-1, 1, options.n_cameras) * options.clock_offsets
    drawn[0] = 0.0
    return np.asarray(drawn)
