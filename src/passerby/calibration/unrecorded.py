"""Times at which a camera did not record: no person can be missed in a gap between the pieces of a recording."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from passerby.association.result import Association
from passerby.common.arrays import Ints

Spans = Sequence[tuple[float, float]]


def unrecorded_instants(gaps: Mapping[str, Spans], association: Association) -> dict[str, Ints]:
    """Return, by camera with gaps, the common instants at which it recorded nothing, of those at which a person was seen.

    Args:
        gaps: by camera, spans of its own frame numbers in which it recorded nothing.
        association: the cameras' clocks, and people at common instants.
    """
    seen = association.instants
    parts = [part.frame for camera in seen.cameras.values() for part in (camera.boxes, camera.keypoints)]
    instants = np.unique(np.concatenate(parts)) if parts else np.zeros(0, dtype=np.int64)
    out = {}
    for name, spans in gaps.items():
        grid, clock = seen.clocks.get(name), association.clocks.get(name)
        own = instants if grid is None or clock is None else clock.frames(grid.seconds(instants))
        inside = np.zeros(len(instants), dtype=bool)
        for first, last in spans:
            inside |= (own > first) & (own < last)
        out[name] = instants[inside]
    return out
