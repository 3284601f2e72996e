"""PETS 2009: pictures, calibration and the three kinds of annotated boxes."""

import re

import numpy as np
import pytest

from passerby.common.errors import InputError
from passerby.datasets.pets import read
from support.datasets import tsai as tsai_sets


@pytest.fixture(scope="module")
def recording(tmp_path_factory):
    return tsai_sets.write_pets(tmp_path_factory.mktemp("pets"))


@pytest.fixture
def broken(tmp_path):
    return tsai_sets.write_pets(tmp_path / "set", views=False, pictures=2)


def names():
    return list(tsai_sets.cameras())


def test_cameras_pictures_and_boxes(recording):
    published = read(recording)
    assert (published.rig.names, published.fps) == (("View_001", "View_002", "View_003", "View_004"), 7.0)
    for camera, true in zip(published.rig, tsai_sets.cameras().values(), strict=True):
        assert camera.lens.size == true.size
        assert np.allclose(camera.centre, true.pose.centre, atol=1e-6)
    assert [path.name for path in published.pictures["View_002"]] == [f"frame_{number:04}.jpg" for number in range(4)]
    assert published.frames_of_pictures("View_002") == (1, 2, 3, 4)
    assert (published.identities_known, published.ground) == (True, None)
    assert len(published.boxes["View_003"]) == len(tsai_sets.boxes(names()[2]))


def test_cvml_counts_from_0_and_has_centres(broken):
    boxes = read(broken).boxes
    true = tsai_sets.boxes(names()[0])
    true = true[np.lexsort((true[:, 1], true[:, 0]))]
    assert list(boxes) == ["View_001"]
    assert np.array_equal(boxes["View_001"].frame, true[:, 0])
    assert np.array_equal(boxes["View_001"].identity, true[:, 1])
    assert np.allclose(boxes["View_001"].ltwh[:, :2], true[:, 2:4], atol=2e-4)
    assert not read(broken).identities_known


def test_positions_of_the_3d_challenge_get_the_boxes_numbers(recording, tmp_path):
    folder = tsai_sets.write_pets(tmp_path / "set")
    lines = (line.split(",", 2) for line in tsai_sets.mot_truth(names()[0]).splitlines())
    (folder / "gt").mkdir()
    (folder / "gt" / "gt.txt").write_text("".join(f"{frame},{30 - int(identity)},{rest}\n" for frame, identity, rest in lines))
    ground = read(folder).ground
    true = tsai_sets.scene().ground_positions + tsai_sets.SHIFT[:2]
    assert len(ground) == len(tsai_sets.boxes(names()[0]))
    assert np.abs(true[ground.frame - 1, ground.identity - 1] - ground.xy).max() < 1e-3


def test_views_may_be_spelt_otherwise(broken):
    next(broken.rglob("PETS2009-S2L1.xml")).unlink()
    for number, camera in enumerate(names(), start=1):
        (broken / f"view-{number}.txt").write_text(tsai_sets.vatic(camera))
    published = read(broken)
    assert list(published.boxes) == ["View_001", "View_002", "View_003", "View_004"]
    assert len(published.boxes["View_004"]) == len(tsai_sets.boxes(names()[3]))


def test_pictures_keep_their_frames_where_one_is_missing(broken):
    next(broken.rglob("View_001/frame_0000.jpg")).unlink()
    published = read(broken)
    assert (published.frames_of_pictures("View_001"), published.frames_of_pictures("View_002")) == ((2,), (1, 2))


@pytest.mark.parametrize(
    ("name", "text", "told"),
    [
        ("View_002.xml", "<Camera>", "View_002.xml: is not XML"),
        ("Time_14-55/View_001/frame_0000.jpg", "", "a second folder of images of View_001"),
        ("old/View_001.xml", "<Camera/>", "a second calibration of View_001"),
        ("PETS2009-S2L1.xml", "<dataset><frame number='0'></dataset>", "PETS2009-S2L1.xml: is not XML"),
        ("PETS2009-S2L1.xml", "<dataset><frame number='0'><objectlist><object id='1'/></objectlist></frame></dataset>",
         '<object id="1"> has no <box>'),
        ("PETS2009-S2L2.xml", "<dataset><frame number='0'/></dataset>", "a second annotation of View_001"),
        ("boxes-View_009.xml", "<dataset><frame number='0'/></dataset>", "has no calibration View_009.xml"),
        ("S2/L1/Time_12-34/View_003/frame_0000.jpg", "no image", "is not an image that can be read"),
        ("gt/gt.txt", "1,2,3\n", "3 columns"),
    ],
)  # fmt: skip
def test_what_is_broken_is_told(broken, name, text, told):
    path = broken / name
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(text)
    with pytest.raises(InputError, match=re.escape(told)):
        read(broken)


def test_missing_calibrations_and_pictures(tmp_path):
    with pytest.raises(InputError, match=r"holds no calibrations View_00N.xml"):
        read(tmp_path)
    for number, camera in enumerate(tsai_sets.cameras().values(), start=1):
        (tmp_path / f"View_{number:03}.xml").write_text(camera.xml())
    with pytest.raises(InputError, match=r"holds no View_00N/frame_NNNN.jpg"):
        read(tmp_path)
