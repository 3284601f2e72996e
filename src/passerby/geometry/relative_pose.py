"""The relative pose of two cameras as a hypothesis."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

from passerby.common.arrays import Floats


@dataclass(frozen=True, eq=False)
class PairHypothesis:
    """One guess at the motion between cameras a and b: `x_b = R_ba x_a + t_ba`, metres."""

    a: int
    b: int
    R_ba: Floats
    t_ba: Floats
    route: str
    """ground | epipolar | joints; tracks for a guess from outside, found before anybody was known in both cameras"""
    inliers: int
    matches: int

    def among(self, cameras: Sequence[int]) -> PairHypothesis | None:
        """The same guess in a rig of these cameras alone; None where one of its two is not among them."""
        if self.a not in cameras or self.b not in cameras:
            return None
        return replace(self, a=list(cameras).index(self.a), b=list(cameras).index(self.b))

    @property
    def inverse(self) -> PairHypothesis:
        """The same guess from b to a."""
        return PairHypothesis(self.b, self.a, self.R_ba.T, -self.R_ba.T @ self.t_ba, self.route, self.inliers, self.matches)
