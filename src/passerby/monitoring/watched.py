"""What is watched and what came of it: options, moves, windows."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from passerby.common.arrays import Floats
from passerby.common.errors import InputError
from passerby.core.cameras import Pose, PoseSigma
from passerby.core.quarter_turns import axes_turn, turn_pose, turn_sigma
from passerby.monitoring.evidence import ChangePoint, MotionTest

STEPS = 5
"""Tests in each window: windows overlap, so that a move is seen well before a whole window lies behind it."""
LEAST_BUDGET_S, MOST_BUDGET_S = 0.001, 3600.0


@dataclass(frozen=True)
class WatchOptions:
    """How footage is watched. Raises `InputError` for a value that cannot be."""

    every_s: float = 60.0
    """Length of a window."""
    threshold: float = 4.7
    """Score from which a camera has moved: see `evidence.MotionTest.score`. In 120 quiet hours tried out the largest were 4.4,
    4.1, 3.5 and 3.3; of 120 bumps of a degree or 10 cm 117 went beyond 4.5 within a minute."""

    budget_s: float | None = None
    """Processor seconds for each camera and minute of recording: see `budget`. None: `budget.SITE_BUDGET_S` of a rig of many
    cameras; else no footage is left out."""

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
        """From one test to the next."""
        return self.every_s / STEPS


@dataclass(frozen=True, eq=False)
class Move:
    """A camera that is not where it was."""

    camera: str
    noticed_s: float
    """End of the window that gave it away."""
    moment: ChangePoint | None
    """When it moved; None: before the footage began."""
    score: float
    shift: Floats
    """(6,) centre (metres, world) and rotation vector (radians, camera frame) from the pose before to the new one."""
    covariance: Floats
    """(6, 6) of `shift`."""
    pose: Pose | None
    """The new pose, beside the other cameras' poses as the rig has them; None where too few people tell."""
    sigma: PoseSigma | None
    others: tuple[str, ...] = ()
    """Cameras that may have moved instead: the people do not tell which."""

    def turned(self, degrees: int) -> Move:
        """The move of the camera whose images are turned clockwise by a multiple of 90 degrees."""
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
        """Whether something can be said of a camera."""
        return any(test.camera == camera and test.is_clear for test in self.tests)


@dataclass(frozen=True, eq=False)
class Watched:
    """The result of all the footage."""

    names: tuple[str, ...]
    moves: tuple[Move, ...]
    windows: tuple[Window, ...]
    """Successive ones, without overlap."""
    from_s: float
    until_s: float
    by_joints: bool = False
    """Whether each window's cameras were adjusted anew (`readjusting`), or tested as they stand."""
    whole: tuple[Window, ...] = ()
    """All the footage since the last move, compared with the rig at once; of many cameras, stretches of different lengths."""
