"""Options and results of the test of footage: moves and windows."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from passerby.common.arrays import Floats
from passerby.common.errors import InputError
from passerby.core.cameras import Pose, PoseSigma
from passerby.core.quarter_turns import axes_turn, turn_pose, turn_sigma
from passerby.monitoring.evidence import ChangePoint, MotionTest

STEPS = 5
"""Number of tests for each length of a window: windows overlap, so that a move is noticed long before a whole window has passed
after it."""
LEAST_BUDGET_S, MOST_BUDGET_S = 0.001, 3600.0


@dataclass(frozen=True)
class WatchOptions:
    """Options of the test of footage. Raises `InputError` for an invalid value."""

    every_s: float = 60.0
    """Length of a window, seconds."""
    threshold: float = 4.7
    """Score from which a camera has moved: see `evidence.MotionTest.score`. In 120 quiet hours the largest scores were 4.4,
    4.1, 3.5 and 3.3; of 120 bumps of a degree or 10 cm 117 exceeded 4.5 within a minute."""

    budget_s: float | None = None
    """Processor seconds for each camera and minute of recording: see `budget`. None: `budget.SITE_BUDGET_S` for a rig of many
    cameras; for others no footage is left out."""

    def __post_init__(self) -> None:
        if self.budget_s is not None and not LEAST_BUDGET_S <= self.budget_s <= MOST_BUDGET_S:
            raise InputError(
                f"a budget of {self.budget_s:g} s: give {LEAST_BUDGET_S:g} to {MOST_BUDGET_S:g} seconds of processor time "
                "for each camera and minute of recording"
            )
        if not 10 <= self.every_s <= 3600:
            raise InputError(f"a window of {self.every_s:g} s: give 10 to 3600 seconds")
        if not 3 <= self.threshold <= 100:
            raise InputError(f"threshold = {self.threshold:g}: give a number from 3 to 100")

    @property
    def step_s(self) -> float:
        """Time from one test to the next, seconds."""
        return self.every_s / STEPS


@dataclass(frozen=True, eq=False)
class Move:
    """A camera that has moved."""

    camera: str
    noticed_s: float
    """End of the window in which the move was noticed, seconds."""
    moment: ChangePoint | None
    """Time of the move; None: before the footage began."""
    score: float
    shift: Floats
    """(6,) centre (metres, world) and rotation vector (radians, camera frame) from the pose before to the new one."""
    covariance: Floats
    """(6, 6) covariance of `shift`."""
    pose: Pose | None
    """The new pose, relative to the other cameras' poses in the rig; None for too few people."""
    sigma: PoseSigma | None
    others: tuple[str, ...] = ()
    """Cameras that may have moved instead: the people do not determine which."""

    def turned(self, degrees: int) -> Move:
        """Return the move of the camera after its images are turned clockwise by a multiple of 90 degrees."""
        if degrees % 360 == 0:
            return self
        block = np.eye(6)
        block[3:, 3:] = axes_turn(degrees)
        pose = None if self.pose is None else turn_pose(self.pose, degrees)
        sigma = None if self.sigma is None else turn_sigma(self.sigma, degrees)
        covariance = block @ self.covariance @ block.T
        return replace(self, shift=block @ self.shift, covariance=covariance, pose=pose, sigma=sigma)


@dataclass(frozen=True, eq=False)
class Window:
    """The result of one window."""

    from_s: float
    until_s: float
    tests: tuple[MotionTest, ...]

    def clear(self, camera: int) -> bool:
        """Check whether the window's test of a camera is sensitive enough (`MotionTest.is_clear`)."""
        return any(test.camera == camera and test.is_clear for test in self.tests)


@dataclass(frozen=True, eq=False)
class Watched:
    """The result of all the footage."""

    names: tuple[str, ...]
    moves: tuple[Move, ...]
    windows: tuple[Window, ...]
    """Successive windows without overlap."""
    from_s: float
    until_s: float
    by_joints: bool = False
    """Whether the cameras were adjusted in each window (`watching.watch_adjusted`), instead of tested with fixed poses."""
    whole: tuple[Window, ...] = ()
    """Tests of all the footage since the last move at once; with many cameras, stretches of different lengths."""
