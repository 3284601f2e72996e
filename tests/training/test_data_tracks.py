"""Crops cut out of videos by tracks: the right pixels of the right people, cut once."""

import os
import shutil

import cv2
import numpy as np
import pytest

from passerby.common.errors import InputError
from passerby.interchange.motchallenge import read_boxes
from passerby.perception.crop_network import stretch_crop
from passerby.perception.video import VideoReader
from passerby.training.data import cutting, read_data
from passerby.training.data.cutting import WantedCrops, cut_crops, find_clear_boxes, spread_rows
from passerby.training.embedding import make_full_box
from support.datasets.pictures_of_people import SIZE, film, picture, scene, tracks, two_walkers


def yard(tmp_path, rows=None, **how):
    """A folder of one video and its tracks, read."""
    tracks(tmp_path / "yard" / "C1.txt", two_walkers() if rows is None else rows)
    if not (tmp_path / "yard" / "C1.mp4").exists():
        film(tmp_path / "yard" / "C1.mp4", **how)
    return again(tmp_path)


def again(tmp_path, cache="cache"):
    return read_data(tmp_path / "yard", tmp_path / cache)


@pytest.mark.parametrize("layout", ["beside", "videos and truth"])
def test_a_folder_of_videos_and_text(tmp_path, layout):
    folder = tmp_path / "yard"
    videos, text = (folder, folder) if layout == "beside" else (folder / "videos", folder / "truth")
    shown, boxes = {}, {}
    for seed, camera in enumerate(("C1", "C2")):
        video = film(videos / f"{camera}.mp4", seed=100 * seed)
        shown[camera] = {frame.number: frame.picture for frame in VideoReader(video)}
        tracks(text / f"{camera}.txt", two_walkers(ids=(4, 9 if seed == 0 else 5)))
        boxes[camera] = read_boxes(text / f"{camera}.txt")
    if layout != "beside":  # identities of each camera's own, which are not to be taken
        tracks(folder / "tracks" / "C1.txt", two_walkers(ids=(1, 2)))
    data = read_data(folder, tmp_path / "cache")
    train = data.train
    assert (train.people, train.cameras) == (("yard/4", "yard/5", "yard/9"), ("yard/C1", "yard/C2"))
    assert (train.apart, data.notes) == (None, ())
    assert np.bincount(train.person).tolist() == [48, 24, 24]
    for path, person, camera in zip(train.paths, train.person, train.camera, strict=True):
        name, identity = train.cameras[camera][5:], int(train.people[person][5:])
        frame = int(path.stem.split("_")[-1])
        row = np.flatnonzero((boxes[name].frame == frame) & (boxes[name].identity == identity))[0]
        crop = cv2.imread(str(path))
        # What a network sees of the crop is what it would see of the box, pixel by pixel.
        seen = stretch_crop(crop, make_full_box(crop)[0], (24, 48))
        np.testing.assert_array_equal(seen, stretch_crop(shown[name][frame], boxes[name].ltwh[row], (24, 48)))


def test_crops_are_cut_once(tmp_path, monkeypatch):
    first = yard(tmp_path).train
    before = {path: path.read_bytes() for path in first.paths}
    opened = []
    original = cutting.VideoReader
    monkeypatch.setattr(cutting, "VideoReader", lambda *args, **kwargs: opened.append(1) or original(*args, **kwargs))
    assert again(tmp_path).train.paths == first.paths
    assert not opened
    first.paths[3].write_bytes(b"damaged")
    first.paths[5].unlink()
    assert (again(tmp_path).train.paths, {path: path.read_bytes() for path in first.paths}) == (first.paths, before)
    assert len(opened) == 1
    film(tmp_path / "yard" / "C1.mp4", seed=50)
    assert set(again(tmp_path).train.paths).isdisjoint(first.paths)
    assert (len(opened), len(yard(tmp_path, two_walkers(last=20)).train), len(opened)) == (2, 40, 3)


def test_an_interrupted_cutting_leaves_nothing_that_is_taken_for_crops(tmp_path, monkeypatch):
    whole = yard(tmp_path).train
    cut = tmp_path / "other"

    def breaks(_, after):
        for frame in VideoReader(tmp_path / "yard" / "C1.mp4", after=after):
            if frame.number == 20:
                raise KeyboardInterrupt
            yield frame

    with monkeypatch.context() as patch:
        patch.setattr(cutting, "VideoReader", breaks)
        with pytest.raises(KeyboardInterrupt):
            again(tmp_path, "other")
    assert not [*cut.rglob("*.png")]
    killed = cut / "yard" / "C1" / ".killed.part"
    killed.mkdir()
    assert [path.name for path in again(tmp_path, "other").train.paths] == [path.name for path in whole.paths]
    assert not killed.exists()


def scene_file(folder, mode):
    """A scene file whose third camera has no boxes."""
    text = "".join(
        f'[cameras.{name}]\nintrinsics = "rig.toml"\nvideo = "{name}.mp4"\ntracks = "{name}.txt"\n' for name in ("C1", "C2")
    )
    text += '[cameras.C3]\nintrinsics = "rig.toml"\nvideo = "C3.mp4"\nkeypoints = "C3.json"\n'
    (folder / "scene.toml").write_text(f'{text}[association]\nmode = "{mode}"\n')
    return folder / "scene.toml"


def test_a_scene_file_with_given_identities_or_with_those_of_each_camera(tmp_path):
    """C1: 4 and 9 together, then 9 and 5; C2: 4 alone."""
    folder = tmp_path / "yard"
    for camera in ("C1", "C2"):
        film(folder / f"{camera}.mp4")
    tracks(folder / "C1.txt", two_walkers(1, 12) + two_walkers(13, 30, (5, 9)))
    tracks(folder / "C2.txt", [row for row in two_walkers() if row[1] == 4])
    data = read_data(scene_file(folder, "given"), tmp_path / "cache")
    assert (data.train.people, data.train.apart) == (("yard/4", "yard/5", "yard/9"), None)
    seen = {(int(person), int(camera)) for person, camera in zip(data.train.person, data.train.camera, strict=True)}
    assert seen == {(0, 0), (1, 0), (2, 0), (0, 1)}
    data = read_data(scene_file(folder, "combined"), tmp_path / "cache")
    people = data.train.people
    assert (data.name, people) == ("yard", ("yard/C1-4", "yard/C1-5", "yard/C1-9", "yard/C2-4"))
    pairs = {(people[a][5:], people[b][5:]) for a, b in np.argwhere(data.train.apart)}
    assert pairs == {("C1-4", "C1-9"), ("C1-9", "C1-4"), ("C1-5", "C1-9"), ("C1-9", "C1-5")}
    assert any("camera C3 has no tracks: left out" in note for note in data.notes)


def test_clear_boxes_alone_are_cut_and_a_few_of_many_evenly_spread():
    boxes = {
        "clear": (20, 10, 20, 50, True),
        "behind the next": (60, 10, 20, 50, False),
        "before it": (62, 14, 20, 50, True),
        "beside it": (75, 10, 20, 50, True),
        "small": (120, 10, 7, 50, False),
        "low": (130, 10, 9, 15, False),
        "mostly outside": (-12, 10, 20, 50, False),
        "half outside": (150, 60, 19, 40, True),
    }
    table = np.array(list(boxes.values()), dtype=float)
    ltwh, clear = table[:, :4], table[:, 4] == 1
    one_frame, order = np.full(len(boxes), 7), np.random.default_rng(0).permutation(len(boxes))
    assert dict(zip(boxes, find_clear_boxes(one_frame, ltwh, SIZE), strict=True)) == dict(zip(boxes, clear, strict=True))
    np.testing.assert_array_equal(find_clear_boxes(one_frame, ltwh[order], SIZE), clear[order])
    # In frames of their own no one is before anybody.
    assert find_clear_boxes(np.arange(len(boxes)), ltwh, SIZE)[list(boxes).index("behind the next")]
    frame, person, usable = np.tile(np.arange(1, 101), 3), np.repeat([0, 1, -1], 100), np.ones(300, dtype=bool)
    usable[100:197] = False
    rows = spread_rows(frame, person, usable, at_most=10)
    shown = {who: frame[rows[person[rows] == who]].tolist() for who in (0, 1, -1)}
    assert shown == {0: list(range(6, 106, 10)), 1: [98, 99, 100], -1: []}
    assert not len(spread_rows(frame, person, ~np.ones(300, dtype=bool)))


def test_boxes_beyond_the_end_of_the_video_and_people_without_clear_frames_are_named(tmp_path):
    data = yard(tmp_path, two_walkers(11, 34))
    assert len(data.train) == 40
    assert "8 of 48 boxes are of frames that it does not have" in data.notes[0]
    assert "frames 31 to 34" in data.notes[0]
    data = yard(tmp_path, two_walkers() + [(frame, 7, 70.0, 90.0, 5.0, 10.0) for frame in range(1, 31)])
    assert data.train.people == ("yard/4", "yard/9")
    assert data.notes == ("1 people without two clear frames, kept out of the training: yard/7",)


def mot(folder, rows):
    """A MOT17 sequence of 10 pictures, the rows of its gt.txt as they are given."""
    for part in ("img1", "gt"):
        (folder / part).mkdir(parents=True)
    for frame in range(1, 11):
        assert cv2.imwrite(str(folder / "img1" / f"{frame:06d}.png"), scene(frame))
    (folder / "gt" / "gt.txt").write_text("".join(",".join(map(str, row)) + "\n" for row in rows))
    (folder / "seqinfo.ini").write_text(f"[Sequence]\nname={folder.name}\nimDir=img1\nframeRate=30\nseqLength=10\nimExt=.png\n")
    return folder


def mot_rows():
    """By identity, as MOT17 has them: 1 and 2 are pedestrians, 2 hidden at first; 3 is no pedestrian, 4 is to be ignored."""
    rows = [(frame, 1, 11 + frame, 21, 20, 50, 1, 1, 1.0) for frame in range(1, 11)]
    rows += [(frame, 2, 101 - frame, 21, 20, 50, 1, 1, 0.2 if frame < 6 else 0.9) for frame in range(1, 11)]
    rows += [(frame, 3, 60, 11, 20, 50, 1, 7, 1.0) for frame in range(1, 11)]
    return rows + [(frame, 4, 60, 61, 20, 50, 0, 1, 1.0) for frame in range(1, 11)]


def test_motchallenge_sequences(tmp_path):
    train = read_data(mot(tmp_path / "MOT17-02-FRCNN", mot_rows()), tmp_path / "cache").train
    assert [name.split("/")[1] for name in train.people] == ["MOT17-02-FRCNN-1", "MOT17-02-FRCNN-2"]
    assert np.bincount(train.person).tolist() == [10, 5]
    assert train.apart[0, 1]
    # The first pixel counts as 1 there: the box of frame 1 begins at column 11, row 20.
    np.testing.assert_array_equal(cv2.imread(str(train.paths[0])), scene(1)[20:70, 11:31])
    # Pictures that cannot be read are as if they were not there.
    folder = mot(tmp_path / "seq", mot_rows())
    (folder / "img1" / "000007.png").write_bytes(b"")
    picture(folder / "img1" / "cover.png")
    data = read_data(folder, tmp_path / "cache")
    assert np.bincount(data.train.person).tolist() == [9, 4]
    assert "2 of 15 boxes" in data.notes[0]
    # Every sequence once; a person of one sequence may be one of another.
    for name in ("MOT17-02-DPM", "MOT17-02-FRCNN", "MOT17-04-DPM"):
        mot(tmp_path / "MOT17" / name, mot_rows())
    train = read_data(tmp_path / "MOT17", tmp_path / "cache").train
    assert train.cameras == ("MOT17/MOT17-02-DPM", "MOT17/MOT17-04-DPM")
    assert int(train.apart.sum()) == 4


def videos(folder, rows):
    film(folder / "C1.mp4", count=5)
    for camera in ("C1", "C2"):
        tracks(folder / f"{camera}.txt", rows)
    return folder


def with_content(folder, name, content):
    (videos(folder, two_walkers(1, 5)) / name).write_bytes(content)


def without_text(folder):
    for text in videos(folder, two_walkers(1, 5)).glob("*.txt"):
        text.unlink()


def mot_without(folder, part):
    shutil.rmtree(mot(folder, mot_rows()) / part)


def scene_of(folder, tracks):
    path = scene_file(videos(folder, two_walkers(1, 5)), "combined")
    path.write_text(path.read_text().replace("tracks", tracks))
    (folder / "C1.mp4").unlink()
    return path


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (without_text, "yard: holds videos, but no tracks of people"),
        (lambda folder: scene_of(folder, "tracks"), "C1.mp4: .* no such file|C1.mp4: no such file"),
        (lambda folder: scene_of(folder, "detections"), "no camera has both `video` and `tracks`"),
        (lambda folder: videos(folder, [(1, -1, 10.0, 10.0, 20.0, 50.0)]), "none is left to learn from"),
        (lambda folder: videos(folder, two_walkers(50, 60)), "none is left to learn from"),
        (lambda folder: mot_without(folder, "gt"), "gt.txt: no such file"),
        (lambda folder: mot_without(folder, "img1"), "img1: no such folder"),
        (lambda folder: mot(folder, ["abc"]), "gt.txt: is not MOTChallenge text"),
        (lambda folder: mot(folder, mot_rows()[:1] * 2), "gt.txt: identity 1 is in frame 1 twice"),
        *((lambda folder, row=row: mot(folder, [*mot_rows(), row]),
           r"gt\.txt: frame .*, id .*: whole numbers are needed, of frames from 0 on")
          for row in ((-1, 1, 10, 10, 20, 50, 1, 1, 1), (1.5, 1, 10, 10, 20, 50, 1, 1, 1), (1, 0.5, 10, 10, 20, 50, 1, 1, 1))),
        (lambda folder: with_content(folder, "C1.txt", b"1,2,3\n"), "C1.txt: line 1"),
        (lambda folder: with_content(folder, "C1.mp4", b"no video"), "C1.mp4"),
    ],
)  # fmt: skip
def test_what_is_wrong_is_named(tmp_path, make, message):
    made = make(tmp_path / "yard")
    with pytest.raises(InputError, match=message):
        read_data(made if made and made.is_file() else tmp_path / "yard", tmp_path / "cache")


@pytest.mark.parametrize(
    ("lines", "said"),
    [
        *((f"imDir={name}\n", r"imDir is [ai].*\.\.\.: no such folder") for name in ("i" * 5000, "i - " * 500, "a/" * 300)),
        (f"{'a ' * 500}=1\n" * 2, "is not a description of a sequence: .* a a"),
    ],
)
def test_what_is_no_description_of_a_sequence_is_named_in_short(lines, said, tmp_path):
    (mot(tmp_path / "yard", mot_rows()) / "seqinfo.ini").write_text(f"[Sequence]\n{lines}")
    with pytest.raises(InputError, match=rf"yard/seqinfo\.ini: {said}") as raised:
        again(tmp_path)
    assert len(str(raised.value).replace(str(tmp_path), "")) < 250


def test_what_cut_crops_refuses(tmp_path):
    video = film(tmp_path / "C1.mp4", count=3)
    box = np.array([[10.0, 10, 20, 50]] * 2)

    def cut(frame, person, ltwh=box, people=("a b", "a/b"), place="cache"):
        wanted = WantedCrops("C 1", video, np.array(frame), ltwh, np.array(person))
        return cut_crops([wanted], people, tmp_path / place, name="set").crops

    for frame, person, told in (
        ([2, 2], [0, 0], "a b is in frame 2 twice"),
        ([2], [0], "a row each"),
        ([2, 2], [1, 2], "rows 1 to 2 are not of 2 people"),
    ):
        with pytest.raises(InputError, match=told):
            cut(frame, person)
    crops = cut([2, 2], [0, 1])
    assert len({path.name for path in crops.paths}) == 2  # names that are alike as names of files
    assert (crops.people, crops.cameras) == (("set/a b", "set/a/b"), ("set/C 1",))
    assert not len(cut([], [], np.zeros((0, 4))))
    if os.geteuid():
        (tmp_path / "closed").mkdir(mode=0o500)
        with pytest.raises(InputError, match="cannot be written"):
            cut([1], [0], box[:1], place="closed")
