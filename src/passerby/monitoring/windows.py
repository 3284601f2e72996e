"""Window after window of footage, whatever a window is tested by: until a camera has moved, and then on from its new pose.

A camera that was turned before the footage began is turned in every window alike. Where no window shows that by itself, the
windows in which nothing seems to move are what the later ones are compared with. So all the footage since the last move is
compared with the rig at the end, at once.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from passerby.common.progress import Progress
from passerby.core.cameras import PoseSigma, Rig
from passerby.monitoring.comparison import Comparison, Displacement
from passerby.monitoring.evidence import Baseline, MotionTest
from passerby.monitoring.moments import ChangePoint, estimate_change_point
from passerby.monitoring.watched import Move, Watched, WatchOptions, Window
from passerby.people.held_cameras import GroundPlane
from passerby.people.sightings import Sightings

STAGE = "monitoring"
PIECE_S = 600.0
"""Of footage that is worked on at once: memory stays at some 100 MB."""
FIRST_S = 15.0
"""A move that seems to lie so near to the beginning of the footage cannot be told from one before it."""


def span_of(seen: Sightings) -> tuple[float, float]:
    """The first time at which somebody was seen, and just after the last: seconds; zeros where nobody was."""
    if not seen.n_blocks:
        return 0.0, 0.0
    return float(seen.block_seconds.min()), float(seen.block_seconds.max()) + 1e-6


class WindowRun(ABC):
    """One footage on its way: poses change as cameras move."""

    def __init__(
        self, rig: Rig, seen: Sightings, options: WatchOptions, ground: GroundPlane, tell: Progress,
        span: tuple[float, float] | None = None,
    ) -> None:  # fmt: skip
        self.rig, self.seen, self.options, self.ground, self.tell = rig, seen, options, ground, tell
        self.names = seen.names
        self.lost: tuple[str, ...] = ()
        self.moves: list[Move] = []
        self.windows: list[Window] = []
        self.start, self.end = span or span_of(seen)
        self.baseline = Baseline.of_rig(rig, self.names)
        self.prior, self.since = self.baseline, self.start
        """What was known before the footage, or before what followed the last move, and when that begins."""

    @abstractmethod
    def _tested(self, from_s: float, until_s: float) -> list[MotionTest]:
        """The cameras' tests by a window."""

    @abstractmethod
    def _learn(self, found: Sequence[MotionTest]) -> None:
        """Take a quiet window for what is usual."""

    @abstractmethod
    def _moved(self, found: Sequence[MotionTest], from_s: float, until_s: float) -> float:
        """Who moved, when and by how much; returns the time at which watching begins anew."""

    @abstractmethod
    def _compared_since(self, from_s: float) -> Comparison | None:
        """What was known before against all the footage from a time on; None where that is nothing."""

    def result(self) -> Watched:
        """Window after window."""
        every, step = self.options.every_s, self.options.step_s
        origin, until, full = self.start, min(self.start + every, self.end), self.start + every
        total = max(1, int(np.ceil((self.end - self.start) / every)))
        while True:
            self.tell(STAGE, min(len(self.windows), total), total)
            found = self._tested(max(origin, until - every), until)
            last = until >= self.end
            if max((test.score for test in found), default=0.0) >= self.options.threshold:
                origin = self._moved(found, max(origin, until - every), until)
                self.windows.append(Window(max(self.start, until - every), until, tuple(found)))
                self.prior, self.since = self.baseline, origin
                until, full = min(origin + every, self.end), origin + every
                if last or origin >= self.end:
                    break
                continue
            if until >= full - 1e-9 or last:
                self.windows.append(Window(max(origin, until - every), until, tuple(found)))
                self._learn(found)
                full += every
            if last:
                break
            until = min(until + step, self.end)
        whole = self._whole()
        self.tell(STAGE, total, total)
        return Watched(self.names, tuple(self.moves), tuple(self.windows), self.start, self.end, whole=whole)

    def _whole(self) -> tuple[Window, ...]:
        """All the footage since the last move, compared at once."""
        found = self._compared_since(self.since)
        if found is None:
            return ()
        self.baseline = self.prior
        self._settle_displaced(found.moved, self.since, self.end, self._compared_since)
        return (Window(self.since, self.end, found.tests),)

    def _settle_displaced(
        self, moved: Sequence[Displacement], from_s: float, until_s: float, again: Callable[[float], Comparison | None]
    ) -> float:
        """Date the moves that a stretch of footage shows, and go on with the new poses; returns since when these hold.

        Args:
            moved: the cameras that moved.
            from_s: when the stretch begins,
            until_s: and when it ends.
            again: compares the footage from a time on, for cameras that moved within the stretch.
        """
        moments = self._dated(moved, from_s, until_s)
        after = max([from_s, *(moment.seconds for moment in moments.values())])
        if after > from_s + FIRST_S:
            # Some of the stretch shows the cameras where they were before.
            late = again(after)
            if late is not None and late.moved:
                moved, moments = late.moved, self._dated(late.moved, from_s, until_s)
        for one in moved:
            self._settle_one(one, moments.get(one.camera), until_s)
        return after

    def _dated(self, moved: Sequence[Displacement], from_s: float, until_s: float) -> dict[int, ChangePoint]:
        """When cameras moved; nothing of those whose people no camera saw that stood still."""
        cameras, found = [one.camera for one in moved], dict[int, ChangePoint]()
        for camera in cameras:
            seen = self._without(camera, cameras, from_s, until_s)
            several = np.bincount(seen.block, minlength=seen.n_blocks)[seen.block] > 1
            if several[seen.camera == camera].any() and (moment := self._moment(camera, seen)) is not None:
                found[camera] = moment
        return found

    def _settle_one(self, one: Displacement, moment: ChangePoint | None, noticed: float) -> None:
        """Note a move, and go on with the camera's new pose."""
        name = self.names[one.camera]
        if moment is not None and moment.seconds - self.start < FIRST_S:
            moment = None
        sigma = PoseSigma.from_covariance(one.pose_covariance)
        others = tuple(self.names[c] for c in one.others)
        self.moves.append(Move(name, noticed, moment, one.score, one.shift, one.covariance, one.pose, sigma, others))
        self.baseline = self.baseline.replaced(one.camera, one.pose_covariance)
        cameras = [replace(c, pose=one.pose, sigma=sigma) if c.name == name else c for c in self.rig.cameras]
        self.rig = replace(self.rig, cameras=tuple(cameras))

    def _moments(self, cameras: Sequence[int], from_s: float, until_s: float) -> list[ChangePoint]:
        """When each of the cameras moved, by those that did not; some time in the window where these saw none of its people."""
        whole = ChangePoint(from_s, from_s, until_s)
        return [self._moment(camera, self._without(camera, cameras, from_s, until_s)) or whole for camera in cameras]

    def _without(self, camera: int, moved: Sequence[int], from_s: float, until_s: float) -> Sightings:
        """What was seen about a window by a camera and by those that did not move."""
        every = self.options.every_s
        seen = self.seen.between(max(self.start, from_s - every), min(until_s + every / 2, self.end))
        if until_s - from_s > PIECE_S:
            step = np.unique(seen.block_seconds, return_inverse=True)[1]
            seen = seen.of_blocks(step % int(np.ceil((until_s - from_s) / PIECE_S)) == 0)
        return seen.without(np.isin(self.names, [*self.lost, *(self.names[c] for c in moved if c != camera)]))

    def _moment(self, camera: int, seen: Sightings) -> ChangePoint | None:
        """When a camera moved; None where nothing tells."""
        return estimate_change_point(self.rig, seen, self.names[camera], self.baseline, self.ground)
