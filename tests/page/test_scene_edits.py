"""Acts as lines of the scene file: what is not changed stays byte for byte, in whatever form it was written."""

import re
import tomllib

import pytest
import tomlkit

from passerby.common.errors import InputError
from passerby.interchange.world_files import read_known_points
from passerby.page import scene_edits as edits
from passerby.page.plan_acts import remove_plan, write_plan

MARKS = {"C1": [(1.0, 2.0), (3.0, 4.125)], "gate 2": [(5.0, 6.0), (7.0, 8.0)]}
TEXT = """# What the terrace has.
[scale]   # all of it measured
person_height_m = 1.7 # by tape

[cameras.C1]
video = "a.mp4"  # north

[cameras."gate 2"]
video = "b.mp4"
"""


def test_a_length_is_added_and_removed_by_its_number_and_every_other_line_stays():
    once = edits.add_length(TEXT, 3.25, 0.02, MARKS)
    assert all(line in once.splitlines() for line in TEXT.splitlines())
    twice = edits.add_length(once, 1.0, 0.01, MARKS)
    told = tomllib.loads(twice)["scale"]["lengths"]
    assert told[0] == {"metres": 3.25, "sd_m": 0.02, "points": {"C1": [[1, 2], [3, 4.12]], "gate 2": [[5, 6], [7, 8]]}}
    assert [one["metres"] for one in told] == [3.25, 1.0]
    assert [one["metres"] for one in tomllib.loads(edits.remove_entry(twice, "lengths", 1))["scale"]["lengths"]] == [1.0]
    with pytest.raises(InputError, match="3 is not there"):
        edits.remove_entry(twice, "lengths", 3)


def test_a_file_without_scale_gets_one_and_tables_written_in_one_line_are_continued_in_it():
    told = tomllib.loads(edits.add_person(TEXT[TEXT.index("[cameras.C1]") :], "C1", 311, (8.5, 4.0), 1.83, 0.01))
    assert told["scale"] == {"people": [{"camera": "C1", "frame": 311, "at": [8.5, 4.0], "height_m": 1.83, "sd_m": 0.01}]}
    inline = '[scale]\nlengths = [{metres = 1, points = {}}]\n[cameras.a]\nvideo = "x"\n'
    told = tomllib.loads(edits.add_length(inline, 2.0, 0.02, MARKS))
    assert [one["metres"] for one in told["scale"]["lengths"]] == [1, 2.0]
    assert told["cameras"] == {"a": {"video": "x"}}


def test_a_camera_that_is_left_out_stays_as_comments():
    text = edits.remove_camera(TEXT, "gate 2")
    assert list(tomllib.loads(text)["cameras"]) == ["C1"]
    again = "\n".join(line.removeprefix("# ") for line in text.splitlines() if "Left out" not in line and "What" not in line)
    assert tomllib.loads(again)["cameras"]["gate 2"] == {"video": "b.mp4"}


def test_a_world_frame_replaces_the_one_before_but_for_lines_that_are_not_of_its_heading():
    for before in (edits.set_world_points(TEXT, "a.csv"), f'{TEXT}\n[world]\ncamera = "C1"\n', ""):
        assert tomllib.loads(edits.set_world_points(before, "b.csv"))["world"] == {"points": "b.csv"}
    post, axis = {"C1": [(1.0, 2.0), (1.5, 90.0)]}, {"C1": [(10.0, 2.0), (90.0, 3.0)]}
    text = edits.add_line(edits.add_line(TEXT, "vertical", post), "x", axis)
    placed = tomllib.loads(edits.set_world_points(text, "a.csv"))["world"]
    assert placed == {"points": "a.csv", "lines": [{"direction": "vertical", "points": {"C1": [[1, 2], [1.5, 90]]}}]}
    assert "world" not in tomllib.loads(edits.remove_entry(edits.remove_entry(text, "lines", 2), "lines", 1))


def test_clicks_on_the_ground_are_read_as_known_points(tmp_path):
    places = {"C1": (10.25, 20.0)}, {'gate "2", b': (30.0, 40.5)}
    clicks = [
        edits.GroundClick(point, *next(iter(pixels.items())), x)
        for point, pixels, x in zip(("origin", "x axis"), places, (0.0, 7.5), strict=True)
    ]
    name = edits.write_points(tmp_path, clicks)
    assert edits.write_points(tmp_path, clicks) == name
    found = [(one.name, one.xyz.tolist(), dict(one.pixels)) for one in read_known_points(tmp_path / name)]
    assert found == [("origin", [0, 0, 0], places[0]), ("x axis", [7.5, 0, 0], places[1])]


def test_a_region_and_a_span_are_added_to_a_camera_and_removed_again():
    corners = [(1.0, 2.0), (3.126, 4.0), (5.0, 6.0)]
    text = TEXT
    for key, entry in (("exclude", corners), ("exclude", corners[::-1]), ("exclude_s", (1.5, 2.0))):
        text = edits.add_excluded(text, "gate 2", key, entry)
    assert all(line in text.splitlines() for line in TEXT.splitlines())
    camera = tomllib.loads(text)["cameras"]["gate 2"]
    assert (camera["exclude"][0], camera["exclude_s"]) == ([[1, 2], [3.13, 4], [5, 6]], [[1.5, 2.0]])
    once = edits.remove_excluded(text, "gate 2", "exclude", 1)
    assert tomllib.loads(once)["cameras"]["gate 2"]["exclude"] == [[[5, 6], [3.13, 4], [1, 2]]]
    none = edits.remove_excluded(edits.remove_excluded(once, "gate 2", "exclude", 1), "gate 2", "exclude_s", 1)
    assert tomllib.loads(none) == tomllib.loads(TEXT)
    with pytest.raises(InputError, match=r"exclude 3 is not there: it has 2"):
        edits.remove_excluded(text, "gate 2", "exclude", 3)
    with pytest.raises(InputError, match=r"\[cameras.gate\] is not there"):
        edits.add_excluded(TEXT, "gate", "exclude", corners)


def test_a_file_that_was_broken_or_written_otherwise_meanwhile_is_left_alone():
    """Somebody may edit it beside the page: what cannot be continued is named with where to correct it."""
    with pytest.raises(InputError, match=r"the scene file is not TOML: .*: correct it in an editor first"):
        edits.add_length("[scale\n", 1.0, 0.02, MARKS)
    with pytest.raises(InputError, match=r"\[scale\] lengths is no list of tables: write \[\[scale\.lengths\]\]"):
        edits.add_length("[scale]\nlengths = 3\n", 1.0, 0.02, MARKS)
    with pytest.raises(InputError, match=r"\[cameras\.C1\] exclude is no list: correct it in an editor first"):
        edits.add_excluded(TEXT.replace('"a.mp4"  # north', '"a.mp4"\nexclude = 3'), "C1", "exclude", [1.0, 2.0])


KERB = {"name": "kerb", "at": [9.0, 9.0], "pixels": {"C1": [1.0, 1.0]}}
WANTED = {
    "image": "plan-1.png", "metres_per_pixel": 0.02, "cameras": {"C1": [1.0, 2.0], "gate 2": [30.5, 40.0]},
    "points": [{"at": [5.0, 6.0], "pixels": {"C1": [7.0, 8.0]}}, KERB],
}  # fmt: skip
FINER = {**WANTED, "metres_per_pixel": 0.03}
PLANNED = f"""{TEXT}
[world]   # by us
scale = true

[world.plan] # the surveyor's
image = "plan-1.png"   # sheet 3
metres_per_pixel = 0.02
sd_px = 3  # a thick pen
cameras = {{ C1 = [1, 2], "gate 2" = [30.5, 40.0] }} # on poles

# The kerb stone.
[[world.plan.points]]
at = [5, 6]
pixels = {{ C1 = [7, 8] }} # sharp

[[world.plan.points]]
name = "kerb"
at = [9, 9]
pixels = {{ C1 = [1, 1] }}

[association]
mode = "given"
"""


def plan_of(text):
    return tomllib.loads(text)["world"]["plan"]


def test_a_plan_is_added_and_taken_out_and_every_other_line_stays():
    text = write_plan(TEXT, WANTED)
    assert text.startswith(TEXT)
    assert plan_of(text) == WANTED
    assert write_plan(PLANNED, WANTED) == PLANNED, "a plan that stays the same changes no byte"
    text = remove_plan(PLANNED)
    assert "world" not in tomllib.loads(text)
    assert text.startswith(TEXT)
    assert 'mode = "given"' in text
    with pytest.raises(InputError, match="not there"):
        remove_plan(TEXT)
    with pytest.raises(InputError, match="editor"):
        write_plan("[scale", WANTED)


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
    text = write_plan(PLANNED, wanted)
    assert tomllib.loads(text)["world"] == {"scale": True, "plan": {**wanted, "sd_px": 3}}
    kept = ("by us", "the surveyor's", "sheet 3", "a thick pen", "on poles", "The kerb stone.", "sharp")
    assert all(f"# {one}" in text for one in kept)
    assert 'mode = "given"' in text
    text = write_plan(PLANNED.replace("\n", "\r\n"), FINER)
    assert plan_of(text)["metres_per_pixel"] == 0.03
    assert text.count("\r\n") == PLANNED.count("\n"), "the ends of lines stay"


def test_metres_per_pixel_give_way_to_a_distance_and_back_and_an_origin_stays_with_its_picture():
    distance = {"between": [[0.0, 0.0], [100.0, 0.0]], "metres": 2.0}
    by_distance = {key: one for key, one in WANTED.items() if key != "metres_per_pixel"} | {"distance": distance}
    text = write_plan(PLANNED, by_distance)
    assert plan_of(text) == {**by_distance, "sd_px": 3}
    assert plan_of(write_plan(text, WANTED)) == {**WANTED, "sd_px": 3}
    text = PLANNED.replace("sd_px = 3", "origin = [4, 5]\nsd_px = 3")
    assert plan_of(write_plan(text, FINER))["origin"] == [4, 5]
    assert "origin" not in plan_of(write_plan(text, {**WANTED, "image": "plan-2.png"}))


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
    assert "# What the terrace has." in text


@pytest.mark.parametrize("key", ["image", "cameras"])
def test_a_plan_that_would_be_mangled_is_refused(monkeypatch, key):
    """A library that loses a line of an odd file must not lose a user's: the new text is read again before it is written."""
    dumps = tomlkit.dumps
    monkeypatch.setattr(tomlkit, "dumps", lambda one: re.sub(f"(?m)^{key} = .*$", "", dumps(one)))
    with pytest.raises(InputError, match="in an editor"):
        write_plan(PLANNED, FINER)


def test_lines_stay_when_a_plan_comes_and_goes():
    post = {"direction": "vertical", "points": {"C1": [[1.0, 2.0], [1.5, 90.0]]}}
    along = {"direction": "x", "points": {"C1": [[10.0, 2.0], [90.0, 3.0]]}}
    lined = edits.add_line(edits.add_line(TEXT, "vertical", post["points"]), "x", along["points"])
    assert tomllib.loads(lined)["world"]["lines"] == [post, along]
    planned = write_plan(lined, WANTED)
    assert tomllib.loads(planned)["world"] == {"plan": WANTED, "lines": [post]}
    assert tomllib.loads(remove_plan(planned))["world"] == {"lines": [post]}
