"""The result of a solver, and the verdict on a rig from its findings."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field
from typing import Literal

from passerby.core.cameras import Rig
from passerby.core.figures import SolverFigures
from passerby.findings.finding import Finding
from passerby.findings.texts import texts_of

Verdict = Literal["accepted", "doubtful", "refused"]


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
    """Figures of every stage: counts, residuals, scale cues and their weights, sigmas."""

    @property
    def reasons(self) -> tuple[str, ...]:
        """The evidence against the rig in words, one sentence each, with the remedy."""
        return texts_of(one for one in self.findings if one.severity != "notice")


def decide_verdict(rig: Rig, findings: Iterable[Finding]) -> Verdict:
    """Return `refused` for a refusal or without poses, `doubtful` for a doubt or a camera without a pose, else `accepted`.

    Args:
        rig: the solved rig; a camera that could not be registered has no pose.
        findings: the evidence against the rig; notices do not count.
    """
    severities = {finding.severity for finding in findings}
    posed = len(rig.posed())
    if "refusal" in severities or posed == 0:
        return "refused"
    return "doubtful" if "doubt" in severities or posed < len(rig) else "accepted"
