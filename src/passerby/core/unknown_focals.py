"""Search for unknown focal lengths: the candidates, and the combination that fits pairs of cameras best."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from passerby.common.arrays import Floats
from passerby.core.cameras import Lens, Rig
from passerby.core.lens import LARGEST_FOCAL_SD

SEARCHED_SD = 0.1
"""Relative standard deviation up to which a focal length needs no search."""
# Candidates farther than this many standard deviations from a stated focal length are not tried.
_FARTHEST_SD = 2.5
_SWEEPS = 30


def needs_focal_search(rig: Rig) -> bool:
    """Check whether a focal length of the rig is known too poorly to start from it."""
    return any(camera.lens.uncalibrated and (camera.lens.search_sd or 0.0) > SEARCHED_SD for camera in rig)


def shared_lenses(rig: Rig) -> list[list[int]]:
    """Return the cameras of each uncalibrated lens: those of one `Lens.group` together, all others, known lenses too, alone."""
    sets: dict[str, list[int]] = {}
    for c, camera in enumerate(rig):
        lens = camera.lens
        of_model = lens.uncalibrated and lens.group is not None
        sets.setdefault(f"group {lens.group}" if of_model else f"camera {c}", []).append(c)
    return list(sets.values())


def begin_with(stated: Rig, found: Rig) -> Rig:
    """Return the rig to begin the next estimate with: `stated`, in which unknown lenses have the focal lengths found.

    Args:
        stated: lenses before any estimate. Only their focal lengths are replaced.
        found: the rig of an estimate. A camera without a pose gets the focal length of others of its group, or the stated one.
    """
    cameras = list(stated)
    for members in shared_lenses(stated):
        changes = [
            math.log(found.cameras[c].lens.focal / stated.cameras[c].lens.focal)
            for c in members if found.cameras[c].pose is not None
        ]  # fmt: skip
        for c in members:
            lens = cameras[c].lens
            if changes and lens.uncalibrated:
                lens = lens.started(math.exp(sum(changes) / len(changes)), min(lens.search_sd or 1.0, SEARCHED_SD))
                cameras[c] = replace(cameras[c], lens=lens)
    return replace(stated, cameras=tuple(cameras))


def focals_to_try(lens: Lens, shares: Floats) -> Floats:
    """Return logarithms of the factors to try on a focal length: those near a stated one, or all; 0 alone for a known one.

    Args:
        lens: the lens.
        shares: focal lengths of the grid, as shares of the longer side of the picture.
    """
    sd = lens.search_sd
    if not lens.uncalibrated or sd is None or sd <= SEARCHED_SD:
        return np.zeros(1)
    # A fisheye has half the focal length of a pinhole of a similar field of view, or less.
    focals = np.log((0.5 if lens.fisheye else 1.0) * shares * max(lens.size) / lens.focal)
    if sd < LARGEST_FOCAL_SD:
        focals = focals[np.abs(focals) <= _FARTHEST_SD * sd]
    return np.asarray(focals) if len(focals) else np.zeros(1)


def choose_focals(
    counts: Sequence[int], costs: Mapping[tuple[int, int], Floats], shared: Sequence[Sequence[int]] | None = None
) -> list[int]:
    """Choose one focal length for each camera so that the sum of the pairs' costs is small. From each of several common starts,
    one lens after the other takes its best choice.

    Args:
        counts: (C,) number of choices of each camera.
        costs: by pair (a, b) of cameras, the cost (F_a, F_b) of each combination of choices.
        shared: sets of cameras that choose together; each camera is in one set. None: each camera on its own.
    """
    sets = [[c] for c in range(len(counts))] if shared is None else shared
    best: tuple[float, list[int]] | None = None
    most = max(counts, default=1)
    for start in range(most):
        chosen = [round(start * (count - 1) / max(most - 1, 1)) for count in counts]
        for _ in range(_SWEEPS):
            before = list(chosen)
            for members in sets:
                cost = np.zeros(counts[members[0]])
                for (a, b), table in costs.items():
                    if a in members and b in members:
                        cost += np.diagonal(table)
                    elif a in members:
                        cost += table[:, chosen[b]]
                    elif b in members:
                        cost += table[chosen[a]]
                if cost.any():
                    chosen = [int(np.argmin(cost)) if c in members else one for c, one in enumerate(chosen)]
            if chosen == before:
                break
        total = sum(float(table[chosen[a], chosen[b]]) for (a, b), table in costs.items())
        if best is None or total < best[0] - 1e-9:
            best = total, chosen
    return best[1] if best is not None else []
