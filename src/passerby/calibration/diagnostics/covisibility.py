"""Whom one camera sees, others should see too: of people who stand in several views, how many are found in each?

What a rig rests on are the people whom cameras agree on. Those on whom they do not are nobody's evidence, and so a camera that
films a screen, a mirror or another place, or that has moved, can fit on the strength of the few who agree by chance. Here all
are counted: whoever stands upright on the ground by one camera's box and the rig, well inside another camera's picture, should
have a box there. One that people nearer to the camera hide has none, nor has one whom the detector missed.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from passerby.common.arrays import Bools, Floats, Ints
from passerby.common.columns import Columns
from passerby.core.cameras import Camera, Rig
from passerby.core.observations import UNKNOWN, Boxes, Observations
from passerby.core.synchronisation import sampling_distance
from passerby.findings.finding import Finding, doubt
from passerby.people.segments import ends_of_boxes, lean_in_image
from passerby.people.upright_body import ground_under, height_over, pixels_over

MOST_BOXES = 400
"""Of each camera, at even steps: shares are good to a few percent."""
LATER = 0.37
"""Where people are at another time, so much of the recording later, tells what is found by chance."""
MIN_DUE, MIN_BEYOND_CHANCE = 100, 60
"""So many people have to be due in the other view, and so many of them not to be expected there by chance."""
LEAST_FOUND = 0.28
"""Of what chance does not find. Right rigs of ordinary scenes have 0.59 to 0.96 in the worst of their pairs, 0.52 where people
are 15 pixels high, 0.32 and 0.46 in videos whose background detector misses many; wrong ones that nothing else tells: a screen
0.32, focal lengths 20 % too long in all cameras -0.1, stairs 0.13. Boxes that are off by 20 % of their height fall to 0.1,
though their rig is right to 0.24 m and 1.8 degrees. What other limits would do: docs/results/limits.md."""
LEAST_SHARED = 0.5
"""Of what is found over all pairs of a camera, as a share of what is found over all pairs of the others: detectors miss people
in all cameras alike, wrong identities place one of them. Right rigs of 80 ordinary scenes have 0.77 or more in their worst
camera (docs/results/limits.md), those of 18 rendered films, whose background detector misses many, 0.54 or more."""
BODY_M, MIDDLE_M = 1.75, 0.88
FOOT_SHARE = 0.04
"""A foot's edge is off by this share of the box's height, which along the ground is far where the camera is low."""
NEAR_SHARE = 0.35
"""A box is the one looked for where its middle is so near, as a share of the height that is expected there."""
UPRIGHT = (0.75, 1.25)
"""By foot and head a body is as tall as usual, by this factor: others are bent or half hidden, and their feet elsewhere."""


@dataclass(frozen=True)
class Missed:
    """People whom one camera sees and another one should see as well."""

    sees: str
    should: str
    due: int
    found: int
    by_chance: int
    """Those who have a box there at another time."""

    @property
    def share(self) -> float:
        """What is found of what chance does not find; 1 where nothing can be said."""
        return share_found([self])


def share_found(missed: Sequence[Missed]) -> float:
    """What is found of what chance does not find, over some pairs of cameras together; 1 where nothing can be said."""
    due, found, by_chance = _sums(missed)
    return (found - by_chance) / (due - by_chance) if _says(missed) else 1.0


class Shared(NamedTuple):
    """What a camera and the others find of the people whom both should detect, beyond chance."""

    camera: str
    found: float
    others: float
    """The same over all pairs of the others."""

    @property
    def ratio(self) -> float:
        """Of what is found over the camera's pairs to what is found over those of the others."""
        return self.found / self.others


def least_shared(missed: Sequence[Missed]) -> Shared | None:
    """The camera that shares the fewest people with the others, by how many these share with each other.

    None where nothing can be said: of fewer than three cameras, or where the others find hardly anybody.
    """
    shared = []
    for name in sorted({one.sees for one in missed} | {one.should for one in missed}):
        own = [pair for pair in missed if name in (pair.sees, pair.should)]
        others = [pair for pair in missed if name not in (pair.sees, pair.should)]
        if _says(own) and _says(others) and share_found(others) > LEAST_FOUND:
            shared.append(Shared(name, share_found(own), share_found(others)))
    return min(shared, key=lambda one: one.ratio, default=None)


def _says(missed: Sequence[Missed]) -> bool:
    """Whether enough people are due."""
    due, _, by_chance = _sums(missed)
    return due >= MIN_DUE and due - by_chance >= MIN_BEYOND_CHANCE


def _sums(missed: Sequence[Missed]) -> tuple[int, int, int]:
    """How many are due, found and by chance."""
    return sum(one.due for one in missed), sum(one.found for one in missed), sum(one.by_chance for one in missed)


def doubts_of_missed(rig: Rig, observations: Observations, unrecorded: Mapping[str, Ints] | None = None) -> list[Finding]:
    """A doubt about the pair of cameras of which the second misses most of whom it should see, if it misses nearly all.

    Where there is none, one about the camera that shares far fewer people with the others than these do with each other.
    """
    missed = people_missed(rig, observations, unrecorded)
    if not missed:
        return []
    worst = min(missed, key=lambda pair: pair.share)
    if worst.share < LEAST_FOUND:
        found, by_chance = worst.found / worst.due, worst.by_chance / worst.due
        return [doubt("people_missed", worst.sees, worst.should, found=found, by_chance=by_chance)]
    least = least_shared(missed)
    if least is None or least.ratio >= LEAST_SHARED:
        return []
    return [doubt("people_not_shared", least.camera, found=least.found, others=least.others)]


def people_missed(rig: Rig, observations: Observations, unrecorded: Mapping[str, Ints] | None = None) -> list[Missed]:
    """Count whom each camera should see, and does.

    Args:
        rig: world z up, ground z = 0, metres; cameras without a pose are left out.
        observations: at common instants; boxes of unknown identity count as found, but nobody is looked for by them.
        unrecorded: by camera, the instants at which it recorded nothing.
    """
    posed = [camera for camera in rig if camera.pose is not None and len(observations[camera.name].boxes)]
    if not posed:
        return []
    # Whoever stands by any camera is looked for in one at once: camera by camera, most of the time would go into the calls.
    everyone = _Standing.joined([_standing(c, one, observations[one.name].boxes) for c, one in enumerate(posed)])
    counts = []
    for c, other in enumerate(posed):
        standing = everyone.take(everyone.seen_by != c).but_at((unrecorded or {}).get(other.name))
        counts.append(_counts(standing, other, observations[other.name].boxes, len(posed)))
    some = np.bincount(everyone.seen_by, minlength=len(posed)) > 0
    return [
        Missed(one.name, other.name, *counts[second][:, first].tolist())
        for first, one in enumerate(posed)
        for second, other in enumerate(posed)
        if other is not one and some[first]
    ]


def _counts(standing: _Standing, camera: Camera, boxes: Boxes, cameras: int) -> Ints:
    """(3, C) by the camera that sees them, how many are due in another one, are found there, and would be by chance."""
    there = _InView.of(standing, camera, boxes)
    every = np.ones(len(there.frame), dtype=bool)
    return np.array(
        [np.bincount(there.seen_by[rows], minlength=cameras) for rows in (every, there.found(0.0), there.found(LATER))]
    )


@dataclass(frozen=True, eq=False)
class _Standing(Columns):
    """People who stand upright on the ground by cameras' boxes: N of them."""

    seen_by: Ints
    """(N,) the camera."""
    frame: Ints
    nearest: Floats
    """(N, 2) where they stand if the box's lower edge is too low, metres,"""
    farthest: Floats
    """(N, 2) and if it is too high."""

    def but_at(self, instants: Ints | None) -> _Standing:
        """Those who stand there at other instants."""
        return self if instants is None else self.take(~np.isin(self.frame, instants))


def _standing(number: int, camera: Camera, boxes: Boxes) -> _Standing:
    """Who stands upright on the ground, by one camera, which has a number."""
    rows = np.flatnonzero((boxes.identity > UNKNOWN) & boxes.inside(camera.lens.size))
    rows = rows[:: max(1, len(rows) // MOST_BOXES)]
    top, bottom = ends_of_boxes(boxes.ltwh[rows], lean_in_image(camera))
    places = [ground_under(camera, top + (1 + share) * (bottom - top)) for share in (FOOT_SHARE, 0.0, -FOOT_SHARE)]
    tall = height_over(camera, places[1], top)
    sound = np.isfinite(tall) & np.isfinite(places[0]).all(axis=1) & np.isfinite(places[2]).all(axis=1)
    usual = float(np.median(tall[sound])) if sound.any() else BODY_M
    sound &= (tall > UPRIGHT[0] * usual) & (tall < UPRIGHT[1] * usual)
    frame = boxes.frame[rows][sound]
    return _Standing(np.full(len(frame), number), frame, places[0][sound], places[2][sound])


@dataclass(frozen=True, eq=False)
class _InView:
    """Those who should be seen whole by another camera: M of them, in the pixels of that camera."""

    boxes: Boxes
    """What it saw, by frame."""
    seen_by: Ints
    """(M,) the camera that sees them."""
    frame: Ints
    nearest: Floats
    """(M, 2) the body's middle if the person stands nearest to the camera that sees it,"""
    farthest: Floats
    """(M, 2) and if farthest from it."""
    tall: Floats
    """(M,) height that is expected."""

    @classmethod
    def of(cls, standing: _Standing, camera: Camera, boxes: Boxes) -> _InView:
        """Those whose feet and head are well inside the picture, and who are not smaller there than those who are found."""
        place = 0.5 * (standing.nearest + standing.farthest)
        feet, head = pixels_over(camera, place, 0.0), pixels_over(camera, place, BODY_M)
        size = np.array(camera.lens.size, dtype=np.float64)
        tall = np.linalg.norm(feet - head, axis=1)
        margin = 0.25 * np.nan_to_num(tall)[:, None] + 3.0
        ends = [pixels_over(camera, at, MIDDLE_M) for at in (standing.nearest, standing.farthest)]
        with np.errstate(invalid="ignore"):
            should = (standing.frame >= boxes.frame.min()) & (standing.frame <= boxes.frame.max())
            if sampling_distance(boxes.frame) > 1:  # a slower camera saw nobody in between
                should &= np.isin(standing.frame, boxes.frame)
            for end in (feet, head):
                should &= ((end > margin) & (end < size - margin)).all(axis=1)
            should &= tall > np.quantile(boxes.ltwh[:, 3], 0.05)
        should &= np.isfinite(ends[0]).all(axis=1) & np.isfinite(ends[1]).all(axis=1)
        by_frame = boxes.take(np.argsort(boxes.frame, kind="stable"))
        return cls(by_frame, standing.seen_by[should], standing.frame[should], ends[0][should], ends[1][should], tall[should])

    def found(self, later: float) -> Bools:
        """(M,) who has a box about where it should be, a share of the recording later."""
        begin, end = int(self.boxes.frame[0]), int(self.boxes.frame[-1])
        length = end - begin + 1
        frame = begin + (self.frame - begin + round(later * length)) % length
        first, last = (np.searchsorted(self.boxes.frame, frame, side=side) for side in ("left", "right"))
        middles = self.boxes.ltwh[:, :2] + self.boxes.ltwh[:, 2:] / 2
        out = np.zeros(len(frame), dtype=bool)
        for k in range(int((last - first).max(initial=0))):
            who = np.flatnonzero(first + k < last)
            away = _from_segment(middles[first[who] + k], self.nearest[who], self.farthest[who])
            out[who] |= away < NEAR_SHARE * self.tall[who]
        return out


def _from_segment(point: Floats, start: Floats, end: Floats) -> Floats:
    """(N,) distances of points from segments, all (N, 2)."""
    along = end - start
    length = np.maximum(np.einsum("nk,nk->n", along, along), 1e-9)
    share = np.clip(np.einsum("nk,nk->n", point - start, along) / length, 0.0, 1.0)
    return np.asarray(np.linalg.norm(point - start - share[:, None] * along, axis=1))
