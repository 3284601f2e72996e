"""The result of association."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

from passerby.association.clocks.drift import Drift
from passerby.core.association_figures import AssociationFigures
from passerby.core.observations import Clock, Observations
from passerby.core.scale_cues import PersonHeight
from passerby.findings.finding import Finding


@dataclass(frozen=True, eq=False)
class Association:
    """Identities and clocks."""

    observations: Observations
    """Boxes and joints as they were read, with identities that hold over all cameras; those without one are left out."""
    instants: Observations
    """The same, at instants that all cameras share."""
    clocks: Mapping[str, Clock]
    """Each camera's clock with its offset; the first registered camera's offset is 0."""
    sigma_s: Mapping[str, float] = field(default_factory=dict)
    """One sigma of the offsets that were refined, seconds, by camera."""
    figures: AssociationFigures = field(default_factory=AssociationFigures)
    """Figures of cameras, pairs (route, score, runner-up, matched tracklets, matches, offset), rounds."""
    lost: Mapping[str, Finding] = field(default_factory=dict)
    """By camera that no registration joins to another: the reason."""
    doubts: tuple[Finding, ...] = ()
    """Evidence against the result."""
    notices: tuple[Finding, ...] = ()
    """Unusual facts about the result."""
    drifts: Mapping[str, Drift] = field(default_factory=dict)
    """By camera, the drift of its clock relative to the others'; empty where too few people walk to measure it."""
    known_heights: tuple[PersonHeight, ...] = ()
    """Known heights of the people that the user marked, by the identities found."""
    height_findings: tuple[Finding, ...] = ()
    """Findings about these heights."""
