from pathlib import Path

import cv2
import numpy as np
import pytest
from onnx import TensorProto, helper

from passerby.common.errors import InputError
from passerby.perception.reid import ReidEmbedder, StripesEmbedder
from support.networks.crop_networks import fixed, network, port, saved, stripe_means
from support.paths import MODELS

COLOURS = np.array([[10, 200, 30], [250, 40, 90], [60, 60, 220], [120, 180, 0]], dtype=np.uint8)  # BGR, head to foot
IMAGENET = {"scale": 1 / 255, "mean": (0.485, 0.456, 0.406), "std": (0.229, 0.224, 0.225)}


def striped(left: int, top: int, width: int, height: int) -> np.ndarray:
    """A noisy picture with one person of four plain stripes."""
    picture = np.random.default_rng(3).integers(0, 256, (240, 320, 3), dtype=np.uint8)
    for k, colour in enumerate(COLOURS):
        picture[top + k * height // 4 : top + (k + 1) * height // 4, left : left + width] = colour
    return picture


def unit(colours: np.ndarray) -> np.ndarray:
    vector = colours.T.reshape(-1)
    return vector / np.linalg.norm(vector)


def embedder_of(model: Path, batch: int = 16, **convention: object) -> ReidEmbedder:
    return ReidEmbedder(network(model, "embedder", "embedding", **convention), batch=batch)


@pytest.mark.parametrize("channels_first", [True, False])
@pytest.mark.parametrize("kind", [TensorProto.FLOAT, TensorProto.UINT8])
@pytest.mark.parametrize("size", [(16, 32), (64, 128)])
@pytest.mark.parametrize(("colour", "order"), [("bgr", [0, 1, 2]), ("rgb", [2, 1, 0])])
def test_colours_of_the_stripes_in_the_networks_order(tmp_path, channels_first, kind, size, colour, order):
    embedder = embedder_of(stripe_means(tmp_path / "m.onnx", channels_first=channels_first, kind=kind), colour=colour)
    got = embedder(striped(100, 50, *size), np.array([[100.0, 50.0, *size]]))
    assert (got.dtype, got.shape, embedder.dimensions) == (np.float32, (1, 12), 12)
    np.testing.assert_allclose(got[0], unit(COLOURS[:, order].astype(float)), atol=1e-6)


def test_scale_mean_and_deviation_in_the_networks_order(tmp_path):
    embedder = embedder_of(stripe_means(tmp_path / "m.onnx"), colour="rgb", **IMAGENET)
    got = embedder(striped(100, 50, 32, 64), np.array([[100.0, 50.0, 32.0, 64.0]]))
    wanted = (COLOURS[:, ::-1] / 255 - IMAGENET["mean"]) / IMAGENET["std"]
    np.testing.assert_allclose(got[0], unit(wanted), atol=1e-6)


@pytest.mark.parametrize("batch", [1, 4, "n"])
def test_any_number_of_boxes_in_any_batch(tmp_path, batch):
    rng = np.random.default_rng(5)
    picture = cv2.GaussianBlur(rng.integers(0, 256, (240, 320, 3), dtype=np.uint8), (0, 0), 5)
    boxes = np.hstack([rng.uniform(0, 100, (11, 2)), rng.uniform((20, 40), (80, 130), (11, 2))])
    embedder = embedder_of(stripe_means(tmp_path / "m.onnx", batch=batch), batch=3)
    together = embedder(picture, boxes)
    np.testing.assert_allclose(together, np.vstack([embedder(picture, box[None]) for box in boxes]), atol=1e-6)
    np.testing.assert_allclose(np.linalg.norm(together, axis=1), 1.0, atol=1e-6)


def test_a_part_outside_of_the_picture_is_not_shown(tmp_path):
    got = embedder_of(stripe_means(tmp_path / "m.onnx"))(striped(0, 50, 40, 128), np.array([[-24.0, 50.0, 64.0, 128.0]]))
    np.testing.assert_allclose(got[0], unit(COLOURS.astype(float)), atol=1e-6)


@pytest.mark.parametrize("kind", ["network", "stripes"])
def test_boxes_that_show_nothing_are_rows_of_zeros(tmp_path, kind):
    embedder = StripesEmbedder() if kind == "stripes" else embedder_of(stripe_means(tmp_path / "m.onnx"))
    boxes = np.array([[10, 10, 5, 40], [10, 10, 40, 12], [-70, 10, 80, 160], [500, 10, 80, 160], [10, 10, 40, 80.0]])
    picture = striped(10, 10, 40, 80)
    got = embedder(picture, boxes)
    assert (got.dtype, got.shape) == (np.float32, (5, embedder.dimensions))
    assert not got[:4].any()
    np.testing.assert_allclose(np.linalg.norm(got[4]), 1.0, atol=1e-6)
    assert embedder(picture, np.zeros((0, 4))).shape == (0, embedder.dimensions)
    with pytest.raises(InputError, match=r"\(2, 3\)"):
        embedder(picture, np.ones((2, 3)))


def test_an_answer_that_is_not_a_number_is_a_row_of_zeros(tmp_path):
    model = fixed(tmp_path / "m.onnx", {"v": np.array([[1.0, np.nan, 2.0]])}, ["n", 3, 32, 16])
    assert not embedder_of(model)(striped(10, 10, 40, 80), np.array([[10, 10, 40, 80.0]])).any()


def test_an_open_size_is_the_usual_one(tmp_path):
    nodes = [helper.make_node("GlobalAveragePool", ["crop"], ["mean"])]
    ports = [port("crop", ["n", 3, "h", "w"])], [port("mean", ["n", 3, 1, 1])]
    embedder = embedder_of(saved(tmp_path / "m.onnx", nodes, *ports))
    assert (embedder.dimensions, embedder(striped(10, 10, 40, 80), np.array([[10, 10, 40, 80.0]])).shape) == (3, (1, 3))


def test_what_decides_the_result_is_in_the_identity(tmp_path):
    model = stripe_means(tmp_path / "m.onnx")
    first, second = embedder_of(model).identity, embedder_of(model, colour="rgb").identity
    assert first["sha256"] == "0" * 64
    assert first != second


def relu(path: Path, *shape: int | str) -> Path:
    return saved(path, [helper.make_node("Relu", ["a"], ["b"])], [port("a", list(shape))], [port("b", list(shape))])


@pytest.mark.parametrize(
    ("make", "found"),
    [
        (lambda path: relu(path, 4, "n"), r"takes a \[4, \?\] of float.*height, width"),
        (lambda path: relu(path, "n", 5, 32, 16), r"takes a \[\?, 5, 32, 16\] of float.*role embedder"),
        (lambda path: fixed(path, {"v": np.ones((1, 3)), "w": np.ones((1, 4))}, [1, 3, 32, 16]),
         r"gives v \[1, 3\] of float; w \[1, 4\].*one output"),
        (lambda path: fixed(path, {"v": np.ones((1, 1))}, [1, 3, 32, 16]), r"gives the shape \[1, 1\]"),
    ],
    ids=["no picture", "five channels", "two outputs", "a single number"],
)  # fmt: skip
def test_a_network_of_another_kind_is_refused(tmp_path, make, found):
    with pytest.raises(InputError, match=rf"m\.onnx: {found}"):
        embedder_of(make(tmp_path / "m.onnx"))


def test_a_real_network_finds_the_same_people_in_another_camera(data_root):
    path = MODELS / "person-reidentification-retail-0248.onnx"
    crops = data_root / "reid_crops" / "val"
    for needed in (path, crops):
        if not needed.exists():
            pytest.skip(f"{needed} does not exist; set PASSERBY_MODELS and PASSERBY_DATA")
    embedder = ReidEmbedder(network(path, "embedder", "embedding"))
    assert rank_one(embedder, crops) >= 10 / 12  # 11 of 12 measured; chance is 1 of 12


def rank_one(embedder, crops: Path) -> float:
    """The share of people of one camera whose most similar in another, of one picture each, is the same."""
    vectors = {}
    for camera in ("01", "02"):
        vectors[camera] = {}
        for folder in sorted(crops.glob("*/*")):
            for file in sorted(folder.glob(f"{camera}_*.png"))[:1]:
                picture = cv2.imread(str(file))
                size = [[0.0, 0.0, picture.shape[1], picture.shape[0]]]
                vectors[camera][folder.name] = embedder(picture, np.array(size))[0]
    common = sorted(set(vectors["01"]) & set(vectors["02"]))
    first, second = (np.array([vectors[camera][name] for name in common]) for camera in ("01", "02"))
    return float((np.argmax(first @ second.T, axis=1) == np.arange(len(common))).mean())
