"""What a solver hands back."""

from __future__ import annotations

from dataclasses import dataclass, field

from passerby.core.cameras import Rig
from passerby.core.figures import SolverFigures
from passerby.core.verdict import Verdict
from passerby.findings.finding import Finding
from passerby.findings.texts import texts_of


@dataclass(frozen=True, eq=False)
class Solution:
    """A solved rig with the figures that show its quality."""

    method: str
    rig: Rig
    """World z up, ground at z = 0, metres. A camera that could not be registered has no pose."""
    verdict: Verdict
    findings: tuple[Finding, ...] = ()
    """Evidence against the rig, and notices that explain its sigmas."""
    figures: SolverFigures = field(default_factory=SolverFigures)
    """Of every stage: counts, residuals, scale cues and their weights, sigmas."""

    @property
    def reasons(self) -> tuple[str, ...]:
        """The evidence against it in words, one sentence each, with the remedy."""
        return texts_of(one for one in self.findings if one.severity != "notice")
