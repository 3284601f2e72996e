"""Window after window of footage, whatever a window is tested by: until a camera has moved, and then on from its new pose."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence

import numpy as np

from passerby.common.progress import Progress
from passerby.core.cameras import Rig
from passerby.monitoring.evidence import Baseline, MotionTest
from passerby.monitoring.moments import ChangePoint, estimate_change_point
from passerby.monitoring.watched import Move, Watched, WatchOptions, Window
from passerby.people.held_cameras import GroundPlane
from passerby.people.rig_observations import RigObservations

STAGE = "monitoring"
FIRST_S = 15.0
"""A move that seems to lie so near to the beginning of the footage cannot be told from one before it."""


def span_of(seen: RigObservations) -> tuple[float, float]:
    """The first time at which somebody was seen, and just after the last: seconds; zeros where nobody was."""
    if not seen.n_groups:
        return 0.0, 0.0
    return float(seen.seconds.min()), float(seen.seconds.max()) + 1e-6


class WindowRun(ABC):
    """One footage on its way: poses change as cameras move."""

    def __init__(
        self, rig: Rig, seen: RigObservations, options: WatchOptions, ground: GroundPlane, tell: Progress,
        span: tuple[float, float] | None = None,
    ) -> None:  # fmt: skip
        self.rig, self.seen, self.options, self.ground, self.tell = rig, seen, options, ground, tell
        self.names = seen.names
        self.lost: tuple[str, ...] = ()
        self.moves: list[Move] = []
        self.windows: list[Window] = []
        self.start, self.end = span or span_of(seen)
        self.baseline = Baseline.of_rig(rig, self.names)

    @abstractmethod
    def _tested(self, from_s: float, until_s: float) -> list[MotionTest]:
        """The cameras' tests by a window."""

    @abstractmethod
    def _learn(self, found: Sequence[MotionTest]) -> None:
        """Take a quiet window for what is usual."""

    @abstractmethod
    def _moved(self, found: Sequence[MotionTest], from_s: float, until_s: float) -> float:
        """Who moved, when and by how much; returns the time at which watching begins anew."""

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
        self.tell(STAGE, total, total)
        return Watched(self.names, tuple(self.moves), tuple(self.windows), self.start, self.end)

    def _moments(self, cameras: Sequence[int], from_s: float, until_s: float) -> list[ChangePoint]:
        """When each of the cameras moved, by those that did not; some time in the window where these saw none of its people."""
        whole = ChangePoint(from_s, from_s, until_s)
        return [self._moment(camera, self._without(camera, cameras, from_s, until_s)) or whole for camera in cameras]

    def _without(self, camera: int, moved: Sequence[int], from_s: float, until_s: float) -> RigObservations:
        """What was seen about a window by a camera and by those that did not move."""
        every = self.options.every_s
        seen = self.seen.between(max(self.start, from_s - every), min(until_s + every / 2, self.end))
        return seen.without(np.isin(self.names, [*self.lost, *(self.names[c] for c in moved if c != camera)]))

    def _moment(self, camera: int, seen: RigObservations) -> ChangePoint | None:
        """When a camera moved; None where nothing tells."""
        return estimate_change_point(self.rig, seen, self.names[camera], self.baseline, self.ground)
