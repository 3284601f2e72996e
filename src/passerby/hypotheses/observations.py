"""Test whether one camera's observations were misread, by prediction from people with positions by the other cameras.

Under each reading (`readings`) the camera is registered to these people without a fifth of the blocks, which it then predicts.
A clock's offset is found without them, too. The gains of the blocks are compared as those of all alternatives (`comparison`).
Lenses are those of the rig, stated or estimated.
"""

from __future__ import annotations

from collections.abc import Set
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from passerby.common.arrays import Floats, Ints
from passerby.core.cameras import Lens, Pose, Rig
from passerby.core.figures import adjusted
from passerby.core.measuring import MOST_PLACES, measure_change
from passerby.core.observations import CameraObservations, Observations
from passerby.core.solution import Solution
from passerby.core.stature import PERSON_HEIGHT_M
from passerby.core.synchronisation import USUAL_FPS
from passerby.hypotheses.case import blocks_of
from passerby.hypotheses.comparison import FOLDS, LOG_ODDS, Comparison, effect, may_convince
from passerby.hypotheses.readings import Reading, image_readings, late_clock
from passerby.hypotheses.registration import FEWEST, SeenPeople, find_bodies, rows_of_keys
from passerby.people.body_centres import PeopleRays, TriangulatedPeople, identified_body_centres

MOST_LATE_S = 8.0
"""Largest clock offset that is tried, seconds; the search goes on by one time step while the fit improves."""
WALKING_M_S = 1.0
"""Speed of walkers, metres per second: a wrong clock displaces them by this speed times its error."""
LEAST_S = 0.1
"""Smaller offsets, seconds, also occur in sound recordings: half a time step of the usual 5 a second. A sound scene (seed 4712
of the ordinary ones, points known to 4 mm) shows 0.02 s, since boxes of walkers have errors along their trajectories."""


@dataclass(frozen=True, eq=False)
class ReadCamera:
    """A reading of a camera's observations that fits people better than the stated one."""

    reading: Reading
    name: str
    """Name of the camera."""
    over_base: Comparison
    pose: Pose
    """Pose of the camera under the reading, in the rig's world."""
    effect: float
    """Change of the rig's measurements by the reading, in their standard deviations; infinite where it is unknown."""
    lens: Lens
    """Lens of the camera under the reading."""
    seen: CameraObservations
    """Observations of the camera under the reading, at common time steps."""

    @property
    def log_odds(self) -> float:
        """Logarithm of the odds against the stated observations."""
        return self.over_base.log_evidence + self.reading.log_prior

    def applied(self, rig: Rig, instants: Observations) -> tuple[Rig, Observations]:
        """Apply the reading to the rig and the observations."""
        changed = (replace(one, lens=self.lens, pose=self.pose) if one.name == self.name else one for one in rig)
        return replace(rig, cameras=tuple(changed)), replace(instants, cameras={**instants.cameras, self.name: self.seen})

    @property
    def decision(self) -> Literal["notice", "correct", "doubt"]:
        """The consequence of the reading: a notice, a correction or a doubt."""
        if self.reading.correctable:
            return "correct" if self.effect > 1 else "notice"
        return "doubt" if self.effect > 1 else "notice"


def examine_readings(solution: Solution, instants: Observations, *, clocks: bool) -> list[ReadCamera]:
    """Find the readings that explain cameras' observations better, one for a camera at most, in the order of the search.

    Args:
        solution: the solved rig; world z up, the ground at z = 0.
        instants: people at common time steps, with identities over all cameras.
        clocks: whether clocks can be corrected.
    """
    rig = solution.rig.posed()
    found: list[ReadCamera] = []
    if solution.method != "people" or len(rig) < 2:
        return found
    seen = instants
    while better := _better(rig, seen, {one.name for one in found}, clocks):
        one = min(better, key=_by_gain)
        found.append(_with_effect(one, solution, instants))
        # Misread observations displace the people for the other cameras: these are examined again with the right reading.
        rig, seen = one.applied(rig, seen)
    return found


def _better(rig: Rig, instants: Observations, known: Set[str], clocks: bool) -> list[ReadCamera]:
    """Find the most probable significant reading of each camera, except of the cameras in `known`."""
    rays = PeopleRays.of(rig, identified_body_centres(rig, instants))
    found = []
    for index, name in enumerate(rig.names):
        if name in known:
            continue
        camera = _Camera(rig, index, instants, rays.triangulated(PERSON_HEIGHT_M, rays.camera != index))
        if len(camera.stated) < FEWEST:
            continue
        readings = image_readings(index, len(rig), camera.lens, camera.seen)
        if late_s := camera.late_s():
            readings.append(late_clock(index, len(rig), late_s, camera.fps, correctable=clocks))
        compared = [one for reading in readings if (one := camera.compared(reading)) is not None and one.log_odds > LOG_ODDS]
        found += sorted(compared, key=_by_gain)[:1]
    return found


def _by_gain(found: ReadCamera) -> float:
    """Return the sorting key of significant readings: the largest gain is the most probable."""
    return -(found.over_base.gain + found.reading.log_prior)


class _Camera:
    """One camera's observations, and the people with positions by the other cameras."""

    def __init__(self, rig: Rig, index: int, instants: Observations, people: TriangulatedPeople) -> None:
        camera = rig.cameras[index]
        assert camera.pose is not None
        self.index, self.n_cameras, self.name, self.lens = index, len(rig), camera.name, camera.lens
        self.people, self.seen, self.fps = people, instants[camera.name], instants.fps or USUAL_FPS
        self.bodies = find_bodies(self.seen, self.lens)
        self.stated = self.bodies.with_places(people)
        self.block, self.n_blocks = blocks_of(self.stated.frame, self.stated.identity, self.fps)
        self.pose = self.stated.fitted(camera.pose) if len(self.stated) >= FEWEST else camera.pose

    def late_s(self, first: int = 0, fold: int | None = None) -> float:
        """Find the clock offset that fits people best, seconds later than stated; 0 if it is below `LEAST_S`.

        Args:
            first: offset from which the search begins, time steps.
            fold: number of the held-out fold; None: none is held out.
        """
        costs: dict[int, float] = {}

        def cost(late: int) -> float:
            if late not in costs:
                moved = self.bodies.with_places(self.people, -late)
                if fold is not None:
                    moved = moved.take(self._block_of(moved) % FOLDS != fold)
                part = moved.thinned()
                pose = self.pose if late == 0 and fold is None else part.fitted(self.pose)
                costs[late] = float(part.costs(pose).mean()) if len(part) >= FEWEST else np.inf
            return costs[late]

        best = first
        for towards in (-1, 1):
            at = best + towards
            while cost(at) < cost(best) and abs(at) < MOST_LATE_S * self.fps:
                best, at = at, at + towards
        before, here, after = cost(best - 1), cost(best), cost(best + 1)
        bend = before + after - 2 * here
        between = 0.5 * (before - after) / bend if np.isfinite(bend) and bend > 0 else 0.0
        late = best + float(np.clip(between, -0.5, 0.5))
        return late / self.fps if abs(late) >= LEAST_S * self.fps else 0.0

    def compared(self, reading: Reading) -> ReadCamera | None:
        """Compare a reading with the stated observations, by the people that both show; None if it fits no better."""
        read = self._read(reading)
        pose = read.other.anew(np.random.default_rng(0)) if reading.anew else self.pose
        if pose is None or len(read.other) < FEWEST:
            return None
        stated = read.stated.costs(self.pose)
        if read.other.costs(pose).sum() >= stated.sum():
            return None
        full, block = read.other.fitted(pose), self._block_of(read.stated)
        fitted, base = (self._by_block(block, each) for each in (read.other.costs(full), stated))
        if not may_convince(fitted, base, reading.log_prior):
            return None
        better, worse = np.zeros(self.n_blocks), np.zeros(self.n_blocks)
        for fold in range(FOLDS):
            part = read
            if reading.late_s is not None:  # found again: an offset from all blocks would not be a prediction
                late_s = self.late_s(round(reading.late_s * self.fps), fold)
                part = self._read(late_clock(self.index, self.n_cameras, late_s, self.fps, correctable=reading.correctable))
            block = self._block_of(part.stated)
            held = block % FOLDS == fold
            if held.any() and not held.all():
                for seen, start, costs in ((part.other, pose, better), (part.stated, self.pose, worse)):
                    costs += self._by_block(block[held], seen.take(held).costs(seen.take(~held).fitted(start)))
        return ReadCamera(reading, self.name, Comparison.of(better, worse), full, np.inf, read.lens, read.seen)

    def _read(self, reading: Reading) -> _Read:
        lens, seen = reading.read(self.lens, self.seen)
        every = find_bodies(seen, lens).with_places(self.people)
        at = self._rows(every)
        return _Read(lens, seen, every.take(at >= 0), self.stated.take(at[at >= 0]))

    def _rows(self, seen: SeenPeople) -> Ints:
        """Return the row (M,) of each observation among the stated ones; -1 without one."""
        ids = int(max(seen.identity.max(initial=0), self.stated.identity.max(initial=0))) + 1
        return rows_of_keys(seen.frame * ids + seen.identity, self.stated.frame * ids + self.stated.identity)

    def _by_block(self, block: Ints, costs: Floats) -> Floats:
        """Sum costs (M,) by block (B,)."""
        return np.asarray(np.bincount(block, costs, self.n_blocks), dtype=np.float64)

    def _block_of(self, seen: SeenPeople) -> Ints:
        """Return the block (M,) of each observation; -1 without one."""
        at = self._rows(seen)
        return np.where(at >= 0, self.block[at], -1)


@dataclass(frozen=True, eq=False)
class _Read:
    """A camera's observations under another reading, and as stated: the same people at the same times."""

    lens: Lens
    seen: CameraObservations
    other: SeenPeople
    stated: SeenPeople


def _with_effect(found: ReadCamera, solution: Solution, instants: Observations) -> ReadCamera:
    """Add the change of the rig's measurements by the camera's pose under the reading."""
    rig = solution.rig.posed()
    moved = Rig(tuple(replace(one, pose=found.pose) if one.name == found.name else one for one in rig))
    places = PeopleRays.of(rig, identified_body_centres(rig, instants))
    located = places.triangulated(PERSON_HEIGHT_M, np.ones(len(places.camera), dtype=bool)).place[:, :2]
    step = max(1, len(located) // MOST_PLACES)
    change, measuring = measure_change(rig, moved, located[::step]), adjusted(solution.figures).measuring
    if change is None or measuring is None:
        return found
    late_mm = 1000 * WALKING_M_S * abs(found.reading.late_s or 0.0) / max(measuring.points.median_mm, 1e-9)
    return replace(found, effect=max(effect(change, measuring), late_mm))
