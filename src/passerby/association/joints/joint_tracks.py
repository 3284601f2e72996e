"""Joints of a camera's tracklets at common times: rays, on a time grid that all cameras share."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from passerby.common.arrays import Bools, Floats, Ints
from passerby.core.cameras import Lens
from passerby.core.observations import MIN_JOINT_SCORE, UNKNOWN, Clock, Keypoints
from passerby.core.synchronisation import MAX_GAP_S
from passerby.geometry.groups import expanded_ranges

GRID_S = 0.05
"""Step of the grid, seconds. A recording of a second or two has some dozens of samples; more of one movement are redundant."""
MIN_TRACKED_JOINTS = 6
"""Least number of joints of a person at one time. Fewer joints contain little of the pose, and are more often all wrong."""


@dataclass(frozen=True, eq=False)
class JointTracks:
    """The joints of the tracklets of one camera: N samples of J joints, sorted by tracklet and time."""

    tracklet: Ints
    """(N,)"""
    step: Ints
    """(N,) grid times: the camera's time is `step * GRID_S`."""
    rays: Floats
    """(N, J, 3) unit rays, camera frame."""
    found: Bools
    """(N, J) which joints were found."""
    size: Floats
    """(N,) angle from the highest to the lowest joint found, radians."""
    names: tuple[str, ...]
    """The J joints."""

    def __len__(self) -> int:
        return len(self.step)

    def rows(self, tracklet: int) -> slice:
        """Return the samples of a tracklet."""
        return slice(*np.searchsorted(self.tracklet, [tracklet, tracklet + 1]).tolist())


def joint_tracks(keypoints: Keypoints, lens: Lens, clock: Clock) -> JointTracks:
    """Interpolate the joints of all tracklets on the grid.

    A joint is interpolated where it was found in both neighbouring samples.

    Args:
        keypoints: identities are tracklet numbers of this camera, or -1 for people who are left out.
        lens: the camera's lens.
        clock: from frames to seconds.
    """
    found = keypoints.score > MIN_JOINT_SCORE
    known = np.flatnonzero((keypoints.identity > UNKNOWN) & (found.sum(axis=1) >= MIN_TRACKED_JOINTS))
    seconds = clock.seconds(keypoints.frame[known])
    order = np.lexsort((seconds, keypoints.identity[known]))
    known, at = known[order], seconds[order] / GRID_S
    before, share, step = _on_grid(keypoints.identity[known], at)
    after = np.where(share > 0, before + 1, before)
    weight = share[:, None, None]
    xy = (1.0 - weight) * keypoints.xy[known[before]] + weight * keypoints.xy[known[after]]
    seen = found[known[before]] & found[known[after]]
    n_joints = len(keypoints.joints)
    rays = lens.bearings(xy.reshape(-1, 2)).reshape(-1, n_joints, 3)
    seen &= np.isfinite(rays).all(axis=2)
    y = xy[..., 1]
    low = np.where(seen, y, -np.inf).max(axis=1, initial=-np.inf)
    high = np.where(seen, y, np.inf).min(axis=1, initial=np.inf)
    whole = np.flatnonzero((seen.sum(axis=1) >= MIN_TRACKED_JOINTS) & (low > high))
    size = (low[whole] - high[whole]) / lens.focal
    tracklet = keypoints.identity[known[before]]
    return JointTracks(tracklet[whole], step[whole], rays[whole], seen[whole], size, keypoints.joints)


def _on_grid(tracklet: Ints, at: Floats) -> tuple[Ints, Floats, Ints]:
    """Find the rows and weights for each grid time: `(1 - share) * before + share * (before + 1)`.

    Args:
        tracklet: (M,) sorted.
        at: (M,) times in grid steps, sorted within each tracklet.

    Returns:
        (N,) rows before, (N,) shares, (N,) grid times.
    """
    near = np.round(at)
    at = np.where(np.abs(at - near) < 1e-6, near, at)
    joined = np.append(np.diff(tracklet) == 0, False) if len(at) else np.zeros(0, np.bool_)
    ahead = np.append(np.diff(at), 0.0) if len(at) else at
    joined &= (ahead > 0) & (ahead <= MAX_GAP_S / GRID_S + 1e-6)
    first = np.ceil(at).astype(np.int64)
    # Each row serves the grid times from its own to before the next row's, or only its own.
    last = np.where(joined, np.ceil(at + ahead).astype(np.int64) - 1, np.floor(at).astype(np.int64))
    count = np.maximum(last - first + 1, 0)
    before, step = expanded_ranges(first, count)
    share = np.divide(step - at[before], ahead[before], out=np.zeros(len(before)), where=joined[before])
    # The ranges of rows do not overlap: each grid time occurs once, even where a camera is faster than the grid.
    return before, share, step


def mirrored_order(names: tuple[str, ...]) -> Ints:
    """Return the index (J,) of the joint to take for each joint when left and right are exchanged."""
    place = {name: index for index, name in enumerate(names)}
    swap = {"left": "right", "right": "left"}
    out = []
    for index, name in enumerate(names):
        side, _, rest = name.partition("_")
        out.append(place.get(f"{swap[side]}_{rest}", index) if side in swap else index)
    return np.array(out, dtype=np.int64)


def swap_left_and_right(keypoints: Keypoints, exchanged: Bools) -> Keypoints:
    """Exchange left and right joints in the tracklets where `exchanged` (T,) is true."""
    rows = keypoints.identity > UNKNOWN
    rows[rows] = exchanged[keypoints.identity[rows]]
    if not rows.any():
        return keypoints
    order = mirrored_order(keypoints.joints)
    xy, score = keypoints.xy.copy(), keypoints.score.copy()
    xy[rows], score[rows] = xy[rows][:, order], score[rows][:, order]
    return replace(keypoints, xy=xy, score=score)
