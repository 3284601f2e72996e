"""Estimates of the scale from people's walking speed, and from the width of their boxes.

Both are computed in the solved rig and do not change it: compared with people's heights, their weight is small. They are used
in the test of scale cues (`cue_agreement`), since their errors are of another kind. Boxes that show the upper half of each
person make the rig twice as large; then people walk twice as fast and are twice as wide. A wrong frame rate changes only the
speed.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from passerby.common.arrays import Floats, Ints
from passerby.core.cameras import Rig
from passerby.core.figures import CueFigures
from passerby.core.observations import Observations
from passerby.geometry.groups import group_numbers
from passerby.people.body_centres import locate_people
from passerby.solver.cue_agreement import MOST_SIGMAS

WALK_M, WALK_SITE_SD, WALK_PERSON_SD = 1.1, 0.12, 0.19
"""Median walking speed of people at a site, m/s; standard deviations of the logarithm between sites and between people.
Comfortable speeds of groups by age and sex are 0.94 to 1.43 m/s (Bohannon and Andrews 2011, *Normal walking speed: a
descriptive meta-analysis*): 0.21 either way as a logarithm, taken as less than two sigmas. People differ by 0.26 of 1.34 m/s
(Weidmann 1993, *Transporttechnik der Fussgänger*). In areas that cameras watch, people turn, wait and walk together: the
medians of simulated scenes without runners are 0.93 to 1.31, their middle is 1.1."""
RUN_M, RUN_SD = 2.8, 0.3
"""Speed of people who run, m/s, and standard deviation of its logarithm: from a jog of 2 m/s, below which people walk
(Thorstensson and Roberthson 1987, *Adaptations to changing speed in human locomotion*), to a sprint across a court of 4 to 5
m/s."""
RUNS_RARELY = 4.0
"""Power of the share of walking in the prior: on average a sixth of motion is running, and almost never all of it. Of 2, 4 and
8 on simulated scenes (seeds 861 to 883): with 2, walkers at three times their frame rate may count as runners; with 8, four
people on a court count as walking too fast."""
SPOILT = 0.05
"""Share of invalid speeds, from places that are wrong because of another person's box."""
BLOCK_S = 10.0
"""Seconds after which a person may change between walking and running."""
MOVES_M = 0.5
"""Speed below which people count as standing, m/s."""
STEADY = 0.5
"""Two successive displacements that differ by less than this share of the longer one count as steady motion."""
BODY_WIDTH_M, BODY_WIDTH_SD = 0.6, 0.15
"""Median width of people's boxes and the standard deviation of its logarithm, between detectors and between people: 0.55 to
0.70 m in ordinary simulated scenes, 0.44 to 0.81 with detectors that cut off 5 % of the height at each edge, or add 10 %.
Annotated pedestrians are 0.41 times as wide as tall (Dollar et al. 2012, *Pedestrian Detection: An Evaluation of the State of
the Art*)."""
BORDER_PX = 2.0
"""Distance from the image's border within which a box may be cut off by it."""
FEWEST = 10
"""Smallest number of speeds, or of boxes, of a person who is used."""
_SHIFT, _SHARE = np.linspace(-2.0, 2.0, 401), np.linspace(0.0, 0.98, 50)


def people_cues(rig: Rig, observations: Observations) -> list[CueFigures]:
    """Compute the cues `walking_speed` and `body_width`, which have no weight in the adjustment; each only with evidence.

    Args:
        rig: lenses and poses, z up, metres.
        observations: people with identities at common time steps.
    """
    keys, places = locate_people(rig, observations)
    cues = []
    speeds = walking_speeds(keys, places, observations.fps)
    if speeds:
        found = scale_by_walking(speeds, BLOCK_S * float(observations.fps or 0.0))
        cues.append(_cue("walking_speed", "walking speed", len(speeds), WALK_M, *found))
    widths = body_widths(rig, observations, keys, places)
    if widths:
        log_scale = np.log(BODY_WIDTH_M) - float(np.median([np.log(np.median(own)) for own in widths]))
        sigma = BODY_WIDTH_SD * float(np.sqrt(1 + 1 / len(widths)))
        cues.append(_cue("body_width", "width of the boxes", len(widths), BODY_WIDTH_M, log_scale, sigma))
    return cues


def scale_by_walking(speeds: Sequence[Floats], per_block: float) -> tuple[float, float]:
    """Estimate the logarithm of the factor on all lengths that makes people's speeds usual, and one sigma of it.

    The logarithms of speeds are a mixture of walking and running; the unknown share of running is integrated out. The
    likelihood of the factor may have two peaks (fast walkers or slow runners). The estimate is therefore the middle of the
    interval that a likelihood ratio test at `MOST_SIGMAS` accepts, and its sigma is half the interval over `MOST_SIGMAS`. The
    sigma is at least that of a mean over so many people; the spread between sites is added.

    Args:
        speeds: speeds of each person in motion, m/s.
        per_block: number of successive speeds of a person that count as one observation; all of them if there are fewer.
    """
    logs = np.log(np.concatenate(speeds))
    values, of_value = np.unique(np.round(logs, 2), return_inverse=True)
    counts = [np.full(len(own), 1 / min(len(own), per_block)) for own in speeds]
    weight = np.bincount(of_value, weights=np.concatenate(counts))
    true = values + _SHIFT[:, None]
    walk, run = _normal(true, np.log(WALK_M), WALK_PERSON_SD), _normal(true, np.log(RUN_M), RUN_SD)
    noise = SPOILT / np.ptp(_SHIFT)
    likelihood = np.full(len(_SHIFT), -np.inf)
    for share in _SHARE.tolist():
        density = (1 - SPOILT) * ((1 - share) * walk + share * run) + noise
        likelihood = np.logaddexp(likelihood, np.log(density) @ weight + RUNS_RARELY * np.log(1 - share))
    inside = _SHIFT[2 * (likelihood.max() - likelihood) <= MOST_SIGMAS**2]
    low, high = float(inside.min()), float(inside.max())
    sampled = max((high - low) / (2 * MOST_SIGMAS), WALK_PERSON_SD / np.sqrt(len(speeds)))
    return (low + high) / 2, float(np.hypot(WALK_SITE_SD, sampled))


def walking_speeds(keys: Floats, places: Floats, fps: float | None) -> list[Floats]:
    """Return the speeds in m/s, over two seconds, of each person in steady motion; empty without a frame rate.

    Args:
        keys: (N, 2) frame and identity of people with a known place.
        places: (N, 2) or (N, 3) their places, metres.
        fps: frames a second; None if unknown.
    """
    if not fps or not len(keys):
        return []
    step = max(1, round(fps))
    order = np.lexsort((keys[:, 0], keys[:, 1]))
    frame, identity, place = keys[order, 0], keys[order, 1], places[order, :2]
    # One number for person and frame, by which the place a second later is found.
    code = identity * (int(np.ptp(frame)) + 2 * step + 1) + (frame - frame.min())
    rows, later = _later(code, step)
    moved = np.full(place.shape, np.nan)
    moved[rows] = (place[later] - place[rows]) * fps / step
    rows, later = rows[np.isfinite(moved[later, 0])], later[np.isfinite(moved[later, 0])]
    first, then = moved[rows], moved[later]
    longer = np.maximum(np.linalg.norm(first, axis=1), np.linalg.norm(then, axis=1))
    speed = 0.5 * np.linalg.norm(first + then, axis=1)
    steady = (np.linalg.norm(then - first, axis=1) < STEADY * longer) & (speed > MOVES_M)
    return _by_person(identity[rows][steady], speed[steady])


def body_widths(rig: Rig, observations: Observations, keys: Floats, places: Floats) -> list[Floats]:
    """Return the widths of each person's boxes, metres; boxes at an image's border are left out.

    Args:
        rig: lenses and poses.
        observations: people at common time steps.
        keys: (N, 2) frame and identity of people with a known place.
        places: (N, 3) their places, world, metres.
    """
    who, widths = [np.zeros(0)], [np.zeros(0)]
    for camera in rig.posed() if len(keys) else ():
        boxes, size = observations[camera.name].boxes, np.array(camera.lens.size)
        low, high = boxes.ltwh[:, :2], boxes.ltwh[:, :2] + boxes.ltwh[:, 2:]
        row, place = _placed(np.column_stack([boxes.frame, boxes.identity]), keys)
        whole = (low[row] > BORDER_PX).all(axis=1) & (high[row] < size - BORDER_PX).all(axis=1)
        row, place = row[whole], place[whole]
        middle = (low[row, 1] + high[row, 1]) / 2
        left, right = (camera.lens.bearings(np.column_stack([x[row, 0], middle])) for x in (low, high))
        angle = 2 * np.arcsin(np.clip(np.linalg.norm(left - right, axis=1) / 2, 0.0, 1.0))
        width = np.linalg.norm(places[place] - camera.centre, axis=1) * angle
        sound = np.isfinite(width) & (width > 0)
        who.append(keys[place[sound], 1])
        widths.append(width[sound])
    return _by_person(np.concatenate(who), np.concatenate(widths))


def _cue(kind: str, name: str, count: int, stated_m: float, log_scale: float, sigma: float) -> CueFigures:
    measured, sd = stated_m * float(np.exp(-log_scale)), stated_m * sigma
    return CueFigures(
        cue=f"{name} of {count}", kind=kind, count=count, stated_m=stated_m, measured_m=measured, sd_m=sd,
        residual_sigmas=(measured - stated_m) / sd, share=0.0, own_scale=stated_m / measured, own_sigma=sigma,
    )  # fmt: skip


def _normal(x: Floats, mean: float, sd: float) -> Floats:
    return np.asarray(np.exp(-0.5 * ((x - mean) / sd) ** 2) / (sd * np.sqrt(2 * np.pi)))


def _by_person(who: Floats, values: Floats) -> list[Floats]:
    """Return the values (N,) of each person who has enough of them."""
    order = np.argsort(who, kind="stable")
    starts = np.flatnonzero(np.diff(who[order])) + 1
    return [own for own in np.split(values[order], starts) if len(own) >= FEWEST]


def _later(code: Floats, step: int) -> tuple[Ints, Ints]:
    """Find the rows (K,) of people who also have a place `step` frames later, and the rows (K,) of these later places."""
    at = np.searchsorted(code, code + step)
    met = at < len(code)
    met[met] = code[at[met]] == code[met] + step
    rows = np.flatnonzero(met)
    return rows, at[rows]


def _placed(rows: Floats, keys: Floats) -> tuple[Ints, Ints]:
    """Find the rows (K,) whose frame and identity are among the keys (N, 2), and the index (K,) of their key."""
    number = group_numbers(*np.concatenate([keys, rows]).T)
    key_of = np.full(int(number.max()) + 1, -1)
    key_of[number[: len(keys)]] = np.arange(len(keys))
    key = key_of[number[len(keys) :]]
    found = np.flatnonzero(key >= 0)
    return found, key[found]
