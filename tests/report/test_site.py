"""The report of many cameras: a page, and files beside it that it loads when they are asked for."""

import errno
import json
import re
from itertools import combinations

import numpy as np
import pytest

from passerby.calibration.writing import write_calibration
from passerby.common.errors import InputError
from passerby.core.overlap import Shared
from passerby.findings.finding import doubt
from passerby.interchange.output_folder import report_files, report_folder
from passerby.report import page as page_module
from passerby.report.distances import MOST_TO_MEASURE, TAPE_M, distances_of, distances_to_measure
from passerby.report.page import write_report
from passerby.report.parts import Parts
from passerby.report.seen import EMBEDDED_CAMERAS, MOST_NEIGHBOURS, ZONE_CAMERAS, find_seen, neighbours_of, zones_of
from passerby.report.view_graph import links_of, weakest_links
from support.report.pages import Page, named, with_figures
from support.report.sites import site

MANY = EMBEDDED_CAMERAS + 10
LOST = "cam-007"


@pytest.fixture(scope="session")
def contents():
    few = doubt("few_observations", "cam-010", agreeing=3)
    groups = [{"group": 2, "folder": "groups/2", "verdict": "accepted", "registered": 2, "cameras": ["gate-1", "gate-2"]}]
    return site(MANY, problems=[few], lost=[LOST], groups=groups)


@pytest.fixture(scope="session")
def other():
    return site(MANY, seconds=6, seed=1)


@pytest.fixture(scope="session")
def written(contents, tmp_path_factory):
    path = tmp_path_factory.mktemp("site") / "report.html"
    write_report(contents, path)
    return path


@pytest.fixture
def page(written):
    return Page(written.read_text(encoding="utf-8"))


def parts_of(path):
    """The folder of files that a page names."""
    named = re.search('data-parts="([^"]+)"', path.read_text(encoding="utf-8"))
    return path.parent / named[1]


def value_of(path):
    """What a file hands over to the page."""
    told = re.fullmatch(r"passerbyPart\(\"([a-z0-9-]+)\",(.*)\);\n", path.read_text(encoding="utf-8"), re.DOTALL)
    assert told[1] == path.stem
    return json.loads(told[2])


@pytest.mark.slow
def test_fifty_cameras_are_one_file_and_more_have_files_beside_the_page(tmp_path, written):
    few = tmp_path / "report.html"
    write_report(site(EMBEDDED_CAMERAS, seconds=4), few)
    assert [path.name for path in tmp_path.iterdir()] == ["report.html"]
    assert "plotly" in few.read_text(encoding="utf-8")
    assert sorted(path.name for path in written.parent.iterdir()) == ["report.html", "report_files"]
    assert [path.name for path in report_folder(written).iterdir()] == [parts_of(written).name]


def test_there_is_a_file_for_each_camera_and_each_plot(written, page):
    plots = {told["data-part"] for _, told in page.elements if "data-part" in told}
    assert plots >= {"rig-above", "rig-space", "timeline-plot", "heights-plot"}
    cameras = {f"camera-{place}" for place in range(MANY)}
    assert {path.stem for path in parts_of(written).iterdir()} == cameras | plots | {"plotly"}
    links = {told["href"] for tag, told in page.elements if tag == "a" and told.get("href", "").startswith("#camera=")}
    assert links == {f"#camera={place}" for place in range(MANY)}


def test_a_cameras_file_has_its_panel_and_no_other(written, contents):
    for place in (0, 9, 33):
        html = value_of(parts_of(written) / f"camera-{place}.js")["html"]
        panels = re.findall(r'<article class="view" aria-label="Camera ([^"]+)"', html)
        assert panels == [contents.rig.names[place]]
        assert "camera-picture" in html
    assert "only 3 supporting observations" in value_of(parts_of(written) / "camera-9.js")["html"]
    assert "not registered" in value_of(parts_of(written) / "camera-6.js")["html"]


@pytest.mark.slow
def test_the_same_contents_give_the_same_bytes_under_the_same_names(contents, written, tmp_path):
    again = tmp_path / "report.html"
    write_report(contents, again)
    assert again.read_bytes() == written.read_bytes()
    assert parts_of(again).name == parts_of(written).name
    for path in parts_of(written).iterdir():
        assert (parts_of(again) / path.name).read_bytes() == path.read_bytes()


@pytest.mark.slow
def test_a_page_under_another_name_has_a_folder_of_that_name(contents, tmp_path):
    write_report(contents, tmp_path / "elsewhere.html")
    assert sorted(path.name for path in tmp_path.iterdir()) == ["elsewhere.html", "elsewhere_files"]
    assert parts_of(tmp_path / "elsewhere.html").parent.name == "elsewhere_files"


@pytest.mark.slow
def test_the_page_grows_by_little_for_a_camera(written, tmp_path):
    more = tmp_path / "report.html"
    write_report(site(2 * MANY), more)
    # A thousand cameras stay far below 20 MB.
    assert more.stat().st_size - written.stat().st_size < 4000 * MANY


@pytest.mark.slow
def test_a_new_report_takes_the_place_of_the_old_one_and_of_its_files(contents, other, tmp_path):
    path = tmp_path / "report.html"
    write_report(contents, path)
    first = parts_of(path)
    own = report_folder(path) / "notes.txt"
    own.write_text("mine")
    write_report(other, path)
    assert parts_of(path) != first
    assert not first.exists()
    write_report(site(4, seconds=4), path)
    assert report_files(path) == [path]
    assert [one.name for one in report_folder(path).iterdir()] == ["notes.txt"]


@pytest.mark.slow
@pytest.mark.parametrize("when", ["files", "page"])
def test_a_disk_that_is_full_leaves_the_old_report_whole(contents, other, tmp_path, monkeypatch, when):
    path = tmp_path / "report.html"
    write_report(contents, path)
    before = {one: one.read_bytes() for one in report_files(path)}
    full = OSError(errno.ENOSPC, "No space left on device")

    def fail(*_):
        raise full if when == "files" else InputError(f"{path}: cannot be written")

    monkeypatch.setattr(*((Parts, "place") if when == "files" else (page_module, "write_text")), fail)
    with pytest.raises(InputError, match="cannot be written"):
        write_report(other, path)
    assert {one: one.read_bytes() for one in before} == before
    monkeypatch.undo()
    assert not list(tmp_path.glob(".*"))
    write_report(contents, path)
    assert set(report_files(path)) == set(before)


@pytest.mark.slow
def test_a_damaged_file_is_put_right_by_writing_the_report_again(contents, tmp_path):
    path = tmp_path / "report.html"
    write_report(contents, path)
    damaged = parts_of(path) / "camera-3.js"
    good = damaged.read_bytes()
    damaged.write_bytes(good[:100])
    (parts_of(path) / "camera-4.js").unlink()
    write_report(contents, path)
    assert damaged.read_bytes() == good
    assert (parts_of(path) / "camera-4.js").is_file()


def test_a_new_calibration_takes_an_earlier_reports_files_along(calibrated, contents, tmp_path):
    path = tmp_path / "report.html"
    write_calibration(calibrated[0], tmp_path, report=False)
    write_report(contents, path)
    (report_folder(path) / "notes.txt").write_text("mine")
    write_calibration(calibrated[0], tmp_path, report=False)
    assert report_files(path) == []
    assert [one.name for one in report_folder(path).iterdir()] == ["notes.txt"]
    write_report(contents, path)
    (report_folder(path) / "notes.txt").unlink()
    write_calibration(calibrated[0], tmp_path)
    assert path.is_file()
    assert not report_folder(path).exists()


@pytest.mark.slow
def test_names_are_data_in_every_file(contents, tmp_path):
    hostile = ["</script><script>alert(1)</script>", "\"'><img src=x onerror=alert(2)>", "a/../b", "Küche Ⅲ 🎥"]
    path = tmp_path / "report.html"
    write_report(named(contents, [*hostile, *contents.rig.names[len(hostile) :]]), path)
    page = Page(path.read_text(encoding="utf-8"))
    assert len([told for told, _ in page.scripts if told.get("type") != "application/json"]) == 2
    assert not any(name.startswith("on") for _, told in page.elements for name in told)
    panel = Page(value_of(parts_of(path) / "camera-1.js")["html"])
    assert not any(name.startswith("on") for _, told in panel.elements for name in told)
    assert not [tag for tag, _ in panel.elements if tag in ("img", "script")]
    assert set(hostile) <= {row["Camera"] for row in page.rows("cameras-table")}


def test_the_list_begins_with_what_is_wrong_and_ends_with_other_groups(page):
    rows = page.rows("cameras-table")
    assert [(row["Camera"], row["State"]) for row in rows[:3]] == [
        (LOST, "no pose"), ("cam-010", "problem"), ("cam-001", "good"),
    ]  # fmt: skip
    assert rows[0]["What is wrong"] == "Could not be connected to other cameras."
    assert rows[1]["What is wrong"] == "Camera cam-010 has only 3 supporting observations."
    assert [(row["Camera"], row["State"]) for row in rows[-2:]] == [("gate-1", "other group"), ("gate-2", "other group")]
    assert len(rows) == MANY + 2
    links = [told["href"] for tag, told in page.elements if tag == "a" and told.get("href", "").startswith("groups/")]
    assert links.count("groups/2/report.html") == 3  # in the summary, and of both cameras


def test_zones_are_neighbours_and_no_larger_than_can_be_read():
    contents = site(100, seconds=4, lost=[LOST])
    zones = zones_of(contents)
    assert LOST not in zones
    assert len(zones) == 99
    sizes = np.bincount(list(zones.values()))[1:]
    assert sizes.min() > ZONE_CAMERAS / 4
    assert sizes.max() <= ZONE_CAMERAS
    centre = {camera.name: camera.centre[:2] for camera in contents.rig.posed()}
    spread = [
        np.ptp([centre[name] for name in zones if zones[name] == zone], axis=0).max() for zone in range(1, len(sizes) + 1)
    ]
    assert max(spread) < 0.6 * np.ptp(list(centre.values()), axis=0).max()


def test_groups_that_the_scene_states_are_the_zones():
    names = [f"cam-{number:03d}" for number in range(1, MANY + 1)]
    contents = site(MANY, seconds=4, stated=[names[:20], names[10:40], names[40:]])
    zones = zones_of(contents)
    assert [zones[name] for name in (names[0], names[15], names[30], names[50])] == [1, 1, 2, 3]


def test_what_cameras_share_is_the_same_without_looking_at_all_pairs(contents):
    seen = find_seen(contents)
    looks = {name: contents.observations[name].boxes for name in contents.rig.names}
    sightings = {name: set(zip(one.frame.tolist(), one.identity.tolist(), strict=True)) for name, one in looks.items()}
    for first, second in combinations(contents.rig.names, 2):
        both = sightings[first] & sightings[second]
        expected = Shared(len({who for _, who in both}), len(both))
        assert seen.shared.get((first, second), Shared(0, 0)) == expected
    assert len(seen.shared) < MANY * (MANY - 1) / 8


def test_a_pair_that_a_stage_tells_of_is_a_link_although_it_shares_nobody(contents):
    names = contents.rig.names
    pair = {"cameras": [names[-1], names[0]], "route": "ground", "inliers": 5, "matches": 10, "support": 1.0}
    links = {(one.first, one.second): one for one in links_of(with_figures(contents, pairs=[pair]), find_seen(contents))}
    told = links[names[0], names[-1]]
    assert (told.shared, told.word) == (Shared(0, 0), "fair")
    assert list(links) == sorted(links, key=lambda pair: [names.index(name) for name in pair])


def test_the_weakest_pairs_come_first(contents):
    links = weakest_links(links_of(contents, find_seen(contents)))
    assert len(links) > 20
    assert all(link.used for link in links)
    assert [link.confidence for link in links] == sorted(link.confidence for link in links)


def test_the_distances_that_are_listed_are_the_best_to_measure(contents):
    found, every = distances_to_measure(contents), distances_of(contents)
    within = sorted((one.metres for one in every if one.metres <= TAPE_M), reverse=True)
    assert [one.metres for one in found] == pytest.approx(within[:MOST_TO_MEASURE])
    all_of_them = distances_to_measure(contents, len(every))
    beyond = [one.metres for one in all_of_them[len(within) :]]
    assert len(all_of_them) == len(every)
    assert beyond == pytest.approx(sorted(one.metres for one in every if one.metres > TAPE_M))


def test_neighbours_share_most_and_have_a_pose(contents):
    seen = find_seen(contents)
    near = neighbours_of(contents.rig, seen)
    assert not any(LOST in names for names in near.values())
    assert set(near["cam-001"]) >= {"cam-002", "cam-003", "cam-004"}  # of the same hall
    for name, names in near.items():
        shared = [max(seen.shared.get(pair, Shared(0, 0)).sightings for pair in ((name, one), (one, name))) for one in names]
        assert shared == sorted(shared, reverse=True)
        assert len(names) <= MOST_NEIGHBOURS
        assert 0 not in shared
