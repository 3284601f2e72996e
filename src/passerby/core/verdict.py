"""The verdict on a rig, by its findings: nothing else sets it."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Literal

from passerby.core.cameras import Rig
from passerby.findings.finding import Finding

Verdict = Literal["accepted", "doubtful", "refused"]


def decide_verdict(rig: Rig, findings: Iterable[Finding]) -> Verdict:
    """`refused` where there is no rig, `doubtful` where a camera has no pose or a finding is a doubt, else `accepted`.

    Args:
        rig: as solved; a camera that could not be registered has no pose.
        findings: the evidence against it; notices do not count.
    """
    severities = {finding.severity for finding in findings}
    posed = len(rig.posed())
    if "refusal" in severities or posed == 0:
        return "refused"
    return "doubtful" if "doubt" in severities or posed < len(rig) else "accepted"
