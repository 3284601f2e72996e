"""A calibration from videos that is stopped at any moment, and goes on to the same bits."""

import signal

import pytest

import killed
from filmed import film, puppets, scene_file
from killed import calibrate, content


@pytest.fixture(scope="module")
def scene(tmp_path_factory):
    """Two cameras, half a minute, 90 pictures each."""
    folder = tmp_path_factory.mktemp("resume")
    made = puppets(30.0, 3.0, 2, 4)
    film(made, folder)
    return scene_file(folder, {name: f"{name}.mp4" for name in made.rig.names})


@pytest.fixture(scope="module")
def whole(scene):
    """A run that nothing stopped."""
    out = scene.parent / "whole"
    ended = calibrate(scene, out)
    assert ended.status == 0, ended.errors
    assert not ended.errors
    return ended, content(out)


def halves(out):
    """Temporary files."""
    return [path for path in out.rglob("*") if path.name.endswith(".part")]


def test_killed_again_and_again_it_ends_in_the_same_bits(scene, whole, tmp_path):
    _, files = whole
    assert set(files) == {"rig.toml", "calibration.json", "tracks/C1.txt", "tracks/C2.txt"}
    moments = [("background", 1), ("file", 1), ("detection", 40), ("file", 3), ("name", 4), ("picture", 100), ("embedding", 5),
               ("people of each camera", 2), ("solving", 1), ("tracks", 2), ("rig", 1), ("file", 3)]  # fmt: skip
    for moment in moments:
        assert calibrate(scene, tmp_path, moment).killed, f"{moment} does not come"
        assert not (tmp_path / "calibration.json").exists()
    last = calibrate(scene, tmp_path)
    assert last.seen["detection"] == last.seen["picture"] == 0, "all was kept"
    assert content(tmp_path) == files


def test_no_more_than_a_segment_is_made_twice(scene, whole, tmp_path):
    ended, files = whole
    assert calibrate(scene, tmp_path, ("detection", 40)).killed
    rest = calibrate(scene, tmp_path)
    assert rest.seen["background"] == 1, "that of the first camera was learnt"
    # Of the first camera, 39 pictures were done.
    assert rest.seen["detection"] == ended.seen["detection"] - 39 // killed.SEGMENT * killed.SEGMENT
    assert content(tmp_path) == files
    assert not halves(tmp_path)


@pytest.mark.parametrize("moment", [("detection", 100), ("solving", 1)], ids=lambda moment: moment[0])
def test_interrupted_it_says_so_and_goes_on(scene, whole, tmp_path, moment):
    stopped = calibrate(scene, tmp_path, moment, signal.SIGINT)
    assert stopped.status == 130
    assert stopped.errors == "error: interrupted\n"
    assert not content(tmp_path)
    assert not halves(tmp_path)
    assert calibrate(scene, tmp_path).status == 0
    assert content(tmp_path) == whole[1]


EVENTS = ("picture", "detection", "embedding", "file", "name", "people of each camera", "looks", "pairs of cameras", "solving",
          "tracks", "rig", "writing")  # fmt: skip


@pytest.mark.slow
@pytest.mark.parametrize("share", [0.0, 0.2, 0.45, 0.7, 1.0])
@pytest.mark.parametrize("event", EVENTS)
def test_killed_at_any_moment_it_ends_in_the_same_bits(scene, whole, tmp_path, event, share):
    ended, files = whole
    count = ended.seen[event]
    assert count
    moment = event, 1 + round(share * (count - 1))
    assert calibrate(scene, tmp_path, moment).killed
    assert calibrate(scene, tmp_path).status == 0
    assert content(tmp_path) == files
