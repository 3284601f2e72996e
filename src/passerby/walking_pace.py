"""Are people as tall as they are taken to be? Walkers keep to a pace, and it grows with the scale of the rig.

A rig that rests on nothing but how tall people are is too large by half where they are children: all angles fit, and all
sigmas are small. What betrays it is how fast they seem to go. Adults walk at 1.3 m/s, and 2 m/s is a run (Bohannon 1997,
*Comfortable and maximum walking speed of adults aged 20 to 79 years*; Weidmann 1993 gives 1.34 m/s, standard deviation 0.26).
Where people run as well, paces differ widely, and nothing is said.
"""

from __future__ import annotations

import numpy as np

from passerby.cameras import Floats

OVER_S = 1.0
"""Places are compared over a second: what they are off by is a few centimetres, and turns are hardly cut short."""
MOVES = 0.5
"""Metres per second: slower people stand about."""
MIN_STEPS = 100
EVEN = 1.75
"""Upper quartile of the pace over the lower one: people who walk have 1.3 to 1.6 in ordinary scenes and in the real sets; where
they run, jump and stand as well it is 2.1 to 2.5."""
TOO_FAST = 1.38
"""Metres per second, median: 0.93 to 1.30 in ordinary scenes and in the real sets; 1.44 and more where children of 1.1 m are
taken for adults."""


def doubts_of_pace(keys: Floats, places: Floats, fps: float | None) -> list[str]:
    """A sentence where people walk faster than people walk; the scale rests on how tall they are taken to be.

    Args:
        keys: (N, 2) frame and identity of who was placed by two cameras or more.
        places: (N, 2) or (N, 3) where, metres.
        fps: of the frames; None where nobody knows it, and nothing is said.
    """
    pace = paces(keys, places, fps)
    if len(pace) < MIN_STEPS:
        return []
    low, median, high = np.quantile(pace, (0.25, 0.5, 0.75))
    if high > EVEN * low or median <= TOO_FAST:
        return []
    return [
        f"people walk at {median:.1f} m/s if they are as tall as they are taken to be, which is fast: are they children? "
        "Write their mean height as person_height_m under [scale], or give a length, and check the frame rate"
    ]


def paces(keys: Floats, places: Floats, fps: float | None) -> Floats:
    """(K,) metres per second of everybody who moves, over a second."""
    if not fps or not len(keys):
        return np.zeros(0)
    step = max(1, round(OVER_S * fps))
    order = np.lexsort((keys[:, 0], keys[:, 1]))
    frame, identity, place = keys[order, 0], keys[order, 1], places[order, :2]
    # One number for person and frame: the place a second later is looked up by it.
    stride = int(frame.max() - frame.min()) + step + 1
    code = identity * stride + (frame - frame.min())
    at = np.searchsorted(code, code + step)
    met = at < len(code)
    met[met] = code[at[met]] == code[met] + step
    rows = np.flatnonzero(met)
    pace = np.linalg.norm(place[at[rows]] - place[rows], axis=1) * fps / step
    return np.asarray(pace[pace > MOVES])
