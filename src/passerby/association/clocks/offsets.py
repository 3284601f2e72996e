"""The cameras' clocks with their time offsets, and the correction of the offsets by a solver's result."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from scipy.special import chdtri

from passerby.association.camera_tracklets import CameraTracklets
from passerby.common.arrays import Floats
from passerby.core.cameras import Rig
from passerby.core.figures import ClockCorrection, adjusted
from passerby.core.observations import Clock, Observations
from passerby.core.solution import Solution
from passerby.core.synchronisation import resample_to_common_steps

WHOLE_SIGMA = 0.12
"""Largest sigma of an offset, in frames, with which the test for whole frames is meaningful: three sigmas on either side are
most of a frame."""
BY_CHANCE = 0.95
"""Confidence of the test: offsets count as whole frames unless they deviate more than in 95 of 100 such recordings."""


def clocks_with(cameras: Sequence[CameraTracklets], offset_s: Floats) -> dict[str, Clock]:
    """Return the cameras' clocks, by name, with offsets (C,) in seconds."""
    return {
        camera.name: replace(camera.clock, offset_s=float(offset)) for camera, offset in zip(cameras, offset_s, strict=True)
    }


def synchronise(rig: Rig, cameras: Sequence[CameraTracklets], observations: Observations, offset_s: Floats) -> Observations:
    """Resample people to common instants (see `resample_to_common_steps`), by clocks with offsets (C,) in seconds."""
    sizes = {camera.name: camera.lens.size for camera in rig}
    return resample_to_common_steps(observations, clocks_with(cameras, offset_s), sizes=sizes)


def relative_to_reference(offset_s: Floats, rig: Rig | None) -> Floats:
    """Return the offsets (C,) relative to that of the first registered camera, or of the first camera where none is."""
    registered = [c for c, camera in enumerate(rig) if camera.pose is not None] if rig is not None else []
    return np.asarray(offset_s - offset_s[registered[0] if registered else 0])


def clock_corrections(solution: Solution) -> tuple[Floats, Floats]:
    """Return the solver's corrections (C,) of the offsets, 0 where it has none, and their sigmas (C,), NaN there; seconds."""
    found, nothing = adjusted(solution.figures).clocks, ClockCorrection(correction_s=0.0, sigma_s=np.nan)
    rows = [found.get(name, nothing) for name in solution.rig.names]
    return np.array([row.correction_s for row in rows]), np.array([row.sigma_s for row in rows])


def snap_to_whole_frames(offset_s: Floats, sigma_s: Floats, fps: Floats) -> Floats | None:
    """Round the offsets to whole frames; return None where the evidence contradicts whole frames or is too weak.

    Cameras with a common trigger, and recordings cut from one, are whole frames apart. Then the solver has one unknown less for
    each camera. Offsets may deviate by their sigmas. The sigmas must be small relative to a frame, or any offset would pass.

    Args:
        offset_s: (C,) offsets, seconds; the first with a sigma is the reference.
        sigma_s: (C,) their sigmas, 0 for the reference, NaN for cameras that are not registered.
        fps: (C,) frame rates.
    """
    known = np.isfinite(sigma_s)
    if np.count_nonzero(known) < 2 or np.ptp(fps[known]) > 0:
        return None
    rate, reference = float(fps[known][0]), offset_s[known][0]
    frames = (offset_s - reference) * rate
    stray = (frames - np.round(frames))[known] / rate
    free = sigma_s[known] > 0
    if (sigma_s[known] > WHOLE_SIGMA / rate).any():
        return None
    square = float(((stray[free] / sigma_s[known][free]) ** 2).sum())
    if square > chdtri(np.count_nonzero(free), 1 - BY_CHANCE):
        return None
    return np.where(known, reference + np.round(frames) / rate, offset_s)
