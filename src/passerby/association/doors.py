"""Door between two groups of cameras, through which people pass, in a calibration's result."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from passerby.association.ground.passages import Passage
from passerby.findings.finding import Finding, notice


@dataclass(frozen=True, eq=False)
class Door:
    """Two groups between which people pass."""

    first: tuple[str, ...]
    """Names of the cameras of the first group, in the order of the passage."""
    second: tuple[str, ...]
    """Names of the cameras of the second group, in the same order."""
    passage: Passage

    @property
    def nearest(self) -> tuple[str, str]:
        """The two cameras, one of each group, that see most of the people who pass."""
        a, b = np.unravel_index(int(self.passage.cameras.argmax()), self.passage.cameras.shape)
        return self.first[a], self.second[b]

    @property
    def finding(self) -> Finding:
        """The notice that the two groups are joined to one rig."""
        return notice("groups_joined", *self.nearest, people=self.passage.votes, sizes=[len(self.first), len(self.second)])
