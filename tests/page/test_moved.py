"""A camera that was moved while it filmed: one part of its recording is kept, with undo and Remove."""

import pytest

from passerby.scene.check import check_scene

from .conftest import act, scene_of


@pytest.mark.parametrize(("keep", "key", "frames"), [("before", "until_s", (1, 11)), ("after", "from_s", (11, 20))])
def test_the_part_that_is_kept_is_all_that_is_read(client, session, keep, key, frames):
    """At 2 s and 5 frames a second the camera is at its frame 11; the recording has 20 frames."""
    before = session.scene_file.read_bytes()
    answer = act(client, session, act="moved", camera="C2", at_s=2.004, keep=keep)
    assert answer.status == 200
    assert answer.json()["limits"] == {"C1": {}, "C2": {key: 2.0}, "C3": {}, "C4": {}}
    assert scene_of(session)["cameras"]["C2"][key] == 2.0
    read = next(one for one in check_scene(session.scene_file).cameras if one.name == "C2")
    assert (read.first_frame, read.last_frame) == frames
    assert act(client, session, act="undo").status == 200
    assert session.scene_file.read_bytes() == before


def test_all_is_kept_again(client, session):
    before = session.scene_file.read_bytes()
    act(client, session, act="moved", camera="C2", at_s=1, keep="after")
    act(client, session, act="moved", camera="C2", at_s=3, keep="before")
    assert act(client, session, act="keep_all", camera="C2", key="from_s").json()["limits"]["C2"] == {"until_s": 3.0}
    act(client, session, act="keep_all", camera="C2", key="until_s")
    assert session.scene_file.read_bytes() == before
    assert act(client, session, act="keep_all", camera="C2", key="until_s").status == 422


@pytest.mark.parametrize(
    ("content", "why"),
    [
        ({"camera": "C9", "at_s": 1, "keep": "before"}, "is not there"),
        ({"camera": "C2", "at_s": -1, "keep": "before"}, "greater than or equal to 0"),
        ({"camera": "C2", "at_s": 1, "keep": "both"}, "before"),
        ({"camera": "C2", "at_s": 2, "keep": "before"}, "nothing would be left"),
    ],
)
def test_a_part_that_cannot_be_is_refused(client, session, content, why):
    act(client, session, act="moved", camera="C2", at_s=3, keep="after")
    before = session.scene_file.read_bytes()
    answer = act(client, session, act="moved", **content)
    assert answer.status == 422
    assert why in answer.json()["error"]
    assert session.scene_file.read_bytes() == before
