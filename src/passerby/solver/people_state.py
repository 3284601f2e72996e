"""The unknowns of the person model."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np

from passerby.common.arrays import Floats


@dataclass(frozen=True, eq=False)
class AdjustmentState:
    """Values of all unknowns of the person model."""

    R: Floats
    """(C, 3, 3) world to camera."""
    centre: Floats
    """(C, 3) metres."""
    slack: Floats
    """(C,) logarithm of the ratio of the heights of boxes and people; its mean is 0."""
    globals: Floats
    """(1,) foot shift, as a share of the height."""
    heights: Floats
    """(P,) standing heights, metres."""
    people: Floats
    """(N, 4) of each person-instant: x, y, height of the lowest and of the highest point, metres."""
    joints: Floats
    """(J, 3) 3D joints, metres."""
    time: Floats = field(default_factory=lambda: np.zeros(0))
    """(C,) seconds to be added to the clocks' offsets: a camera shows the world so much later than its clock says. Empty where
    clocks are taken to be right."""
    lens: Floats = field(default_factory=lambda: np.zeros((0, 0)))
    """(C, L) differences of the lenses from the stated ones (`LensUnknowns`); no columns where they are not refined."""
    lengths: Floats = field(default_factory=lambda: np.zeros((0, 6)))
    """(K, 6) the two ends of each known length, metres (`CueRows`)."""

    def scaled(self, scale: float) -> AdjustmentState:
        """Multiply all lengths of cameras, people and joints by `scale`, standing heights included."""
        return replace(
            self, centre=self.centre * scale, heights=self.heights * scale, people=self.people * scale,
            joints=self.joints * scale, lengths=self.lengths * scale,
        )  # fmt: skip
