"""Published data sets and folders per identity: recognised, read, and what is wrong in them is named."""

import shutil
from pathlib import Path

import numpy as np
import pytest

from passerby.common.errors import InputError
from passerby.training.crops import DISTRACTOR, JUNK, mix_sets
from passerby.training.data import read_all, read_data
from support.datasets.pictures_of_people import market, msmt17, picture, pictures


def listed(crops):
    """(file, person, camera) of each picture, the names without the set's."""
    people = (*(name.split("/")[-1] for name in crops.people), DISTRACTOR, JUNK)
    cameras = [name.split("/")[-1] for name in crops.cameras]
    rows = zip(crops.paths, crops.person, crops.camera, strict=True)
    return sorted(((path.name, people[person], cameras[camera]) for path, person, camera in rows), key=str)


def without(folder, *parts):
    """What is left of a set where some files or folders are removed."""
    for part in parts:
        shutil.rmtree(folder / part) if (folder / part).is_dir() else (folder / part).unlink()


def emptied(folder):
    without(market(folder), *(file.relative_to(folder) for file in (folder / "query").iterdir()))


def test_market_and_duke(tmp_path):
    data = read_data(market(tmp_path / "market1501"), tmp_path / "cache")
    assert (data.name, data.train.people) == ("market1501", ("market1501/0002", "market1501/0007"))
    assert data.train.cameras == ("market1501/c1", "market1501/c2", "market1501/c3")
    assert [" ".join(one) for one in listed(data.train)] == [
        "0002_c1s1_000451_03.jpg 0002 c1", "0002_c2s1_000500_01.jpg 0002 c2", "0007_c1s1_000451_01.jpg 0007 c1",
        "0007_c3s2_000451_01.jpg 0007 c3",
    ]  # fmt: skip
    assert listed(data.query) == [("0001_c1s1_001051_00.jpg", "0001", "c1"), ("0003_c2s1_001051_00.jpg", "0003", "c2")]
    assert listed(data.gallery) == [
        ("-1_c1s1_000401_03.jpg", JUNK, "c1"),
        ("0000_c4s1_000401_03.jpg", DISTRACTOR, "c4"),
        ("0001_c2s1_001976_01.jpg", "0001", "c2"),
        ("0003_c1s1_000076_01.jpg", "0003", "c1"),
        ("0003_c2s1_000077_01.jpg", "0003", "c2"),
    ]
    assert data.query.people == data.gallery.people
    assert (data.train.apart, data.notes, (tmp_path / "cache").exists()) == (None, (), False)
    duke = tmp_path / "DukeMTMC-reID"
    pictures(duke / "bounding_box_train", "0001_c2_f0046182.jpg 0001_c5_f0051341.jpg")
    pictures(duke / "query", "0005_c2_f0046985.jpg")
    pictures(duke / "bounding_box_test", "0005_c7_f0051000.jpg 0008_c2_f0046985.jpg")
    data = read_data(duke, tmp_path)
    assert listed(data.gallery) == [("0005_c7_f0051000.jpg", "0005", "c7"), ("0008_c2_f0046985.jpg", "0008", "c2")]
    assert listed(data.train)[1] == ("0001_c5_f0051341.jpg", "0001", "c5")


@pytest.mark.parametrize("folders", [("train", "test"), ("mask_train_v2", "mask_test_v2")])
def test_msmt17(tmp_path, folders):
    data = read_data(msmt17(tmp_path / "msmt17", *folders), tmp_path)
    # Train and val count the same people, query and gallery count others from 0 again.
    assert data.train.people == ("msmt17/train-0000", "msmt17/train-0001")
    assert [camera for _, _, camera in listed(data.train)] == ["01", "02", "14", "05"]
    assert data.query.people == ("msmt17/test-0000",)
    assert listed(data.gallery) == [("0000_001_04_0303morning_0015_0.jpg", "test-0000", "04")]
    assert data.train.paths[0].parent.parent.name == folders[0]


@pytest.mark.parametrize("splits", [("train", "query", "gallery"), ("train", "val/query", "val/gallery")])
def test_a_folder_per_identity_with_splits(tmp_path, splits):
    train, query, gallery = (tmp_path / "set" / split for split in splits)
    pictures(train, "001/01_1.png 001/02_1.png 003/01_1.png 003/02_7.jpg")
    pictures(query, "004/01_1.png")
    pictures(gallery, "004/02_1.png 012/02_1.png")
    pictures(gallery.parent / "all_imgs", "004/01_1.png 099/01_1.png")
    data = read_data(tmp_path / "set", tmp_path)
    assert [" ".join(one) for one in listed(data.train)] == [
        "01_1.png 001 01", "01_1.png 003 01", "02_1.png 001 02", "02_7.jpg 003 02",
    ]  # fmt: skip
    assert listed(data.query) == [("01_1.png", "004", "01")]
    assert (listed(data.gallery), data.notes) == ([("02_1.png", "004", "02"), ("02_1.png", "012", "02")], ())
    alone = read_data(gallery.parent, tmp_path)
    assert len(alone.train) == (0 if "val" in splits[1] else 4)
    assert listed(alone.gallery) == listed(data.gallery)


def test_a_flat_folder_per_identity_is_to_learn_from(tmp_path):
    pictures(tmp_path / "set", "anna/0001_c3s1_1.jpg anna/0001_c4s1_1.jpg bert/0002_c3s1_1.jpg bert/0002_c3s1_2.jpg")
    heard = []
    data = read_data(tmp_path / "set", tmp_path, lambda stage, done=0, total=0, *, part="": heard.append((done, total)))
    assert (data.train.people, data.train.cameras) == (("set/anna", "set/bert"), ("set/c3", "set/c4"))
    assert not len(data.query)
    assert (heard[0], heard[-1]) == ((0, 4), (4, 4))


@pytest.mark.parametrize(
    "names",
    [
        "a/one.png a/two.png b/three.png b/more.png",  # no camera in the names
        "a/a_1.png a/a_2.png b/b_1.png b/b_2.png",  # the person, not a camera
        "a/img_1.png a/img_2.png b/img_1.png b/img_2.png",  # the same for all: no camera
        "a/01_1.png a/02_1.png b/01_1.png b/01-1.png",  # not all of them
    ],
)
def test_names_without_a_camera(tmp_path, names):
    data = read_data(pictures(tmp_path / "set", names), tmp_path)
    assert data.train.cameras == ("set/unknown-camera",)
    (note,) = data.notes
    assert "do not state their cameras" in note


def test_bad_pictures_are_named_and_left_out(tmp_path):
    names = [f"{who}/{camera}_{view}.{kind}" for who in "ab" for camera in "12" for view in range(4) for kind in ("png", "jpg")]
    folder = pictures(tmp_path / "set", " ".join(names)) / "a"
    (folder / "1_0.png").write_bytes(b"")
    for cut in ("1_0.jpg", "1_1.png"):
        (folder / cut).write_bytes((folder / cut).read_bytes()[:-100])
    for view in range(4):
        (folder / f"2_{view}.jpg").write_text("not an image")
    picture(folder / "2_3.png", size=(4, 8))
    data = read_data(tmp_path / "set", tmp_path)
    assert len(data.train) == 32 - 8
    unreadable, small = data.notes
    assert unreadable.startswith("7 images that cannot be read: ")
    assert unreadable.endswith(" and 2 more")
    assert (unreadable.count(str(folder)), small) == (5, f"1 image that is too small: {folder / '2_3.png'}")


def test_people_with_one_picture_are_not_learnt_from_and_those_both_learnt_from_and_searched_for_are_named(tmp_path):
    pictures(tmp_path / "set", "a/1_1.png a/2_1.png b/1_1.png c/1_1.png c/2_1.png")
    (tmp_path / "set" / "c" / "2_1.png").write_bytes(b"")  # which leaves one
    (tmp_path / "set" / "empty").mkdir()
    data = read_data(tmp_path / "set", tmp_path)
    assert data.train.people == ("set/a",)
    assert "1 folder without images" in data.notes[0]
    assert data.notes[-1] == "2 people with one image each, kept out of the training: b, c"
    pictures(tmp_path / "both", "train/a/1_1.png train/a/2_1.png query/a/1_1.png gallery/a/2_1.png")
    assert any("both train and query" in note for note in read_data(tmp_path / "both", tmp_path).notes)


def of_others_in_the_gallery(folder):
    pictures(folder, "query/a/1_1.png gallery/b/2_1.png gallery/a/1_2.png query/c/1_1.png")
    (folder / "gallery" / "no-one").mkdir()


def with_val(folder, number):
    (msmt17(folder) / "list_val.txt").write_text(f"0000/0000_000_01_0303morning_0015_0.jpg{number}\n")


def of_bad_pictures(folder):
    for file in pictures(folder, "a/1_1.png a/2_1.png").rglob("*.png"):
        file.write_bytes(b"")


@pytest.mark.parametrize(
    ("make", "message"),
    [
        *((lambda folder, part=part: without(market(folder), part), f"set/{part}: no such folder")
          for part in ("query", "bounding_box_test", "bounding_box_train")),
        (emptied, "set/query: holds no image named as"),
        (lambda folder: pictures(folder, "train/a/1_1.png train/a/2_1.png val/query/a/1_1.png"),
         "set/val/gallery: no such folder, but there is query"),
        (of_others_in_the_gallery, "set: no person of the query is in the gallery, seen by another camera"),
        (lambda folder: without(msmt17(folder), "list_gallery.txt"), "list_gallery.txt: no such file"),
        (lambda folder: with_val(folder, ""),
         "list_val.txt: line 1: '0000/0000_000_01_0303morning_0015_0.jpg' is not an image and a person"),
        (lambda folder: with_val(folder, f" {'9' * 5000}"),
         "list_val.txt: line 1: '0000/0000_000_01_0303morning_0015_0.jpg 999"),
        (lambda folder: without(msmt17(folder), "test"), "train and test or mask_train_v2 and mask_test_v2 are needed"),
        (Path.mkdir, "set: holds no images of people in a known layout: give Market-1501 .* a folder per identity"),
        (of_bad_pictures, "2 images that cannot be read: .* nothing is left to learn from"),
        (lambda folder: market(folder / "Market-1501-v15.09.15"), "set/Market-1501-v15.09.15 holds one"),
        (lambda folder: folder.write_text(""), "is a file, but no scene file"),
        (lambda folder: None, "set: no such folder: give Market-1501"),
    ],
)  # fmt: skip
def test_what_is_wrong_is_named(tmp_path, make, message):
    make(tmp_path / "set")
    with pytest.raises(InputError, match=message):
        read_data(tmp_path / "set", tmp_path)


def test_sets_of_one_name_do_not_collide_and_one_set_twice_or_within_another_is_refused(tmp_path):
    paths = [market(tmp_path / place / "market") for place in ("a", "b", "a/data", "b/data")]
    first, second, third = read_all([*paths[:2], msmt17(tmp_path / "c" / "msmt17")], tmp_path / "cache")
    assert (first.name, second.name, third.name) == ("a/market", "b/market", "msmt17")
    together = mix_sets([first.train, second.train, third.train])
    assert (len(together.people), len(np.unique(together.person))) == (6, 6)
    assert [data.name for data in read_all(paths[2:], tmp_path)] == ["a/data/market", "b/data/market"]
    folder = market(tmp_path / "market")
    (tmp_path / "link").symlink_to(folder)
    for same in (tmp_path / "market" / ".." / "market", tmp_path / "link"):
        with pytest.raises(InputError, match="market: is given twice"):
            read_all([folder, same], tmp_path)
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
