"""Start times of the cameras' recordings, minutes or hours apart, found before any two cameras are registered.

Candidates come from measured differences, or from people's activity (`activity`); the tracks of people decide between them. A
spanning forest is built of the pairs that agree, the clearest first, so that every other pair is searched about one lag only.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from passerby.association.camera_tracklets import CameraTracklets
from passerby.association.clocks.activity import LagPeak, find_lag_peaks, lag_of_visits, region_activity
from passerby.association.graph import ALONE_RUNNER_UP
from passerby.association.ground.ground_tracks import GroundTracks
from passerby.association.ground.registration import PairRegistration, Registration, register_pair
from passerby.association.sampling import STEP_S
from passerby.common.arrays import Floats, Ints
from passerby.core.association_figures import StartDifference
from passerby.findings.finding import Finding, notice

FULL_SEARCH_S = 60.0
"""Lags up to this are all searched by tracks, seconds; above it, candidates are found first."""
NEAR_S = 2.0
"""Range of the search on either side of a candidate, or of a pair's lag where the starts are known, seconds."""
CANDIDATES = 5
"""Number of lags of a pair at which tracks are tried. Of 25 simulated pairs that share people (`simulation.passing_crowd`,
seeds 100 to 104 with 1.5 to 25 people a minute) the true lag was the first of them in 23."""
LEAST_SIGNIFICANCE = 3.0
"""Peaks below it are not tried: any two recordings have such a peak."""
CLEAR_SIGNIFICANCE = 7.0
"""No two cameras that see different people reach it: the best of 50 simulated pairs (the same scenes) had 5.2."""
MUCH_CLEARER = 2.0
"""Ratio of the significance of a peak to that of the next one, from which the peak is tried alone."""
CLEAR_SHARE, CLEAR_SCORE = 0.5, 60.0
"""Least share of the people that both cameras should see, and least score in samples of walkers. The best score of cameras that
see different people is 30 over all lags (120 simulated pairs, 1 to 5 people for 1 to 3 minutes)."""
MEASURED_SIGMAS, LEAST_MISS_S = 3.0, 0.25
"""People contradict a measured difference if it is wrong by more than this number of sigmas, and of seconds."""
ACTIVITY, SOUND, WALL_CLOCK = "activity", "sound", "wall clock"
TIMECODE, CREATION_TIME = "timecode", "creation time"
FILE_CLOCKS = (TIMECODE, CREATION_TIME)
"""Clocks stated in files. They may be those of copies of the file, so that other evidence has to agree with them."""


@dataclass(frozen=True)
class MeasuredStart:
    """A difference of two clocks that was measured without people."""

    cameras: tuple[str, str]
    offset_s: float
    """Start time of the second recording minus that of the first, seconds."""
    sigma_s: float
    found_by: str
    """`WALL_CLOCK`, `SOUND`, or one of `FILE_CLOCKS`."""


@dataclass(frozen=True, eq=False)
class Starts:
    """Start times of the recordings, where they are known."""

    searched_s: float
    """Largest difference that was searched for, seconds."""
    offset_s: Floats
    """(C,) offset to add to each camera's clock, seconds, in whole grid steps; 0 for the first of each group."""
    group: Ints
    """(C,) group of each camera; the clocks of one group are known relative to each other."""
    differences: tuple[StartDifference, ...] = ()
    """The differences between pairs from which the offsets are computed."""
    doubts: Mapping[int, Finding] = field(default_factory=dict)
    """By camera outside the largest group: the reason why its start is unknown."""
    notices: tuple[Finding, ...] = ()
    """Unusual facts about the starts."""
    measured: tuple[MeasuredStart, ...] = ()
    """Differences measured without people."""

    @property
    def far(self) -> bool:
        """Whether pairs whose starts are unknown cannot be searched in full."""
        return self.searched_s > FULL_SEARCH_S

    def lag_steps(self, a: int, b: int) -> int | None:
        """Return the time of camera b's clock minus that of camera a's, in grid steps; None where it is not known."""
        if self.group[a] != self.group[b]:
            return None
        return round(float(self.offset_s[a] - self.offset_s[b]) / STEP_S)


@dataclass(frozen=True)
class _Edge:
    """Two cameras whose clocks agree at a lag."""

    a: int
    b: int
    lag: int
    """Time of camera b's clock minus that of camera a's, grid steps."""
    lag_s: float
    found_by: str
    peak: LagPeak | None


@dataclass(frozen=True, eq=False)
class _Pair:
    """Candidates of two cameras, the best first."""

    a: int
    b: int
    measured: tuple[MeasuredStart, ...]
    peaks: tuple[LagPeak, ...]

    @property
    def clarity(self) -> tuple[float, float]:
        """Key by which pairs are sorted: measured pairs first, the most exact of them first; then pairs by their best peak."""
        if self.measured:
            return 1.0, -min(one.sigma_s for one in self.measured)
        return 0.0, self.peaks[0].significance if self.peaks else 0.0


def find_starts(
    cameras: Sequence[CameraTracklets], max_lag_s: float, measured: Sequence[MeasuredStart] = (),
    affinity: Mapping[tuple[int, int], Floats] | None = None,
    *, known: bool = False, by_tracks: bool = True,
) -> Starts:  # fmt: skip
    """Find the start times of the cameras' recordings, where they have to be known before pairs are searched.

    Args:
        cameras: all cameras.
        max_lag_s: largest difference of two clocks that is searched for.
        measured: differences measured without people; tracks must agree with them.
        affinity: by pair of cameras, log-likelihood ratio of tracklets being one person.
        known: whether tracklet numbers are identities that hold in all cameras.
        by_tracks: whether tracks decide. Otherwise only differences that are significant without tracks are used: with unknown
            focal lengths tracks do not fit yet.
    """
    pairs = sorted(
        (_pair(a, b, cameras, max_lag_s, measured, known) for a in range(len(cameras)) for b in range(a + 1, len(cameras))),
        key=lambda pair: pair.clarity, reverse=True,
    )  # fmt: skip
    group = np.arange(len(cameras))
    offset = np.zeros(len(cameras), dtype=np.int64)
    edges: list[_Edge] = []
    unclear: dict[tuple[int, int], tuple[Registration, ...]] = {}
    for pair in pairs:
        if group[pair.a] == group[pair.b]:
            continue
        edge, rest = _try(pair, cameras, (affinity or {}).get((pair.a, pair.b)), by_tracks, max_lag_s)
        if edge is None:
            unclear[pair.a, pair.b] = rest
            continue
        edges.append(edge)
        members = group == group[pair.b]
        offset[members] += offset[pair.a] - edge.lag - offset[pair.b]
        group[members] = group[pair.a]
    for one in np.unique(group):
        members = np.flatnonzero(group == one)
        group[members] = members[0]
        offset[members] -= offset[members[0]]
    differences = tuple(_difference(edge, cameras) for edge in edges)
    doubts = _doubts(cameras, group, unclear, max_lag_s) if max_lag_s > FULL_SEARCH_S else {}
    notices = tuple(_begin_apart(cameras, group, offset, edges))
    return Starts(
        max_lag_s, np.asarray(offset * STEP_S, dtype=np.float64), group, differences, doubts, notices, tuple(measured)
    )


def shifted(tracks: GroundTracks, lag: int) -> GroundTracks:
    """Shift the tracks of a camera to another camera's clock, which shows `lag` grid steps less."""
    return tracks if lag == 0 else replace(tracks, step=tracks.step - lag)


def _pair(
    a: int, b: int, cameras: Sequence[CameraTracklets], max_lag_s: float, measured: Sequence[MeasuredStart], known: bool
) -> _Pair:
    """Collect the measured differences of two cameras, and peaks of activity where the range is too large for full search."""
    names = cameras[a].name, cameras[b].name
    own = [one for one in measured if one.cameras == names]
    own += [replace(one, cameras=names, offset_s=-one.offset_s) for one in measured if one.cameras == names[::-1]]
    own.sort(key=lambda one: one.sigma_s)
    first, second = cameras[a].tracks, cameras[b].tracks
    if max_lag_s <= FULL_SEARCH_S or first is None or second is None:
        return _Pair(a, b, tuple(own), ())
    return _Pair(a, b, tuple(own), _peaks(first, second, max_lag_s, known))


def _peaks(first: GroundTracks, second: GroundTracks, max_lag_s: float, known: bool) -> tuple[LagPeak, ...]:
    most = int(max_lag_s / STEP_S)
    low, high = -most, most
    visits = lag_of_visits(first, second) if known else None
    if visits is not None:
        low, high = max(low, visits[0]), min(high, visits[1])
    activity_a, activity_b = region_activity(first), region_activity(second)
    if activity_a is None or activity_b is None:
        return ()
    peaks = find_lag_peaks(activity_a, activity_b, low, high, CANDIDATES)
    return tuple(one for one in peaks if visits is not None or one.significance >= LEAST_SIGNIFICANCE)


def _try(
    pair: _Pair, cameras: Sequence[CameraTracklets], affinity: Floats | None, by_tracks: bool,
    max_lag_s: float,
) -> tuple[_Edge | None, tuple[Registration, ...]]:  # fmt: skip
    """Find the lag at which two cameras agree significantly; without one, return the registrations that fit at several lags."""
    first, second = cameras[pair.a].tracks, cameras[pair.b].tracks
    if first is None or second is None or not len(first) or not len(second):
        return None, ()
    for one in pair.measured:
        lag = round(-one.offset_s / STEP_S)
        reach = max(NEAR_S, MEASURED_SIGMAS * one.sigma_s)
        if not by_tracks:
            if one.found_by in FILE_CLOCKS and not (pair.peaks and abs(pair.peaks[0].lag - lag) * STEP_S <= reach):
                continue
            return _Edge(pair.a, pair.b, lag, -one.offset_s, one.found_by, None), ()
        found = _at(pair, first, second, lag, reach, affinity)
        if _is_clear(found):
            return _Edge(pair.a, pair.b, round(found.candidates[0].lag_s / STEP_S), -one.offset_s, one.found_by, None), ()
    clear = bool(pair.peaks) and _stands_alone(pair.peaks)
    if not by_tracks:
        best = pair.peaks[0] if clear else None
        return (None if best is None else _Edge(pair.a, pair.b, best.lag, best.lag * STEP_S, ACTIVITY, best)), ()
    edge, rest = _by_activity(pair, first, second, clear, affinity)
    # Sound is significant alone: where no other source can find the offset, it is used, and later steps check it.
    beyond = [
        one for one in pair.measured if one.found_by == SOUND and (max_lag_s > FULL_SEARCH_S or abs(one.offset_s) > max_lag_s)
    ]
    if edge is None and beyond:
        return _Edge(pair.a, pair.b, round(-beyond[0].offset_s / STEP_S), -beyond[0].offset_s, SOUND, None), ()
    return edge, rest


def _by_activity(
    pair: _Pair, first: GroundTracks, second: GroundTracks, clear: bool, affinity: Floats | None
) -> tuple[_Edge | None, tuple[Registration, ...]]:
    """Find the peak of activity at which tracks agree significantly; without one, return the registrations, best first."""
    tried: list[tuple[Registration, LagPeak, bool]] = []
    for peak in pair.peaks[:1] if clear else pair.peaks:
        found = _at(pair, first, second, peak.lag, NEAR_S, affinity)
        if found.candidates:
            tried.append((found.candidates[0], peak, _is_clear(found)))
    tried.sort(key=lambda entry: -entry[0].score)
    rest = tuple(registration for registration, _, _ in tried)
    if not tried or not tried[0][2]:
        return None, ()
    if any(one.score >= ALONE_RUNNER_UP * rest[0].score for one in rest[1:]):
        return None, rest
    best = tried[0][1]
    return _Edge(pair.a, pair.b, round(rest[0].lag_s / STEP_S), rest[0].lag_s, ACTIVITY, best), ()


def _stands_alone(peaks: Sequence[LagPeak]) -> bool:
    """Check whether the first peak is significant."""
    after = peaks[1].significance if len(peaks) > 1 else 0.0
    return peaks[0].significance >= max(CLEAR_SIGNIFICANCE, MUCH_CLEARER * after)


def _at(
    pair: _Pair, first: GroundTracks, second: GroundTracks, lag: int, reach_s: float, affinity: Floats | None
) -> PairRegistration:
    """Register two cameras near a lag, and return the registrations with their total lags."""
    found = register_pair(pair.a, pair.b, first, shifted(second, lag), reach_s, affinity)
    return with_lag(found, lag)


def with_lag(found: PairRegistration, lag: int) -> PairRegistration:
    """Return a registration of tracks that were `shifted`, with the total lags."""
    if lag == 0:
        return found
    return replace(found, candidates=tuple(replace(one, lag_s=one.lag_s + lag * STEP_S) for one in found.candidates))


def _is_clear(found: PairRegistration) -> bool:
    """Check whether the best registration is significant even though several lags are tried."""
    if not found.candidates or found.runner_up >= ALONE_RUNNER_UP or found.candidates[0].score < CLEAR_SCORE:
        return False
    return found.candidates[0].share >= CLEAR_SHARE or found.clear_of_chance


def _difference(edge: _Edge, cameras: Sequence[CameraTracklets]) -> StartDifference:
    return StartDifference(
        cameras=(cameras[edge.a].name, cameras[edge.b].name), offset_s=-edge.lag_s, found_by=edge.found_by,
        significance=None if edge.peak is None else edge.peak.significance,
    )  # fmt: skip


def contradicted_starts(
    starts: Starts | None, names: Sequence[str], offset_s: Floats, registered: Sequence[bool]
) -> list[Finding]:
    """Return a notice for each measured difference that the rig's clocks contradict.

    Args:
        starts: has the measured differences.
        names: names of all cameras.
        offset_s: (C,) offset to add to each camera's clock, found by people, seconds.
        registered: (C,) whether the offset was found by people.
    """
    number = {name: c for c, name in enumerate(names)}
    # A creation time may be that of the start or of the end: it is enough that one of both agrees.
    told: dict[tuple[tuple[str, str], str], list[MeasuredStart]] = {}
    for one in () if starts is None else starts.measured:
        told.setdefault((one.cameras, one.found_by), []).append(one)
    found = []
    for (cameras, found_by), measured in told.items():
        a, b = (number[name] for name in cameras)
        by_people = float(offset_s[b] - offset_s[a])
        if not (registered[a] and registered[b]):
            continue
        if all(abs(by_people - one.offset_s) > max(LEAST_MISS_S, MEASURED_SIGMAS * one.sigma_s) for one in measured):
            values = {"found_by": found_by, "measured_s": measured[0].offset_s, "people_s": by_people}
            found.append(notice("start_contradicted", names[b], names[a], **values))
    return found


def _begin_apart(cameras: Sequence[CameraTracklets], group: Ints, offset: Ints, edges: Sequence[_Edge]) -> list[Finding]:
    """Return a notice for recordings that begin farther apart than `FULL_SEARCH_S`."""
    found = []
    for one in np.unique(group).tolist():
        members = np.flatnonzero(group == one)
        if len(members) < 2 or np.ptp(offset[members]) * STEP_S <= FULL_SEARCH_S:
            continue
        earliest = members[np.argmin(offset[members])]
        later = {cameras[c].name: float((offset[c] - offset[earliest]) * STEP_S) for c in members.tolist() if c != earliest}
        names = [cameras[earliest].name, *later]
        by = sorted({edge.found_by for edge in edges if edge.a in members})
        found.append(notice("starts_apart", *names, later_s=later, found_by=by))
    return found


def _doubts(
    cameras: Sequence[CameraTracklets], group: Ints, unclear: Mapping[tuple[int, int], tuple[Registration, ...]],
    searched_s: float,
) -> dict[int, Finding]:  # fmt: skip
    """Return the reason why the start of each camera outside the largest group is unknown; of every camera without a group."""
    size = np.bincount(group, minlength=len(cameras))
    main = int(np.argmax(size)) if size.max() > 1 else -1
    out = {}
    for c, camera in enumerate(cameras):
        if group[c] == main or camera.tracks is None or not len(camera.tracks):
            continue
        rivals = [rest for pair, rest in unclear.items() if c in pair and len(rest) > 1]
        best = max(rivals, key=lambda rest: rest[0].score, default=())
        lags = None if not best else [abs(one.lag_s) for one in best[:2]]
        out[c] = notice("start_unknown", camera.name, searched_s=searched_s, lags_s=lags)
    return out
