"""The looks of all cameras' tracklets: what they say of every pair of cameras."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from passerby.association.appearance.discriminability import (
    Usefulness,
    appearance_llr,
    camera_usefulness,
    different_similarities,
    pair_usefulness,
)
from passerby.association.appearance.embeddings import TrackletFeatures, Votes, match_boxes, tracklet_features, votes
from passerby.association.camera_tracklets import PreparedCamera
from passerby.association.sampling import STEP_S
from passerby.common.arrays import Floats, Ints
from passerby.core.observations import Boxes


@dataclass(frozen=True, eq=False)
class CameraLooks:
    """One camera's tracklets as they look, thinned to the grid of time."""

    boxes: Boxes
    """One box a tracklet and grid time."""
    instants: Ints
    """(N,) grid times of the boxes, by the camera's own clock."""
    features: TrackletFeatures
    different: Floats
    """Similarities of people who are surely two."""
    usefulness: Usefulness | None
    n_tracklets: int


@dataclass(frozen=True, eq=False)
class PairLooks:
    """What looks say of two cameras."""

    likeness: Floats
    """(T_a, T_b) log-likelihood ratio of being one person, by tracklet numbers."""
    usefulness: Usefulness | None
    votes: Votes


@dataclass(frozen=True, eq=False)
class Looks:
    """The looks of all cameras; None for a camera without embeddings."""

    cameras: tuple[CameraLooks | None, ...]
    pairs: dict[tuple[int, int], PairLooks] = field(default_factory=dict)

    @classmethod
    def of(cls, cameras: Sequence[PreparedCamera], rng: np.random.Generator) -> Looks | None:
        """The looks of the cameras' tracklets; None where fewer than two cameras have embeddings."""
        found = tuple(_camera_looks(camera, rng) for camera in cameras)
        if sum(looks is not None for looks in found) < 2:
            return None
        looks = cls(found)
        for a in range(len(found)):
            for b in range(a + 1, len(found)):
                pair = _pair_looks(found[a], found[b], rng)
                if pair is not None:
                    looks.pairs[a, b] = pair
        return looks

    def likeness(self) -> dict[tuple[int, int], Floats]:
        """The pairs whose looks tell anything."""
        return {key: pair.likeness for key, pair in self.pairs.items() if pair.likeness.any()}

    def features_of(self, a: int, b: int) -> tuple[TrackletFeatures, TrackletFeatures]:
        """The features of a pair that has looks."""
        first, second = self.cameras[a], self.cameras[b]
        assert first is not None
        assert second is not None
        return first.features, second.features


def _camera_looks(camera: PreparedCamera, rng: np.random.Generator) -> CameraLooks | None:
    boxes = camera.seen.boxes
    if boxes.embedding is None or not len(boxes):
        return None
    features = tracklet_features(boxes, rng)
    useful = camera_usefulness(boxes, rng)
    seconds = camera.clock.seconds(boxes.frame)
    step = np.round(seconds / STEP_S)
    # The nearest box of each tracklet to each grid time.
    order = np.lexsort((np.abs(seconds - step * STEP_S), step, boxes.identity))
    key = np.column_stack([boxes.identity[order], step[order]])
    first = np.ones(len(order), dtype=bool)
    first[1:] = (np.diff(key, axis=0) != 0).any(axis=1)
    rows = np.sort(order[first & (key[:, 0] >= 0)])
    thinned = replace(boxes.take(rows), embedding=None)
    return CameraLooks(
        thinned, step[rows].astype(np.int64), features, different_similarities(thinned, features), useful, camera.n_tracklets
    )


def _pair_looks(a: CameraLooks | None, b: CameraLooks | None, rng: np.random.Generator) -> PairLooks | None:
    if a is None or b is None:
        return None
    columns = a.boxes, b.boxes, a.features, b.features, a.instants, b.instants
    useful = pair_usefulness(*columns, rng)
    counted = votes(*columns, match_boxes(*columns))
    ratio = appearance_llr(
        a.features, b.features, np.concatenate([a.different, b.different]), useful.weight if useful else 0.0, counted.together
    )
    likeness = np.zeros((a.n_tracklets, b.n_tracklets))
    likeness[np.ix_(a.features.tracklet, b.features.tracklet)] = ratio
    return PairLooks(likeness, useful, counted)
