"""Reasons why a camera could not be registered by the tracks of its people, and changes that would make them fit.

Two mistakes are usual: a frame rate that is not the recording's, and clocks that differ by more than was searched for. Both
are tried, so that the finding can name the remedy.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from passerby.association.camera_tracklets import CameraTracklets
from passerby.association.candidates import Candidates
from passerby.association.clocks.far_offsets import far_registration
from passerby.association.clocks.starts import Starts
from passerby.association.graph import ALONE_RUNNER_UP, Edge, ViewGraph
from passerby.association.ground.ground_tracks import GroundTracks, ground_tracks
from passerby.association.ground.registration import BELIEVED_SHARE, Registration, register_pair
from passerby.association.sampling import STEP_S
from passerby.common.arrays import Floats
from passerby.core.cameras import Pose
from passerby.findings.finding import Finding, doubt, notice
from passerby.geometry.groups import group_numbers

MISTAKEN_RATES = tuple(
    ratio
    for pair in ((2, 1), (6, 5), (5, 4), (25, 24), (12, 5), (5, 3), (5, 2))
    for ratio in (pair[0] / pair[1], pair[1] / pair[0])
)
"""Ratios of frame rates that are mistaken for each other: 25 and 50, 25 and 30, 24 and 30, 24 and 25, 25 and 60, 30 and 50, 10
and 25 frames per second."""
PACE_RATIO = 1.4
"""People of two cameras walk equally fast; the medians of some seconds agree within this factor."""
WALK_M, WALK_BLOCK_S = 1.0, 1.0
NEAR_LAG_S = 60.0
"""Every lag up to this, or half of the shorter recording, is searched in full: some 3 s of computing."""
CLEAR_SHARE, CLEAR_SCORE = 0.5, 30.0
"""Least share of the people that both cameras should see, and least score in samples of walkers, of a significant fit."""
FAR_SCORE = 60.0
"""Least score where all lags at which two recordings overlap are tried. Over so many lags, different people score 30 at best
(120 simulated pairs, 1 to 5 people for 1 to 3 minutes); people seen by both cameras for two minutes score some 200 each."""
PARTNERS = 2
"""Number of other cameras against which a camera is tried."""


def fit_of(edge: Edge) -> dict[str, Any]:
    """Return how well the tracks of an unused pair fit, as values of a finding."""
    if edge.guess is None:
        return {"fit": "never_together"}
    if edge.guess.share < BELIEVED_SHARE:
        return {"fit": "few_in_both", "share": edge.guess.share}
    if edge.runner_up >= 1:
        return {"fit": "contradicted"}
    return {"fit": "ambiguous", "runner_up": edge.runner_up}


def unregistered_cameras(
    cameras: Sequence[CameraTracklets], graph: ViewGraph, max_lag_s: float, *, timed: bool = True,
    starts: Starts | None = None, near: Candidates | None = None,
) -> dict[str, Finding]:  # fmt: skip
    """Return, by name, a finding with the reason why each camera without any registration has no pose.

    Args:
        cameras: all cameras.
        graph: their registrations.
        max_lag_s: largest difference of two clocks that was searched for.
        timed: whether the clocks of such cameras are known nevertheless.
        starts: start times of the recordings, where they were searched for first.
        near: the pairs of cameras that may share ground; None: all.
    """
    inside = graph.groups[0]
    alone = [group[0] for group in graph.groups if len(group) == 1]
    return {
        cameras[c].name: _unregistered(c, cameras, graph, inside, max_lag_s, timed, starts, near)
        for c in alone
        if c not in inside
    }


def _unregistered(
    c: int, cameras: Sequence[CameraTracklets], graph: ViewGraph, inside: Sequence[int], max_lag_s: float, timed: bool,
    starts: Starts | None, near: Candidates | None,
) -> Finding:  # fmt: skip
    camera = cameras[c]
    if (empty := sees_too_little(camera)) is not None:
        return empty
    if starts is not None and c in starts.doubts:
        return starts.doubts[c]
    edges = [edge for edge in graph.edges if c in (edge.a, edge.b) and edge.a + edge.b - c in inside]
    best = max(edges, key=lambda edge: -1.0 if edge.guess is None else edge.guess.share, default=None)
    fit = {"fit": "nobody"} if best is None else fit_of(best)
    other = None if best is None else cameras[best.a + best.b - c].name
    possible = [p for p in inside if near is None or (min(c, p), max(c, p)) in near]
    partners = sorted(possible, key=lambda p: -_samples(cameras[p]))[:PARTNERS]
    partners = partners if starts is None else []
    better = next((one for p in partners if (one := what_would_fit(cameras[p], camera, max_lag_s)) is not None), None)
    return notice("camera_unregistered", camera.name, to=other, timed=timed, **fit, **fixed_by(better))


def fixed_by(better: Finding | None) -> dict[str, Any]:
    """Return the change that would make tracks fit, as values of a finding."""
    return {} if better is None else {"fixed_by": better.as_value()}


def sees_too_little(camera: CameraTracklets) -> Finding | None:
    """Return the reason why a camera has no tracks; None where it has some."""
    if not len(camera.bodies):
        return notice("nobody_seen_whole", camera.name)
    if not _samples(camera):
        return notice("few_walkers", camera.name)
    return None


def _samples(camera: CameraTracklets) -> int:
    return 0 if camera.tracks is None else len(camera.tracks)


def nobody_walks(cameras: Sequence[CameraTracklets], poses: Sequence[Pose | None]) -> list[Finding]:
    """Return a doubt where fewer than two registered cameras saw people walk: then clocks and identities are uncertain."""
    if sum(_someone_walks(camera) for camera, pose in zip(cameras, poses, strict=True) if pose is not None) > 1:
        return []
    return [doubt("people_stand_still")]


def _someone_walks(camera: CameraTracklets) -> bool:
    """Check whether a tracklet has two positions that are farther apart than the errors of its ground positions.

    Its ends alone are not enough: a person who paces up and down a room for half a minute often ends at the start.
    """
    tracks = camera.tracks
    if tracks is None or not len(tracks):
        return False
    # Means of a second or so: single samples jump where a foot is hidden.
    block = group_numbers(tracks.tracklet, tracks.step // max(1, round(WALK_BLOCK_S / STEP_S)))
    size = np.bincount(block)
    place = (np.bincount(block, tracks.position.real) + 1j * np.bincount(block, tracks.position.imag)) / size
    off = np.bincount(block, tracks.sigma[0]) / size
    tracklet = tracks.tracklet[np.unique(block, return_index=True)[1]]
    return any(_walked(place[tracklet == one], off[tracklet == one]) for one in np.unique(tracklet).tolist())


def _walked(place: NDArray[np.complex128], off: Floats) -> bool:
    """Check whether the farthest positions (N,) of a tracklet, with errors (N,), metres, are apart by a walk.

    They are the position farthest from the first one, and the position farthest from that.
    """
    one = int(np.argmax(np.abs(place - place[0])))
    apart = np.abs(place - place[one])
    return bool((apart > WALK_M + 2 * np.maximum(off, off[one])).any())


def what_would_fit(a: CameraTracklets, b: CameraTracklets, max_lag_s: float) -> Finding | None:
    """Find another frame rate of camera b, or another lag of the clocks, with which the two cameras fit.

    Nothing is tried where the clocks are taken as synchronised.
    """
    if a.tracks is None or b.tracks is None or not len(a.tracks) or not len(b.tracks) or max_lag_s <= 0:
        return None
    found = [(ratio, guess) for ratio in _likely_ratios(a.tracks, b.tracks) if (guess := _at_rate(a, b, ratio, max_lag_s))]
    if found:
        ratio, guess = max(found, key=lambda entry: entry[1].merit)
        rates = {"fits_fps": b.clock.fps / ratio, "fps": b.clock.fps}
        return notice("other_rate_fits", b.name, a.name, **rates, share=guess.share)
    wide = _at_larger_lag(a, b, max_lag_s)
    if wide is not None:
        enough_s = int(np.ceil(abs(wide.lag_s))) + 1
        return notice("clock_far_off", b.name, a.name, ahead_s=wide.lag_s, search_s=enough_s)
    return None


def _at_larger_lag(a: CameraTracklets, b: CameraTracklets, max_lag_s: float) -> Registration | None:
    """Register at lags that were not searched: in full up to a minute, then coarsely over all of the overlap."""
    assert a.tracks is not None
    assert b.tracks is not None
    spans = [float(np.ptp(tracks.step)) * STEP_S for tracks in (a.tracks, b.tracks)]
    longest = min(NEAR_LAG_S, 0.5 * min(spans))
    near = _clear(a, b, b.tracks, longest) if max_lag_s < longest else None
    if near is not None and abs(near.lag_s) > max_lag_s:
        return near
    far = far_registration(a.tracks, b.tracks, max(longest, max_lag_s), ALONE_RUNNER_UP)
    return far if far is not None and far.share >= CLEAR_SHARE and far.score >= FAR_SCORE else None


def _likely_ratios(a: GroundTracks, b: GroundTracks) -> list[float]:
    """Return the mistaken rates at which the people of both cameras walk equally fast."""
    pace_a, pace_b = (float(np.percentile(np.abs(tracks.velocity), 70.0)) for tracks in (a, b))
    if min(pace_a, pace_b) <= 0:
        return []
    return [ratio for ratio in MISTAKEN_RATES if abs(np.log(ratio * pace_a / pace_b)) < np.log(PACE_RATIO)]


def _at_rate(a: CameraTracklets, b: CameraTracklets, ratio: float, max_lag_s: float) -> Registration | None:
    """Register the cameras as if camera b's seconds were `ratio` times as long."""
    if b.level is None:
        return None
    return _clear(a, b, ground_tracks(replace(b.bodies, seconds=b.bodies.seconds * ratio), b.level), max_lag_s)


def _clear(a: CameraTracklets, b: CameraTracklets, tracks_b: GroundTracks, max_lag_s: float) -> Registration | None:
    """Register two cameras; return None where it is not significant, since several tries also fit by chance."""
    assert a.tracks is not None
    found = register_pair(0, 1, a.tracks, tracks_b, max_lag_s)
    best = found.candidates[0] if found.candidates else None
    if best is None or best.share < CLEAR_SHARE or best.score < CLEAR_SCORE or found.runner_up > ALONE_RUNNER_UP:
        return None
    return best
