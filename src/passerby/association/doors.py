"""Where people pass between two groups of cameras, as a calibration knows it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from passerby.association.ground.passages import Passage
from passerby.findings.finding import Finding, notice


@dataclass(frozen=True, eq=False)
class Door:
    """Two groups between which people pass."""

    first: tuple[str, ...]
    """Names of the cameras of one group, in the order of the passage,"""
    second: tuple[str, ...]
    """and of the other."""
    passage: Passage

    @property
    def nearest(self) -> tuple[str, str]:
        """The camera of either group that sees most of the people who pass."""
        a, b = np.unravel_index(int(self.passage.cameras.argmax()), self.passage.cameras.shape)
        return self.first[a], self.second[b]

    @property
    def finding(self) -> Finding:
        """The notice that two groups are one rig."""
        return notice("groups_joined", *self.nearest, people=self.passage.votes, sizes=[len(self.first), len(self.second)])
