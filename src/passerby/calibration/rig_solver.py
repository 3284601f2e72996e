"""What association needs of a solver."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Protocol

from passerby.core.cameras import Rig
from passerby.core.observations import Observations
from passerby.core.scale_cues import PersonHeight
from passerby.core.solution import Solution
from passerby.geometry.relative_pose import PairHypothesis


class RigSolver(Protocol):
    """Solves a rig."""

    def __call__(
        self,
        synchronised: Observations,
        guesses: Sequence[PairHypothesis],
        *,
        passing: bool,
        refine_time: bool,
        lenses: Rig | None = None,
        known: Sequence[PersonHeight] = (),
    ) -> Solution:
        """The rig from people at common time steps, refused where the evidence does not do.

        A passing one may use a part of the evidence; the clocks' errors are unknowns of it where they are refined. `lenses`
        are those to begin with, where they are known better than at first. `known` are heights of these identities.
        """
