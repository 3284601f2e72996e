"""Trajectories: the positions of people over time."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np

from passerby.common.arrays import Floats, Ints
from passerby.core.observations import Clock


@dataclass(frozen=True, eq=False)
class Trajectories:
    """N positions, sorted by identity, then by time. World of the rig: z up, ground at z = 0, metres."""

    identity: Ints
    """(N,) identities."""
    frame: Ints
    """(N,) frames of `clock`."""
    time_s: Floats
    """(N,) the rig's time, seconds."""
    xyz: Floats
    """(N, 3) x, y on the ground below the body; z: height of the body's middle."""
    sigma_m: Floats
    """(N,) root of the trace of the covariance of (x, y), metres, in the rig's world. It does not include errors that the whole
    world shares (of its position, orientation and scale). NaN where unknown (pairwise with one pair)."""
    cameras: Ints
    """(N,) number of cameras that agree; 0: no camera saw the person, and the position is interpolated between others."""
    part: Ints
    """(N,) number of the stretch without long gaps, from 1 for each identity."""
    clock: Clock
    """Clock of the frames."""
    figures: dict[str, Any] = field(default_factory=dict)
    """JSON-ready: options, people, boxes used and outvoted, and disagreement by camera."""

    def __repr__(self) -> str:
        seconds = float(np.ptp(self.time_s)) if len(self) else 0.0
        return f"Trajectories({len(self.people)} people, {len(self)} positions, {seconds:.1f} s)"

    def __len__(self) -> int:
        return len(self.identity)

    @property
    def people(self) -> Ints:
        """(P,) identities, ascending."""
        return np.unique(self.identity)
