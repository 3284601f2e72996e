"""Acts through the server: acknowledged ones are in the file, stale and wrong ones change nothing."""

import numpy as np
import pytest

from passerby.calibration.alignment.scene_world import align_rig
from passerby.core.cameras import Rig
from passerby.interchange.rig_toml import read_rig, write_rig
from passerby.scene.check import check_scene
from passerby.scene.scene import Scene
from passerby.scene.world_tables import WorldTable

from .conftest import act, middle, refusal, scene_of


@pytest.fixture
def truth(session):
    return read_rig(session.scene_file.parent / "truth.toml")


def length(rig, metres=None):
    """A length on the ground that two cameras see, as an act."""
    ends = middle(rig) + np.array([[-0.5, -1.0, 0.0], [0.5, 1.0, 0.0]])
    points = {name: rig[name].project(ends).round(2).tolist() for name in rig.names[:2]}
    return {"act": "length", "metres": metres or float(np.linalg.norm(ends[1] - ends[0])), "points": points}


def clicks_on_ground(rig):
    """Two places on the ground, and clicks on them in the first camera."""
    ends, first = middle(rig) + np.array([[0.3, -1.0, 0], [1.0, 2.0, 0]]), rig.names[0]
    return ends, [{"camera": first, "at": rig[first].project(one)[0].tolist()} for one in ends]


def test_corrections_of_identities_are_in_the_file_and_can_be_removed(client, session):
    boxes = [{"camera": "C1", "frame": 5, "at": [10.0, 20.125]}, {"camera": "C2", "frame": 6, "at": [30.0, 20.0]}]
    assert "correct the ids there" in refusal(act(client, session, act="identities", key="same", boxes=boxes))
    session.scene_file.write_text(session.scene_file.read_text().replace('mode = "given"', 'mode = "combined" # no ids'))
    lines = session.scene_file.read_text().splitlines()
    for key in ("same", "different"):
        assert act(client, session, act="identities", key=key, boxes=boxes).status == 200
    state = act(client, session, act="not_people", box=boxes[0]).json()
    boxes[0]["at"][1] = 20.12
    corrected = {"same": [{"boxes": boxes}], "different": [{"boxes": boxes}], "not_people": boxes[:1]}
    assert (state["same"], state["not_people"]) == (corrected["same"], corrected["not_people"])
    assert scene_of(session)["association"] == {"mode": "combined"} | corrected
    assert set(lines) <= set(session.scene_file.read_text().splitlines())
    assert act(client, session, act="identities", key="same", boxes=boxes[:1]).status == 422
    assert act(client, session, act="identities", key="all", boxes=boxes).status == 422
    for key in corrected:
        assert act(client, session, act="remove", key=key, number=1).status == 200
    assert scene_of(session)["association"] == {"mode": "combined"}


def test_a_line_is_measured_and_written(client, session, truth):
    places = middle(truth) + np.array([[0.0, 0.0, 0.0], [0.0, 0.0, 2.0]])
    points = {truth.names[0]: truth[truth.names[0]].project(places).round(2).tolist()}
    told = client.post("/api/line", {"direction": "vertical", "points": points}).json()
    assert told["off_deg"] < 3 * told["sigma_deg"] + 1
    assert client.post("/api/line", {"direction": "up", "points": {}}).status == 422
    state = act(client, session, act="line", direction="vertical", points=points).json()
    assert state["lines"] == [{"direction": "vertical", "points": points}]
    assert act(client, session, act="line", direction="horizontal", points=points).status == 422
    assert act(client, session, act="remove", key="lines", number=1).status == 200
    assert "world" not in scene_of(session)


@pytest.mark.parametrize(("key", "check"), [("lengths", False), ("checks", True)])
def test_an_acknowledged_length_is_in_the_file_and_in_the_state(client, session, truth, key, check):
    """It may only check the rig."""
    answer = act(client, session, **length(truth), check=check)
    (told,) = scene_of(session)["scale"][key]
    assert (answer.status, answer.json()["version"]) == (200, session.version)
    metres = {name: [one["metres"] for one in answer.json()[name]] for name in ("lengths", "checks")}
    assert metres == {"lengths": [], "checks": []} | {key: [told["metres"]]}
    assert len(getattr(Scene.load(session.scene_file).scale, key)) == 1
    assert act(client, session, act="remove", key=key, number=1).status == 200
    assert key not in scene_of(session).get("scale", {})


PERSON = {"act": "person", "frame": 1, "at": [1, 1]}


@pytest.mark.parametrize(
    ("content", "why"),
    [
        ({"act": "length", "metres": -1, "points": {}}, "greater than 0"),
        ({"act": "length", "metres": 1, "points": {"C1": [[1, 1], [2, 2]]}}, "at least 2"),
        ({"act": "length", "metres": 1, "points": {"C1": [[1, 1], [2, 2]], "C9": [[1, 1], [2, 2]]}}, "C9"),
        ({"act": "length", "metres": 1e999, "points": {}}, ""),
        ({**PERSON, "camera": "C9", "height_m": 1.8}, "C9"),
        ({**PERSON, "camera": "C1", "height_m": 18}, "less than 3"),
        ({"act": "leave_out", "camera": "C9"}, "not there"),
        ({"act": "remove", "key": "lengths", "number": 1}, "not there"),
        ({"act": "undo"}, "no act"),
        ({"act": "explode"}, "act"),
        ({"act": "moved", "camera": "C9", "at_s": 1, "keep": "before"}, "is not there"),
        ({"act": "moved", "camera": "C2", "at_s": -1, "keep": "before"}, "greater than or equal to 0"),
        ({"act": "moved", "camera": "C2", "at_s": 1, "keep": "both"}, "before"),
        ({"act": "moved", "camera": "C2", "at_s": 2, "keep": "before"}, "nothing would be left"),
    ],
)  # fmt: skip
def test_a_wrong_act_is_refused_with_a_sentence(client, session, content, why):
    text = session.scene_file.read_text()
    session.scene_file.write_text(text.replace("[cameras.C2]\n", "[cameras.C2]\nfrom_s = 3.0\n"))
    before = session.scene_file.read_bytes()
    assert why in refusal(act(client, session, **content))
    assert session.scene_file.read_bytes() == before


@pytest.mark.parametrize("body", [b"[", b"1", b"[]", b"null", b'{"act": {}}', b"[" * 5000])
def test_a_body_that_is_no_act_is_refused(client, body):
    for path in ("act", "epipolar", "length", "ground", "axis", "person", "plan/fit"):
        assert client.post(f"/api/{path}", body).status == 422


def test_undo_takes_back_act_after_act_byte_for_byte(client, session, truth):
    texts = [session.scene_file.read_bytes()]
    act(client, session, **length(truth))
    texts.append(session.scene_file.read_bytes())
    act(client, session, act="person", camera="C1", frame=3, at=[100, 100], height_m=1.8)
    texts.append(session.scene_file.read_bytes())
    assert act(client, session, act="leave_out", camera="C4").json()["cameras"] == ["C1", "C2", "C3"]
    for before in reversed(texts):
        assert client.get("/api/state").json()["can_undo"]
        assert act(client, session, act="undo").json()["cameras"] == ["C1", "C2", "C3", "C4"]
        assert session.scene_file.read_bytes() == before
    assert not client.get("/api/state").json()["can_undo"]


def test_a_stale_act_changes_nothing_and_what_an_editor_wrote_is_never_undone(client, session, truth):
    act(client, session, **length(truth))
    seen = session.version
    session.scene_file.write_text(session.scene_file.read_text() + "\n# by an editor\n")
    before = session.scene_file.read_bytes()
    answer = act(client, session, seen, **length(truth))
    assert answer.status == 409
    assert "changed meanwhile" in answer.json()["error"]
    assert not client.get("/api/state").json()["can_undo"]
    assert act(client, session, act="undo").status == 422
    assert session.scene_file.read_bytes() == before


def test_two_clicks_set_the_frame_that_the_command_line_then_finds(client, session, truth):
    ends, clicks = clicks_on_ground(truth)
    assert "farther away" in refusal(act(client, session, act="world", origin=clicks[0], along_x=clicks[0]))
    assert act(client, session, act="world", origin=clicks[0], along_x=clicks[1]).status == 200
    points = session.scene_file.parent / scene_of(session)["world"]["points"]
    motion = align_rig(truth, WorldTable(points=points)).motion
    moved = [motion.scale * motion.rotation @ one + motion.translation for one in ends]
    assert moved[0] == pytest.approx([0, 0, 0], abs=2e-3)
    assert moved[1] == pytest.approx([np.linalg.norm(ends[1] - ends[0]), 0, 0], abs=2e-3)


@pytest.mark.parametrize("length_first", [False, True])
def test_a_marked_length_corrects_the_distance_of_the_two_clicks(client, session, truth, length_first):
    """The rig is a tenth too small: the frame's points must fit the one that the length will make."""
    small = truth.moved(np.eye(3), np.zeros(3), 0.9)
    write_rig(session.out / "rig.toml", Rig(small.cameras))
    ends, clicks = clicks_on_ground(truth)
    world = {"act": "world", "origin": clicks[0], "along_x": clicks[1]}
    for one in [length(truth), world] if length_first else [world, length(truth)]:
        assert act(client, session, **one).status == 200
    rows = (session.scene_file.parent / scene_of(session)["world"]["points"]).read_text().splitlines()
    assert float(rows[2].split(",")[4]) == pytest.approx(np.linalg.norm(ends[1] - ends[0]), rel=2e-3)


def test_geometry_is_answered_by_the_rig(client, truth):
    marks = length(truth)
    found = client.post("/api/length", marks["points"]).json()
    assert found["metres"] == pytest.approx(marks["metres"], rel=1e-3)
    lines = client.post("/api/epipolar", {"camera": "C1", "at": marks["points"]["C1"][0]}).json()["lines"]
    assert {one["camera"] for one in lines} == {"C2", "C3", "C4"}


def test_the_part_of_a_moved_camera_that_is_kept_is_all_that_is_read_until_all_is_kept_again(client, session):
    """At 2 s and 5 frames a second the camera is at its frame 11; the recording has 20 frames."""
    before = session.scene_file.read_bytes()
    for keep, key, frames in (("before", "until_s", (1, 11)), ("after", "from_s", (11, 20))):
        answer = act(client, session, act="moved", camera="C2", at_s=2.004, keep=keep)
        assert answer.status == 200
        assert answer.json()["limits"] == {"C1": {}, "C2": {key: 2.0}, "C3": {}, "C4": {}}
        assert scene_of(session)["cameras"]["C2"][key] == 2.0
        read = next(one for one in check_scene(session.scene_file).cameras if one.name == "C2")
        assert (read.first_frame, read.last_frame) == frames
        assert act(client, session, act="undo").status == 200
        assert session.scene_file.read_bytes() == before
    act(client, session, act="moved", camera="C2", at_s=1, keep="after")
    act(client, session, act="moved", camera="C2", at_s=3, keep="before")
    assert act(client, session, act="keep_all", camera="C2", key="from_s").json()["limits"]["C2"] == {"until_s": 3.0}
    act(client, session, act="keep_all", camera="C2", key="until_s")
    assert session.scene_file.read_bytes() == before
    assert act(client, session, act="keep_all", camera="C2", key="until_s").status == 422
