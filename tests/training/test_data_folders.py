"""Published data sets and folders per identity: recognised, read, and told about where something is wrong."""

from __future__ import annotations

import shutil
from pathlib import Path

import numpy as np
import pytest

from passerby.common.errors import InputError
from passerby.training.crops import DISTRACTOR, JUNK, mix_sets
from passerby.training.data import read_all, read_data
from support.datasets.pictures_of_people import market, msmt17, picture, pictures


def told(crops):
    """(file, person, camera) of each picture, the names without the set's."""
    people = (*(name.split("/")[-1] for name in crops.people), DISTRACTOR, JUNK)
    cameras = [name.split("/")[-1] for name in crops.cameras]
    return sorted(
        (
            (path.name, people[person], cameras[camera])
            for path, person, camera in zip(crops.paths, crops.person, crops.camera, strict=True)
        ),
        key=str,
    )


def test_market(tmp_path):
    data = read_data(market(tmp_path / "market1501"), tmp_path / "cache")
    assert data.name == "market1501"
    assert data.train.people == ("market1501/0002", "market1501/0007")
    assert data.train.cameras == ("market1501/c1", "market1501/c2", "market1501/c3")
    assert told(data.train) == [
        ("0002_c1s1_000451_03.jpg", "0002", "c1"),
        ("0002_c2s1_000500_01.jpg", "0002", "c2"),
        ("0007_c1s1_000451_01.jpg", "0007", "c1"),
        ("0007_c3s2_000451_01.jpg", "0007", "c3"),
    ]
    assert told(data.query) == [("0001_c1s1_001051_00.jpg", "0001", "c1"), ("0003_c2s1_001051_00.jpg", "0003", "c2")]
    assert told(data.gallery) == [
        ("-1_c1s1_000401_03.jpg", JUNK, "c1"),
        ("0000_c4s1_000401_03.jpg", DISTRACTOR, "c4"),
        ("0001_c2s1_001976_01.jpg", "0001", "c2"),
        ("0003_c1s1_000076_01.jpg", "0003", "c1"),
        ("0003_c2s1_000077_01.jpg", "0003", "c2"),
    ]
    assert data.query.people == data.gallery.people
    assert data.train.apart is None
    assert data.notes == ()
    assert not (tmp_path / "cache").exists()


def test_duke(tmp_path):
    duke = tmp_path / "DukeMTMC-reID"
    pictures(duke / "bounding_box_train", "0001_c2_f0046182.jpg 0001_c5_f0051341.jpg")
    pictures(duke / "query", "0005_c2_f0046985.jpg")
    pictures(duke / "bounding_box_test", "0005_c7_f0051000.jpg 0008_c2_f0046985.jpg")
    data = read_data(duke, tmp_path)
    assert told(data.gallery) == [("0005_c7_f0051000.jpg", "0005", "c7"), ("0008_c2_f0046985.jpg", "0008", "c2")]
    assert told(data.train)[1] == ("0001_c5_f0051341.jpg", "0001", "c5")


@pytest.mark.parametrize("folders", [("train", "test"), ("mask_train_v2", "mask_test_v2")])
def test_msmt17(tmp_path, folders):
    data = read_data(msmt17(tmp_path / "msmt17", *folders), tmp_path)
    # Train and val count the same people, query and gallery count others from 0 again.
    assert data.train.people == ("msmt17/train-0000", "msmt17/train-0001")
    assert [camera for _, _, camera in told(data.train)] == ["01", "02", "14", "05"]
    assert data.query.people == ("msmt17/test-0000",)
    assert told(data.gallery) == [("0000_001_04_0303morning_0015_0.jpg", "test-0000", "04")]
    assert data.train.paths[0].parent.parent.name == folders[0]


@pytest.mark.parametrize("splits", [("train", "query", "gallery"), ("train", "val/query", "val/gallery")])
def test_a_folder_per_identity_with_splits(tmp_path, splits):
    train, query, gallery = (tmp_path / "set" / split for split in splits)
    pictures(train, "001/01_1.png 001/02_1.png 003/01_1.png 003/02_7.jpg")
    pictures(query, "004/01_1.png")
    pictures(gallery, "004/02_1.png 012/02_1.png")
    pictures(gallery.parent / "all_imgs", "004/01_1.png 099/01_1.png")
    data = read_data(tmp_path / "set", tmp_path)
    assert told(data.train) == [
        ("01_1.png", "001", "01"),
        ("01_1.png", "003", "01"),
        ("02_1.png", "001", "02"),
        ("02_7.jpg", "003", "02"),
    ]
    assert told(data.query) == [("01_1.png", "004", "01")]
    assert told(data.gallery) == [("02_1.png", "004", "02"), ("02_1.png", "012", "02")]
    assert data.notes == ()
    alone = read_data(gallery.parent, tmp_path)
    assert len(alone.train) == (0 if "val" in splits[1] else 4)
    assert told(alone.gallery) == told(data.gallery)


def test_a_flat_folder_per_identity_is_to_learn_from(tmp_path):
    pictures(tmp_path / "set", "anna/0001_c3s1_1.jpg anna/0001_c4s1_1.jpg bert/0002_c3s1_1.jpg bert/0002_c3s1_2.jpg")
    data = read_data(tmp_path / "set", tmp_path)
    assert data.train.people == ("set/anna", "set/bert")
    assert data.train.cameras == ("set/c3", "set/c4")
    assert not len(data.query)


@pytest.mark.parametrize(
    "names",
    [
        "a/one.png a/two.png b/three.png",  # no camera in the names
        "a/a_1.png a/a_2.png b/b_1.png b/b_2.png",  # the person, not a camera
        "a/img_1.png a/img_2.png b/img_1.png b/img_2.png",  # the same for all: no camera
        "a/01_1.png a/02_1.png b/01_1.png b/01-1.png",  # not all of them
    ],
)
def test_names_that_tell_no_camera(tmp_path, names):
    pictures(tmp_path / "set", names + " b/more.png" * names.startswith("a/one"))
    data = read_data(tmp_path / "set", tmp_path)
    assert data.train.cameras == ("set/unknown-camera",)
    assert len(data.notes) == 1
    assert "do not state their cameras" in data.notes[0]


def test_bad_pictures_are_named_and_left_out(tmp_path):
    names = " ".join(
        f"{person}/{camera}_{view}.{kind}"
        for person in ("a", "b")
        for camera in "12"
        for view in range(4)
        for kind in ("png", "jpg")
    )
    pictures(tmp_path / "set", names)
    folder = tmp_path / "set" / "a"
    (folder / "1_0.png").write_bytes(b"")
    (folder / "1_0.jpg").write_bytes((folder / "1_0.jpg").read_bytes()[:-100])
    (folder / "1_1.png").write_bytes((folder / "1_1.png").read_bytes()[:-100])
    for view in range(4):
        (folder / f"2_{view}.jpg").write_text("not an image")
    picture(folder / "2_3.png", size=(4, 8))
    data = read_data(tmp_path / "set", tmp_path)
    assert len(data.train) == 32 - 8
    unreadable, small = data.notes
    assert unreadable.startswith("7 images that cannot be read: ")
    assert unreadable.endswith(" and 2 more")
    assert unreadable.count(str(folder)) == 5
    assert small == f"1 image that is too small: {folder / '2_3.png'}"


def test_people_with_one_picture_are_not_learnt_from(tmp_path):
    pictures(tmp_path / "set", "a/1_1.png a/2_1.png b/1_1.png c/1_1.png c/2_1.png")
    (tmp_path / "set" / "c" / "2_1.png").write_bytes(b"")  # which leaves one
    (tmp_path / "set" / "empty").mkdir()
    data = read_data(tmp_path / "set", tmp_path)
    assert data.train.people == ("set/a",)
    assert "1 folder without images" in data.notes[0]
    assert data.notes[-1] == "2 people with one image each, kept out of the training: b, c"


def test_people_both_learnt_from_and_searched_for_are_told(tmp_path):
    pictures(tmp_path / "set", "train/a/1_1.png train/a/2_1.png query/a/1_1.png gallery/a/2_1.png")
    assert any("both train and query" in note for note in read_data(tmp_path / "set", tmp_path).notes)


def test_many_pictures_are_tried_with_progress(tmp_path):
    pictures(tmp_path / "set", " ".join(f"a/1_{view}.png b/2_{view}.png a/2_{view}.png" for view in range(3)))
    heard = []
    read_data(tmp_path / "set", tmp_path, lambda stage, done=0, total=0, *, part="": heard.append((done, total)))
    assert heard[0] == (0, 9)
    assert heard[-1] == (9, 9)


def broken(tmp_path: Path, what: str) -> Path:
    """A set with something wrong."""
    folder = tmp_path / "set"
    if what in ("query", "bounding_box_test", "bounding_box_train"):
        shutil.rmtree(market(folder) / what)
    elif what == "empty part":
        market(folder)
        for file in (folder / "query").iterdir():
            file.unlink()
    elif what == "gallery":
        pictures(folder, "train/a/1_1.png train/a/2_1.png val/query/a/1_1.png")
    elif what == "nobody in gallery":
        pictures(folder, "query/a/1_1.png gallery/b/2_1.png gallery/a/1_2.png query/c/1_1.png")
        (folder / "gallery" / "nobody").mkdir()
    elif what == "list":
        (msmt17(folder) / "list_gallery.txt").unlink()
    elif what == "line":
        (msmt17(folder) / "list_val.txt").write_text("0000/0000_000_01_0303morning_0015_0.jpg\n")
    elif what == "number":
        (msmt17(folder) / "list_val.txt").write_text(f"0000/0000_000_01_0303morning_0015_0.jpg {'9' * 5000}\n")
    elif what == "images of msmt17":
        shutil.rmtree(msmt17(folder) / "test")
    elif what == "nothing":
        folder.mkdir()
    elif what == "all bad":
        for file in pictures(folder, "a/1_1.png a/2_1.png").rglob("*.png"):
            file.write_bytes(b"")
    elif what == "inside":
        market(folder / "Market-1501-v15.09.15")
    elif what == "file":
        folder.write_text("")
    return folder


@pytest.mark.parametrize(
    ("what", "message"),
    [
        ("query", "set/query: no such folder"),
        ("bounding_box_test", "set/bounding_box_test: no such folder"),
        ("bounding_box_train", "set/bounding_box_train: no such folder"),
        ("empty part", "set/query: holds no image named as"),
        ("gallery", "set/val/gallery: no such folder, but there is query"),
        ("nobody in gallery", "set: no person of the query is in the gallery, seen by another camera"),
        ("list", "list_gallery.txt: no such file"),
        ("line", "list_val.txt: line 1: '0000/0000_000_01_0303morning_0015_0.jpg' is not an image and a person"),
        ("number", "list_val.txt: line 1: '0000/0000_000_01_0303morning_0015_0.jpg 999"),
        ("images of msmt17", "train and test or mask_train_v2 and mask_test_v2 are needed"),
        ("nothing", "set: holds no images of people in a known layout: give Market-1501 .* a folder per identity"),
        ("all bad", "2 images that cannot be read: .* nothing is left to learn from"),
        ("inside", "set/Market-1501-v15.09.15 holds one"),
        ("file", "is a file, but no scene file"),
        ("missing", "set: no such folder: give Market-1501"),
    ],
)
def test_what_is_wrong_is_told(tmp_path, what, message):
    with pytest.raises(InputError, match=message):
        read_data(broken(tmp_path, what), tmp_path)


def test_sets_of_one_name_do_not_collide(tmp_path):
    paths = [market(tmp_path / place / "market") for place in ("a", "b")] + [msmt17(tmp_path / "c" / "msmt17")]
    first, second, third = read_all(paths, tmp_path / "cache")
    assert (first.name, second.name, third.name) == ("a/market", "b/market", "msmt17")
    together = mix_sets([first.train, second.train, third.train])
    assert len(together.people) == 6
    assert len(np.unique(together.person)) == 6


def test_folders_of_one_name_in_folders_of_one_name(tmp_path):
    paths = [market(tmp_path / place / "data" / "market") for place in ("a", "b")]
    assert [data.name for data in read_all(paths, tmp_path)] == ["a/data/market", "b/data/market"]


def test_one_set_twice(tmp_path):
    folder = market(tmp_path / "market")
    with pytest.raises(InputError, match="market: is given twice"):
        read_all([folder, tmp_path / "market" / ".." / "market"], tmp_path)
    (tmp_path / "link").symlink_to(folder)
    with pytest.raises(InputError, match="market: is given twice"):
        read_all([folder, tmp_path / "link"], tmp_path)


def test_a_set_within_another(tmp_path):
    pictures(tmp_path / "set", "train/a/1_1.png train/a/2_1.png val/query/b/1_1.png val/gallery/b/2_1.png")
    with pytest.raises(InputError, match=r"val: lies in .*set, which is given too"):
        read_all([tmp_path / "set", tmp_path / "set" / "val"], tmp_path)


def test_real_crops(data_root, tmp_path):
    if not (data_root / "reid_crops").is_dir():
        pytest.skip(f"no crops in {data_root}")
    data = read_data(data_root / "reid_crops", tmp_path)
    assert (len(data.train), len(data.train.people)) == (992, 62)
    assert (len(data.query), len(data.gallery), len(data.gallery.people)) == (28, 181, 12)
    assert data.train.cameras == ("reid_crops/01", "reid_crops/02")
