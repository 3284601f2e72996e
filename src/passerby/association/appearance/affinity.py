"""The appearance of all cameras' tracklets, and its evidence on identities for every pair of cameras."""

from __future__ import annotations

from collections.abc import Container, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from passerby.association.appearance.discriminability import (
    Discriminability,
    appearance_log_likelihood_ratios,
    between_camera_discriminability,
    similarities_of_different_people,
    within_camera_discriminability,
)
from passerby.association.appearance.embeddings import (
    CameraAppearance,
    TrackletFeatures,
    Votes,
    count_votes,
    match_boxes,
    tracklet_features,
)
from passerby.association.camera_tracklets import CameraTracklets
from passerby.association.sampling import STEP_S
from passerby.common.arrays import Floats


@dataclass(frozen=True, eq=False)
class CameraAffinity(CameraAppearance):
    """One camera's tracklets, thinned to one box a tracklet and grid time by the camera's own clock."""

    different: Floats
    """Similarities of tracklets that are known to be different people."""
    usefulness: Discriminability | None
    n_tracklets: int


@dataclass(frozen=True, eq=False)
class PairAffinity:
    """Evidence of appearance on the people of two cameras."""

    affinity: Floats
    """(T_a, T_b) log-likelihood ratio of one person against two, by tracklet numbers."""
    usefulness: Discriminability | None
    votes: Votes


@dataclass(frozen=True, eq=False)
class AppearanceAffinity:
    """The appearance in all cameras; None for a camera without embeddings."""

    cameras: tuple[CameraAffinity | None, ...]
    pairs: dict[tuple[int, int], PairAffinity] = field(default_factory=dict)

    @classmethod
    def of(
        cls, cameras: Sequence[CameraTracklets], rng: np.random.Generator, candidates: Container[tuple[int, int]] | None = None
    ) -> AppearanceAffinity | None:
        """Compare the appearance of the cameras' tracklets; return None where fewer than two cameras have embeddings.

        Only pairs of cameras a < b among the `candidates` are compared; all pairs where that is None.
        """
        found = tuple(_camera_looks(camera, rng) for camera in cameras)
        if sum(appearance is not None for appearance in found) < 2:
            return None
        appearance = cls(found)
        for a in range(len(found)):
            for b in range(a + 1, len(found)):
                if candidates is not None and (a, b) not in candidates:
                    continue
                pair = _pair_looks(found[a], found[b], rng)
                if pair is not None:
                    appearance.pairs[a, b] = pair
        return appearance

    def affinity(self) -> dict[tuple[int, int], Floats]:
        """Return the log-likelihood ratios of the pairs in which not all of them are 0."""
        return {key: pair.affinity for key, pair in self.pairs.items() if pair.affinity.any()}

    def features_of(self, a: int, b: int) -> tuple[TrackletFeatures, TrackletFeatures]:
        """Return the features of a pair of cameras that both have embeddings."""
        first, second = self.cameras[a], self.cameras[b]
        assert first is not None
        assert second is not None
        return first.features, second.features


def _camera_looks(camera: CameraTracklets, rng: np.random.Generator) -> CameraAffinity | None:
    boxes = camera.seen.boxes
    if boxes.embedding is None or not len(boxes):
        return None
    features = tracklet_features(boxes, rng)
    useful = within_camera_discriminability(boxes, rng)
    seconds = camera.clock.seconds(boxes.frame)
    step = np.round(seconds / STEP_S)
    # The nearest box of each tracklet to each grid time.
    order = np.lexsort((np.abs(seconds - step * STEP_S), step, boxes.identity))
    key = np.column_stack([boxes.identity[order], step[order]])
    first = np.ones(len(order), dtype=bool)
    first[1:] = (np.diff(key, axis=0) != 0).any(axis=1)
    rows = np.sort(order[first & (key[:, 0] >= 0)])
    thinned = replace(boxes.take(rows), embedding=None)
    return CameraAffinity(
        thinned,
        step[rows].astype(np.int64),
        features,
        similarities_of_different_people(thinned, features),
        useful,
        camera.n_tracklets,
    )


def _pair_looks(a: CameraAffinity | None, b: CameraAffinity | None, rng: np.random.Generator) -> PairAffinity | None:
    if a is None or b is None:
        return None
    useful = between_camera_discriminability(a, b, rng)
    counted = count_votes(a, b, match_boxes(a, b))
    ratio = appearance_log_likelihood_ratios(
        a.features, b.features, np.concatenate([a.different, b.different]), useful.weight if useful else 0.0, counted.together
    )
    affinity = np.zeros((a.n_tracklets, b.n_tracklets))
    affinity[np.ix_(a.features.tracklet, b.features.tracklet)] = ratio
    return PairAffinity(affinity, useful, counted)
