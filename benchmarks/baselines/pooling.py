"""Matches of several pairs and moments as correspondences that GeoPose takes."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from baselines.matching import Matches
from passerby.common.arrays import Floats, Ints
from passerby.core.cameras import Rig
from passerby.solver.geopose.correspondences import ImagePoints, numbered_points

SAME_PX = 0.01
"""Matches whose places in the reference's picture agree to this are of one keypoint."""


def pooled_points(rig: Rig, reference: str, moments: Sequence[Mapping[str, Matches]], sigma_px: float = 1.0) -> ImagePoints:
    """Matches of the reference with other cameras, at several moments of cameras that stand still, as points.

    The same keypoint of the reference's picture at the same moment is the same point, in whichever cameras it was matched. A
    place of a picture is used once: the surer match wins.

    Args:
        rig: names and lenses.
        reference: the camera whose pictures are the first of every pair.
        moments: for each moment, camera -> the matches of the reference's picture with that camera's.
        sigma_px: standard deviation of every place.

    Raises:
        InputError: a camera that the rig lacks.
    """
    seen: dict[str, list[tuple[Ints, Floats]]] = {reference: []}
    count = 0
    for pairs in moments:
        kept = {name: _single(matches) for name, matches in pairs.items()}
        places = [np.round(matches.xy_a / SAME_PX).astype(np.int64) for matches in kept.values()]
        keys, first, number = np.unique(
            np.concatenate([np.zeros((0, 2), dtype=np.int64), *places]), axis=0, return_index=True, return_inverse=True
        )
        xy = np.concatenate([np.zeros((0, 2)), *(matches.xy_a for matches in kept.values())])
        seen[reference].append((count + np.arange(len(keys)), xy[first]))
        ends = np.cumsum([0, *(len(matches) for matches in kept.values())])
        for (name, matches), begin, end in zip(kept.items(), ends[:-1], ends[1:], strict=True):
            seen.setdefault(name, []).append((count + number.reshape(-1)[begin:end], matches.xy_b))
        count += len(keys)
    sightings = {
        name: (np.concatenate([numbers for numbers, _ in parts]), np.concatenate([pixels for _, pixels in parts]))
        for name, parts in seen.items()
        if parts
    }
    return numbered_points(rig, sightings, sigma_px)


def _single(matches: Matches) -> Matches:
    """The surest match of every place, in either picture."""
    order = np.argsort(-matches.score, kind="stable")
    for ends in (matches.xy_a, matches.xy_b):
        cells = np.round(ends[order] / SAME_PX)
        order = order[np.sort(np.unique(cells, axis=0, return_index=True)[1])]
    return matches.take(np.sort(order))
