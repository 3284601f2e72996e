"""`[world.plan]` as lines of the scene file: what is not changed stays byte for byte, in whatever form it was written."""

import re
import tomllib

import pytest
import tomlkit

from passerby.common.errors import InputError
from passerby.page.plan_acts import remove_plan, write_plan
from passerby.page.scene_edits import add_line

KERB = {"name": "kerb", "at": [9.0, 9.0], "pixels": {"C1": [1.0, 1.0]}}
WANTED = {
    "image": "plan-1.png", "metres_per_pixel": 0.02, "cameras": {"C1": [1.0, 2.0], "gate 2": [30.5, 40.0]},
    "points": [{"at": [5.0, 6.0], "pixels": {"C1": [7.0, 8.0]}}, KERB],
}  # fmt: skip
TEXT = """# The terrace.
[cameras.C1]
video = "a.mp4"  # north

[cameras."gate 2"]
video = "b.mp4"

[scale]
person_height_m = 1.7 # by tape
"""
PLANNED = """
[world]   # by us
scale = true

[world.plan] # the surveyor's
image = "plan-1.png"   # sheet 3
metres_per_pixel = 0.02
sd_px = 3  # a thick pen
cameras = { C1 = [1, 2], "gate 2" = [30.5, 40.0] } # on poles

# The kerb stone.
[[world.plan.points]]
at = [5, 6]
pixels = { C1 = [7, 8] } # sharp

[[world.plan.points]]
name = "kerb"
at = [9, 9]
pixels = { C1 = [1, 1] }

[association]
mode = "given"
"""


def plan_of(text):
    return tomllib.loads(text)["world"]["plan"]


def test_a_plan_is_added_and_every_line_stays():
    text = write_plan(TEXT, WANTED)
    assert text.startswith(TEXT)
    assert plan_of(text) == WANTED
    assert write_plan(TEXT + PLANNED, WANTED) == TEXT + PLANNED, "a plan that stays the same changes no byte"


@pytest.mark.parametrize(
    "world", ['[world] # old\ncamera = "C1"\n', '[world]\npoints = "p.csv"\nscale = true\n', 'world = { camera = "C1" }\n']
)
def test_a_plan_replaces_what_set_the_world_before(world):
    text = write_plan(world + TEXT, WANTED)
    assert tomllib.loads(text)["world"] == {"plan": WANTED}
    assert TEXT.splitlines()[-1] in text


def test_only_what_changes_is_written_anew():
    points = [WANTED["points"][0], {"at": [3.0, 3.0], "pixels": {"C1": [4.0, 4.0]}}]
    wanted = {**WANTED, "cameras": {"C1": [1.5, 2.0]}, "points": points}
    text = write_plan(TEXT + PLANNED, wanted)
    assert tomllib.loads(text)["world"] == {"scale": True, "plan": {**wanted, "sd_px": 3}}
    kept = ("by us", "the surveyor's", "sheet 3", "a thick pen", "on poles", "The kerb stone.", "sharp")
    assert all(f"# {one}" in text for one in kept)
    assert 'mode = "given"' in text


def test_metres_per_pixel_give_way_to_a_distance_and_back():
    distance = {"between": [[0.0, 0.0], [100.0, 0.0]], "metres": 2.0}
    by_distance = {key: one for key, one in WANTED.items() if key != "metres_per_pixel"} | {"distance": distance}
    text = write_plan(TEXT + PLANNED, by_distance)
    assert plan_of(text) == {**by_distance, "sd_px": 3}
    assert plan_of(write_plan(text, WANTED)) == {**WANTED, "sd_px": 3}


@pytest.mark.parametrize(
    "plan",
    [
        'world = { plan = { image = "p.png", metres_per_pixel = 1, sd_px = 3, cameras = { C1 = [1, 2], D = [3, 4] } } }\n',
        'world.plan.image = "p.png"\nworld.plan.metres_per_pixel = 1\nworld.plan.sd_px = 3\nworld.plan.cameras = { C1 = [1, 2] }\n',  # noqa: E501
        '[world.plan]\nimage = "p.png"\nmetres_per_pixel = 1\nsd_px = 3\npoints = [{ at = [1, 2], pixels = { C1 = [1, 2] } }]\n',  # noqa: E501
        '[world.plan]\nimage = "p.png"\nsd_px = 3\ndistance.between = [[0, 0], [1, 1]]\ndistance.metres = 4\n'
        '[world.plan.cameras]\nC1 = [1, 1]\nD = [2, 2]\n',
    ],
)  # fmt: skip
def test_a_plan_in_any_form_is_changed(plan):
    text = write_plan(plan + TEXT, WANTED)
    assert plan_of(text) == {**WANTED, "sd_px": 3}
    assert tomllib.loads(text)["scale"] == {"person_height_m": 1.7}
    assert "# The terrace." in text


@pytest.mark.parametrize("key", ["image", "cameras"])
def test_a_plan_that_would_be_mangled_is_refused(monkeypatch, key):
    """A library that loses a line of an odd file must not lose a user's: the new text is read again before it is written."""
    dumps = tomlkit.dumps
    monkeypatch.setattr(tomlkit, "dumps", lambda one: re.sub(f"(?m)^{key} = .*$", "", dumps(one)))
    with pytest.raises(InputError, match="in an editor"):
        write_plan(TEXT + PLANNED, {**WANTED, "metres_per_pixel": 0.03})


def test_an_origin_stays_with_its_picture():
    text = (TEXT + PLANNED).replace("sd_px = 3", "origin = [4, 5]\nsd_px = 3")
    assert plan_of(write_plan(text, {**WANTED, "metres_per_pixel": 0.03}))["origin"] == [4, 5]
    assert "origin" not in plan_of(write_plan(text, {**WANTED, "image": "plan-2.png"}))


def test_the_ends_of_lines_stay():
    text = write_plan((TEXT + PLANNED).replace("\n", "\r\n"), {**WANTED, "metres_per_pixel": 0.03})
    assert plan_of(text)["metres_per_pixel"] == 0.03
    assert text.count("\r\n") == (TEXT + PLANNED).count("\n")


def test_a_plan_is_taken_out_and_all_else_stays():
    text = remove_plan(TEXT + PLANNED)
    assert "world" not in tomllib.loads(text)
    assert text.startswith(TEXT)
    assert 'mode = "given"' in text
    with pytest.raises(InputError, match="not there"):
        remove_plan(TEXT)
    with pytest.raises(InputError, match="editor"):
        write_plan("[scale", WANTED)


def test_lines_stay_when_a_plan_comes_and_goes():
    post = {"direction": "vertical", "points": {"C1": [[1.0, 2.0], [1.5, 90.0]]}}
    along = {"direction": "x", "points": {"C1": [[10.0, 2.0], [90.0, 3.0]]}}
    lined = add_line(add_line(TEXT, "vertical", post["points"]), "x", along["points"])
    assert tomllib.loads(lined)["world"]["lines"] == [post, along]
    planned = write_plan(lined, WANTED)
    assert tomllib.loads(planned)["world"] == {"plan": WANTED, "lines": [post]}
    assert tomllib.loads(remove_plan(planned))["world"] == {"lines": [post]}
