"""A plan through the server: a draft is tried on the rig, saved into the scene file, undone, refused where it is none."""

import json

import numpy as np
import pytest

from passerby.interchange.rig_toml import read_rig, write_rig
from passerby.page.session import Session
from passerby.scene.scene import Scene

from .conftest import Client, act, scene_of
from .plan_support import UNIT, DrawnPlan


@pytest.fixture
def plan(session):
    return DrawnPlan(read_rig(session.scene_file.parent / "truth.toml"))


@pytest.fixture
def image(client, plan):
    return client.post("/api/plan/upload", plan.png).json()["image"]


@pytest.fixture
def spot(plan):
    """Amid the cameras, on the ground."""
    return np.mean([camera.centre for camera in plan.truth], axis=0) * [1, 1, 0]


def fit(client, draft):
    return client.post("/api/plan/fit", json.dumps(draft).encode())


def draft_of(plan, image, spot):
    cameras, points = plan.cameras("C1", "C3"), [plan.point(spot, "C1", "C2")]
    return {"image": image, "metres_per_pixel": UNIT, "cameras": cameras, "points": points}


def test_a_saved_plan_is_in_the_file_and_in_the_state_until_it_is_undone(client, session, plan, image, spot):
    before = session.scene_file.read_bytes()
    answer = act(client, session, act="plan", plan=draft_of(plan, image, spot))
    assert answer.status == 200
    told, state = Scene.load(session.scene_file).world.plan, answer.json()
    assert (told.image.name, set(told.cameras)) == (image, {"C1", "C3"})
    assert (state["world"], state["plan"]["name"]) == ("plan", image)
    assert state["plan"]["cameras"]["C1"] == plan.cameras("C1")["C1"]
    assert str(session.scene_file.parent) not in answer.body.decode()
    assert act(client, session, act="undo").status == 200
    assert session.scene_file.read_bytes() == before


def test_a_draft_shows_every_camera_on_the_plan_before_it_is_saved(client, session, plan, image, spot):
    write_rig(session.out / "rig.toml", plan.truth.moved(np.eye(3), np.zeros(3), 1.25))
    before = session.version
    told = fit(client, draft_of(plan, image, spot)).json()
    assert session.version == before
    assert told["scale_percent"] == pytest.approx(-20, abs=0.5)
    for one in told["cameras"]:
        assert one["at"] == pytest.approx(plan.pixel(plan.truth[one["name"]].centre), abs=2)
        assert len(one["seen"]) > 3
    placed = {(one["point"], one["camera"]) for one in told["placements"]}
    assert placed == {(None, "C1"), (None, "C3"), ("1", "C1"), ("1", "C2")}
    assert all(one["off_m"] < 0.05 and one["used"] for one in told["placements"])


def test_a_wrong_placement_is_named_before_it_is_saved(client, session, plan, image, spot):
    draft = draft_of(plan, image, spot)
    draft["cameras"] = plan.cameras("C1", "C2", "C3", "C4")
    draft["cameras"]["C2"][0] -= 150
    told = fit(client, draft).json()
    (wrong,) = [one for one in told["placements"] if not one["used"]]
    assert wrong["camera"] == "C2"
    assert wrong["off_m"] == pytest.approx(150 * UNIT, abs=0.1)
    assert any("C2" in one for one in told["notes"])


def test_placements_are_changed_and_removed_and_the_picture_stays(client, session, plan, image, spot):
    act(client, session, act="plan", plan=draft_of(plan, image, spot))
    draft = {**draft_of(plan, None, spot), "points": [], "cameras": plan.cameras("C1", "C2", "C3")}
    assert act(client, session, act="plan", plan=draft).status == 200
    told = scene_of(session)["world"]["plan"]
    assert (told["image"], set(told["cameras"]), "points" in told) == (image, {"C1", "C2", "C3"}, False)
    assert act(client, session, act="remove_plan").status == 200
    assert "world" not in scene_of(session)
    assert act(client, session, act="remove_plan").status == 422


@pytest.mark.parametrize(
    ("change", "why"),
    [
        ({"metres_per_pixel": None}, "needs its scale"),
        ({"distance": {"between": [[0, 0], [9, 9]], "metres": 3}}, "needs its scale"),
        ({"metres_per_pixel": -1}, "greater than 0"),
        ({"metres_per_pixel": None, "distance": {"between": [[5, 5], [5, 5]], "metres": 3}}, "twice"),
        ({"cameras": {}}, "place two or more"),
        ({"cameras": {"C1": [5, 5], "C3": [99_000, 5]}}, "outside"),
        ({"cameras": {"C1": [5, 5], "C9": [50, 5]}}, "C9"),
        ({"points": [{"at": [5, 5], "pixels": {"C1": [9000, 9000]}}]}, "outside"),
        ({"image": "../truth.toml"}, "no such plan"),
        ({"image": "plan-" + "0" * 20 + ".png"}, "plan-0"),
        ({"image": None}, "no plan yet"),
        ({"extra": 1}, "not permitted"),
    ],
)
def test_what_is_no_plan_is_refused_with_a_sentence(client, session, plan, image, spot, change, why):
    before = session.scene_file.read_bytes()
    answer = act(client, session, act="plan", plan={**draft_of(plan, image, spot), **change})
    assert answer.status == 422
    assert why in answer.json()["error"]
    assert str(session.scene_file.parent) not in answer.json()["error"]
    assert session.scene_file.read_bytes() == before
    assert fit(client, {**draft_of(plan, image, spot), **change}).status == 422


def test_a_draft_without_a_rig_says_so_and_can_be_saved(client, session, plan, image, spot):
    (session.out / "rig.toml").unlink()
    assert "calibrate first" in fit(client, draft_of(plan, image, spot)).json()["error"]
    assert act(client, session, act="plan", plan=draft_of(plan, image, spot)).status == 200


def test_the_further_keys_of_a_plan_count_in_the_draft(client, session, plan, image, spot):
    act(client, session, act="plan", plan=draft_of(plan, image, spot))
    before = fit(client, draft_of(plan, None, spot)).json()["turn_sigma_deg"]
    text = session.scene_file.read_text().replace("[world.plan]\n", "[world.plan]\nsd_px = 20\n")
    session.scene_file.write_text(text)
    assert fit(client, draft_of(plan, None, spot)).json()["turn_sigma_deg"] > 3 * before


def test_a_plan_anywhere_is_shown_by_its_file_name_only(client, session, plan, tmp_path):
    (tmp_path / "elsewhere").mkdir()
    picture = tmp_path / "elsewhere" / "sheet.png"
    picture.write_bytes(plan.png)
    cameras = ", ".join(f"{name} = {at}" for name, at in plan.cameras("C1", "C3").items())
    with session.scene_file.open("a") as file:
        file.write(f'\n[world.plan]\nimage = "{picture}"\nmetres_per_pixel = {UNIT}\ncameras = {{ {cameras} }}\n')
    client = Client(Session(session.scene_file, session.out))
    state = client.get("/api/state")
    assert state.json()["plan"]["name"] == "sheet.png"
    assert b"elsewhere" not in state.body
    assert client.get("/api/plan/picture").json()["size"] == list(plan.size)
    assert client.get("/plan").headers["content-type"] == "image/png"
