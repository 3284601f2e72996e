"""How rightly a calibration from videos tells who is who, against the true boxes."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from itertools import combinations
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from metrics.detections import paired
from metrics.identities import IdentityAgreement, identity_agreement
from passerby.association.appearance.affinity import AppearanceAffinity
from passerby.association.appearance.embeddings import match_boxes
from passerby.association.camera_tracklets import build_tracklets
from passerby.common.progress import silent
from passerby.core.observations import UNKNOWN, Boxes
from passerby.interchange.motchallenge import read_boxes
from passerby.scene.inputs import read_inputs
from passerby.scene.scene import Scene
from passerby.scene.video_inputs import SceneVideoProcessor
from perception_runs import used_boxes

OVERLAP = 0.5
"""Intersection over union from which on a found box shows the person of a true one."""


@dataclass(frozen=True)
class LooksScore:
    """What the Hungarian algorithm makes of the looks alone, instant by instant, before anything is verified."""

    matched: int
    """Pairs of boxes, both on somebody known."""
    right: int
    useful_pairs: int
    """Pairs of cameras in which the association finds that looks tell more than chance."""
    pairs: int

    @property
    def precision(self) -> float | None:
        """Share of the matched pairs that show one person."""
        return self.right / self.matched if self.matched else None


def true_boxes(folder: Path) -> dict[str, Boxes]:
    """Camera -> the true boxes of a recording."""
    return {path.stem: read_boxes(path) for path in sorted((folder / "truth").glob("*.txt"))}


def identities(out: Path, truth: Mapping[str, Boxes]) -> IdentityAgreement:
    """The identities that a calibration has written, each carried over to the true box that its box overlaps best."""
    carried = {}
    for name, boxes in used_boxes(out, tuple(truth)).items():
        true, found, rows, columns = _on_truth(truth[name], boxes)
        identity = np.full(len(true), UNKNOWN)
        identity[rows] = found.identity[columns]
        carried[name] = Boxes(true.frame, identity, true.ltwh, true.score)
    return identity_agreement(carried, truth)


def appearance(scene: Path, out: Path, truth: Mapping[str, Boxes], seed: int = 0) -> LooksScore | None:
    """What the looks alone say of the boxes that a calibration has kept in `out`; None where there are no embeddings.

    As the association does in all modes: tracklets, the mean of eight boxes each, less the camera's mean; the same steps twice
    a second.
    """
    inputs = read_inputs(Scene.load(scene), SceneVideoProcessor(out, None, silent))
    rng = np.random.default_rng(seed)
    seen = inputs.observations
    cameras = build_tracklets(inputs.rig, seen, seen.clocks, Scene.load(scene).scale.person_height_m, rng)
    found = AppearanceAffinity.of(cameras, rng)
    if found is None:
        return None
    matched = right = 0
    for a, b in combinations(range(len(cameras)), 2):
        first, second = found.cameras[a], found.cameras[b]
        if first is None or second is None:
            continue
        one, two = (_people(truth[cameras[c].name], looked.boxes) for c, looked in ((a, first), (b, second)))
        pairs = match_boxes(first, second)
        who, whom = one[pairs.row_a], two[pairs.row_b]
        known = (who != UNKNOWN) & (whom != UNKNOWN)
        matched, right = matched + int(known.sum()), right + int((known & (who == whom)).sum())
    useful = sum(pair.usefulness is not None and pair.usefulness.weight > 0 for pair in found.pairs.values())
    return LooksScore(matched, right, useful, len(found.pairs))


def _people(truth: Boxes, boxes: Boxes) -> NDArray[np.int64]:
    """(N,) the true identity of each found box; -1 where it shows nobody for sure."""
    order = np.argsort(boxes.frame, kind="stable")
    true, _, rows, columns = _on_truth(truth, boxes.take(order))
    people = np.full(len(boxes), UNKNOWN)
    people[order[columns]] = true.identity[rows]
    return people


def _on_truth(truth: Boxes, found: Boxes) -> tuple[Boxes, Boxes, NDArray[np.int64], NDArray[np.int64]]:
    """Both sorted by frame, and which rows of them stand for each other."""
    true, found = (boxes.take(np.argsort(boxes.frame, kind="stable")) for boxes in (truth, found))
    return true, found, *paired(true, found, OVERLAP)
