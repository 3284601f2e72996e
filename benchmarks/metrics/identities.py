"""How well found identities agree with the true ones, over pairs of boxes of different cameras at the same instant.

A pair is what association says something about: these two boxes are one person. Identities are only names, so nothing has to
be matched between the found and the true ones, and a person split in two or two people merged cost what they spoil.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from itertools import combinations
from typing import Any

import numpy as np
from scipy.spatial import cKDTree

from passerby.common.arrays import Floats, Ints
from passerby.common.errors import InputError
from passerby.core.observations import UNKNOWN, Boxes, Clock

SAME_BOX_PX = 0.01
"""Boxes that passed through files with nine significant digits differ by far less, two people's boxes by far more."""


@dataclass(frozen=True)
class IdentityAgreement:
    """Found identities against true ones, counted over pairs of boxes."""

    pairs_true: int
    """Pairs of boxes of one person, the boxes' identities found or not."""
    pairs_found: int
    """Pairs of boxes with one found identity, both of whose true identities are known."""
    pairs_right: int
    """Pairs that are both."""
    boxes_true: int
    """Boxes whose true identity is known."""
    boxes_identified: int
    """Those of them that have a found identity."""
    boxes_without_truth: int
    """Boxes with a found identity of which no true one is known; they count for nothing else."""

    @property
    def precision(self) -> float | None:
        """Share of the found pairs that are right; None where none was found."""
        return self.pairs_right / self.pairs_found if self.pairs_found else None

    @property
    def recall(self) -> float | None:
        """Share of the true pairs that were found; None where there are none."""
        return self.pairs_right / self.pairs_true if self.pairs_true else None

    def to_dict(self) -> dict[str, Any]:
        """As plain values for JSON."""
        return {"precision": self.precision, "recall": self.recall, **vars(self)}


@dataclass(frozen=True, eq=False)
class _Labelled:
    """The boxes of one camera whose true identity is known; N of them."""

    frame: Ints
    true: Ints
    found: Ints


def identity_agreement(
    found: Mapping[str, Boxes],
    true: Mapping[str, Boxes],
    clocks: Mapping[str, Clock] | None = None,
    tolerance_s: float = np.inf,
) -> IdentityAgreement:
    """Compare identities, which name a person alike in all cameras, with the true ones.

    A found box is the true box of the same camera and frame whose left, top, width and height are its own within `SAME_BOX_PX`.

    Args:
        found: camera -> boxes; identity -1 where none was found.
        true: camera -> boxes with true identities; -1 where it is unknown. A camera that is missing here has none.
        clocks: the cameras' true clocks. Without, the same frame number is the same instant. With them, a frame of the slower
            camera of a pair goes with the frame of the other that is nearest in time, at most half a frame away.
        tolerance_s: with clocks, frames further apart than this are no common instant, seconds.

    Raises:
        InputError: clocks are given, but not for a camera of `true`.
    """
    without = {name: boxes for name, boxes in found.items() if name not in true}
    labelled: dict[str, _Labelled] = {}
    n_without = sum(int((boxes.identity != UNKNOWN).sum()) for boxes in without.values())
    for name, boxes in true.items():
        labelled[name], strangers = _label(found.get(name, Boxes.empty()), boxes)
        n_without += strangers
    if clocks is not None and not set(true) <= set(clocks):
        missing = sorted(set(true) - set(clocks))
        raise InputError(f"camera {missing[0]} has true identities, but no clock: give one for each camera, or none at all")
    pairs = np.zeros(3, dtype=np.int64)
    for first, second in combinations(labelled, 2):
        a, b = labelled[first], labelled[second]
        instant_a, instant_b = a.frame.astype(np.float64), b.frame.astype(np.float64)
        if clocks is not None and clocks[first].fps <= clocks[second].fps:
            instant_a = _nearest(a.frame, clocks[first], clocks[second], tolerance_s)
        elif clocks is not None:
            instant_b = _nearest(b.frame, clocks[second], clocks[first], tolerance_s)
        pairs += _count(a, instant_a, b, instant_b)
    return IdentityAgreement(
        pairs_true=int(pairs[0]),
        pairs_found=int(pairs[1]),
        pairs_right=int(pairs[2]),
        boxes_true=sum(len(boxes.frame) for boxes in labelled.values()),
        boxes_identified=sum(int((boxes.found != UNKNOWN).sum()) for boxes in labelled.values()),
        boxes_without_truth=n_without,
    )


def _label(found: Boxes, true: Boxes) -> tuple[_Labelled, int]:
    """The true boxes with the identity found for each, and how many found identities belong to no true box."""
    true = true.take(true.identity != UNKNOWN)
    found = found.take(found.identity != UNKNOWN)
    identity = np.full(len(true), UNKNOWN)
    strangers = len(found)
    if len(found) and len(true):
        # Frames are whole numbers: within the tolerance only the same one is near.
        tree = cKDTree(np.column_stack([true.frame, true.ltwh]))
        nearest = tree.query(np.column_stack([found.frame, found.ltwh]), p=np.inf)
        distance, row = np.asarray(nearest[0]), np.asarray(nearest[1])
        same = np.flatnonzero(distance <= SAME_BOX_PX)
        _, first = np.unique(row[same], return_index=True)
        same = same[first]
        identity[row[same]] = found.identity[same]
        strangers -= len(same)
    return _Labelled(true.frame, true.identity, identity), strangers


def _nearest(frame: Ints, slow: Clock, fast: Clock, tolerance_s: float) -> Floats:
    """(N,) the frame of the faster clock nearest to each of the slower one's; NaN where it is too far away in time."""
    wanted = fast.frames(slow.seconds(frame))
    # Half a frame is a tie: rounded first, so that all frames at a constant offset fall the same way and none is taken twice.
    nearest = np.floor(np.round(wanted, 6) + 0.5)
    return np.where(np.abs(nearest - wanted) / fast.fps <= tolerance_s + 1e-9, nearest, np.nan)


def _count(a: _Labelled, instant_a: Floats, b: _Labelled, instant_b: Floats) -> Ints:
    """(3,) pairs of one true, one found, and both one true and one found identity between two cameras."""
    known_a, known_b = np.isfinite(instant_a), np.isfinite(instant_b)
    identified_a, identified_b = known_a & (a.found != UNKNOWN), known_b & (b.found != UNKNOWN)
    counts = [
        _matches(np.column_stack([instant_a, a.true])[known_a], np.column_stack([instant_b, b.true])[known_b]),
        _matches(np.column_stack([instant_a, a.found])[identified_a], np.column_stack([instant_b, b.found])[identified_b]),
        _matches(
            np.column_stack([instant_a, a.true, a.found])[identified_a],
            np.column_stack([instant_b, b.true, b.found])[identified_b],
        ),
    ]
    return np.array(counts, dtype=np.int64)


def _matches(a: Floats, b: Floats) -> int:
    """How many pairs of a row of `a` and a row of `b` are equal."""
    kinds, which = np.unique(np.concatenate([a, b]), axis=0, return_inverse=True)
    which = which.ravel()
    return int(np.bincount(which[: len(a)], minlength=len(kinds)) @ np.bincount(which[len(a) :], minlength=len(kinds)))
