"""Joints of people by networks of each kind: where they lie in the picture, and which are implausible."""

import json
from collections.abc import Iterator
from pathlib import Path

import cv2
import numpy as np
import pytest
from onnx import TensorProto

from passerby.common.errors import InputError
from passerby.core.observations import BODY_17
from passerby.perception.crop_network import enlarge_box, sample_crop
from passerby.perception.keypoints import MovenetKeypoints, open_keypoints, plausible_joints
from support.networks.crop_networks import brightest, fixed, network, stripe_means
from support.paths import MODELS

PICTURE = np.zeros((480, 640, 3), dtype=np.uint8)
BOX = np.array([[200.0, 100.0, 90.0, 240.0]])
MOVENET = {"colour": "rgb", "padding": 0.0}


def spot(x: float, y: float, sigma: float, channel: int = 0) -> np.ndarray:
    """A black picture with a round spot of light at (x, y) in one channel of BGR."""
    columns, rows = np.meshgrid(np.arange(640), np.arange(480))
    picture = PICTURE.copy()
    picture[..., channel] = np.round(255 * np.exp(-0.5 * ((columns - x) ** 2 + (rows - y) ** 2) / sigma**2))
    return picture


class Unchecked(MovenetKeypoints):
    """All joints at one place are no person; here only where they come to lie matters."""

    def where(self, picture, box):
        area = self._area(box, 1.0)
        answers = self._crops([sample_crop(picture, area, self._crops.size, 0.0)])
        return area[:2] + self.decoded(answers)[0][0, 0] * area[2:]


@pytest.mark.parametrize("kind", [TensorProto.INT32, TensorProto.FLOAT])
@pytest.mark.parametrize(
    "box",
    [
        (200.0, 100.0, 90.0, 240.0),  # shrunk, by no whole number
        (231.3, 180.7, 30.6, 63.1),  # enlarged
        (140.0, 20.0, 301.0, 460.0),  # several samples averaged
        (150.5, 40.25, 190.0, 200.0),  # wider than it would need
    ],
)
def test_a_spot_of_light_is_found_where_it_is(tmp_path, box, kind):
    truth = np.array([243.37, 207.81])
    estimator = Unchecked(network(brightest(tmp_path / "m.onnx", 192, kind), "keypoints", "movenet", **MOVENET))
    found = estimator.where(spot(*truth, sigma=5.0), np.array(box))
    # OpenCV samples pictures at multiples of 1/32 px.
    np.testing.assert_allclose(found, truth, atol=0.02)


@pytest.mark.parametrize(("colour", "channel"), [("rgb", 0), ("bgr", 2)])
def test_colours_are_in_the_networks_order_and_black_around_the_picture_moves_nothing(tmp_path, colour, channel):
    model = network(brightest(tmp_path / "m.onnx", 192), "keypoints", "movenet", colour=colour, padding=0.0)
    for truth, sigma, box in (((243.0, 207.0), 5.0, BOX[0]), ((31.2, 447.6), 4.0, np.array([-60.0, 330.0, 140.0, 200.0]))):
        np.testing.assert_allclose(Unchecked(model).where(spot(*truth, sigma, channel), box), truth, atol=0.01)


def person() -> np.ndarray:
    """17 joints of somebody who stands, (17, 2) as shares of the box: nose and eyes to ankles, left before right."""
    x = [0, 3, -3, 7, -7, 20, -20, 30, -30, 35, -35, 12, -12, 12, -12, 12, -12]
    y = [7, 5, 5, 6, 6, 18, 18, 33, 33, 48, 48, 50, 50, 73, 73, 94, 94]
    return np.column_stack([0.5 + np.array(x) / 100, np.array(y) / 100])


def movenet_answer(fractions: np.ndarray, score: np.ndarray | float = 0.9) -> np.ndarray:
    return np.concatenate([fractions[:, ::-1], np.broadcast_to(score, 17)[:, None]], axis=1)[None, None]


def in_crop(xy: np.ndarray, box: np.ndarray, margin: float, aspect: float) -> np.ndarray:
    area = enlarge_box(box, margin, aspect)
    return (xy - area[:2]) / area[2:]


@pytest.mark.parametrize("fit", ["letterbox", "stretch"])
def test_movenets_joints_in_the_picture(tmp_path, fit):
    truth = BOX[0, :2] + person() * BOX[0, 2:]
    aspect = 1.0 if fit == "letterbox" else 90 / 240
    answer = movenet_answer(in_crop(truth, BOX[0], MovenetKeypoints.margin, aspect))
    model = fixed(tmp_path / "m.onnx", {"joints": answer}, [1, 64, 64, 3])
    estimator = open_keypoints(network(model, "keypoints", "movenet", fit=fit, **MOVENET))
    assert estimator.joints == BODY_17
    xy, score = estimator(PICTURE, BOX)
    np.testing.assert_allclose(xy[0], truth, atol=0.01)
    np.testing.assert_allclose(score, 0.9, atol=1e-6)


def simcc_answers(places: np.ndarray, size=(192, 256), joints: int = 17) -> dict[str, np.ndarray]:
    """Bells of height 0.8 about the crop's pixels (17, 2), in bins of half a pixel; joints beyond the 17 are elsewhere."""
    answers = {}
    for axis, name in enumerate(("x", "y")):
        bins = np.arange(2 * size[axis]) / 2
        rows = np.full((1, joints, len(bins)), 0.01)
        rows[0, :17] = 0.8 * np.exp(-0.5 * ((bins - places[:, axis : axis + 1]) / 3.0) ** 2)
        answers[name] = rows
    return answers


@pytest.mark.parametrize("joints", [17, 26, 133])
@pytest.mark.parametrize("batch", [1, "n"])
def test_simccs_joints_in_the_picture(tmp_path, joints, batch):
    area = enlarge_box(BOX[0], 1.25, 192 / 256)
    np.testing.assert_allclose(area, [132.5, 70.0, 225.0, 300.0])
    # On bins, that is on whole and half pixels of the crop counted from the middle of its first.
    places = np.round(2 * (in_crop(BOX[0, :2] + person() * BOX[0, 2:], BOX[0], 1.25, 0.75) * (192, 256) - 0.5)) / 2
    model = fixed(tmp_path / "m.onnx", simcc_answers(places, joints=joints), [batch, 3, 256, 192])
    estimator = open_keypoints(network(model, "keypoints", "simcc", colour="rgb", fit="letterbox"))
    xy, score = estimator(PICTURE, np.repeat(BOX, 3, axis=0))
    assert xy.shape == (3, 17, 2)
    np.testing.assert_allclose(xy, np.broadcast_to(area[:2] + (places + 0.5) * area[2:] / (192, 256), (3, 17, 2)), atol=0.01)
    np.testing.assert_allclose(score, 0.8, atol=1e-6)


def test_heatmaps_joints_in_the_picture(tmp_path):
    truth = BOX[0, :2] + person() * BOX[0, 2:]
    cells = in_crop(truth, BOX[0], 1.25, 0.75) * (48, 64) - 0.5
    columns, rows = np.meshgrid(np.arange(48), np.arange(64))
    maps = np.stack([0.7 * np.exp(-0.5 * ((columns - x) ** 2 + (rows - y) ** 2) / 4.0) for x, y in cells])[None]
    model = fixed(tmp_path / "m.onnx", {"maps": maps}, ["n", 3, 256, 192])
    estimator = open_keypoints(network(model, "keypoints", "heatmaps", fit="letterbox"))
    xy, score = estimator(PICTURE, BOX)
    np.testing.assert_allclose(xy[0], truth, atol=0.01)
    assert (score > 0.6).all()


@pytest.mark.parametrize("output", ["simcc", "heatmaps"])
def test_logits_beyond_one_and_nan_are_scores_within_zero_and_one(tmp_path, output):
    places = np.round(in_crop(standing(), BOX[0], 1.25, 0.75) * (192, 256))
    if output == "simcc":
        answers = {name: 3.0 * rows for name, rows in simcc_answers(places).items()}
        answers["x"][0, 5] = np.nan
    else:
        maps = np.full((1, 17, 64, 48), 0.01)
        for joint, (x, y) in enumerate(places.astype(int) // 4):
            maps[0, joint, y, x] = 3.0
        maps[0, 5] = np.nan
        answers = {"maps": maps}
    estimator = open_keypoints(network(fixed(tmp_path / "m.onnx", answers, [1, 3, 256, 192]), "keypoints", output))
    xy, score = estimator(PICTURE, BOX)
    assert np.isfinite(xy).all()
    assert score[0, 5] == 0.0
    assert (np.delete(score[0], 5) == 1.0).all()


def test_no_boxes_and_boxes_that_show_nothing(tmp_path):
    model = fixed(tmp_path / "m.onnx", {"joints": movenet_answer(person())}, [1, 64, 64, 3])
    estimator = open_keypoints(network(model, "keypoints", "movenet", **MOVENET))
    assert estimator.identity["keypoints"] == "movenet"
    other = open_keypoints(network(model, "keypoints", "movenet", colour="bgr", padding=0.0))
    assert estimator.identity != other.identity, "results of other conventions are others"
    xy, score = estimator(PICTURE, np.zeros((0, 4)))
    assert (xy.shape, score.shape) == ((0, 17, 2), (0, 17))
    _, score = estimator(PICTURE, np.array([[10, 10, 5, 40], [-100, 10, 120, 160], BOX[0]]))
    assert not score[:2].any()
    assert score[2].any()


def checked(xy: np.ndarray, score: np.ndarray | float = 0.9, box: np.ndarray = BOX) -> np.ndarray:
    return plausible_joints(xy[None], np.broadcast_to(score, (1, 17)), box, (640, 480))[0]


def standing(box: np.ndarray = BOX) -> np.ndarray:
    return np.asarray(box[0, :2] + person() * box[0, 2:])


def test_joints_of_a_neighbour_and_outside_of_the_picture_are_dropped_and_a_foot_cut_off_is_kept():
    xy = standing()
    xy[15] = BOX[0, :2] + (0.5, 1.05) * BOX[0, 2:]
    xy[9] = BOX[0, :2] + (1.5, 0.5) * BOX[0, 2:]
    score = checked(xy)
    assert score[9] == 0.0
    assert (np.delete(score, 9) == 0.9).all()
    box = np.array([[-30.0, 300.0, 90.0, 240.0]])
    xy = standing(box)
    inside = (xy[:, 0] >= -0.5) & (xy[:, 1] <= 479.5)
    assert 4 < inside.sum() < 17
    np.testing.assert_array_equal(checked(xy, box=box) > 0, inside)


def test_unsure_joints_are_dropped_and_a_few_or_such_that_fill_little_of_the_box_are_no_person():
    sure = np.where(np.arange(17) % 3 == 0, 0.02, 0.7)
    np.testing.assert_array_equal(checked(standing(), sure), np.where(sure == 0.7, sure, 0.0))
    assert not checked(BOX[0, :2] + (0.3 + 0.25 * person()) * BOX[0, 2:]).any()
    assert checked(BOX[0, :2] + (0.3 + 0.4 * person()) * BOX[0, 2:]).all()
    few = np.where(np.isin(np.arange(17), (0, 13, 16)), 0.9, 0.0)
    assert not checked(standing(), few).any()
    few[[5, 6, 15]] = 0.9
    np.testing.assert_array_equal(checked(standing(), few), few)


@pytest.mark.parametrize(
    ("output", "said"),
    [
        *((kind, rf"gives mean \[1, 3, 4, 1\]: {kind} needs (one|two) output") for kind in ("movenet", "simcc", "heatmaps")),
        ("embedding", "its output is embedding: keypoints need one of movenet, simcc, heatmaps"),
    ],
)
def test_a_network_of_another_kind_is_refused(tmp_path, output, said):
    with pytest.raises(InputError, match=rf"m\.onnx: {said}"):
        open_keypoints(network(stripe_means(tmp_path / "m.onnx"), "keypoints", output))


# Measured: 0.015 and 0.014. The reference lies on a grid of 5 px, 0.006 of the person's height.
@pytest.mark.parametrize(("size", "bound"), [("lightning", 0.025), ("thunder", 0.02)])
def test_movenet_on_a_real_person(data_root, size, bound):
    path, folder = MODELS / f"movenet-{size}.onnx", data_root / "pose2sim_single"
    for needed in (path, folder):
        if not needed.exists():
            pytest.skip(f"{needed} does not exist; set PASSERBY_MODELS and PASSERBY_DATA")
    estimator = open_keypoints(network(path, "keypoints", "movenet", **MOVENET))
    distances = []
    for camera in ("cam03", "cam04"):  # The pictures of the other two are scaled to a width of 1080.
        for picture, truth in some_of(folder, camera):
            sure = truth[:, 2] > 0.4
            low, high = truth[sure, :2].min(axis=0), truth[sure, :2].max(axis=0)
            box = np.concatenate([low - 0.05 * (high - low), 1.1 * (high - low)])
            xy, score = estimator(picture, box[None])
            body = (np.arange(17) >= 5) & sure
            assert (score[0, body] > 0).mean() >= 0.9
            distances.extend(np.linalg.norm(xy[0] - truth[:, :2], axis=1)[body] / box[3])
    assert np.median(distances) < bound
    assert np.mean(np.array(distances) < 0.05) >= 0.9


def some_of(folder: Path, camera: str) -> Iterator[tuple[np.ndarray, np.ndarray]]:
    """Four pictures of a camera, and the reference's joints (17, 3) in them, with confidence.

    COCO's joints come first there, whatever they are called; the first row belongs to the second picture.
    """
    people = json.loads((folder / "keypoints" / f"{camera}.json").read_text())["annotations"]
    reader = cv2.VideoCapture(str(folder / "videos" / f"{camera}.mp4"))
    for number in range(42):
        _, picture = reader.read()
        if number % 20 == 1:
            yield picture, np.array(people[number - 1]["keypoints"]).reshape(-1, 3)[:17]
    reader.release()
