"""What association hands on."""

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
    """Identities, and clocks."""

    observations: Observations
    """Boxes and joints as they were read, with identities that hold over the rig; those without one are left out."""
    instants: Observations
    """The same at instants that all cameras share."""
    clocks: Mapping[str, Clock]
    """Each camera's clock with its offset; the first registered camera's offset is 0."""
    sigma_s: Mapping[str, float] = field(default_factory=dict)
    """One sigma of the offsets, as far as they were refined."""
    figures: AssociationFigures = field(default_factory=AssociationFigures)
    """Of cameras, pairs (route, score, runner-up, matched tracklets, matches, offset), rounds."""
    lost: Mapping[str, Finding] = field(default_factory=dict)
    """By camera that no registration joins to another: why."""
    doubts: tuple[Finding, ...] = ()
    """Evidence against relying on it."""
    notices: tuple[Finding, ...] = ()
    """What is odd."""
    drifts: Mapping[str, Drift] = field(default_factory=dict)
    """By camera, how its clock drifts against the others'; empty where too few people walk to tell."""
    known_heights: tuple[PersonHeight, ...] = ()
    """Of the people at whom the user pointed, by the identities found."""
    height_findings: tuple[Finding, ...] = ()
    """What is wrong or odd about them."""
