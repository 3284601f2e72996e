"""Are people as tall as they are taken to be? Walkers keep to a pace, and it grows with the scale of the rig.

A rig that rests on nothing but how tall people are is too large by half where they are children: all angles fit, and all
sigmas are small. What betrays it is how fast they seem to go. Adults walk at 1.3 m/s, and 2 m/s is a run (Bohannon 1997,
*Comfortable and maximum walking speed of adults aged 20 to 79 years*; Weidmann 1993 gives 1.34 m/s, standard deviation 0.26).
Where people run as well, paces differ widely, and only what nobody runs at is told.

The same holds where heights were stated, of a population or of a person: boxes that show half of each person make the rig
twice as large all the same. Only a measured length is evidence of another kind: then people may walk as fast as they like, and
the check is whether anybody could run so fast.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Literal

import numpy as np

from passerby.common.arrays import Floats, Ints
from passerby.core.figures import CueFigures
from passerby.findings.finding import Finding, doubt

ScaleBasis = Literal["taken", "stated", "measured"]
"""What the scale rests on: how tall people are taken to be, how tall they are said to be, or lengths that were measured."""

OVER_S = 1.0
"""Places are compared over a second: what they are off by is a few centimetres, and turns are hardly cut short."""
MOVES = 0.5
"""Metres per second: slower people stand about."""
MIN_STEPS = 100
EVEN = 1.8
"""Upper quartile of the pace over the lower one: people who walk have 1.3 to 1.6 in ordinary scenes and in the real sets, up to
1.76 with boxes that lack the lower 35 % of each person; where they run, jump and stand as well it is 1.9 to 2.5."""
TOO_FAST = 1.38
"""Metres per second, median: 0.93 to 1.30 in ordinary scenes and in the real sets; 1.44 and more where children of 1.1 m are
taken for adults."""
TOO_FAST_QUARTER = 1.55
"""Metres per second, upper quartile of the steady paces where people walk: 1.05 to 1.47 in 128 simulated scenes
of walkers, 1.57 and more in 28 whose boxes lack the lower 35 % of each person. It shows what the median does not where many
carry things or stroll."""
SLOWEST = 1.25
"""Metres per second, lowest tenth of the steady paces: where people run, some walk between the runs. 0.84 to 1.19 on
64 simulated courts, 1.30 and more on 14 whose boxes lack the lower 35 %."""
STEADY = 0.5
"""Two successive displacements that differ by less than this share of the longer one are somebody's way. With 20 % of the
identities exchanged the upper quartile of all paces grows from 1.2 to 6.2 m/s, that of the steady ones to 1.9 m/s at most."""
RUN, RUN_BY_HEIGHT = 4.75, 4.2
"""Metres per second, upper quartile of the steady paces: 1.1 to 1.5 where people walk, 2.6 to 3.3 on simulated courts, where
they run at 2 to 4 m/s; 4.6 and more where boxes of half height make such a court 1.8 to 1.9 times as large. A measured length
is doubted later than heights are: a few people run races."""
MOST_OFF = 0.18
"""People whose median height a length makes so much larger or smaller: four times what heights of an unknown crowd are known
to, as for a scale cue that contradicts the rest."""


def scale_basis(cues: Sequence[CueFigures], *, said: bool) -> ScaleBasis:
    """What the scale rests on.

    Args:
        cues: the solver's figures of its scale cues, each with its name and its share of the weight.
        said: whether the user has said how tall the people are.
    """
    measured = sum(cue.share for cue in cues if cue.kind not in ("population", "person", "segments"))
    return "measured" if measured > 0.5 else "stated" if said else "taken"


def doubts_of_pace(keys: Floats, places: Floats, fps: float | None, basis: ScaleBasis = "taken") -> list[Finding]:
    """A doubt where people walk faster than people walk, or run faster than they run.

    Args:
        keys: (N, 2) frame and identity of who was placed by two cameras or more.
        places: (N, 2) or (N, 3) where, metres.
        fps: of the frames; None where nobody knows it, and nothing is said.
        basis: what the scale rests on; where that is measured lengths, fast walkers are no doubt.
    """
    heights = "stated" if basis == "stated" else "taken"
    pace, steady = paces(keys, places, fps), paces(keys, places, fps, steady=True)
    slow, fast = np.quantile(steady, (0.1, 0.75)).tolist() if len(steady) >= MIN_STEPS else (0.0, 0.0)
    if len(pace) >= MIN_STEPS and basis != "measured":
        low, median, high = np.quantile(pace, (0.25, 0.5, 0.75))
        if high <= EVEN * low and (median > TOO_FAST or fast > TOO_FAST_QUARTER):
            return [doubt("people_walk_fast", speed=float(median if median > TOO_FAST else fast), heights=heights)]
    if fast > (RUN if basis == "measured" else RUN_BY_HEIGHT):
        return [doubt("people_run_fast", speed=fast)]
    if slow > SLOWEST and basis != "measured":
        return [doubt("nobody_walks_slowly", speed=slow, heights=heights)]
    return []


def doubts_of_heights(heights: Mapping[str, float], scale: float, person_height_m: float) -> list[Finding]:
    """A doubt where known places, which set the scale, make people taller or shorter than people are.

    Args:
        heights: identity -> standing height by the solver's scale, metres; empty where it tells none.
        scale: what all lengths were multiplied by.
        person_height_m: how tall people are on average.
    """
    if not heights:
        return []
    tall = scale * float(np.median(list(heights.values())))
    if abs(tall / person_height_m - 1) <= MOST_OFF:
        return []
    return [doubt("people_too_tall", metres=tall, expected_m=person_height_m)]


def paces(keys: Floats, places: Floats, fps: float | None, *, steady: bool = False) -> Floats:
    """(K,) metres per second of everybody who moves, over a second.

    With `steady` only of those who go on as they went for a second more, over both: most places that somebody else's box has
    spoilt are left out so.
    """
    if not fps or not len(keys):
        return np.zeros(0)
    step = max(1, round(OVER_S * fps))
    order = np.lexsort((keys[:, 0], keys[:, 1]))
    frame, identity, place = keys[order, 0], keys[order, 1], places[order, :2]
    # One number for person and frame: the place a second later is looked up by it.
    stride = int(frame.max() - frame.min()) + 2 * step + 1
    code = identity * stride + (frame - frame.min())
    rows, later = _later(code, step)
    moved = np.full(place.shape, np.nan)
    moved[rows] = (place[later] - place[rows]) * fps / step
    if steady:
        rows, later = rows[np.isfinite(moved[later, 0])], later[np.isfinite(moved[later, 0])]
        first, then = moved[rows], moved[later]
        longer = np.maximum(np.linalg.norm(first, axis=1), np.linalg.norm(then, axis=1))
        on = np.linalg.norm(then - first, axis=1) < STEADY * longer
        pace = 0.5 * np.linalg.norm(first + then, axis=1)[on]
    else:
        pace = np.linalg.norm(moved[rows], axis=1)
    return np.asarray(pace[pace > MOVES])


def _later(code: Floats, step: int) -> tuple[Ints, Ints]:
    """Rows (K,) whose person is placed a step later too, and the rows (K,) of then."""
    at = np.searchsorted(code, code + step)
    met = at < len(code)
    met[met] = code[at[met]] == code[met] + step
    rows = np.flatnonzero(met)
    return rows, at[rows]
