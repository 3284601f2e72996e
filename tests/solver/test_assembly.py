"""From pair hypotheses to a levelled rig."""

import itertools
from collections.abc import Iterable

import numpy as np
import pytest

from passerby.core.cameras import Pose
from passerby.geometry.rotations import angle_between, direction_angle, exp_rotation
from passerby.geometry.single_view import Level
from passerby.geometry.two_view import PairHypothesis
from passerby.solver.pose_graph import (
    connected_components,
    cycle_consistency,
    gravity_aligned,
    heading_rotation,
    poses_of_tree,
    spanning_trees,
)
from support.scenes.people_and_rigs import ring

POSES = [camera.pose for camera in ring(5) if camera.pose is not None]


def edge(
    a: int, b: int, *, inliers: int = 50, route: str = "ground", turn: tuple[float, float, float] = (0, 0, 0)
) -> PairHypothesis:
    """The true motion from camera a to b, turned by a rotation vector (radians) where it is to be wrong."""
    R = POSES[b].R_cw @ POSES[a].R_cw.T
    wrong = exp_rotation(np.array(turn))
    return PairHypothesis(a, b, wrong @ R, wrong @ (POSES[b].t_cw - R @ POSES[a].t_cw), route, inliers, 100)


PAIRS = list(itertools.combinations(range(5), 2))
STAR = poses_of_tree([edge(0, c) for c in range(1, 5)], 0)


def relative_error(poses: dict[int, Pose], root: int) -> float:
    """Largest angle (radians) and distance (metres) to the truth in the root's frame, the larger of the two numbers."""
    worst = 0.0
    for c, pose in poses.items():
        R = POSES[c].R_cw @ POSES[root].R_cw.T
        centre = POSES[root].R_cw @ POSES[c].centre + POSES[root].t_cw
        worst = max(worst, float(angle_between(pose.R_cw, R)), float(np.linalg.norm(pose.centre - centre)))
    return worst


def level(c: int, *, turn: tuple[float, float, float] = (0, 0, 0), height: float | None = None) -> Level:
    up = exp_rotation(np.array(turn)) @ POSES[c].R_cw @ np.array([0.0, 0, 1])
    return Level(up, float(POSES[c].centre[2]) if height is None else height, 0.01)


def test_components_are_joined_by_edges_with_enough_inliers() -> None:
    edges = [edge(0, 3), edge(3, 4, inliers=8), edge(1, 2), edge(2, 4, inliers=7)]
    assert connected_components(5, edges, 8) == [[0, 3, 4], [1, 2]]
    assert connected_components(5, edges, 7) == [[0, 1, 2, 3, 4]]
    assert connected_components(5, edges, 9) == [[0, 3], [1, 2], [4]]
    assert connected_components(3, [], 8) == [[0], [1], [2]]


def test_true_edges_agree_and_a_wrong_one_does_not() -> None:
    edges = [edge(a, b, inliers=100) for a, b in PAIRS]
    assert (cycle_consistency(edges, 5) > 0.95).all()
    edges[3] = edge(0, 4, inliers=100, turn=(0, 1.0, 0))
    support = cycle_consistency(edges, 5)
    assert support[3] < 0.01
    assert np.delete(support, 3).min() > 0.5
    assert cycle_consistency([edge(0, 1)], 2).tolist() == [0.0], "without third cameras nothing supports an edge"


def test_a_wrong_edge_with_many_inliers_loses_to_agreement() -> None:
    """The wrong guess has every inlier, the right ones half (30 % of the names swapped)."""
    edges = [edge(a, b) for a, b in PAIRS]
    wrong = edge(0, 1, inliers=100, route="epipolar", turn=(0.0, 2.5, 0.0))
    trees = dict(spanning_trees([*edges, wrong], range(5), 5))
    assert wrong not in trees["all"]
    assert relative_error(poses_of_tree(trees["all"], 0), 0) < 1e-9


@pytest.mark.parametrize("root", [0, 3])
def test_every_tree_spans_its_group_and_leads_to_the_true_poses(root: int) -> None:
    edges = [edge(a, b, route=route) for a, b in PAIRS for route in ("ground", "epipolar")]
    trees = spanning_trees(edges, range(5), 5)
    assert trees[0][0] == "all"
    keys = []
    for _, tree in trees:
        assert len(tree) == 4
        poses = poses_of_tree(tree, root)
        assert sorted(poses) == list(range(5))
        assert relative_error(poses, root) < 1e-9
        keys.append(tuple(sorted((h.a, h.b, h.route) for h in tree)))
    assert len(set(keys)) == len(keys)


def test_a_route_that_does_not_span_gives_no_tree_of_its_own() -> None:
    edges = [edge(0, 1), edge(1, 2), edge(2, 3), edge(3, 4), edge(0, 4, route="epipolar")]
    assert "epipolar" not in dict(spanning_trees(edges, range(5), 5))
    assert spanning_trees(edges[:2], range(5), 5) == []
    assert len(spanning_trees(edges[:2], [0, 1, 2], 5)[0][1]) == 2


@pytest.mark.parametrize("levelled", [range(5), (1, 4)])
def test_levelled_poses_have_z_up_and_the_ground_at_zero(levelled: Iterable[int]) -> None:
    """Cameras without a level are carried along."""
    for c, pose in gravity_aligned(STAR, [level(c) if c in levelled else None for c in range(5)]).items():
        np.testing.assert_allclose(pose.R_cw @ [0, 0, 1], POSES[c].R_cw @ [0, 0, 1], atol=1e-9)
        assert pose.centre[2] == pytest.approx(POSES[c].centre[2])
    assert gravity_aligned(STAR, [None] * 5) == STAR


def test_two_bad_levels_of_five_do_not_tilt_the_world() -> None:
    levels = [level(c, turn=(0.002 * c, 0.001, 0)) for c in range(5)]
    levels[1], levels[3] = level(1, turn=(0.5, 0, 0.4), height=9.0), level(3, turn=(-0.2, 0.6, 0), height=0.5)
    found = gravity_aligned(STAR, levels)
    up = np.array([0.0, 0.0, 1.0])
    for c, pose in found.items():
        assert np.degrees(direction_angle(pose.R_cw @ up, POSES[c].R_cw @ up)) < 1.5
        assert pose.centre[2] == pytest.approx(POSES[c].centre[2], abs=0.3)


def test_heading_turns_the_view_onto_y() -> None:
    for pose in POSES:
        turned = pose.moved(heading_rotation(pose.R_cw), np.zeros(3))
        assert turned.R_cw[2, 0] == pytest.approx(0, abs=1e-12)
        assert turned.R_cw[2, 1] > 0
        assert turned.R_cw[2, 2] == pytest.approx(pose.R_cw[2, 2])
    straight_down = np.diag([1.0, -1.0, -1.0])
    np.testing.assert_array_equal(heading_rotation(straight_down), np.eye(3))
