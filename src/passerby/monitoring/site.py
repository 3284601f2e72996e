"""The cameras of a site: which of them are neighbours, who is who among these, and what each small rig says of its camera."""

from __future__ import annotations

from collections.abc import Mapping
from concurrent.futures import Executor
from dataclasses import dataclass

import numpy as np
from threadpoolctl import threadpool_limits

from passerby.common.arrays import Floats
from passerby.common.progress import Progress, silent
from passerby.core.cameras import Rig
from passerby.core.observations import CameraObservations, Observations
from passerby.core.synchronisation import resample_to_common_steps
from passerby.monitoring.identities import SEED, identify_by_rig
from passerby.monitoring.neighbourhoods import Site, watch_neighbourhoods
from passerby.monitoring.neighbours import Pairs, connected, neighbours_by_rig
from passerby.monitoring.watched import Watched, WatchOptions
from passerby.people.ground import rough_height
from passerby.people.sightings import gather_sightings

MANY = 12
"""Up to so many cameras all are tested together, by all that all of them saw."""


@dataclass(frozen=True, eq=False)
class CamerasOfSite:
    """Cameras, what they saw, and which of them are compared."""

    rig: Rig
    """With poses."""
    observations: Observations
    """Of these cameras, with a clock for each."""
    height_m: Mapping[str, float]
    """Of each camera that saw anybody, about how high the ground is, metres."""
    pairs: Pairs
    """The neighbours; no others are compared."""

    @classmethod
    def of(cls, rig: Rig, observations: Observations) -> CamerasOfSite:
        """Neighbours by poses, and by the ground that each camera's people stand on."""
        # By one camera's people alone: floors of a house have a ground each.
        heights = {
            camera.name: rough_height(Rig((camera,)), observations) for camera in rig if _sees(observations[camera.name])
        }
        return cls(rig, observations, heights, neighbours_by_rig(rig, heights))

    @property
    def pairs_by_name(self) -> list[tuple[str, str]]:
        """The pairs, in the order of the rig."""
        names = self.rig.names
        return [(names[a], names[b]) for a, b in sorted(self.pairs)]


def _sees(seen: CameraObservations) -> bool:
    return len(seen.boxes) > 0 or len(seen.keypoints) > 0


def watch_site(
    cameras: CamerasOfSite, options: WatchOptions, *, known: bool, tell: Progress = silent, executor: Executor | None = None
) -> Watched:
    """What footage says about a rig of many cameras.

    Args:
        cameras: that are watched.
        options: see `WatchOptions`.
        known: whether identities hold over all cameras; they are each camera's own tracklets else, or -1 for detections.
        tell: told of each stage.
        executor: works on cameras side by side.
    """
    # The systems are small, and the number of BLAS threads would change the last bits.
    with threadpool_limits(limits=1, user_api="blas"):
        sites = [_site(cameras, part, known, tell, executor) for part in connected(cameras.pairs, len(cameras.rig))]
        span = _span(cameras.observations)
        return watch_neighbourhoods(sites, cameras.rig.names, options, span, tell=tell, executor=executor)


def _site(cameras: CamerasOfSite, numbers: list[int], known: bool, tell: Progress, executor: Executor | None) -> Site:
    """Some of the cameras, with identities over them."""
    seen, rig = cameras.observations, Rig(tuple(cameras.rig.cameras[k] for k in numbers))
    clocks = {name: seen.clocks[name] for name in rig.names}
    own = Observations({name: seen[name] for name in rig.names}, seen.fps, clocks)
    height = float(np.median([cameras.height_m[name] for name in rig.names]))
    if not known:
        place = {k: index for index, k in enumerate(numbers)}
        near = frozenset((place[a], place[b]) for a, b in cameras.pairs if a in place)
        tell("associating identities")
        rng = np.random.default_rng(SEED)
        own = identify_by_rig(rig, own, clocks, rng, ground_m=height, executor=executor, tell=tell, candidates=near)
    at_steps = resample_to_common_steps(own, clocks, sizes={camera.name: camera.lens.size for camera in rig})
    return Site(rig, at_steps, gather_sightings(rig, at_steps), height)


def _span(observations: Observations) -> tuple[float, float]:
    """From the first time at which anybody was seen to just after the last, seconds; zeros where nobody was."""
    ends: list[Floats] = []
    for name, seen in observations.cameras.items():
        frames = np.concatenate([seen.boxes.frame, seen.keypoints.frame])
        if len(frames):
            ends.append(observations.clocks[name].seconds(np.array([frames.min(), frames.max()])))
    if not ends:
        return 0.0, 0.0
    return float(np.min(ends)), float(np.max(ends)) + 1e-6
