"""Acts as lines of the scene file."""

import tomllib

import pytest

from passerby.common.errors import InputError
from passerby.interchange.world_files import read_known_points
from passerby.page import scene_edits as edits

MARKS = {"C1": [(1.0, 2.0), (3.0, 4.125)], "gate 2": [(5.0, 6.0), (7.0, 8.0)]}
TEXT = """# What the terrace has.
[scale]   # all of it measured
person_height_m = 1.7 # by tape

[cameras.C1]
video = "a.mp4"  # north

[cameras."gate 2"]
video = "b.mp4"
"""


def test_a_length_is_added_and_every_other_line_stays():
    once = edits.add_length(TEXT, 3.25, 0.02, MARKS)
    assert all(line in once.splitlines() for line in TEXT.splitlines())
    told = tomllib.loads(edits.add_length(once, 1.0, 0.01, MARKS))["scale"]["lengths"]
    assert told[0] == {"metres": 3.25, "sd_m": 0.02, "points": {"C1": [[1, 2], [3, 4.12]], "gate 2": [[5, 6], [7, 8]]}}
    assert [one["metres"] for one in told] == [3.25, 1.0]


def test_a_file_without_scale_gets_one():
    told = tomllib.loads(edits.add_person(TEXT[TEXT.index("[cameras.C1]") :], "C1", 311, (8.5, 4.0), 1.83, 0.01))
    assert told["scale"] == {"people": [{"camera": "C1", "frame": 311, "at": [8.5, 4.0], "height_m": 1.83, "sd_m": 0.01}]}


def test_tables_written_in_one_line_are_continued_in_it():
    inline = '[scale]\nlengths = [{metres = 1, points = {}}]\n[cameras.a]\nvideo = "x"\n'
    told = tomllib.loads(edits.add_length(inline, 2.0, 0.02, MARKS))
    assert [one["metres"] for one in told["scale"]["lengths"]] == [1, 2.0]
    assert told["cameras"] == {"a": {"video": "x"}}


def test_an_entry_is_removed_by_its_number():
    text = edits.add_length(edits.add_length(TEXT, 1.0, 0.02, MARKS), 2.0, 0.02, MARKS)
    assert [one["metres"] for one in tomllib.loads(edits.remove_entry(text, "lengths", 1))["scale"]["lengths"]] == [2.0]
    with pytest.raises(InputError, match="3 is not there"):
        edits.remove_entry(text, "lengths", 3)


def test_a_camera_that_is_left_out_stays_as_comments():
    text = edits.remove_camera(TEXT, "gate 2")
    assert list(tomllib.loads(text)["cameras"]) == ["C1"]
    again = "\n".join(line.removeprefix("# ") for line in text.splitlines() if "Left out" not in line and "What" not in line)
    assert tomllib.loads(again)["cameras"]["gate 2"] == {"video": "b.mp4"}


@pytest.mark.parametrize("before", [edits.set_world_points(TEXT, "a.csv"), f'{TEXT}\n[world]\ncamera = "C1"\n', ""])
def test_a_world_frame_replaces_the_one_before(before):
    assert tomllib.loads(edits.set_world_points(before, "b.csv"))["world"] == {"points": "b.csv"}


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


def test_what_would_be_no_scene_is_not_written(session):
    path, before = session.scene_file, session.scene_file.read_text()
    version = edits.version_of(path)
    for wrong in (before + "\n[scale]\n", edits.add_length(before, 1.0, 0.02, {"C1": MARKS["C1"], "C9": MARKS["C1"]})):
        with pytest.raises(InputError):
            edits.save_scene(path, wrong)
    assert (path.read_text(), edits.version_of(path)) == (before, version)


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


def test_lines_stay_when_the_frame_is_set_anew_but_for_those_of_its_heading():
    post, axis = {"C1": [(1.0, 2.0), (1.5, 90.0)]}, {"C1": [(10.0, 2.0), (90.0, 3.0)]}
    text = edits.add_line(edits.add_line(TEXT, "vertical", post), "x", axis)
    placed = tomllib.loads(edits.set_world_points(text, "a.csv"))["world"]
    assert placed == {"points": "a.csv", "lines": [{"direction": "vertical", "points": {"C1": [[1, 2], [1.5, 90]]}}]}
    assert "world" not in tomllib.loads(edits.remove_entry(edits.remove_entry(text, "lines", 2), "lines", 1))


def test_a_file_that_was_broken_or_written_otherwise_meanwhile_is_left_alone():
    """Somebody may edit it beside the page: what cannot be continued is told with where to correct it."""
    with pytest.raises(InputError, match=r"the scene file is not TOML: .*: correct it in an editor first"):
        edits.add_length("[scale\n", 1.0, 0.02, MARKS)
    with pytest.raises(InputError, match=r"\[scale\] lengths is no list of tables: write \[\[scale\.lengths\]\]"):
        edits.add_length("[scale]\nlengths = 3\n", 1.0, 0.02, MARKS)
    with pytest.raises(InputError, match=r"\[cameras\.C1\] exclude is no list: correct it in an editor first"):
        edits.add_excluded(TEXT.replace('"a.mp4"  # north', '"a.mp4"\nexclude = 3'), "C1", "exclude", [1.0, 2.0])
