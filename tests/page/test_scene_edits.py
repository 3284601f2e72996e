"""Acts as lines of the scene file."""

import tomllib

import pytest

from passerby.common.errors import InputError
from passerby.interchange.world_files import read_known_points
from passerby.page.scene_edits import (
    GroundClick,
    add_excluded,
    add_identities,
    add_length,
    add_line,
    add_not_a_person,
    add_person,
    remove_camera,
    remove_entry,
    remove_excluded,
    remove_time_limit,
    save_scene,
    set_time_limit,
    set_world_points,
    version_of,
    write_points,
)

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
    once = add_length(TEXT, 3.25, 0.02, MARKS)
    assert all(line in once.splitlines() for line in TEXT.splitlines())
    told = tomllib.loads(add_length(once, 1.0, 0.01, MARKS))["scale"]["lengths"]
    assert told[0] == {"metres": 3.25, "sd_m": 0.02, "points": {"C1": [[1, 2], [3, 4.12]], "gate 2": [[5, 6], [7, 8]]}}
    assert [one["metres"] for one in told] == [3.25, 1.0]


def test_a_file_without_scale_gets_one():
    told = tomllib.loads(
        add_person(TEXT.partition("[cameras.C1]")[2].join(["[cameras.C1]", ""]), "C1", 311, (8.5, 4.0), 1.83, 0.01)
    )
    assert told["scale"] == {"people": [{"camera": "C1", "frame": 311, "at": [8.5, 4.0], "height_m": 1.83, "sd_m": 0.01}]}


def test_tables_written_in_one_line_are_continued_in_it():
    inline = '[scale]\nlengths = [{metres = 1, points = {}}]\n[cameras.a]\nvideo = "x"\n'
    told = tomllib.loads(add_length(inline, 2.0, 0.02, MARKS))
    assert [one["metres"] for one in told["scale"]["lengths"]] == [1, 2.0]
    assert told["cameras"] == {"a": {"video": "x"}}


def test_an_entry_is_removed_by_its_number():
    text = add_length(add_length(TEXT, 1.0, 0.02, MARKS), 2.0, 0.02, MARKS)
    assert [one["metres"] for one in tomllib.loads(remove_entry(text, "lengths", 1))["scale"]["lengths"]] == [2.0]
    with pytest.raises(InputError, match="3 is not there"):
        remove_entry(text, "lengths", 3)


def test_a_camera_that_is_left_out_stays_as_comments():
    text = remove_camera(TEXT, "gate 2")
    assert list(tomllib.loads(text)["cameras"]) == ["C1"]
    again = "\n".join(line.removeprefix("# ") for line in text.splitlines() if "Left out" not in line and "What" not in line)
    assert tomllib.loads(again)["cameras"]["gate 2"] == {"video": "b.mp4"}


def test_a_world_frame_replaces_the_one_before():
    text = set_world_points(set_world_points(TEXT, "a.csv"), "b.csv")
    assert tomllib.loads(text)["world"] == {"points": "b.csv"}
    assert tomllib.loads(set_world_points(f'{TEXT}\n[world]\ncamera = "C1"\n', "b.csv"))["world"] == {"points": "b.csv"}


def test_clicks_on_the_ground_are_read_as_known_points(tmp_path):
    clicks = [GroundClick("origin", "C1", (10.25, 20.0), 0.0), GroundClick("x axis", 'gate "2", b', (30.0, 40.5), 7.5)]
    name = write_points(tmp_path, clicks)
    assert write_points(tmp_path, clicks) == name
    found = read_known_points(tmp_path / name)
    assert [(one.name, one.xyz.tolist(), dict(one.pixels)) for one in found] == [
        ("origin", [0, 0, 0], {"C1": (10.25, 20.0)}),
        ("x axis", [7.5, 0, 0], {'gate "2", b': (30.0, 40.5)}),
    ]


def test_what_would_be_no_scene_is_not_written(session):
    path, before = session.scene_file, session.scene_file.read_text()
    version = version_of(path)
    for wrong in (before + "\n[scale]\n", add_length(before, 1.0, 0.02, {"C1": MARKS["C1"], "C9": MARKS["C1"]})):
        with pytest.raises(InputError):
            save_scene(path, wrong)
    assert (path.read_text(), version_of(path)) == (before, version)


def test_a_region_and_a_span_are_added_to_a_camera_and_removed_again():
    corners = [(1.0, 2.0), (3.126, 4.0), (5.0, 6.0)]
    text = add_excluded(add_excluded(TEXT, "gate 2", "exclude", corners), "gate 2", "exclude", corners[::-1])
    text = add_excluded(text, "gate 2", "exclude_s", (1.5, 2.0))
    assert all(line in text.splitlines() for line in TEXT.splitlines())
    camera = tomllib.loads(text)["cameras"]["gate 2"]
    assert camera["exclude"][0] == [[1, 2], [3.13, 4], [5, 6]]
    assert camera["exclude_s"] == [[1.5, 2.0]]
    once = remove_excluded(text, "gate 2", "exclude", 1)
    assert tomllib.loads(once)["cameras"]["gate 2"]["exclude"] == [[[5, 6], [3.13, 4], [1, 2]]]
    assert tomllib.loads(remove_excluded(remove_excluded(once, "gate 2", "exclude", 1), "gate 2", "exclude_s", 1)) == (
        tomllib.loads(TEXT)
    )
    with pytest.raises(InputError, match=r"exclude 3 is not there: it has 2"):
        remove_excluded(text, "gate 2", "exclude", 3)
    with pytest.raises(InputError, match=r"\[cameras.gate\] is not there"):
        add_excluded(TEXT, "gate", "exclude", corners)


def test_identities_are_corrected_and_the_corrections_removed():
    boxes = [("C1", 31, (8.5, 4.0)), ("gate 2", 40, (1.0, 2.125))]
    text = add_identities(add_identities(TEXT, "same", boxes), "different", boxes)
    text = add_not_a_person(add_not_a_person(text, *boxes[0]), *boxes[1])
    assert all(line in text.splitlines() for line in TEXT.splitlines())
    first, second = {"camera": "C1", "frame": 31, "at": [8.5, 4.0]}, {"camera": "gate 2", "frame": 40, "at": [1.0, 2.12]}
    both = [{"boxes": [first, second]}]
    assert tomllib.loads(text)["association"] == {"same": both, "different": both, "not_people": [first, second]}
    text = remove_entry(remove_entry(text, "same", 1), "not_people", 1)
    assert tomllib.loads(text)["association"] == {"different": both, "not_people": [second]}
    with pytest.raises(InputError, match=r"\[\[association.same\]\] 1 is not there"):
        remove_entry(text, "same", 1)


def test_corrections_join_an_association_table_that_is_there():
    text = add_not_a_person('[association]\nmode = "trajectory"  # no looks\n' + TEXT, "C1", 3, (1.0, 2.0))
    assert tomllib.loads(text)["association"] == {
        "mode": "trajectory",
        "not_people": [{"camera": "C1", "frame": 3, "at": [1, 2]}],
    }
    assert "# no looks" in text


def test_lines_are_marked_and_stay_when_the_frame_is_set_anew():
    post, axis = {"C1": [(1.0, 2.0), (1.5, 90.0)]}, {"C1": [(10.0, 2.0), (90.0, 3.0)]}
    text = add_line(add_line(TEXT, "vertical", post), "x", axis)
    told = tomllib.loads(text)["world"]["lines"]
    assert [one["direction"] for one in told] == ["vertical", "x"]
    assert told[0]["points"] == {"C1": [[1, 2], [1.5, 90]]}
    placed = tomllib.loads(set_world_points(text, "a.csv"))["world"]
    assert placed == {"points": "a.csv", "lines": told[:1]}
    alone = remove_entry(remove_entry(text, "lines", 2), "lines", 1)
    assert "world" not in tomllib.loads(alone)


def test_a_part_of_a_recording_is_kept_and_all_of_it_again():
    once = set_time_limit(TEXT, "gate 2", "until_s", 62.0)
    assert all(line in once.splitlines() for line in TEXT.splitlines())
    both = set_time_limit(set_time_limit(once, "gate 2", "until_s", 61.123), "gate 2", "from_s", 3)
    assert tomllib.loads(both)["cameras"]["gate 2"] == {"video": "b.mp4", "until_s": 61.12, "from_s": 3.0}
    assert remove_time_limit(once, "gate 2", "until_s") == TEXT
    with pytest.raises(InputError, match=r"from_s is not there"):
        remove_time_limit(once, "gate 2", "from_s")
    with pytest.raises(InputError, match=r"\[cameras\.C9\] is not there"):
        set_time_limit(TEXT, "C9", "from_s", 1.0)


def test_a_file_that_was_broken_or_written_otherwise_meanwhile_is_left_alone():
    """Somebody may edit it beside the page: what cannot be continued is told with where to correct it."""
    with pytest.raises(InputError, match=r"the scene file is not TOML: .*: correct it in an editor first"):
        add_length("[scale\n", 1.0, 0.02, MARKS)
    with pytest.raises(InputError, match=r"\[scale\] lengths is no list of tables: write \[\[scale\.lengths\]\]"):
        add_length("[scale]\nlengths = 3\n", 1.0, 0.02, MARKS)
    with pytest.raises(InputError, match=r"\[cameras\.C1\] exclude is no list: correct it in an editor first"):
        add_excluded(TEXT.replace('"a.mp4"  # north', '"a.mp4"\nexclude = 3'), "C1", "exclude", [1.0, 2.0])


def test_a_world_in_an_empty_file_stands_alone():
    assert set_world_points("", "points.csv") == '[world]\npoints = "points.csv"\n'
