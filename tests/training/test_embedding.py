"""How well an embedder tells people apart: whole pictures, cameras' means, and sets without query and gallery."""

import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest

from passerby.common.errors import InputError
from passerby.perception.crop_network import stretch_crop
from passerby.perception.networks import InputConvention, Network
from passerby.perception.reid import ReidEmbedder, StripesEmbedder
from passerby.training.crops import JUNK, CropSet
from passerby.training.data import read_data
from passerby.training.embedding import embed_crops, leave_one_out, make_full_box, score_crops, score_data
from support.datasets.pictures_of_people import picture, pictures
from support.paths import MODELS


def crops_of(person, camera, people=None, cameras=None):
    """A set of files that do not exist."""
    people = people or tuple(f"set/{number}" for number in range(max(person) + 1))
    cameras = cameras or tuple(f"set/c{number}" for number in range(max(camera) + 1))
    return CropSet(tuple(map(Path, map(str, range(len(person))))), np.array(person), np.array(camera), people, cameras)


def appearance(degrees):
    """(N, 2) unit vectors."""
    angle = np.radians(degrees)
    return np.stack([np.cos(angle), np.sin(angle)], axis=1).astype(np.float32)


@pytest.mark.parametrize("size", [(16, 32), (17, 33), (9, 17), (8, 16), (63, 129)])
def test_a_picture_is_taken_whole(tmp_path, size):
    shown = cv2.imread(str(picture(tmp_path / "a.png", size=size)))
    np.testing.assert_array_equal(stretch_crop(shown, make_full_box(shown)[0], size), shown)


def test_every_picture_is_embedded_in_its_row_and_a_set_is_scored(tmp_path):
    data = read_data(pictures(tmp_path / "set", "a/1_1.png a/2_1.png b/1_1.png b/2_1.png"), tmp_path)
    heard = []
    embedder = StripesEmbedder()
    vectors = embed_crops(data.train, embedder, lambda stage, done=0, total=0, *, part="": heard.append((done, total)))
    assert vectors.shape == (4, embedder.dimensions)
    np.testing.assert_allclose(np.linalg.norm(vectors, axis=1), 1, atol=1e-5)
    for path, vector in zip(data.train.paths, vectors, strict=True):
        shown = cv2.imread(str(path))
        np.testing.assert_array_equal(vector, embedder(shown, np.array([[0.0, 0, 16, 32]]))[0])
    assert heard[-1] == (4, 4)
    # A set without query is scored by its people.
    shown = {"1_1.png": 0, "2_1.png": 10}

    def embed(crops):
        return appearance([90 * int(person) + shown[path.name] for path, person in zip(crops.paths, crops.person, strict=True)])

    score = score_data(data, embed)
    assert (score.queries, score.rank_1) == (4, 1)
    split = replace(data, query=data.train.take(np.array([0, 2])), gallery=data.train.take(np.array([1, 3])), train=CropSet())
    assert score_data(split, embed).queries == 2
    data.train.paths[2].unlink()
    with pytest.raises(InputError, match="is not an image that can be read"):
        embed_crops(data.train, embedder)


def test_people_and_cameras_are_matched_by_name():
    query = crops_of([0, 1], [0, 0], ("set/a", "set/b"), ("set/c1",))
    gallery = crops_of([0, 1, 0, 1], [0, 0, 1, 1], ("set/b", "set/a"), ("set/c2", "set/c1"))
    # By c2: b at 90 degrees, a at 0; by c1, nearer: b and a, the former of each passed over where it is the same person.
    score = score_crops(query, gallery, appearance([10, 80]), appearance([90, 0, 80, 10]))
    assert (score.rank_1, score.mean_average_precision) == (1, 1)
    assert score_crops(query, gallery, appearance([80, 10]), appearance([90, 0, 80, 10])).rank_1 == 0
    # Those of unknown cameras are compared in full.
    crops = crops_of([0, 1], [0, 0], cameras=("set/unknown-camera",))
    assert score_crops(crops, crops, appearance([0, 90]), appearance([10, 80])).rank_1 == 1
    # A picture without a known look is like none and unlike none: cosines of 0.17, 0 (unknown) and -0.17.
    gallery = crops_of([1, 0, 1], [1, 1, 1])
    query = crops_of([0], [0], gallery.people, ("set/c0", "set/c1"))
    vectors = appearance([80, 0, 100]) * [[1], [0], [1]]
    assert score_crops(query, gallery, appearance([0]), vectors).mean_average_precision == 0.5


def test_what_a_camera_does_to_all_is_taken_off():
    """Camera 1 adds so much to one component that all people in it look alike."""
    rng = np.random.default_rng(0)
    person = np.repeat(np.arange(10), 4)
    camera = np.tile([0, 0, 1, 1], 10)
    vectors = (rng.normal(0, 1, (10, 16))[person] + rng.normal(0, 0.1, (40, 16))).astype(np.float32)
    vectors[camera == 1, 0] += 30
    crops = crops_of(person.tolist(), camera.tolist())
    half = np.arange(40) % 2 == 0
    plain, centred = (
        score_crops(crops.take(half), crops.take(~half), vectors[half], vectors[~half], centred) for centred in (False, True)
    )
    assert plain.rank_1 < 0.3
    assert (centred.rank_1, leave_one_out(crops, vectors, centred=True).rank_1) == (1, 1)
    # Vectors of another length are the same looks.
    assert score_crops(crops.take(half), crops.take(~half), 7 * vectors[half], vectors[~half]) == plain


def test_leave_one_out_searches_the_other_cameras():
    # Person 0 at 0, 10 (camera 0) and 40 degrees (camera 1), person 1 at 30 (camera 0) and 90 (camera 1).
    crops, vectors = crops_of([0, 0, 0, 1, 1], [0, 0, 1, 0, 1]), appearance([0, 10, 40, 30, 90])
    score = leave_one_out(crops, vectors)
    # From 0 and 10 to 40: first. From 40: 30, 10, 0. From 30: 40, 90. From 90: 30, then nobody else's.
    assert (score.queries, score.rank_1) == (5, pytest.approx(3 / 5))
    assert score.mean_average_precision == pytest.approx((1 + 1 + (1 / 2 + 2 / 3) / 2 + 1 / 2 + 1) / 5)
    # It searches all others where cameras do not matter: 0: 20 is right. 20: 30 before 0. 30: 20, 0, 90. 90: 30 is right.
    for name in ("set/unknown-camera", "set/c0"):
        score = leave_one_out(crops_of([0, 0, 1, 1], [0, 0, 0, 0], cameras=(name,)), appearance([0, 20, 30, 90]))
        assert (score.rank_1, score.mean_average_precision) == (2 / 4, pytest.approx((1 + 1 / 2 + 1 / 3 + 1) / 4))


def test_crops_that_may_be_of_one_person_count_neither_as_right_nor_as_wrong():
    crops, vectors = crops_of([0, 0, 1, 2], [0, 1, 1, 1]), appearance([0, 20, 10, 15])
    assert leave_one_out(crops, vectors).mean_average_precision == pytest.approx((1 / 3 + 1) / 2)
    apart = np.ones((3, 3), dtype=bool) & ~np.eye(3, dtype=bool)
    apart[0, 1] = apart[1, 0] = False
    unsure = replace(crops, apart=apart)
    assert leave_one_out(unsure, vectors).mean_average_precision == pytest.approx((1 / 2 + 1) / 2)
    query, gallery = unsure.take(np.array([0])), unsure.take(np.array([1, 2, 3]))
    assert score_crops(query, gallery, vectors[:1], vectors[1:]).mean_average_precision == pytest.approx(1 / 2)


@pytest.mark.slow
def test_reading_and_scoring_need_no_pytorch():
    code = "import sys, passerby.training.data, passerby.training.embedding; sys.exit('torch' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0


def test_what_cannot_be_scored():
    crops, two = crops_of([0, 1], [0, 1]), appearance([0, 1])
    with pytest.raises(InputError, match="for 2 and 2 images: one each"):
        score_crops(crops, crops, two, two[:1])
    with pytest.raises(InputError, match="none of 2 queries"):
        leave_one_out(crops, two)
    with pytest.raises(InputError, match="has no person"):
        score_crops(replace(crops, person=np.array([JUNK, 0])), crops, two, two)


def test_real_crops(data_root, tmp_path):
    """Measured, plain and centred: stripes 0.04 and 0.50, since people of the same camera look more alike to them than the same
    person does to the other camera; the network 0.82 and 0.93. Across the cameras alone, on the other 62, 0.31 and 0.81."""
    if not (data_root / "reid_crops").is_dir():
        pytest.skip(f"no crops in {data_root}")
    if not (MODELS / "person-reidentification-retail-0248.onnx").is_file():
        pytest.skip(f"no networks in {MODELS}: set PASSERBY_MODELS to the folder of models")
    network = Network("retail", "embedder", MODELS / "person-reidentification-retail-0248.onnx", "", "embedding",
                      InputConvention(fit="stretch"))  # fmt: skip
    data = read_data(data_root / "reid_crops", tmp_path)
    found = {}
    for name, embedder in (("stripes", StripesEmbedder()), ("network", ReidEmbedder(network))):
        vectors = embed_crops(data.query, embedder), embed_crops(data.gallery, embedder)
        for centred in (False, True):
            found[name, centred] = score_crops(data.query, data.gallery, *vectors, centred).rank_1
    assert found["network", False] > 0.7
    assert found["network", True] > 0.85
    assert found["stripes", True] > 0.4
    assert found["stripes", False] < 0.2
