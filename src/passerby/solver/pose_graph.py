"""Pose graph: from hypotheses of pairs to a rig, by the consistency of cycles through third cameras, and by spanning trees.

There is no greedy choice: the trees of all routes are passed on, and the adjustment's own cost selects one.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy.spatial.transform import Rotation

from passerby.common.arrays import Floats
from passerby.core.cameras import Pose
from passerby.geometry.rotations import angle_between, rotation_between
from passerby.geometry.single_view import Level
from passerby.geometry.two_view import PairHypothesis

# Scales of the difference of two paths to the same camera: a few times the error of a good hypothesis.
_CYCLE_ANGLE = np.deg2rad(6.0)
_CYCLE_SHARE = 0.25
# Weight of a hypothesis that no third camera supports.
_ALONE = 0.02


def connected_components(n_cameras: int, hypotheses: Sequence[PairHypothesis], min_inliers: int) -> list[list[int]]:
    """Return the groups of cameras that hypotheses with enough inliers connect, the largest first (of equal groups, the one
    with the smallest camera number).
    """
    label = list(range(n_cameras))
    for h in hypotheses:
        if h.inliers >= min_inliers:
            old, new = max(label[h.a], label[h.b]), min(label[h.a], label[h.b])
            label = [new if value == old else value for value in label]
    groups = [[c for c in range(n_cameras) if label[c] == value] for value in sorted(set(label))]
    return sorted(groups, key=lambda group: (-len(group), group[0]))


def cycle_consistency(hypotheses: Sequence[PairHypothesis], n_cameras: int) -> Floats:
    """Return the agreement (K,) of each hypothesis with paths through third cameras, 0 to 1: the mean of the best agreement
    through each of these cameras.
    """
    by_pair: dict[tuple[int, int], list[PairHypothesis]] = {}
    for h in hypotheses:
        by_pair.setdefault((h.a, h.b), []).append(h)
        by_pair.setdefault((h.b, h.a), []).append(h.inverse)
    beside: list[set[int]] = [set() for _ in range(n_cameras)]
    for a, b in by_pair:
        beside[a].add(b)
    support = np.zeros(len(hypotheses))
    for index, h in enumerate(hypotheses):
        ways = [
            (c, first, second)
            for c in sorted(beside[h.a] & beside[h.b])
            for first in by_pair[h.a, c]
            for second in by_pair[c, h.b]
        ]
        if ways:
            camera = np.array([c for c, _, _ in ways])
            agreement = _agreements(h, [first for _, first, _ in ways], [second for _, _, second in ways])
            votes = np.maximum.reduceat(agreement, np.flatnonzero(np.diff(camera, prepend=-1)))
            support[index] = float(np.mean(votes))
    return support


def _agreements(h: PairHypothesis, first: Sequence[PairHypothesis], second: Sequence[PairHypothesis]) -> Floats:
    """Return the agreement (K,) of paths over two pairs, `first` then `second`, with the hypothesis, 0 to 1."""
    R1, t1 = np.array([one.R_ba for one in first]), np.array([one.t_ba for one in first])
    R2, t2 = np.array([one.R_ba for one in second]), np.array([one.t_ba for one in second])
    t = (R2 @ t1[:, :, None])[:, :, 0] + t2
    turn = angle_between(R2 @ R1, h.R_ba) / _CYCLE_ANGLE
    reach = np.linalg.norm(t1, axis=1) + np.linalg.norm(t2, axis=1) + np.linalg.norm(h.t_ba)
    shift = np.linalg.norm(t - h.t_ba, axis=1) / (_CYCLE_SHARE * 0.5 * reach)
    return np.asarray(np.exp(-0.5 * (turn**2 + shift**2)))


def spanning_trees(
    hypotheses: Sequence[PairHypothesis], group: Sequence[int], n_cameras: int
) -> list[tuple[str, list[PairHypothesis]]]:
    """Return spanning trees of a group, weighted by agreement: from all routes, and from each route alone, without
    duplicates.
    """
    support = cycle_consistency(hypotheses, n_cameras)
    inliers = np.array([h.inliers for h in hypotheses], dtype=np.float64)
    share = inliers / np.array([max(h.matches, 1) for h in hypotheses])
    by_agreement = share * np.sqrt(inliers) * (_ALONE + support)
    routes = sorted({h.route for h in hypotheses})
    weights = [("all", by_agreement)]
    weights += [(route, np.where([h.route == route for h in hypotheses], by_agreement, 0.0)) for route in routes]
    trees: list[tuple[str, list[PairHypothesis]]] = []
    seen = set()
    for name, weight in weights:
        tree = _spanning_tree(hypotheses, weight, group)
        key = tuple(sorted(tree))
        if len(tree) == len(group) - 1 and key not in seen:
            seen.add(key)
            trees.append((name, [hypotheses[i] for i in tree]))
    return trees


def _spanning_tree(hypotheses: Sequence[PairHypothesis], weight: Floats, group: Sequence[int]) -> list[int]:
    """Return the indices of the hypotheses of a maximum spanning tree (Kruskal)."""
    label = {camera: camera for camera in group}
    tree = []
    for index in np.argsort(-weight, kind="stable"):
        h = hypotheses[index]
        if weight[index] <= 0 or h.a not in label or h.b not in label or label[h.a] == label[h.b]:
            continue
        old, new = label[h.a], label[h.b]
        label = {camera: new if value == old else value for camera, value in label.items()}
        tree.append(int(index))
    return tree


def poses_of_tree(tree: Sequence[PairHypothesis], root: int) -> dict[int, Pose]:
    """Compute poses in the root camera's frame, along the tree's edges."""
    poses = {root: Pose(np.eye(3), np.zeros(3))}
    edges: dict[int, list[PairHypothesis]] = {}
    for h in tree:
        edges.setdefault(h.a, []).append(h)
        edges.setdefault(h.b, []).append(h.inverse)
    waiting = [root]
    for a in waiting:
        for edge in edges.get(a, ()):
            if edge.b not in poses:
                waiting.append(edge.b)
                at = poses[edge.a]
                poses[edge.b] = Pose(edge.R_ba @ at.R_cw, edge.R_ba @ at.t_cw + edge.t_ba)
    return poses


def gravity_aligned(poses: dict[int, Pose], levels: Sequence[Level | None]) -> dict[int, Pose]:
    """Return the poses in a world with z up and the ground at z = 0, by the medians of the cameras' own levels."""
    ups = {c: poses[c].R_cw.T @ level.up for c, level in enumerate(levels) if level is not None and c in poses}
    if not ups:
        return poses
    turn = rotation_between(_median_direction(np.array(list(ups.values()))), np.array([0.0, 0.0, 1.0]))
    turned = {c: pose.moved(turn, np.zeros(3)) for c, pose in poses.items()}
    drop = float(
        np.median([turned[c].centre[2] - level.height for c, level in enumerate(levels) if level is not None and c in ups])
    )
    return {c: pose.moved(np.eye(3), np.array([0.0, 0.0, -drop])) for c, pose in turned.items()}


def _median_direction(directions: Floats) -> Floats:
    """Return the direction (3,) with the smallest sum of angles to the others (Weiszfeld's algorithm on the sphere)."""
    mean = directions.sum(axis=0)
    mean /= np.linalg.norm(mean)
    for _ in range(20):
        angle = np.arccos(np.clip(directions @ mean, -1, 1))
        mean = (directions / np.maximum(angle, 1e-3)[:, None]).sum(axis=0)
        mean /= np.linalg.norm(mean)
    return np.asarray(mean)


def heading_rotation(R_cw: Floats) -> Floats:
    """Return the rotation (3, 3) about z that turns a camera's horizontal viewing direction to +y."""
    forward = R_cw[2]
    angle = float(np.arctan2(forward[0], forward[1])) if np.hypot(forward[0], forward[1]) > 1e-6 else 0.0
    return np.asarray(Rotation.from_euler("z", angle).as_matrix())
