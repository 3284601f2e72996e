"""Figures of association: what `calibration.json` has as `association`, field by field under the same names."""

from __future__ import annotations

from dataclasses import dataclass, field

from passerby.common.arrays import ABSENT
from passerby.core.figures import LevelFigures


@dataclass(frozen=True, kw_only=True)
class CameraTracks:
    """What a camera brought."""

    name: str
    tracklets: int
    tracked_boxes: int
    boxes: int
    walking_samples: int
    own_level: LevelFigures | None
    looks: float | None
    """Probability that its embeddings tell its own people apart; None without embeddings."""


def route_in_words(route: str) -> str:
    """A pair's route as users read it; the names in files are older."""
    return {"looks": "appearance", "joints": "keypoints"}.get(route, route)


@dataclass(frozen=True, kw_only=True)
class TiedPair:
    """How two cameras a and b were tied."""

    cameras: tuple[str, str]
    route: str
    """`tracks`, `joints` or `looks`."""
    used: bool
    score: float | None
    share: float | None
    runner_up: float | None
    """Score of the next best motion, as a share of this one's."""
    support: float | None
    matches: int | None
    matched_tracklets: int
    offset_s: float
    """Of b's clock less a's."""
    registered_offset_s: float | None
    looks: float | None


@dataclass(frozen=True, kw_only=True)
class StartDifference:
    """What tells when the recording of one camera began against that of another, before the two are registered."""

    cameras: tuple[str, str]
    offset_s: float
    """When the second began, less when the first did."""
    found_by: str
    """`activity`, `wall clock` or `sound`."""
    significance: float | None
    """Of activity: how far the lag stands out from all others, in their standard deviations."""


@dataclass(frozen=True, kw_only=True)
class PairsTried:
    """Which pairs of cameras were registered, where not all were tried."""

    possible: int
    tried: int
    by_activity: int
    """Pairs of `tried` whose people come and go alike."""
    stated: int
    """Pairs of `tried` that the user named."""
    most_of_a_camera: int
    """Pairs of the camera that has most."""


@dataclass(frozen=True, kw_only=True)
class AssociationRound:
    """A turn of solver and association."""

    registered: int
    """Cameras with a pose."""
    unchanged: float
    """Pairs of tracklets that are together before and after, as a share of those in either."""


@dataclass(frozen=True, kw_only=True)
class AssociationFigures:
    """Identities, and how they were found; all but the mode None where identities were given and the clocks agree."""

    mode: str | None = field(default=None, metadata=ABSENT)
    """As the scene file has it; association itself leaves it out."""
    cameras: tuple[CameraTracks, ...] | None = field(default=None, metadata=ABSENT)
    pairs: tuple[TiedPair, ...] | None = field(default=None, metadata=ABSENT)
    starts: tuple[StartDifference, ...] | None = field(default=None, metadata=ABSENT)
    """What tells when recordings began; None where all clock offsets were searched in full."""
    searched_s: float | None = field(default=None, metadata=ABSENT)
    """The largest clock offset that was searched for, beside `starts`."""
    pairs_tried: PairsTried | None = field(default=None, metadata=ABSENT)
    """None where every pair of cameras was tried."""
    people: int | None = field(default=None, metadata=ABSENT)
    rounds: tuple[AssociationRound, ...] | None = field(default=None, metadata=ABSENT)
    """None where identities were given."""
