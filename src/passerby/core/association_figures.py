"""Figures of association: the entry `association` of `calibration.json`, field by field under the same names."""

from __future__ import annotations

from dataclasses import dataclass, field

from passerby.common.arrays import ABSENT
from passerby.core.figures import LevelFigures


@dataclass(frozen=True, kw_only=True)
class CameraTracks:
    """Input of one camera to the association."""

    name: str
    tracklets: int
    tracked_boxes: int
    boxes: int
    walking_samples: int
    own_level: LevelFigures | None
    looks: float | None
    """Probability that its embeddings distinguish its own people; None without embeddings."""


def route_in_words(route: str) -> str:
    """Return the name of a pair's route for users; files keep older names."""
    return {"looks": "appearance", "joints": "keypoints"}.get(route, route)


@dataclass(frozen=True, kw_only=True)
class TiedPair:
    """The connection of two cameras a and b by the people that both see."""

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
    """Offset of b's clock minus that of a's, seconds."""
    registered_offset_s: float | None
    looks: float | None


@dataclass(frozen=True, kw_only=True)
class StartDifference:
    """Evidence of when the recording of one camera began relative to that of another, before the two are registered."""

    cameras: tuple[str, str]
    offset_s: float
    """Beginning of the second recording minus that of the first, seconds."""
    found_by: str
    """`activity`, `wall clock` or `sound`."""
    significance: float | None
    """For activity: by how many standard deviations of all lags' values this lag is above the others."""


@dataclass(frozen=True, kw_only=True)
class PairsTried:
    """Numbers of the pairs of cameras that were registered, where not all were tried."""

    possible: int
    tried: int
    by_activity: int
    """Pairs of `tried` in which people come and go at similar times."""
    stated: int
    """Pairs of `tried` that the user named."""
    most_of_a_camera: int
    """Number of pairs of the camera that has most."""


@dataclass(frozen=True, kw_only=True)
class AssociationRound:
    """One round of solver and association."""

    registered: int
    """Number of cameras with a pose."""
    unchanged: float
    """Pairs of tracklets that are together before and after the round, as a share of those together in either."""


@dataclass(frozen=True, kw_only=True)
class AssociationFigures:
    """Identities, and how they were found. All but the mode are None where identities were given and the clocks agree."""

    mode: str | None = field(default=None, metadata=ABSENT)
    """The mode in the scene file; association itself leaves it out."""
    cameras: tuple[CameraTracks, ...] | None = field(default=None, metadata=ABSENT)
    pairs: tuple[TiedPair, ...] | None = field(default=None, metadata=ABSENT)
    starts: tuple[StartDifference, ...] | None = field(default=None, metadata=ABSENT)
    """Evidence of when recordings began; None where all clock offsets were searched in full."""
    searched_s: float | None = field(default=None, metadata=ABSENT)
    """The largest clock offset that was searched for in addition to `starts`, seconds."""
    pairs_tried: PairsTried | None = field(default=None, metadata=ABSENT)
    """None where every pair of cameras was tried."""
    people: int | None = field(default=None, metadata=ABSENT)
    rounds: tuple[AssociationRound, ...] | None = field(default=None, metadata=ABSENT)
    """None where identities were given."""
